"""A mode of the innovations form, and the block of two near an axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt
from floquid.inputs import parts_of, slopes_along_square
from floquid.search import longer


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mode(Rebuilt):
    r"""One mode of the innovations form: a pair of conjugates, or a real multiplier.

    .. math:: z_{k+1} = e^{\lambda h} z_k + \sum_{d,l} g_{d,l}\, e^{i l \omega t_k} v_d, \qquad
              y = \Re \sum_m s_m e^{i m \omega t} z

    v are the measured inputs, then the innovations. Of a real multiplier z and what drives it are real parts, and l
    and m count from 0, or from ½ if it is negative.

    A block has two real states, z + j w with j² = q, and the exponent σ + j: two exponents σ ± √q of either kind. Its
    gains and its shape are those of both states, those of z first.
    """

    exponent: complex  # λ [1/s]
    real: bool  # True for a real multiplier
    # The harmonics m, ascending (turns,), and s (channels, turns)
    turns: Floats
    shape: Complexes
    # The harmonics l, ascending (reach,), and g (inputs + channels, reach)
    reach: Floats
    gains: Complexes
    square: float | None = None  # q of a block [1/s²], whose exponent is σ; its states are real

    @property
    def rows(self) -> int:
        """Real states."""
        return 1 if self.real and self.square is None else 2

    @property
    def axis(self) -> float:
        """The turns of a real multiplier, 0 or ½ if it is negative; 0 of a pair, whose exponent has its own."""
        return float(self.turns[0] % 1.0) if self.real else 0.0

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Real parameters of the exponent, of the gains and of the shape."""
        return self.rows, 2 * self.gains.size, 2 * self.shape.size

    @property
    def parameters(self) -> Floats:
        """Parameters of gains and shape, zero for the exponent (parameters,)."""
        parts = [np.ravel(part) for own in (self.gains, self.shape) for part in (own.real, own.imag)]
        return np.concatenate([np.zeros(self.rows), *parts])

    def moved(self, step: Floats) -> Mode:
        """With the parameters moved by a step: λ, or σ and q, gains, shape, real parts before imaginary ones."""
        of_exponent, of_gains, of_shape = np.split(step, np.cumsum(self.sizes)[:2])
        return replace(
            self,
            exponent=self.exponent + complex(of_exponent[0], 0.0 if self.real else of_exponent[-1]),
            square=None if self.square is None else self.square + float(of_exponent[-1]),
            gains=self.gains + as_complex(of_gains).reshape(self.gains.shape),
            shape=self.shape + as_complex(of_shape).reshape(self.shape.shape),
        )

    def transition(self, step: float) -> Floats:
        """The real states after a step, by those before (rows, rows)."""
        if self.square is None:
            decay = np.exp(self.exponent * step)
            return np.array([[decay.real, -decay.imag], [decay.imag, decay.real]])[: self.rows, : self.rows]
        return _of_block(parts_of(self._ahead(step), self.square, 1.0 / step), self.square)

    def transition_slopes(self, step: float) -> Floats:
        """Derivatives of the transition by Re λ and Im λ, or by σ and q (rows, rows, rows)."""
        late = step * self.transition(step)
        if self.square is None:
            return np.array([late, late @ [[0.0, -1.0], [1.0, 0.0]]] if self.rows == 2 else [late])
        ahead = self._ahead(step)
        by_square = slopes_along_square(ahead, lambda root: step * ahead(root), self.square, 1.0 / step)
        odd = float(np.real(parts_of(ahead, self.square, 1.0 / step)[1]))
        along_square = _of_block(by_square, self.square)
        along_square[0, 1] += odd
        return np.array([late, along_square])

    def _ahead(self, step: float) -> Callable[[complex], NDArray]:
        return lambda root: np.asarray(np.exp((self.exponent + root) * step))

    def widened(self, turns: Floats, reach: Floats) -> Mode:
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
        return self.widened(*(longer(band, by, highest, self.real) for band in (self.turns, self.reach)))

    def seen_wider(self, by: float, highest: float) -> Mode:
        """With some harmonics more at each end of what the outputs see."""
        return self.widened(longer(self.turns, by, highest, self.real), self.reach)

    def turned(self, by: float, omega: float, step: float) -> Mode:
        """Move the mode to another branch: λ + i·by·ω."""
        return replace(
            self,
            exponent=self.exponent + 1j * by * omega,
            turns=self.turns - by,
            reach=self.reach + by,
            gains=self.gains * np.exp(1j * by * omega * step),
        )

    def conjugate(self) -> Mode:
        """Describe a pair by its other exponent; a real multiplier is itself."""
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


def _of_block(parts: NDArray, square: float) -> Floats:
    """The product with a number of two parts as a matrix of both states (2, 2)."""
    even, odd = np.real(parts)
    return np.array([[even, square * odd], [odd, even]])


def as_complex(parts: Floats) -> Complexes:
    """Complex numbers of their real parts and then their imaginary ones (parts,)."""
    half = len(parts) // 2
    return parts[:half] + 1j * parts[half:]


def _placed(old: Floats, values: NDArray, new: Floats) -> Complexes:
    found = np.zeros((len(values), len(new)), complex)
    kept = np.isin(old, new)
    found[:, np.searchsorted(new, old[kept])] = values[:, kept]
    return found
