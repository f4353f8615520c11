"""Three-phase quantities in other coordinates, αβ, dq and symmetrical components of channels and of G."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Literal, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Mask
from floquid._checks import input_error
from floquid.core import Channel, Record, channels_named
from floquid.inputs import TransferFunctions
from floquid.pipeline import Analysis
from floquid.sync import tied
from floquid.views._sidebands import Source, refuse_none, root, source_of, variance_of

CLARKE = np.array([[2.0, -1.0, -1.0], [0.0, np.sqrt(3.0), -np.sqrt(3.0)], [1.0, 1.0, 1.0]]) / 3.0
"""From three phases to α, β and zero, of one amplitude where the phases are balanced."""

TURNING = {sign: 0.5 * np.array([[1.0, sign * 1j], [-sign * 1j, 1.0]]) for sign in (1, -1)}
"""Parts of the rotation from dq to αβ, by the direction in which they turn."""

SEQUENCES = 0.5 * np.array([[1.0, 1j], [1.0, -1j]])
"""From phasors of α and β to those of phase a in the positive and the negative sequence."""

Kind: TypeAlias = Literal["alpha-beta", "dq", "sequence"]
WORDS: dict[Kind, tuple[str, str, str]] = {
    "alpha-beta": ("alpha", "beta", "zero"),
    "dq": ("d", "q", "zero"),
    "sequence": ("positive", "negative", "zero"),
}
Operator: TypeAlias = dict[int, Complexes]  # matrices by the harmonics that they shift by
Subject = TypeVar("Subject", Record, TransferFunctions)


def to_alpha_beta(subject: Subject, *groups: Sequence[str]) -> Subject:
    r"""Channels of a record, or of transfer functions, with three phases as α, β and zero.

    .. math:: \begin{bmatrix} \alpha \\ \beta \\ 0 \end{bmatrix} = \frac13 \begin{bmatrix} 2 & -1 & -1 \\
              0 & \sqrt3 & -\sqrt3 \\ 1 & 1 & 1 \end{bmatrix} \begin{bmatrix} a \\ b \\ c \end{bmatrix}

    `subject` is a record, or transfer functions, whose outputs and inputs change. Each of the `groups` names the
    three phases of one quantity; other channels stay. Deviations take the elements of G for independent. Raises
    InputError where a channel is unknown, or a group has not three channels of one unit.
    """
    return _constant(subject, groups, "alpha-beta", "to_alpha_beta")


def to_sequence(subject: Subject, *groups: Sequence[str]) -> Subject:
    r"""Channels of a record, or of transfer functions, with phases as symmetrical components.

    .. math:: x_\pm = \tfrac12 (\alpha \pm i \beta)

    of phasors; of a record the positive and the negative sequence of phase a, by analytic signals over the whole of it.
    Of transfer functions m = 0 is what a sequence does to itself, and a coupling of sequences two fundamentals apart
    is in m = ±2. Deviations take the elements of G for independent.

    `subject` is a record, or transfer functions, whose outputs and inputs change. Each of the `groups` names the
    three phases, or α and β, of one quantity; other channels stay. Raises InputError where a channel is unknown, misses
    samples, or a group has not two or three channels of one unit.
    """
    return _constant(subject, groups, "sequence", "to_sequence")


def to_dq(
    subject: Record | TransferFunctions | Analysis,
    *groups: Sequence[str],
    period: float | None = None,
    frequencies_hz: ArrayLike | None = None,
    harmonics: ArrayLike = (0,),
) -> Record | TransferFunctions:
    r"""Channels of a record, or transfer functions, in coordinates that turn once a period.

    .. math:: \begin{bmatrix} d \\ q \end{bmatrix} = \begin{bmatrix} \cos\theta & \sin\theta \\ -\sin\theta & \cos\theta
              \end{bmatrix} \begin{bmatrix} \alpha \\ \beta \end{bmatrix}, \qquad
              H_m(\Omega) = \sum_{p,q = \pm 1} P_p\; G_{m+p-q}(\Omega + q \omega)\; P_q

    with θ the phase of the clock and :math:`P_\pm` the parts of the rotation. A balanced converter is constant there:
    it has m = 0 alone. Deviations take the elements of G for independent.

    Raises InputError where a channel is unknown, a group has not two or three channels of one unit, or frequencies and
    harmonics that are needed are missing.

    Parameters
    ----------
    subject
        A record with a clock, an analysis with measured inputs, or transfer functions at frequencies, some of them
        a fundamental apart.
    groups
        The names of three phases, or of α and β, of one quantity each; other channels stay.
    period
        The period of transfer functions [s], which do not know it; a record and an analysis do.
    frequencies_hz
        The frequencies in dq [Hz] of an analysis; by default its own. Transfer functions have those that they tell.
    harmonics
        The harmonics m that are wanted.
    """
    of = "to_dq"
    if isinstance(subject, Record):
        return _turned(subject, groups, of)
    return _framed(source_of(subject, period, frequencies_hz, of), groups, "dq", harmonics, of)


def _framed(
    source: Source, groups: Sequence[Sequence[str]], kind: Kind, harmonics: ArrayLike, of: str
) -> TransferFunctions:
    """Transfer functions with some outputs and inputs in other coordinates."""
    _refuse_unknown([*source.outputs, *source.inputs], groups, of)
    for group in groups:
        sides = [{channel.name for channel in channels} for channels in (source.outputs, source.inputs)]
        if not any(set(group) <= side for side in sides):
            raise input_error("groups", of, "be all outputs or all inputs", f"has {list(group)}")
    left, _, outputs = _operators(source.outputs, groups, kind, of)
    _, right, inputs = _operators(source.inputs, groups, kind, of)
    wanted = np.unique(np.atleast_1d(np.asarray(harmonics, np.int64)))
    shape = (len(wanted), len(outputs), len(inputs), len(source.hertz))
    values, variance, lost, known = np.zeros(shape, complex), np.zeros(shape, complex), np.zeros(shape), True
    for shift, after in right.items():
        pairs = [(place, turn, own) for place, turn in enumerate(wanted.tolist()) for own in left]
        each = source.at(shift, [turn - own - shift for _, turn, own in pairs])
        for (place, _, own), (G, std) in zip(pairs, each, strict=True):
            told = np.isfinite(G)
            values[place] += np.einsum("ai,ijf,jb->abf", left[own], np.where(told, G, 0.0), after)
            lost[place] += np.einsum("ai,ijf,jb->abf", np.abs(left[own]), ~told, np.abs(after))
            known = known and std is not None
            if std is not None:
                weight = np.einsum("ai,jb->abij", left[own], after)
                variance[place] += variance_of(weight, np.where(told, std, 0.0))
    values[lost > 0.0] = np.nan
    rows, columns = _new(source.outputs, outputs), _new(source.inputs, inputs)
    there: Mask = np.asarray(np.isfinite(values[:, rows][:, :, columns]).all(axis=(0, 1, 2)), bool)
    refuse_none(there, of)
    return TransferFunctions(
        frequencies_hz=source.hertz[there],
        harmonics=wanted,
        values=values[..., there],
        std=root(variance)[..., there] if known else None,
        outputs=outputs,
        inputs=inputs,
        step=source.step,
    )


def _operators(
    channels: Sequence[Channel], groups: Sequence[Sequence[str]], kind: Kind, of: str
) -> tuple[Operator, Operator, tuple[Channel, ...]]:
    """Matrices from the channels to the new ones, back, and the new channels; groups that are not there stay."""
    size, names = len(channels), [channel.name for channel in channels]
    new, taken = list(channels), [names.index(name) for group in groups for name in group if name in names]
    rest = np.diag([0.0 if place in taken else 1.0 for place in range(size)]).astype(complex)
    there: Operator = {0: rest}
    back: Operator = {0: rest.copy()}
    for group in groups:
        if not set(group) <= set(names):
            continue
        rows = [names.index(name) for name in group]
        _refuse_unlike(group, [channels[row].unit for row in rows], kind, of)
        forward, backward = _frame(kind, len(rows))
        for whole, part in ((there, forward), (back, backward)):
            for shift, matrix in part.items():
                whole.setdefault(shift, np.zeros((size, size), complex))[np.ix_(rows, rows)] = matrix
        for row, word in zip(rows, WORDS[kind], strict=False):
            new[row] = replace(channels[row], name=_named(group, word))
    used = [{shift: matrix for shift, matrix in own.items() if matrix.any()} for own in (there, back)]
    return used[0], used[1], tuple(new)


def _frame(kind: Kind, size: int) -> tuple[Operator, Operator]:
    """Matrices from two or three phases into a frame, and back, by the harmonics that they shift by."""
    base = (CLARKE if size > len(SEQUENCES) else np.eye(2)).astype(complex)
    inverse = np.linalg.inv(base)

    def padded(matrix: ArrayLike, last: float) -> Complexes:
        whole = np.zeros((size, size), complex)
        whole[:2, :2] = matrix
        whole[2:, 2:] = last
        return whole

    if kind == "dq":
        parts = {sign: padded(matrix, 0.0) for sign, matrix in TURNING.items()}
        zero = padded(np.zeros((2, 2)), 1.0)
        forward = {-sign: matrix @ base for sign, matrix in parts.items()} | {0: zero @ base}
        return forward, {sign: inverse @ matrix for sign, matrix in parts.items()} | {0: inverse @ zero}
    matrix = padded(SEQUENCES if kind == "sequence" else np.eye(2), 1.0)
    return {0: matrix @ base}, {0: inverse @ np.linalg.inv(matrix)}


def _refuse_unlike(group: Sequence[str], units: Sequence[str], kind: Kind, of: str) -> None:
    sizes = (3,) if kind == "alpha-beta" else (2, 3)
    if len(group) not in sizes or len(set(group)) < len(group):
        must = f"each name {'three phases' if len(sizes) == 1 else 'three phases, or alpha and beta'}"
        raise input_error("groups", of, must, f"has {list(group)}")
    if len(set(units)) > 1:
        raise input_error("groups", of, "be of one unit each", f"has {', '.join(units)} in {list(group)}")


def _refuse_unknown(channels: Sequence[Channel], groups: Sequence[Sequence[str]], of: str) -> None:
    if not groups or any(isinstance(group, str) for group in groups):
        must, got = "be lists of names", "has none" if not groups else f"has {groups[0]!r}"
        raise input_error("groups", of, must, got, f'As in {of}(…, ["i_a", "i_b", "i_c"]).')
    for group in groups:
        channels_named(channels, group, argument="groups", of=of)


def _new(before: Sequence[Channel], after: Sequence[Channel]) -> list[int]:
    """The places of channels that changed; all where none did."""
    changed = [place for place, (own, new) in enumerate(zip(before, after, strict=True)) if own != new]
    return changed or list(range(len(after)))


def _named(group: Sequence[str], word: str) -> str:
    """The name of a new channel: what the names of its group have in common, and the word."""
    alike = [letters[0] for letters in takewhile(lambda letters: len(set(letters)) == 1, zip(*group, strict=False))]
    stem = "".join(alike).rstrip("_ -.")
    return f"{stem}_{word}" if stem else word


def _constant(subject: Subject, groups: Sequence[Sequence[str]], kind: Kind, of: str) -> Subject:
    """A record or transfer functions in a frame that does not turn."""
    if isinstance(subject, Record):
        _refuse_unknown(subject.channels, groups, of)
        there, _, channels = _operators(subject.channels, groups, kind, of)
        values = subject.values if kind == "alpha-beta" else _analytic(subject, groups, of)
        step = f"three phases as {', '.join(WORDS[kind])}: {of}"
        return cast("Subject", _with(subject, (there[0] @ values).real, channels, step))
    source = source_of(subject, 1.0, None, of)
    return cast("Subject", _framed(source, groups, kind, subject.harmonics, of))


def _analytic(record: Record, groups: Sequence[Sequence[str]], of: str) -> Complexes:
    """The samples with positive frequencies alone, in the groups; others are as they are."""
    rows = channels_named(record.channels, [name for group in groups for name in group], argument="groups", of=of)
    values = record.values.astype(complex)
    if np.isnan(values[rows]).any():
        raise input_error("subject", of, "have every sample of these channels", "misses some", "Fill the gaps first.")
    lines = np.fft.fft(values[rows], axis=1)
    positive_half = (record.n_samples + 1) // 2
    lines[:, 1:positive_half] *= 2.0
    lines[:, record.n_samples // 2 + 1 :] = 0.0
    values[rows] = np.fft.ifft(lines, axis=1)
    return np.asarray(values, np.complex128)


def _turned(record: Record, groups: Sequence[Sequence[str]], of: str) -> Record:
    """A record in dq by the phase of its clock."""
    if record.clock is None:
        remedy = "Give the period: record.with_clock(ConstantPeriod(period=0.02))."
        raise input_error("subject", of, "have a clock", "has none", remedy)
    _refuse_unknown(record.channels, groups, of)
    there, _, channels = _operators(record.channels, groups, "dq", of)
    angle = 2.0 * np.pi * tied(record).turns(record.times)
    missing = np.isnan(record.values)
    filled = np.where(missing, 0.0, record.values)
    values = sum((np.exp(1j * shift * angle) * (matrix @ filled)).real for shift, matrix in there.items())
    lost = sum(np.abs(matrix) for matrix in there.values()) @ missing > 0.0
    return _with(record, np.where(lost, np.nan, values), channels, "three phases as d, q, zero: to_dq")


def _with(record: Record, values: Floats, channels: Iterable[Channel], step: str) -> Record:
    """A record with other values."""
    provenance = record.provenance.then(step)
    return replace(record, values=values, channels=tuple(channels), orbit=None, provenance=provenance)
