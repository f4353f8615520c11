"""Modes of one point as objects to follow: pairs, couples of real multipliers, single real ones; how alike they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from floquid._arrays import Complexes, Floats

REAL = 1e-6  # of half a fundamental: frequencies that are whole multiples of it
SHIFTS = 6  # harmonics by which a branch may differ from the one before, on either side
TURNED = 1e-6  # fall of the costs of all pairs below which phase zero stays: shapes that do not vary turn for nothing
ALIKE = 0.8  # share of the best similarity above which a branch may be chosen for its frequency


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One object of a point: what is followed from point to point."""

    modes: tuple[int, ...]  # of the result: one, or both of a couple
    exponents: Complexes  # λ of each (modes,) [1/s]
    covariance: Floats  # real parts, then imaginary parts (2 modes, 2 modes); zero where none was estimated
    shapes: Complexes  # over the noise of their channels (modes, channels, harmonics), harmonics from -n to n
    deviations: Complexes  # of the shapes: of real parts the real part, of imaginary parts the imaginary part
    fundamental: float  # ω [rad/s]
    weak: bool = False  # no edge may rest on it
    agreement: float = 1.0  # one where all hits have its shape, less where it stands for several modes

    @cached_property
    def basis(self) -> Complexes:
        """Orthonormal rows that span its shapes (modes, numbers)."""
        return basis_of(flat(self.shapes))

    @cached_property
    def branches(self) -> Complexes:
        """Orthonormal rows that span its shapes on each branch (branches, modes, numbers)."""
        return basis_of(flat(_branches(self)))

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

    def turned(self, angle: float) -> Seen:
        """The object with phase zero of its record moved by `angle` of the period [rad]."""
        waves = waves_at(angle, self.shapes.shape[-1])
        real, imag = self.deviations.real**2, self.deviations.imag**2
        ahead, across = waves.real**2, waves.imag**2
        deviations = np.sqrt(ahead * real + across * imag) + 1j * np.sqrt(across * real + ahead * imag)
        return replace(self, shapes=self.shapes * waves, deviations=deviations)

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
    r"""Squared cosine between the spans of bases (…, modes, numbers): of two modes their MAC.

    .. math:: \|Q_a^H Q_b\|_F^2 / \min(n_a, n_b)

    with Q orthonormal bases: of a pair and a couple the norm of the pair's projection onto the couple's span.
    """
    overlap = np.abs(a.conj() @ np.swapaxes(b, -1, -2)) ** 2
    return overlap.sum(axis=(-2, -1)) / min(a.shape[-2], b.shape[-2])


def basis_of(shapes: Complexes) -> Complexes:
    """Orthonormal rows that span the shapes (…, modes, numbers)."""
    if shapes.shape[-2] > 1:
        return np.swapaxes(np.linalg.qr(np.swapaxes(shapes, -1, -2))[0], -1, -2)
    return shapes / np.maximum(np.linalg.norm(shapes, axis=-1, keepdims=True), 1e-300)


BRANCHES = [(shift, mirrored) for shift in range(-SHIFTS, SHIFTS + 1) for mirrored in (False, True)]


def similarities(known: Seen, new: Seen) -> Floats:
    """Similarity of `known`, on its branch, to each branch of `new` (branches,)."""
    return similarities_of_all([known], new)[0]


def similarities_of_all(known: Sequence[Seen], new: Seen) -> Floats:
    """Similarity of each of the `known`, on its branch, to each branch of `new` (known, branches)."""
    return np.array([similarity(one.basis, new.branches) for one in known])


def _branches(thing: Seen) -> Complexes:
    """The shapes of an object on each branch (branches, modes, channels, harmonics)."""
    both = np.stack([thing.shapes, thing.shapes.conj()[..., ::-1]])
    padded = np.pad(both, [(0, 0)] * 3 + [(SHIFTS, SHIFTS)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, thing.shapes.shape[-1], axis=-1)
    return np.moveaxis(windows, 3, 0).reshape(len(BRANCHES), *thing.shapes.shape)


def flat(shapes: Complexes) -> Complexes:
    """Shapes (…, channels, harmonics) with channels and harmonics in one row (…, numbers)."""
    return shapes.reshape(*shapes.shape[:-2], -1)


def waves_at(angles: float | Floats, size: int) -> Complexes:
    """Factors e^{imφ} of `size` harmonics, from -n to n, where phase zero moves by angles φ (…, harmonics)."""
    return np.exp(1j * np.multiply.outer(angles, np.arange(size) - size // 2))


def turn_between(known: Sequence[Seen], new: Sequence[Seen], wanted: Sequence[complex], near: float) -> float:
    r"""The angle by which phase zero of `new` objects is moved to that of the `known` ones [rad], one for all.

    .. math:: \min_\varphi \min \sum 1 - \mathrm{mac}_{ab}(\varphi) + \min(1, |\lambda_a - \lambda_b| / \epsilon)

    over all assignments of pairs and all branches, ε `near` fundamentals and λ as `wanted` of the known ones. Records
    start where they start, at a blow or at any instant, unless they have a clock in common: each harmonic of a shape
    turns with that instant. Zero where no angle is better than it, as where shapes do not vary.
    """
    from scipy.optimize import linear_sum_assignment, minimize_scalar

    if not known or not new:
        return 0.0
    size = known[0].shapes.shape[-1]
    grid = 2.0 * np.pi * np.arange(4 * size) / (4 * size)
    products = [[_products(one, other) for other in new] for one in known]
    steps = np.array([[_steps(other, lam, near) for other in new] for lam in wanted])

    def costs(angles: Floats) -> Floats:
        """Costs of each pair on each branch (angles, known, new, branches)."""
        waves = waves_at(angles, size).T
        macs = np.array([[np.sum(np.abs(own @ waves) ** 2, axis=(1, 2)).T for own in row] for row in products])
        return 1.0 - np.moveaxis(macs, 2, 0) + steps

    totals = []
    for own in costs(grid).min(axis=-1):
        rows, columns = linear_sum_assignment(own)
        totals.append(float(own[rows, columns].sum()))
    first = int(np.argmin(totals))
    rows, columns = linear_sum_assignment(costs(grid[[first]])[0].min(axis=-1))
    near_it = (grid[first] - grid[1], grid[first] + grid[1])
    found = minimize_scalar(
        lambda angle: costs(np.array([angle]))[0].min(axis=-1)[rows, columns].sum(), bounds=near_it, method="bounded"
    )
    return float(found.x) if totals[0] - found.fun > TURNED else 0.0


def _products(known: Seen, new: Seen) -> Complexes:
    """Inner products of the bases of two objects by harmonic, the new one on each branch."""
    own = known.basis.reshape(known.shapes.shape)
    others = new.branches.reshape(len(BRANCHES), *new.shapes.shape)
    return np.einsum("acm,kbcm->kabm", own.conj(), others) / np.sqrt(min(len(own), others.shape[1]))


def _steps(new: Seen, wanted: complex, near: float) -> Floats:
    """Costs of the step of an object's exponent from a `wanted` one, on each branch (branches,)."""
    shifts, mirrored = np.array(BRANCHES).T
    lam = new.exponent
    frequencies = np.where(mirrored, -lam.imag, lam.imag) + shifts * new.fundamental
    return np.minimum(1.0, np.abs(lam.real + 1j * frequencies - wanted) / (near * new.fundamental))


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
