"""The Fourier series expansion as an identification: lines of the response as it is, grouped into families."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt, input_error, positive
from floquid.core import PeriodicModel, Provenance, Record
from floquid.errors import IdentificationError
from floquid.fit import DEVIATIONS, SURE, chi2_limit
from floquid.lti import AbstractIdentifier
from floquid.periodic.least_squares import ModeParameters, RecordBlock, linearise, model_of
from floquid.periodic.period._spectral_lines import Lines, after_phase_zero, beside, find_lines, lines_by, raw_blocks


@dataclass(frozen=True, slots=True)
class Group:
    """Lines of one mode: which, on which half of the plane, and at which harmonic; the strongest is the first."""

    lines: tuple[int, ...]
    signs: tuple[int, ...]
    harmonics: tuple[int, ...]
    half_turns: int | None = None  # κ where the multiplier is real, its lines being at (m + κ/2)ω; else None

    def joined(self, line: int, sign: int, harmonic: int) -> Group:
        """With one more line."""
        return Group((*self.lines, line), (*self.signs, sign), (*self.harmonics, harmonic), half_turns=self.half_turns)


@dataclass(frozen=True, slots=True)
class Average:
    """Modes from the lines of each, by least squares with the inverse covariance as weight."""

    exponents: Complexes
    """λ of each group on the branch of its strongest line; of a real multiplier the decay alone (groups,)."""
    fundamental: float
    covariance: Floats  # of the decays, of the frequencies of pairs, and of the fundamental where that was free
    misfit: float  # a chi-square of `degrees` degrees of freedom
    degrees: int
    log_volume: float
    """ln of √(|cov θ|/|cov lines|)/√(2π)^degrees: the density of the lines at the average, less the misfit."""


def grouped(lines: Lines, fundamental: float, std: float = 0.0) -> list[Group]:
    """Families of lines, the strongest first: each line with the family that it is nearest to at ω ± `std` [rad/s]."""
    limit = chi2_limit(2, SURE)
    groups: list[Group] = []
    for line in np.argsort(-lines.strength, kind="stable"):
        best, least = None, limit
        for place, group in enumerate(groups):
            for sign in (1, -1) if group.half_turns is None else (1,):
                harmonic, distance = _distance(lines, group.lines[0], int(line), sign, fundamental, std)
                if distance < least and harmonic not in group.harmonics:
                    best, least = (place, sign, harmonic), distance
        if best is None:
            half = _half_turns(lines, int(line), fundamental, std)
            groups.append(Group((int(line),), (1,), (0,), half_turns=half))
        else:
            groups[best[0]] = groups[best[0]].joined(int(line), best[1], best[2])
    return groups


def _half_turns(lines: Lines, line: int, fundamental: float, std: float) -> int | None:
    """κ where a line is at κω/2 within its deviation; else None."""
    value = lines.exponents[line].imag
    half = round(2.0 * value / fundamental)
    off = abs(value - 0.5 * half * fundamental)
    return half if off <= DEVIATIONS * float(np.hypot(lines.std[line].imag, 0.5 * half * std)) else None


def _distance(lines: Lines, seed: int, line: int, sign: int, fundamental: float, std: float) -> tuple[int, float]:
    """The harmonic that a line would be, and the chi-square of its distance from there."""
    n, cov = len(lines.exponents), lines.covariance
    first, second = lines.exponents[seed], lines.exponents[line]
    turns = round((sign * second.imag - first.imag) / fundamental)
    decay, turn = second.real - first.real, sign * second.imag - first.imag - turns * fundamental
    a = cov[seed, seed] + cov[line, line] - 2.0 * cov[seed, line]
    c = cov[n + seed, n + seed] + cov[n + line, n + line] - 2.0 * sign * cov[n + seed, n + line] + (turns * std) ** 2
    b = cov[seed, n + seed] + sign * cov[line, n + line] - sign * cov[seed, n + line] - cov[line, n + seed]
    determinant = a * c - b * b
    if not determinant > 0.0:
        return turns, np.inf
    return turns, float((c * decay * decay - 2.0 * b * decay * turn + a * turn * turn) / determinant)


def averaged(lines: Lines, groups: Sequence[Group], fundamental: float, *, free: bool) -> Average:
    """The exponent of each family, and the fundamental [rad/s] where it is `free`: found from all the spacings, too."""
    n, families = len(lines.exponents), len(groups)
    pairs = [place for place, group in enumerate(groups) if group.half_turns is None]
    design, known = np.zeros((2 * n, families + len(pairs))), np.zeros(2 * n)
    turns = np.zeros(2 * n)
    for place, group in enumerate(groups):
        for line, sign, harmonic in zip(group.lines, group.signs, group.harmonics, strict=True):
            design[line, place] = 1.0
            turns[n + line] = sign * harmonic + 0.5 * (group.half_turns or 0)
            if group.half_turns is None:
                design[n + line, families + pairs.index(place)] = sign
    if free:
        design = np.concatenate([design, turns[:, None]], axis=1)
    else:
        known = turns * fundamental
    seen = np.concatenate([lines.exponents.real, lines.exponents.imag]) - known
    kept = np.diag(lines.covariance) > 0
    # A line at rest says that its family is at rest there, exactly: no number of its own.
    scale = np.sqrt(np.diag(lines.covariance)[kept])
    white = np.linalg.cholesky(lines.covariance[np.ix_(kept, kept)] / np.outer(scale, scale))
    rows = np.linalg.solve(white, design[kept] / scale[:, None])
    data = np.linalg.solve(white, seen[kept] / scale)
    value, _, rank, sizes = np.linalg.lstsq(rows, data, rcond=1e-12)
    inverse = np.linalg.pinv(rows, rcond=1e-12)
    residual = data - rows @ value
    exponents = value[:families].astype(complex)
    exponents[pairs] += 1j * value[families : families + len(pairs)]
    degrees = int(kept.sum()) - int(rank)
    volume = -float(np.sum(np.log(sizes[:rank]))) - float(np.sum(np.log(np.diag(white)))) - float(np.sum(np.log(scale)))
    return Average(
        exponents=exponents,
        fundamental=float(value[-1]) if free else fundamental,
        covariance=inverse @ inverse.T,
        misfit=float(residual @ residual),
        degrees=degrees,
        log_volume=volume - 0.5 * degrees * float(np.log(2.0 * np.pi)),
    )


def entries_of(groups: Sequence[Group], average: Average) -> ModeParameters:
    """The families as entries of a fit, with the harmonics from the lowest to the highest seen."""
    half = [group.half_turns for group in groups]
    bands = [
        (min(group.harmonics) if k is None else -(k // 2) - k % 2, max(group.harmonics))
        for group, k in zip(groups, half, strict=True)
    ]
    return ModeParameters.made(
        average.exponents,
        bands,
        average.fundamental,
        real=[k is not None for k in half],
        offsets=[0.5 * (k or 0) for k in half],
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Family(Rebuilt):
    """Lines λ + imω of one mode, and their average.

    Parameters
    ----------
    exponent
        The average λ, on the branch of the strongest line [1/s].
    exponent_std
        Its deviation: of the real part the real part, of the imaginary part the imaginary one [1/s].
    lines
        The lines as they were found, on the upper half of the plane, the strongest first (lines,) [1/s].
    line_std
        Their deviations likewise (lines,) [1/s].
    harmonics
        m of each line (lines,).
    conjugated
        Whether it is the conjugate of a line that is the harmonic (lines,).
    """

    exponent: complex
    exponent_std: complex
    lines: Complexes
    line_std: Complexes
    harmonics: Integers
    conjugated: Mask

    def __post_init__(self) -> None:
        n = (len(self.lines),)
        self._freeze(dtype=np.complex128, lines=n, line_std=n)
        self._freeze(dtype=np.int64, harmonics=n)
        self._freeze(dtype=np.bool_, conjugated=n)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FSE(Rebuilt):
    """Result of the FSE method.

    Parameters
    ----------
    model
        The periodic model of the families.
    families
        The lines of each mode, strongest first.
    alone
        Lines that belong to no family (lines,) [1/s].
    undamped
        Pure tones, as far as the record tells: of a forced response, not of a mode (lines,) [1/s].
    misfit, degrees
        How far the lines are from families, a chi-square and its degrees of freedom.
    noise
        The deviation of what is left (channels, hits) [units of the channels].
    """

    model: PeriodicModel
    families: tuple[Family, ...]
    alone: Complexes
    undamped: Complexes
    misfit: float
    degrees: int
    noise: Floats

    def __post_init__(self) -> None:
        self._freeze(dtype=np.complex128, alone=("lines",), undamped=("lines",))
        self._freeze(noise=("channels", "hits"))


def fse(
    records: Sequence[Record],
    *,
    period: float,
    identifier: AbstractIdentifier | None = None,
    order: int | None = None,
    least: int = 1,
) -> FSE:
    r"""The periodic model of records as they are, not lifted: an LTI system of many poles.

    .. math:: y(t) = \sum_r \sum_m B_{r,m}\, e^{(\lambda_r + i m \omega)(t - t_0)}

    (Allen 2009, eqs. 11-12.) Every line λ + imω is a pole of its own. Those of equal decay whose imaginary parts, or
    those of their conjugates, are whole multiples of ω apart, within their deviations, are a family; their average,
    with the inverse of the covariance of all lines as weight, is the exponent of the mode, on the branch of its
    strongest line. Amplitudes are the least squares at these averages, over the harmonics from the lowest to the
    highest line. `fit` enforces the spacing from the start, and then sees weaker harmonics too.

    Returns the model, with its covariance; the families; and the lines that belong to none.

    Raises InputError where `records` do not belong together, have missing samples that the identifier cannot do
    without, or `period` is not a period that the sampling shows; IdentificationError where no family rises above the
    noise.

    Parameters
    ----------
    records
        One record, or one a hit on the same system, of equal channels.
    period
        The period T [s], taken as exact.
    identifier
        What finds the poles: any identifier of `floquid.lti`. One that gives no covariance starts the least squares of
        its poles. None finds one line after another in the spectrum of what is left, each fitted with all others.
    order
        The number of poles that `identifier` is to find, conjugates one by one; None where it decides.
    least
        Lines that a family has at least; with 1 a line alone is a mode whose shape has one harmonic.
    """
    fundamental = 2.0 * np.pi / positive(period, "period", "fse", unit="s")
    if period * min(r.sample_rate for r in records) < 2.0:
        must = "be two sampling intervals or more"
        raise input_error("period", "fse", must, f"is {period:g} s", "Check the period and the sampling rate.")
    blocks = raw_blocks(records)
    lines = find_lines(blocks) if identifier is None else lines_by(identifier, records, blocks, order=order)
    damped = lines.picked(~lines.undamped)
    groups = grouped(damped, fundamental)
    alone = [line for group in groups if len(group.lines) < least for line in group.lines]
    damped, others = (
        damped.picked(np.setdiff1d(np.arange(len(damped.exponents)), alone)),
        damped.picked(np.array(alone, np.int64)),
    )
    if not len(damped.exponents):
        raise IdentificationError("Identification ended without a result: no family of lines rises above the noise.")
    groups = grouped(damped, fundamental)
    average = averaged(damped, groups, fundamental, free=False)
    entries, undamped = entries_of(groups, average), lines.exponents[lines.undamped]
    beside_them = np.concatenate([undamped, others.exponents])
    model = model_at(records, blocks, entries, average.covariance, beside_them, entries.bands, lines.noise)
    return FSE(
        model=model,
        families=tuple(families_of(damped, groups, average)),
        alone=others.exponents,
        undamped=undamped,
        misfit=average.misfit,
        degrees=average.degrees,
        noise=lines.noise,
    )


def model_at(
    records: Sequence[Record],
    raw: Sequence[RecordBlock],
    entries: ModeParameters,
    covariance: Floats,
    others: Complexes,
    bands: Integers,
    noise: Floats,
) -> PeriodicModel:
    """The periodic model of modes whose exponents and their covariance are known, its amplitudes by least squares."""
    omega = entries.fundamental
    both = entries.joined(ModeParameters.made(others, (0, 0), omega, real=others.imag == 0.0, fixed=True)).joined(
        beside(omega)
    )
    blocks = after_phase_zero(raw, records, 2.0 * np.pi / omega)
    blocks = tuple(block.with_noise(noise[block.rows, block.hit]) for block in blocks)
    scale = np.sqrt(np.diag(covariance))
    information = np.linalg.inv(covariance / np.outer(scale, scale)) / np.outer(scale, scale)
    solution = replace(linearise(blocks, both), information=information, gauss_newton=information)
    kept = np.concatenate([bands, both.bands[len(bands) :]])
    provenance = Provenance.merge(tuple(record.provenance for record in records))
    return model_of(blocks, solution, kept, channels=records[0].channels, provenance=provenance, most=None)


def families_of(lines: Lines, groups: list[Group], average: Average) -> list[Family]:
    """The families with their lines as they were found."""
    std = np.sqrt(np.diag(average.covariance))
    turns = iter(std[len(groups) :])
    made = []
    for place, group in enumerate(groups):
        places = np.array(group.lines)
        real = group.half_turns is not None
        value = complex(average.exponents[place]) + 0.5j * (group.half_turns or 0) * average.fundamental
        made.append(
            Family(
                exponent=value,
                exponent_std=complex(std[place], 0.0 if real else next(turns)),
                lines=lines.exponents[places],
                line_std=lines.std[places],
                harmonics=np.array(group.harmonics),
                conjugated=np.array(group.signs) < 0,
            )
        )
    return made
