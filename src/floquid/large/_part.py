"""A part of a record larger than memory, identified with all checks, against the modes of the whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core import PeriodicModel, Provenance, Record
from floquid.errors import FloquidError
from floquid.findings import texts
from floquid.fit import MISFIT, chi2_limit, filter_gain
from floquid.large._modes import Basis, Modes, Plan
from floquid.pipeline import CONFIDENT, Analysis, Settings, identify

CHANNELS = 16  # of the part at most: each mode is among the loudest in some of them
SAMPLES = 1e6  # of the part at most: with all checks they take some 5 s
FEWEST = 256  # periods of the part at least, as of the record
SECONDS = 10.0  # processor time of a search in the part [s]: where modes are right it takes one or two
GRID = 512  # frequencies at which the spectrum of the noise is averaged


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict of the checks of a part on the modes of the whole record.

    Parameters
    ----------
    passed
        True where the part passes its checks and has these modes; None where it shows none of them.
    failed
        True where the part was refused, or fails, or a mode that it should show is none there.
    reasons
        What speaks against the model, a sentence each.
    channels, cycles
        The size of the part.
    """

    passed: bool | None = None
    failed: bool = False
    reasons: tuple[str, ...] = ()
    channels: int = 0
    cycles: int = 0


def part_of(plan: Plan, loud: Floats, room: float) -> tuple[Integers, Record]:
    """Rows and record of the channels with the largest energies `loud` (channels, modes), in their first periods."""
    record, fewest = plan.record, FEWEST * plan.phases
    most = min(max(SAMPLES, fewest), room)
    count = int(min(CHANNELS, most // fewest))
    rows = np.sort(np.argsort(-(loud / loud.max(axis=0)).sum(axis=1), kind="stable")[:count])
    samples = slice(0, min(plan.cycles, int(most // (len(rows) * plan.phases))) * plan.phases)
    part = Record(
        values=np.concatenate([np.asarray(record.array[row : row + 1, samples], np.float64) for row in rows.tolist()]),
        sample_rate=record.sample_rate,
        channels=[record.channels[row] for row in rows],
        clock=plan.clock,
        start=record.start,
        provenance=Provenance(sources=(record.source,)),
    )
    return rows, part


def judged(
    part: Record,
    modes: Modes,
    exponents: Complexes,
    std: Complexes,
    noise: Floats,
    phases: int,
    false_alarm: float,
    report: Callable[[str], None],
) -> Verdict:
    """The verdict on the modes of a record by a `part` of it, with the `noise` of its channels (channels,)."""
    responses = (part.values / noise[:, None]).reshape(len(noise), -1, phases)
    shown = _shown(responses, modes, false_alarm)
    size = {"channels": part.n_channels, "cycles": responses.shape[1]}
    # Nothing is repaired, as in the sums; and a slow decay over a few of many periods is not refused as a random one.
    chosen = Settings(mode_false_alarm=false_alarm, repair=False, seconds=SECONDS)
    try:
        found = identify(part, chosen, report=lambda words: report(f"checking a part: {words}"))
    except FloquidError as error:
        refused = bool(shown.any())
        return Verdict(passed=False if refused else None, failed=refused, reasons=(str(error),), **size)
    ours, theirs = _unmatched(exponents, std, found.model, false_alarm)
    ours &= shown
    none_there, missing = exponents[ours], found.model.exponents[theirs]
    colour, coloured = _colour(found)
    reasons = [
        *(_none_there(value, found) for value in none_there),
        *found.reasons,
        *(_missing(value, modes.order) for value in missing),
        *colour,
        *(own for own in found.warnings if own not in found.reasons),
    ]
    failed = found.failed or bool(len(none_there))
    passed = found.passed and not (failed or len(missing) or coloured)
    return Verdict(passed=passed, failed=failed, reasons=tuple(reasons), **size)


def _shown(responses: Floats, modes: Modes, false_alarm: float) -> Mask:
    """True of modes without which responses (channels, cycles, phases) over their noise are not explained (modes,)."""
    basis = Basis.of(modes, responses.shape[1])
    sums = np.tensordot(basis.columns, responses, axes=(0, 1)).reshape(basis.columns.shape[1], -1)
    limits = [chi2_limit(sums.shape[1] * (1 if real else 2), false_alarm) for real in modes.real]
    return basis.rises(sums @ sums.T) > limits


def _unmatched(exponents: Complexes, std: Complexes, model: PeriodicModel, false_alarm: float) -> tuple[Mask, Mask]:
    r"""Modes of the record that the part has not (modes,), and modes that the part knows well and the record has not.

    .. math:: |\Delta|^2 / (s_{\Re}^2 + s_{\Im}^2), \qquad \Delta = \lambda_a - \lambda_b + i k \omega

    with s² the variances of both together is half of χ² of two degrees of freedom for one mode.
    """
    theirs = np.zeros(model.order, bool)
    if model.exponent_std is None:
        return np.zeros(len(exponents), bool), theirs
    values, spread = np.concatenate([exponents, exponents.conj()]), np.concatenate([std, std])
    gaps = np.subtract.outer(values, model.exponents)
    turns = np.rint(gaps.imag / model.fundamental)
    variances = np.add.outer(_variance(spread), _variance(model.exponent_std))
    limit = 0.5 * chi2_limit(2, false_alarm)
    near = np.abs(gaps - 1j * model.fundamental * turns) ** 2 < limit * variances
    own = model.exponent_std
    upper = list(model.upper_modes)
    theirs[upper] = np.maximum(own.real, own.imag)[upper] <= CONFIDENT * model.fundamental
    theirs &= ~near.any(axis=0)
    ours = np.logical_not(near[: len(exponents)].any(axis=1))
    return np.asarray(ours, np.bool_), theirs


def _variance(std: Complexes) -> Floats:
    """The variance of both parts together; the imaginary part of a real multiplier counts as the real one."""
    return std.real**2 + np.where(std.imag > 0.0, std.imag, std.real) ** 2


def _none_there(exponent: complex, part: Analysis) -> str:
    """A sentence on a mode that the part does not have."""
    steady = [own for own in part.findings if own.code in ("drift", "orbit_of_two_periods")]
    instead = " ".join(texts([*steady, *part.interference])) or "A drift, a tone or another period may pass for it."
    return f"The mode at {_hertz(exponent)} is none in the part that was checked, with all else alike. {instead}"


def _missing(exponent: complex, order: int) -> str:
    """A sentence on a mode that the part alone has."""
    return f"The part that was checked has a mode at {_hertz(exponent)} that was not found. Try `order={order + 2}`."


def _hertz(exponent: complex) -> str:
    return f"{abs(exponent) / (2.0 * np.pi):.4g} Hz"


def _colour(part: Analysis) -> tuple[tuple[str, ...], bool]:
    r"""A sentence on noise that is not white, and whether deviations are too far off by it.

    .. math:: \sum_{c,m} |B_{c,m}|^2 S_c(\omega_m) / \sigma_c^2 \Big/ \sum_{c,m} |B_{c,m}|^2

    is the factor of a variance, with B over the noise σ of its channel and S the spectrum at the lines of the mode.
    """
    taps = part.decay.fit.whitening if part.decay is not None else None
    if taps is None:
        return (), False
    model, rate = part.model, part.records[0].sample_rate
    delays = np.arange(taps.shape[1]) / rate
    lines = model.exponents.imag[:, None] + model.fundamental * model.harmonics
    at, every = (
        np.abs(filter_gain(taps, delays, np.asarray(1j * frequencies, np.complex128))) ** -2.0
        for frequencies in (lines, 2.0 * np.pi * rate * np.linspace(0.0, 0.5, GRID))
    )
    weights = np.abs(model.coefficients[:, :, 0] / part.noise[:, :1]).transpose(1, 0, 2) ** 2
    share = np.sum(weights * at / every.mean(axis=1)[:, None, None], axis=(0, 2)) / np.sum(weights, axis=(0, 2))
    low, high = np.sqrt(share.min()), np.sqrt(share.max())
    words = f"The noise is not white: true deviations are about {low:.2g} to {high:.2g} times those given."
    return (words,), bool(high > MISFIT or low < 1.0 / MISFIT)
