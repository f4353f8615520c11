"""Derivatives of states carried to the channels: sums over channels and samples without the slopes of each channel."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats
from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples

if TYPE_CHECKING:
    from floquid.inputs._solver import Linearisation


def carried(samples: Samples, shape: Complexes, turns: Sequence[float]) -> Complexes:
    """The shape of a mode over the samples: amplitudes (…, turns) at harmonics (…, samples)."""
    found = np.empty((*shape.shape[:-1], samples.n_samples), complex)
    for own, part in samples.in_parts(4 * len(turns)):
        found[..., own] = part.kept(shape @ np.array([part.turned(turn) for turn in turns]))
    return found


def in_precision(values: NDArray, number: type) -> NDArray:
    """The values in a precision, complex ones as complex numbers."""
    return values.astype(np.result_type(number, 1j) if np.iscomplexobj(values) else number)


@dataclass(frozen=True, slots=True)
class Piece:
    """A part of the samples, with what is multiplied there."""

    samples: Samples
    rows: Sequence[NDArray]  # derivatives of the state of each mode (parts, [states,] samples)
    columns: NDArray  # (columns, samples)
    left: NDArray  # the residual over the noise (channels, samples)


@dataclass(frozen=True, slots=True)
class Carried:
    """Derivatives of the state of a mode, and what carries them to the channels: sums over channels need no slopes.

    Parameters are the real parts of the derivatives times the shape, then, of pairs, the imaginary ones, negative.
    """

    rows: NDArray  # derivatives of the states (parts, states, samples)
    carried: NDArray  # the shape over its noise along the samples (channels, states, samples)
    waves: NDArray  # factors that make it up (waves, 1 or states, samples)
    shares: NDArray  # of each factor in each channel (channels, waves, states)
    real: bool

    def of_parts(self, values: Complexes, axis: int = 0) -> Floats:
        """The parameters of complex products with the derivatives, which are along an axis."""
        return values.real if self.real else np.concatenate([values.real, -values.imag], axis=axis)

    def products(self, signals: NDArray) -> Complexes:
        """Sums over the samples of the derivatives times a signal of each state (parts,)."""
        return np.asarray(np.tensordot(self.rows, signals, 2), np.complex128)

    def with_columns(self, columns: NDArray) -> Complexes:
        """Sums of the response's derivatives times columns (channels, parts, columns)."""
        found = np.stack([(self.rows * wave) @ columns.T for wave in self.waves])
        return np.einsum("cws,wpsk->cpk", self.shares, found, optimize=True)

    def squares(self, other: Carried) -> Floats:
        """Sums over channels and samples of products with the derivatives of another mode (parameters, parameters)."""
        straight, turned = np.zeros((2, len(self.rows), len(other.rows)), complex)
        for state, own in enumerate(self.carried.swapaxes(0, 1)):
            for beside, others in enumerate(other.carried.swapaxes(0, 1)):
                rows, there = self.rows[:, state], other.rows[:, beside]
                straight += (rows * np.einsum("ct,ct->t", own, others.conj())) @ there.conj().T
                turned += (rows * np.einsum("ct,ct->t", own, others)) @ there.T
        both, apart = 0.5 * (straight + turned), 0.5 * (straight - turned)
        whole = np.block([[both.real, apart.imag], [-both.imag, apart.real]])
        return whole[: len(both) if self.real else None, : both.shape[1] if other.real else None]

    @staticmethod
    def of(samples: Samples, mode: InputMode, shape: Complexes, rows: NDArray) -> Carried:
        """The derivatives of a mode's state (parts, [states,] samples) with its shape over the noise (…, channels)."""
        shape = shape.T.reshape(shape.shape[1], mode.states, -1)
        precision, turns = np.result_type(rows, np.complex64), mode.turns.tolist()
        carrying = carried(samples, shape, turns).astype(precision)
        waves = carried(samples, np.eye(len(turns), dtype=complex), turns).astype(precision)[:, None]
        if mode.real:  # what is not seen at the samples is zero then, and not rounding
            carrying = carrying.real
        # Whatever has fewer: the channels, or the harmonics.
        shares = shape.swapaxes(1, 2)
        if len(carrying) <= len(waves):
            waves, shares = carrying, np.repeat(np.eye(len(carrying))[..., None], mode.states, axis=2)
        return Carried(rows.reshape(len(rows), mode.states, -1), carrying, waves, shares, mode.real)


def of_all_channels(pieces: Iterable[Piece], at: Linearisation) -> tuple[Floats, Floats, Floats]:
    """Sums of products of slopes with one another, the residual and columns, all channels together."""
    places = np.cumsum([0, *map(len, at.free)])
    free, whole = np.flatnonzero(np.concatenate(at.free)), int(places[-1])
    matrix, gradient = np.zeros((whole, whole)), np.zeros(whole)
    along = np.zeros((len(at.noise), whole, len(at.inverse)))
    for piece in pieces:
        carrying = [
            Carried.of(piece.samples, mode, at.shape(place) / at.noise, rows)
            for place, (mode, rows) in enumerate(zip(at.modes, piece.rows, strict=True))
        ]
        for first, one in enumerate(carrying):
            own = slice(places[first], places[first + 1])
            gradient[own] += one.of_parts(one.products(np.einsum("cst,ct->st", one.carried, piece.left)))
            along[:, own] += one.of_parts(one.with_columns(piece.columns), axis=1)
            for second in range(first, len(carrying)):
                block = one.squares(carrying[second])
                other = slice(places[second], places[second + 1])
                matrix[own, other] += block
                matrix[other, own] += block.T if second > first else 0.0
    return matrix[np.ix_(free, free)], gradient[free], along[:, free]
