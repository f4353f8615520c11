"""The period of a system from its response alone: the spacing of the lines, refined with all modes together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Integers
from floquid._checks import Rebuilt, input_error, positive, wrong_value
from floquid.core import PeriodicModel, Record
from floquid.errors import IdentificationError
from floquid.findings import Finding, note, texts, warning
from floquid.fit import ROUNDS, SIGNIFICANT
from floquid.periodic.least_squares import Block, ModeParameters, RecordBlock, Solution, chosen_bands, noise_left, solve
from floquid.periodic.period._fse import averaged, entries_of, grouped, model_at
from floquid.periodic.period._fundamental_candidates import OrbitLines, Spacing, orbit_of, spacings_of
from floquid.periodic.period._spectral_lines import Lines, beside, find_lines, raw_blocks, with_noise_left

CERTAIN = float(np.log(1e2))  # the odds of a fundamental against chance from which on it counts as seen, as a logarithm
DISTINCT = float(np.log(10.0))  # the odds of a fundamental against another one


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodCandidate:
    """A period that was considered.

    Parameters
    ----------
    period, period_std
        By the lines alone [s].
    families
        Modes that it makes of the lines.
    spacings
        Lines that are harmonics of another one.
    tones
        Undamped lines at multiples of half the fundamental.
    evidence
        The logarithm of its odds against lines that have nothing to do with one another.
    certainty
        The same from frequencies alone: what does not rest on equal decays.
    """

    period: float
    period_std: float
    families: int
    spacings: int
    tones: int
    evidence: float
    certainty: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeriodEstimate(Rebuilt):
    """Period of a response, estimated from itself.

    Parameters
    ----------
    period, period_std
        The period and its standard deviation [s]; None where the record cannot tell it.
    told
        Whether the record tells it.
    findings
        Why, or why not.
    candidates
        Periods considered, the one with the highest odds first.
    model
        The periodic model fitted with it; None where the record cannot tell it, or an orbit alone does.
    orbit
        The lines that do not decay where they alone tell the period; None elsewhere.
    lines, undamped
        The lines that decay, and those that do not: tones of a forced response (lines,) [1/s].
    """

    period: float | None
    period_std: float | None
    told: bool
    findings: tuple[Finding, ...]
    candidates: tuple[PeriodCandidate, ...]
    model: PeriodicModel | None
    lines: Complexes
    undamped: Complexes
    orbit: OrbitLines | None = None

    def __post_init__(self) -> None:
        self._freeze(dtype=np.complex128, lines=("lines",), undamped=("lines",))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why, or why not, a sentence each."""
        return texts(self.findings)

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """The period's interval [s] at a level of confidence.

        Raises InputError where `level` is not between 0 and 1; IdentificationError where the record does not tell the
        period.
        """
        from scipy.special import ndtri

        if not 0.0 < level < 1.0:
            raise wrong_value("level", "PeriodEstimate.interval", "lie between 0 and 1", level, "As 0.95.")
        if self.period is None or self.period_std is None:
            raise IdentificationError(f"There is no interval: the record does not tell the period. {self.reasons[-1]}")
        half = float(ndtri(0.5 + 0.5 * level)) * self.period_std
        return self.period - half, self.period + half


def estimate_period(
    records: Sequence[Record],
    *,
    longest: float | None = None,
    shortest: float | None = None,
    report: Callable[[str], None] = lambda _: None,
) -> PeriodEstimate:
    r"""The period of a system from its free response alone.

    .. math:: y(t) = \sum_r \sum_m B_{r,m}\, e^{(\lambda_r + i m \omega)(t - t_0)}

    (Allen 2009, eq. 12): "one might be able to determine" ω "from a collection of identified eigenvalues" (section
    2.2.3). Lines of equal decay are spaced by multiples of ω, and so are their conjugates. Each spacing, and its half,
    third …, is judged by how well it explains all lines; then the period, the exponents, and all amplitudes over the
    harmonics seen and one beyond are fitted together, by maximum likelihood in white noise.

    The fundamental is the largest ω that divides all spacings seen: the half revolution of a shaft
    with two equal halves, as far as the response shows it. One spacing alone is no period, however clear: two modes
    of a constant system with the same damping look the same. Lines that do not decay are a steady response: a limit
    cycle, or that to a force. Where they are multiples of half the fundamental they speak for it; where the lines that
    decay tell nothing, their own fundamental is the period, or twice it where they are its odd multiples alone, as of
    an orbit that is half-wave symmetric, x(t + T) = -x(t).

    Returns the period with its deviation, or why the record does not tell it.

    Raises InputError where records do not belong together, or the bounds leave no period.

    Parameters
    ----------
    records
        One record, or one a hit on the same system, of equal channels. Their clocks are not looked at, except for the
        instant of phase zero that a constant period gives.
    longest, shortest
        Bounds of the period [s]; a quarter of the record, and two sampling intervals, where not given.
    report
        Is told of each stage.
    """
    longest, shortest = _bounds(records, longest, shortest)
    report("searching for lines")
    blocks = raw_blocks(records)
    lines = find_lines(blocks, shortened=True, report=report)
    damped, tones = lines.picked(~lines.undamped), lines.picked(lines.undamped)
    spacings = spacings_of(damped, tones, 2.0 * np.pi / longest, 2.0 * np.pi / shortest)
    findings, determined = _judgement(damped, tones, spacings)
    refined = None
    if determined:
        report("fitting the period")
        try:
            refined = _refined(records, blocks, damped, tones, spacings[0])
        except (IdentificationError, np.linalg.LinAlgError):
            determined, findings = False, (*findings, warning("period_lost"))
    if refined is not None:
        model, period_std = refined
        std = float(np.hypot(2.0 * np.pi * spacings[0].std / spacings[0].fundamental ** 2, period_std))
        if abs(model.period - 2.0 * np.pi / spacings[0].fundamental) > SIGNIFICANT * std:
            determined, findings, refined = False, (*findings, warning("period_differs")), None
    period, period_std = (None, None) if refined is None else (refined[0].period, refined[1])
    orbit = orbit_of(blocks, lines, 2.0 * np.pi / longest, 2.0 * np.pi / shortest)
    if orbit is not None:
        whole = 2.0 * np.pi / orbit.fundamental
        if period is None or period_std is None:
            period = whole / (2 if orbit.symmetric else 1)
            numbers = {"orbit": whole, "harmonics": orbit.harmonics, "symmetric": orbit.symmetric}
            findings, determined = (note("period_of_orbit", period=period, **numbers),), True
            period_std = period * orbit.std / orbit.fundamental
        else:
            halves = max(round(2.0 * whole / period), 1)
            agree = abs(2.0 * whole / halves - period) < SIGNIFICANT * period_std < 0.5 * period / halves
            snapped = 2.0 * whole / halves, 2.0 * whole / halves * orbit.std / orbit.fundamental
            period, period_std = (
                min((period, period_std), snapped, key=lambda candidate: candidate[1])
                if agree
                else (period, period_std)
            )
            orbit = None
    return PeriodEstimate(
        period=period,
        period_std=period_std,
        told=determined,
        findings=findings,
        candidates=tuple(_candidate(candidate) for candidate in spacings),
        model=None if refined is None else refined[0],
        lines=damped.exponents,
        undamped=tones.exponents,
        orbit=orbit,
    )


def _bounds(records: Sequence[Record], longest: float | None, shortest: float | None) -> tuple[float, float]:
    """The longest and shortest period looked at [s]."""
    if not len(records):
        raise input_error("records", "estimate_period", "hold a record", "is empty")
    least = 2.0 / min(record.sample_rate for record in records)
    most = 0.25 * max(record.duration for record in records)
    high = most if longest is None else positive(longest, "longest", "estimate_period", unit="s")
    low = least if shortest is None else positive(shortest, "shortest", "estimate_period", unit="s")
    low = max(low, least)
    if not low < high:
        must, got = "lie above `shortest` and two sampling intervals", f"{high:g} s is not above {low:g} s"
        raise input_error("longest", "estimate_period", must, got, "Widen the bounds, or take a longer record.")
    return high, low


def _judgement(lines: Lines, tones: Lines, spacings: list[Spacing]) -> tuple[tuple[Finding, ...], bool]:
    """Findings on whether the lines determine the period, and whether they do."""
    findings = []
    if len(tones.exponents):
        heard, on = np.abs(tones.exponents.imag) / (2.0 * np.pi), spacings[0].tones if spacings else 0
        findings.append(note("undamped_lines", frequencies=heard, on=on))
    if not spacings:
        return (*findings, warning("period_no_family" if len(lines.exponents) else "period_no_line")), False
    best = spacings[0]
    findings.append(
        note(
            "line_families",
            lines=len(lines.exponents),
            spacings=best.spacings,
            families=len(best.groups),
            frequency=best.fundamental / (2.0 * np.pi),
            odds=best.certainty / np.log(10.0),
        )
    )
    if best.certainty < CERTAIN:
        return (*findings, warning("period_one_spacing" if best.spacings == 1 else "period_by_chance")), False
    others = [spacing for spacing in spacings[1:] if spacing.partition != best.partition]
    if others and best.evidence - others[0].evidence < DISTINCT:
        return (*findings, warning("period_other", frequency=others[0].fundamental / (2.0 * np.pi))), False
    return tuple(findings), True


def _refined(
    records: Sequence[Record], raw: Sequence[RecordBlock], lines: Lines, tones: Lines, best: Spacing
) -> tuple[PeriodicModel, float]:
    """The model with the period free, and the deviation of the period [s]."""
    blocks = tuple(block.with_noise(lines.noise[block.rows, block.hit]) for block in raw)
    groups = grouped(lines, best.fundamental, best.std)
    average = averaged(lines, groups, best.fundamental, free=True)
    most = max(int(np.ceil(np.pi * min(r.sample_rate for r in records) / best.fundamental - 1e-6)) - 1, 0)
    entries = entries_of(groups, average).joined(_free(tones, best.fundamental)).joined(beside(best.fundamental))
    solution, bands = _grown(blocks, replace(entries, free_period=True), len(groups), most)
    blocks = with_noise_left(blocks, solution)
    solution = solve(blocks, solution.entries)
    entries, covariance, families = solution.entries, solution.covariance(), len(groups)
    decays, pairs = int((~entries.fixed).sum()), int((~entries.real[:families]).sum())
    kept = np.concatenate([np.arange(families), np.arange(decays, decays + pairs), [-1]])
    model = model_at(
        records,
        raw,
        entries.picked(range(families)),
        covariance[np.ix_(kept, kept)],
        entries.exponents[families:decays],
        bands[:families],
        noise_left(blocks, solution),
    )
    period_std = 2.0 * np.pi / entries.fundamental**2 * np.sqrt(covariance[-1, -1])
    return model, float(period_std)


def _free(tones: Lines, fundamental: float) -> ModeParameters:
    """Tones as entries of their own: nothing says at first that they are multiples of anything."""
    values = np.where(tones.real, tones.exponents.real, tones.exponents)
    return ModeParameters.made(values, (0, 0), fundamental, real=tones.real)


def _grown(blocks: Sequence[Block], entries: ModeParameters, families: int, most: int) -> tuple[Solution, Integers]:
    """The fit with one harmonic beyond each band of the families, and the bands that rise above the noise."""
    of_families = (np.arange(len(entries.bands)) < families)[:, None]
    rounds = 0
    while True:
        rounds += 1
        solution = solve(
            blocks, replace(entries, bands=np.where(of_families, entries.padded(1, most).bands, entries.bands))
        )
        chosen = np.where(of_families, chosen_bands(blocks, solution), entries.bands)
        low, high = np.minimum(chosen[:, 0], entries.bands[:, 0]), np.maximum(chosen[:, 1], entries.bands[:, 1])
        union = np.stack([low, high], axis=1)
        if rounds == ROUNDS or (union == entries.bands).all():
            return solution, union
        entries = replace(solution.entries, bands=union)


def _candidate(spacing: Spacing) -> PeriodCandidate:
    period = 2.0 * np.pi / spacing.fundamental
    return PeriodCandidate(
        period=period,
        period_std=period * spacing.std / spacing.fundamental,
        families=len(spacing.groups),
        spacings=spacing.spacings,
        tones=spacing.tones,
        evidence=spacing.evidence,
        certainty=spacing.certainty,
    )
