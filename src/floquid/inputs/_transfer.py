"""Harmonic transfer functions of a model with inputs, with deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt
from floquid.core import Channel
from floquid.fit import HALF_DIGITS
from floquid.inputs._estimates import Errors, terms_of
from floquid.inputs._modes import InputMode, input_gain
from floquid.inputs._samples import Hold


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TransferFunctions(Rebuilt):
    r"""Harmonic transfer functions G_m of a periodic system (Wereley and Hall 1990).

    .. math:: u(t) = e^{i \Omega t} \;\to\; y(t) = \sum_m G_m(\Omega)\, e^{i (\Omega + m \omega) t}

    Parameters
    ----------
    frequencies_hz
        Ω/2π (frequencies,) [Hz].
    harmonics
        The integers m, ascending (harmonics,).
    values
        G (harmonics, outputs, inputs, frequencies) [units of the outputs over those of the inputs]; NaN where an input
        that was measured at some frequencies has none.
    std
        Their deviations, that of the real part as the real part, alike; None if not estimated.
    outputs, inputs
        One `Channel` each.
    step
        The sampling interval [s] where G is that of samples: of u at the samples to y at the samples, what the input
        does between them and what is folded included. None where it is that of continuous time.
    """

    frequencies_hz: Floats
    harmonics: Integers
    values: Complexes
    std: Complexes | None
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    step: float | None = None

    def __post_init__(self) -> None:
        self._freeze(frequencies_hz=("frequencies",))
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        axes = (len(self.harmonics), len(self.outputs), len(self.inputs), len(self.frequencies_hz))
        self._freeze(dtype=np.complex128, missing=True, values=axes, std=axes)

    def unit(self, output: int, driven_by: int) -> str:
        """The unit of G of one path; "-" where there is none. `output` and `driven_by` count from 0."""
        above, below = self.outputs[output].unit, self.inputs[driven_by].unit
        if above == below:
            return "-"
        return above if below == "-" else f"{'1' if above == '-' else above}/{f'({below})' if '/' in below else below}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid(Rebuilt):
    """Frequencies and harmonics at which G is wanted."""

    omega: Floats  # Ω (frequencies,) [rad/s]
    harmonics: Integers  # m (harmonics,)
    fundamental: float  # ω [rad/s]
    # The sampling interval and the hold where G is that of samples; None where it is that of continuous time
    held: tuple[float, Hold] | None

    def response(self, mode: InputMode, shape: Complexes) -> Complexes:
        """The part of one mode of amplitudes 2 c (outputs, turns) (harmonics, outputs, inputs, frequencies)."""
        found = np.zeros((len(self.harmonics), len(shape), len(mode.gains), len(self.omega)), complex)
        for exponent, turns, c, reach, b in terms_of(mode, shape, self.fundamental):
            found += modal_transfer(
                exponent, self.fundamental, (turns, c), (reach, b), self.harmonics, self.omega, self.held
            )
        return found

    def transfer(
        self,
        modes: Sequence[InputMode],
        shapes: Sequence[Complexes],
        direct: Mapping[int, Complexes],
        shape: tuple[int, int],
    ) -> Complexes:
        """G of modes of amplitudes 2 c, and of D (outputs, inputs) by harmonics from 0 on, where `shape` is of D."""
        found = np.zeros((len(self.harmonics), *shape, len(self.omega)), complex)
        for mode, own in zip(modes, shapes, strict=True):
            found += self.response(mode, own)
        for turn, value in direct.items():
            found[self.harmonics == turn] += value[:, :, None]
            if turn:
                found[self.harmonics == -turn] += value.conj()[:, :, None]
        return found

    def slopes(self, modes: Sequence[InputMode], shapes: Sequence[Complexes], free: Sequence[Mask]) -> list[Complexes]:
        """Derivatives of G by the `free` numbers of each mode, one after another."""
        found = []
        for mode, shape, mask in zip(modes, shapes, free, strict=True):
            size, half, own = mode.gains.size, len(mask) // 2, self.response(mode, shape)
            ones = np.eye(len(mode.reach), dtype=np.complex128)
            bare = [replace(mode, gains=unit * ones, initial=np.zeros(0, np.complex128)) for unit in (1.0, 1j)]
            by_gain = [self.response(one, shape) for one in bare]
            firsts = (1, 1 + size if mode.real else 1 + half)
            for index in np.flatnonzero(mask).tolist():
                step = np.zeros(len(mask))
                part = int(index >= firsts[1])
                if index in (0, half if not mode.real else 0):
                    step[index] = HALF_DIGITS * max(abs(mode.exponent.real), HALF_DIGITS * self.fundamental)
                    up, down = (self.response(mode.moved(sign * step), shape) for sign in (1.0, -1.0))
                    found.append((up - down) / (2.0 * step[index]))
                elif index < firsts[part] + size:
                    source, turn = divmod(index - firsts[part], len(mode.reach))
                    found.append(np.zeros_like(own))
                    found[-1][:, :, source] = by_gain[part][:, :, turn]
                else:  # of the transient, which is linear, too
                    step[index] = 1.0
                    found.append(self.response(mode.moved(step), shape) - own)
        return found

    def units(self, modes: Sequence[InputMode], direct: Sequence[int], inputs: int) -> Complexes:
        """Derivatives of G of an output by its amplitudes (numbers, harmonics, inputs, frequencies), of all the same.

        Of each mode by the real parts of its turns, then by the imaginary ones, then likewise by D of each input, of
        harmonics above 0 by 2 D.
        """
        found, shape = [], (len(self.harmonics), inputs, len(self.omega))
        for mode in modes:
            one = np.eye(len(mode.turns), dtype=complex)
            for units in (one, 1j * one[turning(mode)]):
                found += list(np.moveaxis(self.response(mode, units), 1, 0))
        for turn in direct:
            for unit in (0.5, 0.5j) if turn else (1.0,):
                for source in range(inputs):
                    whole = np.zeros(shape, complex)
                    whole[self.harmonics == turn, source] = unit
                    if turn:
                        whole[self.harmonics == -turn, source] = np.conj(unit)
                    found.append(whole)
        return np.array(found, complex).reshape(-1, *shape)


def turning(mode: InputMode) -> Mask:
    """Mask of the turns whose amplitude has an imaginary part (turns,)."""
    return (mode.turns > 0.0) | (not mode.real)


def transfer_of(
    grid: Grid,
    modes: Sequence[InputMode],
    shapes: Sequence[Complexes],
    direct: Mapping[int, Complexes],
    errors: Errors,
    channels: tuple[Sequence[Channel], Sequence[Channel]],
    free: Sequence[Mask] | None = None,
) -> TransferFunctions:
    """G of a fit with its deviations by all that is uncertain in it, to first order."""
    outputs, inputs = channels
    masks = [mode.free for mode in modes] if free is None else free
    slopes, units = grid.slopes(modes, shapes, masks), grid.units(modes, list(direct), len(inputs))
    values = grid.transfer(modes, shapes, direct, (len(outputs), len(inputs)))
    std, flat = np.zeros_like(values), units.reshape(len(units), -1).T
    for output in range(len(outputs)):
        rows = np.array([own[:, output].ravel() for own in slopes]).reshape(len(slopes), -1).T
        real, imag = (errors.variance(output, *part) for part in ((rows.real, flat.real), (rows.imag, flat.imag)))
        std[:, output] = (np.sqrt(real) + 1j * np.sqrt(imag)).reshape(std[:, output].shape)
    return TransferFunctions(
        frequencies_hz=grid.omega / (2.0 * np.pi),
        harmonics=grid.harmonics,
        values=values,
        std=std,
        outputs=tuple(outputs),
        inputs=tuple(inputs),
        step=None if grid.held is None else grid.held[0],
    )


def modal_transfer(
    exponent: complex,
    fundamental: float,
    seen: tuple[Integers, Complexes],
    reached: tuple[Integers, Complexes],
    harmonics: Integers,
    omega: Floats,
    sampled: tuple[float, Hold] | None = None,
) -> Complexes:
    r"""The part of one mode in G at angular frequencies (harmonics, outputs, inputs, frequencies).

    `seen` are the harmonics of the outputs and c (outputs, harmonics), `reached` those of the inputs and b. That of
    samples, with their interval h and the hold, has :math:`\beta_l / (e^{i (\Omega + l \omega) h} - e^{\lambda h})` for
    :math:`b_l / (i (\Omega + l \omega) - \lambda)`.
    """
    (turns, c), (reach, b) = seen, reached
    turned = omega + reach[:, None] * fundamental
    with np.errstate(divide="ignore", invalid="ignore"):
        if sampled is None:
            resonance = 1.0 / (1j * turned - exponent)
        else:
            step, ahead = sampled[0], np.exp(1j * turned * sampled[0])
            shares = np.array([input_gain(exponent, turn, fundamental, *sampled) for turn in reach.tolist()])
            resonance = (shares[:, :1] + shares[:, 1:] * ahead) / (ahead - np.exp(exponent * step))
    wanted = harmonics[:, None] - reach
    place = np.clip(np.searchsorted(turns, wanted), 0, len(turns) - 1)
    shifted = np.where(turns[place] == wanted, c[:, place], 0.0)
    return np.einsum("oml,ilf->moif", shifted, b[:, :, None] * resonance)
