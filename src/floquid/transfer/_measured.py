"""Harmonic transfer functions as measured: what they hold, and by a response to inputs that repeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt
from floquid.core import Channel
from floquid.errors import IdentificationError
from floquid.findings import Finding, Severity, note, texts, warning
from floquid.fit import ROUNDING, SURE
from floquid.inputs import Samples, TransferFunctions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredTransfer(Rebuilt):
    """Harmonic transfer functions measured line by line, with deviations, and how far they can be trusted.

    They are those of samples: the hold of the input and what it folds are in them. `DrivenAnalysis.transfer` with
    `sampled=True` gives the same of a model.

    Parameters
    ----------
    transfer
        G with its deviations; NaN where an input has no line, or no power.
    period
        That of the system [s].
    method
        "repeats", "polynomials" or "chirps", which gives no deviations.
    noise
        The deviation of a line of the response, as an amplitude (outputs, frequencies) [units of the outputs].
    coherence
        The share of the power of the response at those frequencies that the inputs explain (outputs, frequencies).
    nonlinear
        The power where a linear system has none, over that of the noise (outputs,): 1 of a linear one; NaN where the
        inputs leave no such lines, or the transient is in them.
    echoes, begins
        What one unit in the spectrum of the response of each record adds to G (records, inputs, frequencies), and the
        times at which the records begin (records,) [s]: what rings there is fitted with them. Of repeats alone.
    findings
        What was done, and what a reader must know.
    """

    kind: ClassVar[str] = "measured"  # by it the functions for a result are found
    transfer: TransferFunctions
    period: float
    method: str
    noise: Floats
    coherence: Floats
    nonlinear: Floats
    echoes: Complexes
    begins: Floats
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        lines = ("outputs", "frequencies")
        self._freeze(finite=False, noise=lines, coherence=lines, nonlinear=("outputs",), begins=("records",))
        self._freeze(dtype=np.complex128, finite=False, echoes=("records", "inputs", "frequencies"))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to a reader, a sentence each."""
        return (*texts(self.findings, Severity.FAILURE), *texts(self.findings, Severity.WARNING))


def measured_of(
    samples: Samples,
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    lines: tuple[Integers, int],
    harmonics: Integers,
    g: tuple[Complexes, Complexes | None],
    **rest: Any,
) -> MeasuredTransfer:
    """G of samples and its deviations at some lines of a spectrum, with the rest of what was measured."""
    places, count = lines
    transfer = TransferFunctions(
        frequencies_hz=places / (count * samples.step),
        harmonics=harmonics,
        values=g[0],
        std=g[1],
        outputs=channels[0],
        inputs=channels[1],
        step=samples.step,
    )
    return MeasuredTransfer(transfer=transfer, period=2.0 * np.pi / samples.fundamental, **rest)


ALIKE = 0.1  # the rms by which repeats of an input may differ, over its own: it may be measured with noise
EXCITED = 1e-3  # the amplitude of a line over the largest from which on it is one of the input,
LOUD = 50.0  # where its power is this multiple of that of the noise of the input
BESIDE = 8  # lines on either side whose variance over the repeats is put together
RINGING = 2.0  # the variance of repeats with what rings on in it, over that without, from which on it is taken out
MARGIN = 0.3  # the share of the noise above which that is told: its own level is an estimate


def repeat_of(samples: Samples) -> int | None:
    """The periods after which the inputs repeat, the fewest; None where they do not at least three times over."""
    inputs = samples.inputs - samples.inputs.mean(axis=1, keepdims=True)
    per_turn = 2.0 * np.pi / (samples.fundamental * samples.step)
    shortest = min(own.stop - own.start for own in samples.records)
    for turns in range(2, int(shortest / (3.0 * per_turn)) + 1):
        lag = round(turns * per_turn)
        if abs(turns * per_turn - lag) > 1e-3:
            continue
        late, early = (
            np.concatenate([inputs[:, own][:, part] for own in samples.records], axis=1)
            for part in (slice(lag, None), slice(None, -lag))
        )
        if np.sqrt(np.mean((late - early) ** 2)) < ALIKE * np.sqrt(np.mean(early**2)):
            return turns
    return None


def by_repeats(
    samples: Samples,
    turns: int,
    harmonics: Sequence[int],
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    drop: int = 1,
) -> MeasuredTransfer:
    r"""G of the lines of inputs that repeat after J periods of the system, from the repeats in all records.

    .. math:: G_m(k) = \frac{\sum_p n_p\, Y_p(k + mJ)\, U_p^*(k)}{\sum_p n_p |U_p(k)|^2}, \qquad
              \mathrm{var}\, G_m(k) = \frac{s_Y^2(k + mJ) + |G_m(k)|^2 s_U^2(k)}{\sum_p n_p |U_p(k)|^2}

    with Y and U the means of the n repeats of record p, and s² of what each repeat differs from that mean, over some
    lines. Each line of the response must belong to one line of one input, as those of `multisine` do (Louarroudi,
    Lataire and Pintelon 2012). A scan is several records, each of one sine or a few: the lines of all are joined.
    """
    count = round(turns * 2.0 * np.pi / (samples.fundamental * samples.step))
    both = [
        (begin, *own)
        for begin, own in zip(samples.first_times.tolist(), _spectra(samples, count, drop), strict=True)
        if own[0].shape[1]
    ]
    answers = [own for _, own, _ in both]
    counts = np.array([own.shape[1] for own in answers])
    repeats = int(counts.sum())
    if repeats < len(both) + 1:
        raise IdentificationError(
            f"Of the records {repeats} whole repeats of {turns} periods are left once the first {drop} are: a variance "
            "needs two at least. Record more of them, or drop fewer."
        )
    (outputs, spread), (inputs, unlike) = _means(answers), _means([own for _, _, own in both])
    alive = _transient(answers, drop)
    if alive and counts.min() > 2:
        spread = np.average([_without_ringing(own) for own in answers], axis=0, weights=counts - 1)
        spread = np.maximum(spread, _rounding(outputs))
    powers = counts[:, None, None] * np.abs(inputs) ** 2
    driving = (powers > EXCITED**2 * powers.max(axis=(0, 2), keepdims=True)) & (powers > LOUD * unlike)
    driving[:, :, 0] = driving[:, :, (count - 1) // 2 + 1 :] = False
    for own in driving:  # lines of different records do not meet: a scan may have one in each
        _refuse_collisions(own, turns)
    power, excited = np.sum(driving * powers, axis=0), driving.any(axis=0)
    places = np.flatnonzero(excited.any(axis=0))
    asked = np.unique(np.asarray(harmonics, np.int64))
    values = np.full((len(asked), outputs.shape[1], len(excited), len(places)), np.nan, complex)
    std, echoes = np.full(values.shape, np.nan, complex), np.zeros((len(both), *values.shape[2:]), complex)
    for number, own in enumerate(excited):
        seen = own[places]
        line = places[seen]
        driven = driving[:, number, line] * inputs[:, number, line].conj() / power[number, line]
        echoes[:, number, seen] = driven
        for row, harmonic in enumerate(asked.tolist()):
            answered = (line + harmonic * turns) % count
            found = np.einsum("p,pok,pk->ok", counts, outputs[:, :, answered], driven)
            variance = (spread[:, answered] + np.abs(found) ** 2 * unlike[number, line]) / power[number, line]
            values[row, :, number][:, seen] = found
            std[row, :, number][:, seen] = (1.0 + 1.0j) * np.sqrt(0.5 * variance)
    level = spread[:, places]
    explained = level + np.einsum("p,pok->ok", counts, np.abs(outputs[:, :, places]) ** 2) / repeats
    # What rings has power at all lines.
    nonlinear, lines = (np.full(len(spread), np.nan), 0) if alive else _nonlinear(answers, spread, excited, turns)
    return measured_of(
        samples,
        channels,
        (places, count),
        asked,
        (values, std),
        method="repeats",
        noise=2.0 / count * np.sqrt(level),
        coherence=np.clip(1.0 - level / np.maximum(explained, np.finfo(float).tiny), 0.0, 1.0),
        nonlinear=nonlinear,
        echoes=echoes,
        begins=np.array([begin for begin, _, _ in both]),
        findings=(
            note("measured_repeats", repeats=repeats, turns=turns, dropped=drop),
            *alive,
            *_not_linear(nonlinear, lines, [channel.name for channel in channels[0]]),
        ),
    )


def _spectra(samples: Samples, count: int, drop: int) -> list[tuple[NDArray, NDArray]]:
    """Spectra of the outputs and of the inputs in the repeats of each record (channels, repeats, lines)."""
    # Phases are those at phase zero of the system.
    found = []
    for own in samples.records:
        both = np.concatenate([samples.values[:, own], samples.inputs[:, own]])
        whole = both[:, drop * count : both.shape[1] // count * count]
        spectra = np.fft.fft(whole.reshape(len(both), -1, count), axis=2)
        turned = spectra * np.exp(-2j * np.pi * np.fft.fftfreq(count, samples.step) * samples.times[own.start])
        found.append((turned[: len(samples.values)], turned[len(samples.values) :]))
    return found


def _means(records: list[NDArray]) -> tuple[NDArray, Floats]:
    """Means of the repeats of each record (records, channels, lines), and the variance of one (channels, lines)."""
    means = np.array([own.mean(axis=1) for own in records])
    free = sum(own.shape[1] - 1 for own in records)
    apart = [np.sum(np.abs(own - mean[:, None]) ** 2, axis=1) for own, mean in zip(records, means, strict=True)]
    return means, np.maximum(_beside(np.sum(apart, axis=0) / free), _rounding(means))


def _rounding(means: NDArray) -> Floats:
    """The variance below which noise is rounding (channels, 1), of means (records, channels, lines)."""
    return (ROUNDING * np.abs(means).max(axis=(0, 2))[:, None]) ** 2


def _without_ringing(own: NDArray) -> Floats:
    """The variance of a repeat (channels, lines) of a record (channels, repeats, lines) beside what rings on."""
    # What rings falls from repeat to repeat by one factor at all lines beside a resonance: it is one direction of the
    # differences between repeats, and where the largest variance of any direction stands out, it is left out.
    from scipy.linalg import helmert

    parts = np.einsum("jr,crk->jck", helmert(own.shape[1]), own)
    products = parts[:, None] * parts.conj()
    sizes = np.linalg.eigvalsh(np.moveaxis(_beside(products), (0, 1), (-2, -1)))
    all_of, width = sizes.mean(axis=-1), 2 * BESIDE + 1
    rest = sizes[..., :-1].mean(axis=-1) * width / (width - 1)
    return np.where(all_of > RINGING * rest, rest, all_of)


def _beside(variance: NDArray) -> NDArray:
    """A variance over lines, each the mean of those beside it (..., lines)."""
    padded = np.concatenate([variance[..., -BESIDE:], variance, variance[..., :BESIDE]], axis=-1)
    total = np.cumsum(np.concatenate([np.zeros_like(padded[..., :1]), padded], axis=-1), axis=-1)
    width = 2 * BESIDE + 1
    return (total[..., width:] - total[..., :-width]) / width


def _refuse_collisions(excited: Mask, turns: int) -> None:
    """Refuse lines whose responses fall on one another."""
    lines = np.concatenate([np.flatnonzero(own) for own in excited])
    pairs = np.minimum(lines % turns, -lines % turns)
    if len(np.unique(pairs)) < len(pairs) or (pairs == 0).any() or (2 * pairs == turns).any():
        raise IdentificationError(
            "Lines of the inputs, or a line and its mirror image, are a multiple of the fundamental apart. A line of "
            "the response then belongs to several. Use a multisine designed for it (`multisine`), or "
            '`method="polynomials"`.'
        )


def _nonlinear(records: list[NDArray], spread: Floats, excited: Mask, turns: int) -> tuple[Floats, int]:
    """The power in the classes that no line is in over that of the noise (outputs,), and how many lines those are."""
    line = np.arange(1, spread.shape[1] // 2)
    pairs = np.minimum(line % turns, -line % turns)
    used = np.concatenate([np.flatnonzero(own) for own in excited])
    taken = np.minimum(used % turns, -used % turns)
    # Lines of the period itself are those of an orbit.
    free = line[(pairs > 0) & ~np.isin(pairs, taken) & (line >= used.min() / 2.0) & (line <= 2.0 * used.max())]
    if not len(free):
        return np.full(len(spread), np.nan), 0
    parts = [
        np.mean(own.shape[1] * np.abs(own[:, :, free].mean(axis=1)) ** 2 / spread[:, free], axis=1) for own in records
    ]
    return np.mean(parts, axis=0), len(free) * len(parts)


def _transient(records: list[NDArray], drop: int) -> list[Finding]:
    """Finding on a first repeat that differs from the others of its record by more than they do, near some line."""
    from scipy.special import fdtrc

    worst, found = 0.0, False
    for own in records:
        repeats, lines = own.shape[1], own.shape[2] // 2
        if repeats < 3:
            continue
        means, spread = _means([own[:, 1:]])
        apart = np.abs(own[:, 0] - means[0]) ** 2 * (repeats - 1.0) / repeats
        ratio = float(np.max((_beside(apart) / spread)[:, 1:lines]))
        width = 2.0 * (2 * BESIDE + 1)
        chance = lines * len(own) * fdtrc(width, width * (repeats - 2), ratio)
        worst, found = max(worst, ratio), found or bool(chance < SURE)
    return [warning("measured_transient", ratio=worst, dropped=drop)] if found else []


def _above(ratio: float, lines: int) -> bool:
    """True where a mean of squares of complex numbers over their variances is above 1 beyond chance."""
    from scipy.special import chdtrc

    return bool(lines and chdtrc(2 * lines, 2 * lines * ratio) < SURE and ratio > 1.0 + MARGIN)


def _not_linear(nonlinear: Floats, lines: int, names: Sequence[str]) -> list[Finding]:
    """Findings on outputs with power where a linear system has none."""
    return [
        warning("measured_nonlinear", channel=name, ratio=ratio)
        for name, ratio in zip(names, nonlinear.tolist(), strict=True)
        if _above(ratio, lines)
    ]
