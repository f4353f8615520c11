"""A mode of the innovations form."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt


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
    def axis(self) -> float:
        """The turns of a real multiplier, 0 or ½ if it is negative; 0 of a pair, whose exponent has its own."""
        return float(self.turns[0] % 1.0) if self.real else 0.0

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Real parameters of the exponent, of the gains and of the shape."""
        return self.rows, 2 * self.gains.size, 2 * self.shape.size

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Those of gains and shape, zero for the exponent (parameters,)."""
        parts = [np.ravel(part) for own in (self.gains, self.shape) for part in (own.real, own.imag)]
        return np.concatenate([np.zeros(self.rows), *parts])

    def moved(self, step: NDArray[np.float64]) -> Mode:
        """With the parameters moved by a step: λ, gains, shape, of each the real parts and then the imaginary ones."""
        of_exponent, of_gains, of_shape = np.split(step, np.cumsum(self.sizes)[:2])
        return replace(
            self,
            exponent=self.exponent + complex(of_exponent[0], 0.0 if self.real else of_exponent[-1]),
            gains=self.gains + as_complex(of_gains).reshape(self.gains.shape),
            shape=self.shape + as_complex(of_shape).reshape(self.shape.shape),
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

    def turned(self, by: float, omega: float, step: float) -> Mode:
        """The same mode on another branch: λ + i·by·ω."""
        return replace(
            self,
            exponent=self.exponent + 1j * by * omega,
            turns=self.turns - by,
            reach=self.reach + by,
            gains=self.gains * np.exp(1j * by * omega * step),
        )

    def conjugate(self) -> Mode:
        """The same pair by its other exponent; a real multiplier is itself."""
        if self.real:
            return self
        return replace(
            self,
            exponent=self.exponent.conjugate(),
            turns=-self.turns[::-1],
            shape=self.shape[:, ::-1].conj(),
            reach=-self.reach[::-1],
            gains=self.gains[:, ::-1].conj(),
        )

    def scaled(self) -> Mode:
        """With a state of such a size that the largest gain is 1."""
        largest = self.gains.ravel()[np.argmax(np.abs(self.gains))]
        by = (abs(largest) if self.real else largest) or 1.0
        return replace(self, gains=self.gains / by, shape=self.shape * by)


def as_complex(parts: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Complex numbers of their real parts and then their imaginary ones (parts,)."""
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
    # On another branch a band may reach beyond the highest harmonic: it keeps what it has.
    return both[(both >= min(band[0], -highest)) & (both <= max(band[-1], highest))]
