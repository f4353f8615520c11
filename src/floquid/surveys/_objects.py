"""Modes of one point as objects to follow: pairs, couples of real multipliers, single real ones; how alike they are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats

REAL = 1e-6  # of half a fundamental: frequencies that are whole multiples of it
SHIFTS = 6  # harmonics by which a branch may differ from the one before, on either side
ALIKE = 0.8  # share of the best similarity above which a branch may be chosen for its frequency


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """One object of a point: what is followed from point to point.

    Parameters
    ----------
    modes
        The modes of the result: one, or both of a couple.
    exponents
        λ of each (modes,) [1/s].
    covariance
        Of real parts, then imaginary parts (2 modes, 2 modes); zero where none was estimated.
    shapes
        Coefficients over the noise of their channels (modes, channels, harmonics), harmonics from -n to n.
    deviations
        Of the real parts as the real part, of the imaginary parts as the imaginary part, as the shapes.
    fundamental
        ω [rad/s].
    weak
        True where no edge may rest on it.
    """

    modes: tuple[int, ...]
    exponents: Complexes
    covariance: Floats
    shapes: Complexes
    deviations: Complexes
    fundamental: float
    weak: bool = False

    @property
    def exponent(self) -> complex:
        """The mean of its exponents [1/s]."""
        return complex(self.exponents.mean())

    @property
    def real(self) -> bool:
        """True of real multipliers: 2 Im λ is a whole number of fundamentals."""
        turns = 2.0 * self.exponents.imag / self.fundamental
        return bool((np.abs(turns - np.rint(turns)) < REAL).all())

    @property
    def growth(self) -> float:
        """The largest real part of its exponents [1/s]."""
        return float(self.exponents.real.max())

    def on(self, shift: int, conjugated: bool) -> Seen:
        """The object with its exponents moved by `shift` fundamentals, of its mirror image where `conjugated`.

        One and the same response: e^{λt} Σ B_m e^{imωt} is also that of λ + isω with B_{m+s}.
        """
        lam, shapes, deviations = self.exponents, self.shapes, self.deviations
        covariance = self.covariance
        if conjugated:
            lam, shapes, deviations = lam.conj(), shapes.conj()[..., ::-1], deviations[..., ::-1]
            sign = np.repeat([1.0, -1.0], len(lam))
            covariance = covariance * np.multiply.outer(sign, sign)
        return replace(
            self,
            exponents=lam + 1j * shift * self.fundamental,
            covariance=covariance,
            shapes=moved(shapes, shift),
            deviations=moved(deviations, shift),
        )

    def drawn(self, count: int, generator: np.random.Generator) -> tuple[Complexes, Complexes]:
        """Exponents (draws, modes) and shapes (draws, modes, channels, harmonics) from their deviations."""
        values, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        real, imag = np.split(generator.standard_normal((count, len(values))) @ root.T, 2, axis=1)
        shapes = np.repeat(self.shapes[None], count, axis=0)
        known = self.deviations != 0.0
        noise = generator.standard_normal((2, count, np.count_nonzero(known)))
        shapes[:, known] += noise[0] * self.deviations[known].real + 1j * noise[1] * self.deviations[known].imag
        return self.exponents + real + 1j * imag, shapes


def moved(shapes: Complexes, shift: int) -> Complexes:
    """B_{m+s} in the place of B_m (…, harmonics); zero where there is none."""
    out = np.zeros_like(shapes)
    size = shapes.shape[-1]
    kept = max(size - abs(shift), 0)
    low = max(-shift, 0)
    out[..., low : low + kept] = shapes[..., low + shift : low + shift + kept]
    return out


def similarity(a: Complexes, b: Complexes) -> Floats:
    r"""Squared cosine between the spans of shapes (…, modes, numbers): of two modes their MAC.

    .. math:: \|Q_a^H Q_b\|_F^2 / \min(n_a, n_b)

    with Q orthonormal bases: of a pair and a couple the norm of the pair's projection onto the couple's span.
    """
    a, b = _basis(a), _basis(b)
    overlap = np.abs(a.conj() @ np.swapaxes(b, -1, -2)) ** 2
    return overlap.sum(axis=(-2, -1)) / min(a.shape[-2], b.shape[-2])


def _basis(shapes: Complexes) -> Complexes:
    """Orthonormal rows that span the shapes (…, modes, numbers)."""
    if shapes.shape[-2] > 1:
        return np.swapaxes(np.linalg.qr(np.swapaxes(shapes, -1, -2))[0], -1, -2)
    return shapes / np.maximum(np.linalg.norm(shapes, axis=-1, keepdims=True), 1e-300)


BRANCHES = [(shift, mirrored) for shift in range(-SHIFTS, SHIFTS + 1) for mirrored in (False, True)]


def similarities(known: Seen, new: Seen) -> Floats:
    """Similarity of `known`, on its branch, to each branch of `new` (branches,)."""
    size = known.shapes.shape[-1]
    both = np.stack([new.shapes, new.shapes.conj()[..., ::-1]])
    padded = np.pad(both, [(0, 0)] * 3 + [(SHIFTS, SHIFTS)])
    stacked = np.moveaxis(np.lib.stride_tricks.sliding_window_view(padded, size, axis=-1), 3, 0)
    stacked = stacked.reshape(len(BRANCHES), len(new.exponents), -1)
    return similarity(known.shapes.reshape(1, len(known.exponents), -1), stacked)


def branch_of(found: Floats, new: Seen, wanted: complex) -> tuple[int, complex]:
    """The branch of `new` among those that are alike whose frequency is nearest to `wanted`, and how far off it is.

    `found` are the similarities of the branches (branches,); the place of one among `BRANCHES` is given back.
    """
    lam = new.exponent
    shifts, mirrored = np.array(BRANCHES).T
    frequencies = np.where(mirrored, -lam.imag, lam.imag) + shifts * new.fundamental
    off = np.where(found >= ALIKE * found.max(), np.abs(frequencies - wanted.imag), np.inf)
    best = int(off.argmin())
    return best, complex(lam.real, frequencies[best]) - wanted


def invariants(a: complex, b: complex) -> tuple[Floats, Floats]:
    r"""Invariants of two exponents that meet, smooth where they do, and their slopes.

    .. math:: \mu = (\lambda_a + \lambda_b)/2, \qquad q = ((\lambda_a - \lambda_b)/2)^2

    The real part of μ, that of q and the imaginary part of q (3,), by the real parts of both exponents, then the
    imaginary parts (3, 4).
    """
    mean, half = 0.5 * (a + b), 0.5 * (a - b)
    ahead, across = np.array([0.5, -0.5, 0.0, 0.0]), np.array([0.0, 0.0, 0.5, -0.5])
    u, v, square = half.real, half.imag, half**2
    slopes = np.array([[0.5, 0.5, 0.0, 0.0], 2.0 * (u * ahead - v * across), 2.0 * (v * ahead + u * across)])
    return np.array([mean.real, square.real, square.imag]), slopes
