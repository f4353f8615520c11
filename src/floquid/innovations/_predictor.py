r"""The one-step predictor of a periodic system in innovations form, and its derivatives by all parameters.

.. math:: s_{k+1} = \Lambda s_k + B_k u_k + K_k e_k, \qquad e_k = y_k - C_k s_k - q\, w_k

Λ is block diagonal, of the modes; B, K and C turn with the period; w are known columns: a mean, harmonics, a direct
term (Ljung 1999, section 4.3; Verhaegen and Yu 1995 of periodic systems).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.inputs import Samples

TOGETHER = 512
"""Samples whose derivatives are held at once."""

LARGEST = 1e3
"""Innovations over the response from which on the predictor diverges."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mode(Rebuilt):
    r"""One mode of the innovations form: a pair of conjugates, or a real multiplier.

    .. math:: z_{k+1} = e^{\lambda h} z_k + \sum_{d,l} g_{d,l}\, e^{i l \omega t_k} v_d, \qquad
              y = \Re \sum_m s_m e^{i m \omega t} z

    v are the measured inputs, then the innovations. Of a real multiplier z and what drives it are real parts, and l
    and m count from 0, or from ½ if it is negative.

    Parameters
    ----------
    exponent
        λ [1/s].
    real
        True for a real multiplier.
    turns, shape
        The harmonics m, ascending (turns,), and s (channels, turns).
    reach, gains
        The harmonics l, ascending (reach,), and g (inputs + channels, reach).
    """

    exponent: complex
    real: bool
    turns: NDArray[np.float64]
    shape: NDArray[np.complex128]
    reach: NDArray[np.float64]
    gains: NDArray[np.complex128]

    @property
    def rows(self) -> int:
        """Real states."""
        return 1 if self.real else 2

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Real parameters of the exponent, of the gains and of the shape."""
        return self.rows, 2 * self.gains.size, 2 * self.shape.size

    def moved(self, step: NDArray[np.float64]) -> Mode:
        """With the parameters moved by a step: λ, gains, shape, of each the real parts and then the imaginary ones."""
        of_exponent, of_gains, of_shape = np.split(step, np.cumsum(self.sizes)[:2])
        return replace(
            self,
            exponent=self.exponent + complex(of_exponent[0], 0.0 if self.real else of_exponent[-1]),
            gains=self.gains + _complex(of_gains).reshape(self.gains.shape),
            shape=self.shape + _complex(of_shape).reshape(self.shape.shape),
        )

    def widened(self, turns: NDArray[np.float64], reach: NDArray[np.float64]) -> Mode:
        """With these harmonics, zero where there were none (turns,), (reach,)."""
        return replace(
            self,
            turns=turns,
            shape=_placed(self.turns, self.shape, turns),
            reach=reach,
            gains=_placed(self.reach, self.gains, reach),
        )

    def padded(self, by: float, highest: float) -> Mode:
        """With some harmonics more at each end of its bands."""
        return self.widened(*(_longer(band, by, highest, self.real) for band in (self.turns, self.reach)))

    def scaled(self) -> Mode:
        """With a state of such a size that the largest gain is 1."""
        largest = self.gains.ravel()[np.argmax(np.abs(self.gains))]
        by = (abs(largest) if self.real else largest) or 1.0
        return replace(self, gains=self.gains / by, shape=self.shape * by)


def _complex(parts: NDArray[np.float64]) -> NDArray[np.complex128]:
    half = len(parts) // 2
    return parts[:half] + 1j * parts[half:]


def _placed(old: NDArray[np.float64], values: NDArray, new: NDArray[np.float64]) -> NDArray[np.complex128]:
    found = np.zeros((len(values), len(new)), complex)
    kept = np.isin(old, new)
    found[:, np.searchsorted(new, old[kept])] = values[:, kept]
    return found


def _longer(band: NDArray[np.float64], by: float, highest: float, real: bool) -> NDArray[np.float64]:
    more = np.arange(1.0, by + 1.0)
    both = np.concatenate([[] if real else band[0] - more[::-1], band, band[-1] + more])
    return both[np.abs(both) <= highest]


@dataclass(frozen=True, slots=True, eq=False)
class Predictor(Rebuilt):
    """Modes, coefficients of the known columns and first states, with the innovations that they leave.

    Parameters
    ----------
    modes
        The modes.
    columns
        Coefficients of the known columns (channels, columns).
    initial
        The state at the first sample of each record (records, states).
    innovations
        e (channels, samples).
    states
        s (samples, states).
    """

    modes: tuple[Mode, ...]
    columns: NDArray[np.float64]
    initial: NDArray[np.float64]
    innovations: NDArray[np.float64]
    states: NDArray[np.float64]

    @property
    def covariance(self) -> NDArray[np.float64]:
        """That of the innovations (channels, channels)."""
        return self.innovations @ self.innovations.T / self.innovations.shape[1]

    @property
    def log_likelihood(self) -> float:
        """Twice the logarithm of the likelihood at its own covariance, up to a constant."""
        return -float(self.innovations.shape[1] * np.linalg.slogdet(self.covariance)[1])

    @property
    def n_parameters(self) -> int:
        """Real numbers that are free: the scale of each state is none."""
        return self.columns.size + self.initial.size + sum(_free(mode) for mode in self.modes)


def _free(mode: Mode) -> int:
    fixed = np.count_nonzero(mode.turns == 0.0) * len(mode.shape) + np.count_nonzero(mode.reach == 0.0) * len(mode.gains)
    return sum(mode.sizes) - (1 + fixed if mode.real else 2)


def predicted(
    samples: Samples, modes: Sequence[Mode], columns: NDArray[np.float64], initial: NDArray[np.float64]
) -> Predictor | None:
    """The predictor with its innovations; None where it diverges."""
    system, gains, seen, drive = _matrices(samples, modes)
    beside = samples.values - columns @ samples.known
    moved = system - gains @ seen
    drive = drive + np.einsum("kni,ik->kn", gains, beside)
    states = np.empty((samples.n_samples, len(system)))
    limit = LARGEST * np.abs(samples.values).max()
    for begin, own in zip(initial, samples.records, strict=True):
        state = begin
        for k in range(own.start, own.stop):
            states[k] = state
            state = moved[k] @ state + drive[k]
    innovations = beside - np.einsum("kin,kn->ik", seen, states)
    if not np.isfinite(innovations).all() or np.abs(innovations).max() > limit:
        return None
    return Predictor(tuple(modes), columns, initial, innovations, states)


def _matrices(
    samples: Samples, modes: Sequence[Mode]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Λ (states, states), K (samples, states, channels), C (samples, channels, states), Bu (samples, states)."""
    count, size = samples.n_samples, sum(mode.rows for mode in modes)
    channels, inputs = len(samples.values), len(samples.inputs)
    system = np.zeros((size, size))
    gains, seen = np.zeros((count, size, channels)), np.zeros((count, channels, size))
    drive, place = np.zeros((count, size)), 0
    for mode in modes:
        decay = np.exp(mode.exponent * samples.step)
        gain = np.tensordot(turning(samples, mode.reach), mode.gains, (0, 1))
        shape = np.tensordot(turning(samples, mode.turns), mode.shape, (0, 1))
        reached = np.einsum("ki,ik->k", gain[:, :inputs], samples.inputs)
        system[place, place], gains[:, place], seen[:, :, place] = decay.real, gain[:, inputs:].real, shape.real
        drive[:, place] = reached.real
        if not mode.real:
            system[place, place + 1], system[place + 1, place] = -decay.imag, decay.imag
            system[place + 1, place + 1] = decay.real
            gains[:, place + 1], seen[:, :, place + 1] = gain[:, inputs:].imag, -shape.imag
            drive[:, place + 1] = reached.imag
        place += mode.rows
    return system, gains, seen, drive


def turning(samples: Samples, turns: NDArray[np.float64]) -> NDArray[np.complex128]:
    """e^{imωt} of some harmonics (turns, samples)."""
    return np.array([samples.turned(turn) for turn in turns.tolist()]).reshape(len(turns), samples.n_samples)


def slopes(samples: Samples, at: Predictor) -> Iterator[tuple[slice, NDArray[np.float64]]]:
    """Derivatives of the innovations by all parameters, some samples at once (samples, channels, parameters).

    Parameters are those of `Mode.moved` of each mode, the coefficients of the known columns by channel, and the first
    states of each record.
    """
    system, gains, seen, _ = _matrices(samples, at.modes)
    moved = system - gains @ seen
    width = sum(sum(mode.sizes) for mode in at.modes) + at.columns.size + at.initial.size
    for number, record in enumerate(samples.records):
        now = np.zeros((len(system), width))
        first = width - at.initial.size + number * len(system)
        now[:, first : first + len(system)] = np.eye(len(system))
        for begin in range(record.start, record.stop, TOGETHER):
            own = slice(begin, min(begin + TOGETHER, record.stop))
            direct, forcing = _forcing(samples, at, gains, own, width)
            states = np.empty((own.stop - own.start + 1, *now.shape))
            states[0] = now
            for k in range(own.stop - own.start):
                np.matmul(moved[own.start + k], states[k], out=states[k + 1])
                states[k + 1] += forcing[k]
            now = states[-1]
            yield own, direct - seen[own] @ states[:-1]


def _forcing(
    samples: Samples, at: Predictor, gains: NDArray[np.float64], own: slice, width: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The derivatives of e, and those of the next state, at a state that is held (samples, channels | states, width)."""
    count, channels = own.stop - own.start, len(samples.values)
    direct = np.zeros((count, channels, width))
    forcing = np.zeros((count, gains.shape[1], width))
    drives = np.concatenate([samples.inputs[:, own], at.innovations[:, own]])
    place = row = 0

    def seen_by_all(signals: NDArray[np.float64], place: int) -> int:
        """Signals (signals, samples) that each channel may hold a share of, channels first."""
        for channel in range(channels):
            where = slice(place, place + len(signals))
            direct[:, channel, where] = -signals.T
            forcing[:, :, where] = -gains[own, :, channel, None] * signals.T[:, None, :]
            place += len(signals)
        return place

    for mode in at.modes:
        rows = slice(row, row + mode.rows)
        state = at.states[own, row] + (0j if mode.real else 1j * at.states[own, row + mode.rows - 1])
        late = samples.step * np.exp(mode.exponent * samples.step) * state
        forcing[:, row, place] = late.real
        if not mode.real:
            forcing[:, row + 1, place], forcing[:, row, place + 1] = late.imag, -late.imag
            forcing[:, row + 1, place + 1] = late.real
        place += mode.rows
        turned = turning_of(samples, mode.reach, own)
        driven = (drives[:, None] * turned).reshape(-1, count).T
        half = driven.shape[1]
        forcing[:, row, place : place + half], forcing[:, row, place + half : place + 2 * half] = driven.real, -driven.imag
        if not mode.real:
            forcing[:, row + 1, place : place + half] = driven.imag
            forcing[:, row + 1, place + half : place + 2 * half] = driven.real
        place += 2 * half
        carried = turning_of(samples, mode.turns, own) * state
        place = seen_by_all(carried.real, place)
        place = seen_by_all(-carried.imag, place)
        row = rows.stop
    place = seen_by_all(samples.known[:, own], place)
    return direct, forcing


def turning_of(samples: Samples, turns: NDArray[np.float64], own: slice) -> NDArray[np.complex128]:
    """e^{imωt} of some harmonics at some samples (turns, samples)."""
    return np.array([samples.turned(turn)[own] for turn in turns.tolist()]).reshape(len(turns), -1)
