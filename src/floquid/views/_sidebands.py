"""Harmonic transfer functions at sidebands, of an analysis or of lines, and the impedances of admittances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Indices, Mask
from floquid._checks import frozen_array, input_error, positive, wrong_value
from floquid.core import Channel, channels_named
from floquid.inputs import TransferFunctions
from floquid.pipeline import Analysis

SIDEBANDS = 6  # harmonics either way that the impedance of a periodic admittance takes in
SAME = 1e-6  # of the fundamental frequency: lines as near as that are one

Both: TypeAlias = tuple[Complexes, Complexes | None]  # values and their deviations


def impedance(
    subject: TransferFunctions | Analysis,
    currents: Sequence[str],
    voltages: Sequence[str],
    *,
    period: float | None = None,
    frequencies_hz: ArrayLike | None = None,
    harmonics: ArrayLike = (0,),
) -> TransferFunctions:
    r"""The impedances from currents to voltages, of admittances from voltages to currents.

    .. math:: \sum_n G_{m-n}(\Omega + n \omega)\, Z_n(\Omega) = \delta_{m0}

    with six harmonics n either way; of transfer functions those that they tell, others being zero. Where these have
    m = 0 alone, as in dq, it is the inverse at each frequency, and needs no period. Deviations take the elements of G
    for independent. It works for any inputs and outputs that are as many.

    Raises InputError where a channel is unknown, there are not as many of either, or a matrix cannot be inverted.

    Parameters
    ----------
    subject
        An analysis with measured inputs, or transfer functions.
    currents, voltages
        The names of outputs and of as many inputs; they become inputs and outputs.
    period, frequencies_hz, harmonics
        As in `to_dq`.
    """
    of = "impedance"
    alone = isinstance(subject, TransferFunctions) and subject.harmonics.tolist() == [0]
    source = source_of(subject, 1.0 if alone else period, frequencies_hz, of, others=0.0)
    rows = channels_named(source.outputs, currents, argument="currents", of=of)
    columns = channels_named(source.inputs, voltages, argument="voltages", of=of)
    if len(rows) != len(columns) or not rows:
        got = f"{len(rows)} and {len(columns)}"
        raise input_error("currents", of, "be as many as the voltages", got, "Name a current for each voltage.")
    reach = 0 if alone else SIDEBANDS
    wanted = np.unique(np.atleast_1d(np.asarray(harmonics, np.int64)))
    if np.abs(wanted).max(initial=0) > reach:
        raise input_error("harmonics", of, f"lie within ±{reach}", f"has {wanted.tolist()}")
    size, turns = len(rows), range(-reach, reach + 1)
    whole = np.zeros((len(source.hertz), len(turns) * size, len(turns) * size), complex)
    spread: Complexes | None = None
    for place, n in enumerate(turns):
        for row, (values, std) in zip(turns, source.at(n, [m - n for m in turns]), strict=True):
            part = (
                slice(None),
                slice((row + reach) * size, (row + reach + 1) * size),
                slice(place * size, (place + 1) * size),
            )
            whole[part] = np.moveaxis(values[np.ix_(rows, columns)], 2, 0)
            if std is not None:
                spread = np.zeros_like(whole) if spread is None else spread
                spread[part] = np.moveaxis(std[np.ix_(rows, columns)], 2, 0)
    there: Mask = np.asarray(np.isfinite(whole).all(axis=(1, 2)), bool)
    refuse_none(there, of)
    try:
        inverse = np.asarray(np.linalg.inv(whole[there]), np.complex128)
    except np.linalg.LinAlgError:
        raise input_error("subject", of, "have an inverse at every frequency", "has none", "Leave some out.") from None
    middle = slice(reach * size, (reach + 1) * size)
    found, std = np.zeros((2, len(wanted), size, size, int(there.sum())), complex)
    for place, m in enumerate(wanted.tolist()):
        left = inverse[:, (m + reach) * size : (m + reach + 1) * size]
        found[place] = np.moveaxis(left[:, :, middle], 0, 2)
        if spread is not None:
            std[place] = np.moveaxis(_deviation(left, spread[there], inverse[:, :, middle]), 0, 2)
    return TransferFunctions(
        frequencies_hz=source.hertz[there],
        harmonics=wanted,
        values=found,
        std=None if spread is None else std,
        outputs=tuple(source.inputs[k] for k in columns),
        inputs=tuple(source.outputs[k] for k in rows),
        step=source.step,
    )


class Source(Protocol):
    """Harmonic transfer functions at shifted frequencies."""

    hertz: Floats
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    step: float | None

    def at(self, shift: int, turns: Sequence[int]) -> list[Both]:
        """G_j(Ω + shift·ω) for each j of some turns."""


@dataclass(frozen=True, slots=True)
class _Model:
    """Transfer functions of an analysis, at any frequency."""

    hertz: Floats
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    step: float | None
    analysis: Analysis

    def at(self, shift: int, turns: Sequence[int]) -> list[Both]:
        found = self.analysis.transfer(self.hertz + shift / self.analysis.model.period, turns)
        places = [found.harmonics.tolist().index(turn) for turn in turns]
        return [(found.values[k], None if found.std is None else found.std[k]) for k in places]


@dataclass(frozen=True, slots=True)
class _Lines:
    """Transfer functions at lines, and at their negatives by conjugates."""

    hertz: Floats
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    step: float | None
    found: TransferFunctions
    fundamental: float
    others: complex  # G of harmonics that are not there: zero, or NaN where they must be

    def at(self, shift: int, turns: Sequence[int]) -> list[Both]:
        own, target = self.found, self.hertz + shift * self.fundamental
        signed = np.concatenate([self.hertz, -self.hertz])
        nearest = np.abs(target[:, None] - signed).argmin(axis=1)
        missing = np.abs(target - signed[nearest]) > SAME * self.fundamental
        mirrored, place = nearest >= len(self.hertz), nearest % len(self.hertz)
        return [self._of(own, turn, place, mirrored, missing) for turn in turns]

    def _of(self, own: TransferFunctions, turn: int, place: Indices, mirrored: Mask, missing: Mask) -> Both:
        def part(array: Complexes, turn: int) -> Complexes:
            rows = np.flatnonzero(own.harmonics == turn)
            none = np.full((len(own.outputs), len(own.inputs), len(place)), self.others)
            return np.asarray(array[rows[0]][:, :, place] if len(rows) else none, np.complex128)

        values = np.where(mirrored, part(own.values, -turn).conj(), part(own.values, turn))
        values[:, :, missing] = np.nan
        if own.std is None:
            return values, None
        return values, np.where(mirrored, part(own.std, -turn), part(own.std, turn))


def source_of(
    subject: object, period: float | None, frequencies_hz: ArrayLike | None, of: str, *, others: complex = np.nan
) -> Source:
    """Transfer functions at shifted frequencies, of an analysis or of lines; `others` are harmonics that lines lack."""
    if isinstance(subject, Analysis):
        hertz = subject.transfer(harmonics=0).frequencies_hz if frequencies_hz is None else frequencies_hz
        shown = frozen_array(hertz, "frequencies_hz", of, axes=("frequencies",))
        return cast("Source", _Model(shown, subject.model.channels, subject.inputs, None, subject))
    if not isinstance(subject, TransferFunctions):
        must = "be a Record, TransferFunctions or an Analysis"
        raise wrong_value("subject", of, must, subject, "Pass `analysis.transfer()`, say.")
    if frequencies_hz is not None:
        must, remedy = "be left out of transfer functions", "They have frequencies of their own."
        raise input_error("frequencies_hz", of, must, "is given", remedy)
    if period is None:
        raise input_error("period", of, "be given with transfer functions", "is not", "They do not know it.")
    ends, fundamental = (subject.outputs, subject.inputs), 1.0 / positive(period, "period", of, unit="s")
    return cast("Source", _Lines(subject.frequencies_hz, *ends, subject.step, subject, fundamental, others))


def refuse_none(there: Mask, of: str) -> None:
    """Refuse transfer functions without a frequency at which all is `there`."""
    if not there.any():
        must, got = "have the harmonics and sidebands that are needed", "has them at no frequency"
        raise input_error("subject", of, must, got, "Pass the analysis, or measure at lines a fundamental apart.")


def variance_of(weight: Complexes, std: Complexes) -> Complexes:
    """Variances of the real and imaginary parts of Σ weight·G, of independent elements of G (i, j, frequencies)."""
    real, imag = weight.real**2, weight.imag**2
    own, other = std.real**2, std.imag**2
    sums = [
        np.einsum("abij,ijf->abf", one, part) for one, part in ((real, own), (imag, other), (imag, own), (real, other))
    ]
    return np.asarray(sums[0] + sums[1] + 1j * (sums[2] + sums[3]), np.complex128)


def root(variance: Complexes) -> Complexes:
    return np.asarray(np.sqrt(variance.real) + 1j * np.sqrt(variance.imag), np.complex128)


def _deviation(left: Complexes, std: Complexes, right: Complexes) -> Complexes:
    """Deviations of left·δG·right (frequencies, a, b), of independent elements of δG."""
    found = np.zeros((len(left), left.shape[1], right.shape[2]), complex)
    for place, (before, own, after) in enumerate(zip(left, std, right, strict=True)):
        weight = np.einsum("ai,jb->abij", before, after)
        found[place] = variance_of(weight, own[:, :, None])[:, :, 0]
    return root(found)
