"""One stretch of a record, in which the modes have factors of their own and the phase a slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel
from floquid.views._modes import is_real, upper_modes

STEPS, AT_REST = 20, 1e-7
"""Gauss-Newton steps at most, and the step [rad], of the deviation, below which it is at rest."""

LONGEST = 0.5
"""The longest step of the slip [rad over the highest harmonic]: phases turn no further than the linear part holds."""

TOLD = 0.5
"""The deviation [rad] from which on a phase is not told."""

TURNS = 1e-9
"""Turns a period from which on a line turns at all."""

SEEN = 1e-9
"""The share of the slope's energy that no factor of a mode takes up, below which a stretch does not tell the slip."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples of all channels over their noise, and the lines of the model there.

    With harmonics of one multiplier that is real come their mirror images: its factor then stays real by itself.
    """

    values: NDArray[np.float64]
    """(channels, samples), zero where a sample is missing."""
    there: NDArray[np.bool_]
    """(channels, samples)."""
    waves: NDArray[np.complex128]
    """e^{λt + imθ} of each line, from the stretch's middle on (lines, samples)."""
    sizes: NDArray[np.complex128]
    """What each line has in each channel, in the middle, over the noise (lines, channels)."""
    turns: NDArray[np.float64]
    """How often each line turns in a period, beside what its mode turns (lines,)."""
    places: NDArray[np.int64]
    """Which factor each line has (lines,)."""
    mirrored: NDArray[np.bool_]
    """Which lines have a mirror image among the lines (lines,)."""
    names: list[tuple[int, int]]
    """The mode and the harmonic of each line."""

    @classmethod
    def of(
        cls,
        model: PeriodicModel,
        times: NDArray[np.float64],
        angles: NDArray[np.float64],
        values: NDArray[np.float64],
        gain: NDArray[np.complex128],
        noise: NDArray[np.float64],
    ) -> Stretch:
        """The samples at `times` [s] and `angles` [rad]; `gain` is a filter's (channels, modes, harmonics)."""
        middle = len(times) // 2
        rates, sizes, turns, places, mirrored, names = [], [], [], [], [], []
        for place, mode in enumerate(upper_modes(model)):
            lam, real = model.exponents[mode], is_real(model, mode)
            half = lam.imag / model.fundamental if real else 0.0
            # What locks to the period turns in the angle alone.
            rate = complex(lam.real, 0.0) if real else complex(lam)
            for index in np.flatnonzero((model.coefficients[mode, :, 0] != 0).any(axis=0)):
                m = float(model.harmonics[index]) + half
                own = model.coefficients[mode, :, 0, index] * gain[:, mode, index] / noise
                rates.append(rate)
                turns.append(m)
                sizes.append(own * (1.0 if real else 2.0) * np.exp(rate * times[middle] + 1j * m * angles[middle]))
                places.append(place)
                mirrored.append(real and abs(m) > TURNS)
                names.append((mode, int(model.harmonics[index])))
        alone = np.exp(np.multiply.outer(np.array(rates), times - times[middle]))
        waves = alone * np.exp(1j * np.multiply.outer(np.array(turns), angles - angles[middle]))
        return cls(
            values=np.nan_to_num(values / noise[:, None]),
            there=~np.isnan(values),
            waves=waves,
            sizes=np.array(sizes),
            turns=np.array(turns),
            places=np.array(places, np.int64),
            mirrored=np.array(mirrored, bool),
            names=names,
        )

    def slip(self, start: float) -> tuple[float, float]:
        """By how much the response is ahead [rad], and its deviation; NaN where that is not told."""
        count = int(self.places.max()) + 1
        factors: NDArray[np.complex128] = np.ones(count, np.complex128)
        slip, std = start, np.nan
        belongs = (self.places[:, None] == np.arange(count)).astype(float)
        reach = LONGEST / max(float(np.abs(self.turns).max()), 1.0)
        for _ in range(STEPS):
            own = self.sizes * np.exp(1j * self.turns * slip)[:, None]
            # The response of each mode, (modes, channels, samples).
            parts = np.einsum("lr,lc,lk->rck", belongs, own, self.waves, optimize=True)
            turned = factors[self.places, None] * 1j * self.turns[:, None] * own
            parts = np.asarray(parts, np.complex128)
            columns = np.concatenate([parts.real, -parts.imag, (turned.T @ self.waves).real[None]]) * self.there
            left = (self.values - np.einsum("r,rck->ck", factors, parts).real) * self.there
            flat = columns.reshape(len(columns), -1)
            information, gradient = flat @ flat.T, flat @ left.ravel()
            # A factor that the stretch does not tell stays near that of the whole record.
            information[:-1, :-1] += np.eye(2 * count)
            gradient[:-1] -= np.concatenate([factors.real - 1.0, factors.imag])
            taken = np.linalg.solve(information[:-1, :-1], information[:-1, -1])
            alone = information[-1, -1] - information[-1, :-1] @ taken
            if not alone > SEEN * information[-1, -1]:
                return np.nan, np.nan
            std = float(alone**-0.5)
            step = np.linalg.solve(information, gradient)
            short = min(1.0, reach / max(abs(step[-1]), 1e-300))
            factors += short * (step[:count] + 1j * step[count:-1])
            slip += float(short * step[-1])
            if abs(step[-1]) < AT_REST * std:
                break
        return (slip, std) if std < TOLD else (np.nan, np.nan)

    def phases(self, lines: list[tuple[int, int]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The phase of lines against the model, all others as the model has them, and its deviation (lines,) [rad]."""
        left = (self.values - (self.sizes.T @ self.waves).real) * self.there
        found, std = np.full((2, len(lines)), np.nan)
        for number, name in enumerate(lines):
            line = self.names.index(name)
            wave = (2.0 if self.mirrored[line] else 1.0) * self.sizes[line][:, None] * self.waves[line] * self.there
            energy = float(np.sum(np.abs(wave) ** 2))
            if energy * TOLD**2 <= 2.0:
                continue
            factor = 1.0 + 2.0 * np.sum(wave.conj() * left) / energy
            deviation = np.sqrt(2.0 / energy) / max(abs(factor), 1e-300)
            if deviation < TOLD:
                found[number], std[number] = np.angle(factor), deviation
        return found, std
