r"""The common or matrix denominator of rational responses: its basis, its normal matrix, its roots.

On lines z^N = 1 the transform of N samples of free response is rational in x = 1/z without leakage (`_spectrum`), and
so it is on any subset of them. With a denominator A(x) = Σ_k q_k(x) C_k of degree n, blocks C_k (inputs, inputs), and
numerators b_o of degree n - 1 that are eliminated, the equations of all outputs o are linear in the denominator,

.. math:: Y_o(x_l)^T A(x_l) - b_o(x_l)^T = 0, \qquad M = \sum_o E_o^T E_o

The q_k are powers of x on all lines, and on a band the polynomials that Arnoldi's recurrence makes orthonormal there:
bases of the same polynomials, so that a band moves no root. White noise adds to M a multiple of a matrix known exactly;
in its metric the eigenvalues of M are one where there is noise alone. What rises above holds the modes, and every other
direction is a denominator with their poles among its roots. Taken is the one of least norm with a fixed coefficient:
the highest power of x, and the roots that belong to no mode have |μ| > 1; the constant, and they have |μ| < 1 (R.
Kumaresan and D. W. Tufts, IEEE Trans. ASSP 30(6), 1982; G. Szegő, "Orthogonal Polynomials", 1939, chapter 11). Decaying
modes are taken from the first, growing ones from the second; least squares would take damping away with the noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import BLOCK, Complexes, Floats, Integers, Mask
from floquid.fit import ROUNDING, SLOW
from floquid.lti._exponentials import complex_residues, powers, real_basis, real_powers
from floquid.lti._poles import PoleSet, line_weights
from floquid.lti._significance import Removal, weakest
from floquid.lti._types import ModalModel, Outcome, TimeResponses


@dataclass(frozen=True, slots=True)
class Basis:
    """Polynomials q_0 … q_n of x: q_0 = `first`, x q_k = Σ_j h_jk q_j with the Hessenberg matrix h (n + 1, n)."""

    first: float
    hessenberg: Floats

    @property
    def degree(self) -> int:
        """The degree n of the last."""
        return self.hessenberg.shape[1]

    @staticmethod
    def powers(degree: int) -> Basis:
        """The powers of x, which are orthogonal on all lines."""
        return Basis(1.0, np.eye(degree + 1, degree, -1))

    @staticmethod
    def on(band: Band, degree: int) -> Basis:
        """Polynomials orthonormal on the weighted lines of a band, as sums over real and imaginary parts."""
        weights = band.weights
        q = np.zeros((degree + 1, 2 * len(weights)))
        h = np.zeros((degree + 1, degree))
        first = 1.0 / float(np.linalg.norm(weights))
        q[0] = stacked((first * weights).astype(np.complex128))
        half = len(weights)
        for k in range(degree):
            new = stacked(band.x * (q[k, :half] + 1j * q[k, half:]))
            for _ in range(2):  # once more, since the first pass leaves rounding of what it took away
                shares = q[: k + 1] @ new
                h[: k + 1, k] += shares
                new = new - shares @ q[: k + 1]
            h[k + 1, k] = np.linalg.norm(new)
            q[k + 1] = new / h[k + 1, k]
        return Basis(first, h)

    def at(self, x: Complexes) -> Complexes:
        """The values (points, n + 1)."""
        q = np.zeros((len(x), self.degree + 1), complex)
        q[:, 0] = self.first
        for k in range(self.degree):
            h = self.hessenberg[: k + 2, k]
            q[:, k + 1] = (x * q[:, k] - q[:, : k + 1] @ h[:-1]) / h[-1]
        return q


@dataclass(frozen=True, slots=True)
class Band:
    """The lines of N samples from one fraction of the Nyquist angle to another."""

    samples: int
    low: float = 0.0
    high: float = 1.0

    @property
    def whole(self) -> bool:
        """True where the band is all lines."""
        return self.low == 0.0 and self.high == 1.0

    @property
    def lines(self) -> Integers:
        """The numbers of the lines (lines,)."""
        lines = np.arange(self.samples // 2 + 1)
        angle = 2.0 * lines / self.samples
        return lines[(angle >= self.low - 1e-9) & (angle <= self.high + 1e-9)]

    @property
    def x(self) -> Complexes:
        """e^{-iθ} at the lines (lines,)."""
        return np.exp(-2j * np.pi * self.lines / self.samples)

    @property
    def weights(self) -> Floats:
        """√2 on all lines but the ends (lines,)."""
        return line_weights(self.samples)[self.lines]

    @property
    def size(self) -> int:
        """Number of real numbers in the lines of one response."""
        return int(np.rint(np.sum(self.weights**2)))

    def spectrum(self, values: Floats) -> Complexes:
        """The weighted lines (…, lines) of responses (…, samples): unit white noise stays of unit variance."""
        return np.fft.rfft(values)[..., self.lines] * (self.weights / np.sqrt(self.samples))

    def holds(self, s: Complexes) -> Mask:
        """Mask of logarithms of multipliers, 0 ≤ Im s ≤ π, with angles in the band."""
        return (s.imag >= np.pi * self.low - 1e-9) & (s.imag <= np.pi * self.high + 1e-9)


def stacked(lines: Complexes) -> Floats:
    """Real parts, then imaginary parts, along the last axis."""
    return np.concatenate([lines.real, lines.imag], axis=-1)


@dataclass(frozen=True, slots=True)
class Equations:
    """Matrices of one band: the basis on lines (lines, n + 1), the numerators' orthonormal span (2 lines, n), and N."""

    band: Band
    values: Complexes
    numerators: Floats

    @staticmethod
    def of(basis: Basis, band: Band) -> Equations:
        """The equations on a band in a basis, which may have been made for another length."""
        values = basis.at(band.x)
        weighted = stacked((band.weights[:, None] * values[:, :-1]).T).T
        return Equations(band, values, np.linalg.qr(weighted)[0])

    def noise(self) -> Floats:
        """Addition to the normal matrix by unit white noise on one response (n + 1, n + 1)."""
        half = len(self.values)
        leverage = np.sum(self.numerators[:half] ** 2 + self.numerators[half:] ** 2, axis=1)
        left = self.band.weights**2 - leverage
        return np.asarray((self.values.conj().T @ (left[:, None] * self.values)).real)

    def triangle(self, lines: Iterable[Complexes]) -> Floats:
        """R (rows, (n + 1) inputs) with RᵀR = M, from weighted lines (outputs, inputs, lines) by orthogonal steps."""
        width = self.values.shape[1]
        root = np.zeros((0, 0))
        for block in lines:
            for output in block:
                # A column is a power and an input, the power first.
                rows = stacked((self.values.T[:, None] * output).reshape(width * len(output), -1)).T
                rows = rows - self.numerators @ (self.numerators.T @ rows)
                root = np.concatenate([root.reshape(-1, rows.shape[1]), rows])
                if len(root) > 8 * rows.shape[1]:
                    root = np.asarray(np.linalg.qr(root, mode="r"))
        return np.asarray(np.linalg.qr(root, mode="r"))


@dataclass(frozen=True, slots=True)
class Denominators:
    """The directions of denominators in the metric of the noise, those of the modes first.

    `values` (m,) are the eigenvalues of the normal matrix, descending, one for unit noise; `directions` (m, m) are the
    coefficients, power by power and input by input within; `equations` is the number of equations.
    """

    basis: Basis
    samples: int
    inputs: int
    values: Floats
    directions: Floats
    equations: int
    rounding: float

    @staticmethod
    def of(
        basis: Basis, samples: int, normal: Floats, noise: tuple[Floats, Floats], equations: int, *, squared: bool
    ) -> Denominators:
        """From the normal matrix M or, where it is not `squared`, from R with RᵀR = M.

        `noise` is what noise adds to M: over the powers (n + 1, n + 1), and how much of that on each input (inputs,).
        """
        over_powers, of_inputs = noise
        inverse = np.kron(np.linalg.inv(np.linalg.cholesky(over_powers)).T, np.diag(1.0 / np.sqrt(of_inputs)))
        if squared:
            values, vectors = np.linalg.eigh(inverse.T @ normal @ inverse)
            values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
        else:
            _, roots, right = np.linalg.svd(normal @ inverse, full_matrices=True)
            values, vectors = np.concatenate([roots**2, np.zeros(len(right) - len(roots))]), right.T
        rounding = ROUNDING if squared else ROUNDING**2
        directions = np.asarray(inverse @ vectors, dtype=np.float64)
        return Denominators(basis, samples, len(of_inputs), values, directions, equations, rounding)

    def rank(self, order: int | None = None) -> int:
        """Number of directions that hold modes: those above the noise, or `order` if those are fewer."""
        # The noise is believed to be one, unless the lower quartile of the eigenvalues tells otherwise: above one it is
        # the noise, and far below one, too. The limit is the edge of Marchenko and Pastur, which a few eigenvalues of
        # noise pass, for the equations are not independent: one direction too many costs little, one too few a bias.
        size = len(self.values)
        share = size / self.equations
        quartile = float(self.values[size - 1 - size // 4])
        noise = max(min(1.0, quartile * (1.0 + 2.0 * np.sqrt(share)) ** 2), quartile)
        above = int((self.values > noise * (1.0 + np.sqrt(share)) ** 2).sum())
        real = int((self.values > self.rounding * size * self.values[0]).sum())
        return min(max(above, order or 0), real, size - self.inputs)

    def roots(self, rank: int) -> tuple[Complexes, Complexes]:
        """Multipliers (k,) and participations (k, inputs) of what decays and of what grows."""
        null = self.directions[:, rank:]
        highest = np.zeros(self.basis.degree + 1)
        highest[-1] = 1.0
        constant = self.basis.at(np.zeros(1, complex))[0].real
        found = []
        for fixed, is_highest in ((highest, True), (constant / np.linalg.norm(constant), False)):
            ends = np.kron(fixed[:, None], np.eye(self.inputs))
            found.append(self._roots(null @ (null.T @ ends), highest=is_highest))
        (inner, inner_shares), (outer, outer_shares) = found
        # Both are asked for roots that hardly change over the record: those that differ by less are one mode.
        keep = np.abs(inner) < np.exp(SLOW / self.samples)
        inner, inner_shares = inner[keep], inner_shares[keep]
        keep = np.abs(outer) > np.exp(-SLOW / self.samples)
        outer, outer_shares = outer[keep], outer_shares[keep]
        if len(inner):
            apart = np.abs(np.log(outer)[:, None] - np.log(inner))
            keep = np.minimum(apart, np.abs(apart - 2.0 * np.pi)).min(axis=1) > SLOW / self.samples
            outer, outer_shares = outer[keep], outer_shares[keep]
        return np.concatenate([inner, outer]), np.concatenate([inner_shares, outer_shares])

    def _roots(self, coefficients: Floats, *, highest: bool) -> tuple[Complexes, Complexes]:
        """μ and l with lᵀ A(1/μ) = 0, from the pencil x B u = K u of the blocks u_k = q_k(x) l, k < n."""
        # The last row of K and B is A's; the others are the recurrence. Where the highest coefficient is fixed, B can
        # be inverted, and K where the constant is. The other is singular when modes leave a combination of inputs
        # alone.
        inputs, degree, h = self.inputs, self.basis.degree, self.basis.hessenberg
        blocks = coefficients.reshape(degree + 1, inputs, inputs).transpose(0, 2, 1)
        end = degree * inputs - inputs
        k, b = np.kron(h[:-1].T, np.eye(inputs)), np.eye(degree * inputs)
        k[end:] = np.kron(h[:-1, -1], blocks[-1]) - h[-1, -1] * np.concatenate(blocks[:-1], axis=1)
        b[end:, end:] = blocks[-1]
        try:
            if highest:
                k[end:] = np.linalg.solve(blocks[-1], k[end:])
            values, vectors = np.linalg.eig(k if highest else np.linalg.solve(k, b))
        except np.linalg.LinAlgError:  # the coefficient that is fixed is zero: there is no root to have
            return np.zeros(0, complex), np.zeros((0, inputs), complex)
        good = np.abs(values) > np.finfo(float).tiny
        parts = vectors.T.reshape(-1, degree, inputs)[good]
        largest = np.argmax(np.linalg.norm(parts, axis=2), axis=1)
        multipliers = 1.0 / values[good] if highest else values[good]
        return multipliers.astype(complex), parts[np.arange(len(parts)), largest].astype(complex)


SMOOTH = 8  # the degree up to which a polynomial in 1/z stands for the skirts of modes far outside a band


@dataclass(frozen=True, slots=True)
class Modes:
    """Poles and how much of each is in each input: `shares` (k, inputs), or None where inputs are independent."""

    poles: PoleSet
    shares: Complexes | None = None

    @staticmethod
    def of(multipliers: Complexes, shares: Complexes | None) -> Modes:
        """Select the upper half of the roots, a real one's shares made real."""
        upper = multipliers.imag >= -1e-9 * np.abs(multipliers)
        poles = PoleSet.from_multipliers(multipliers[upper])
        if shares is None:
            return Modes(poles)
        return Modes(poles, poles.normalised(shares[upper])[0])

    def keep(self, mask: Mask) -> Modes:
        """The entries where `mask` holds."""
        return Modes(self.poles.keep(mask), None if self.shares is None else self.shares[mask])

    def of_input(self, i: int) -> Complexes:
        """The share of input `i` in each pole (order,), conjugates conjugated."""
        if self.shares is None:
            return np.ones(self.poles.order, complex)
        return self.poles.with_conjugates(self.shares[:, i])


@dataclass(frozen=True, slots=True)
class Rows:
    """Data of a response: its samples, or the lines of a band less what lies outside."""

    band: Band
    outside: Floats

    @staticmethod
    def of(band: Band, others: PoleSet) -> Rows:
        """The rows of a band, less the modes beside it and what is smooth on it."""
        if band.whole or not band.size:
            return Rows(band, np.zeros((band.samples if band.whole else 0, 0)))
        degree = min(SMOOTH, band.size // 4)
        smooth = band.weights[:, None] * Basis.on(band, degree).at(band.x)
        beside = stacked(band.spectrum(real_powers(others, band.samples).T))
        both = np.concatenate([stacked(smooth.T), beside]).T
        left, values, _ = np.linalg.svd(both / np.linalg.norm(both, axis=0), full_matrices=False)
        return Rows(band, left[:, values > 1e-12 * values[0]])

    def __call__(self, values: Floats) -> Floats:
        """The rows (…, rows) of responses (…, samples)."""
        values = values[..., : self.band.samples]
        if self.band.whole:
            return values
        seen = stacked(self.band.spectrum(values))
        return seen - (seen @ self.outside) @ self.outside.T


@dataclass(frozen=True, slots=True)
class Fitting:
    """Least squares for residues of some inputs together: their columns and pseudo-inverses, one of each an input."""

    modes: Modes
    inputs: list[int]
    longest: int
    columns: list[Floats]
    inverse: list[Floats]

    @staticmethod
    def of(modes: Modes, inputs: list[int], rows: Sequence[Rows]) -> Fitting:
        """For these inputs."""
        longest = max(rows[i].band.samples for i in inputs)
        terms = powers(modes.poles.full(), longest)
        columns = [rows[i](real_basis(modes.poles, terms * modes.of_input(i)).T).T for i in inputs]
        q, r = np.linalg.qr(np.concatenate(columns))
        whole = np.linalg.pinv(r, rcond=1e-14) @ q.T
        inverse = np.split(whole, np.cumsum([len(part) for part in columns])[:-1], axis=1)
        return Fitting(modes, inputs, longest, columns, inverse)

    def residues(self, seen: Sequence[Floats]) -> Floats:
        """The real residues (order, outputs) of the rows (outputs, rows) of each input."""
        return np.sum([one @ y.T for one, y in zip(self.inverse, seen, strict=True)], axis=0)


def chosen(modes: Modes, data: TimeResponses, scale: Floats, rows: Sequence[Rows], order: int) -> Modes:
    """The modes that take most out of the responses over `scale`, at most `order` poles; the weakest leave in turn."""
    spread, moments = [], []
    for fitting in _fittings(modes, rows):
        moment = np.zeros((modes.poles.order,) * 2)
        for _, seen in _looked_at(data, scale, rows, fitting.inputs):
            residues = fitting.residues(seen)
            moment += residues @ residues.T
        spread.append(np.sum([one @ one.T for one in fitting.inverse], axis=0))
        moments.append(moment)
    now, left = Removal(modes.poles, tuple(spread), tuple(moments)), np.arange(len(modes.poles))
    while (worst := weakest(now.poles, now.rises(), order)) is not None:
        now, left = now.without(worst), np.delete(left, worst)
    return modes.keep(np.isin(np.arange(len(modes.poles)), left))


def model_on(modes: Modes, data: TimeResponses, scale: Floats, rows: Sequence[Rows], outcome: Outcome) -> ModalModel:
    """The model of the modes, residues fitted on the rows of the responses over `scale`."""
    poles, n = modes.poles, modes.poles.order
    residues = np.zeros((n, data.n_outputs, data.n_inputs), complex)
    left = np.zeros((data.n_outputs, data.n_inputs))
    for fitting in _fittings(modes, rows):
        # The columns were scaled so that a growing mode cannot overflow; residues belong to sample zero.
        s = poles.full()
        start = np.exp(-np.where(s.real > 0, fitting.longest - 1, 0) * s)
        for part, seen in _looked_at(data, scale, rows, fitting.inputs):
            real = fitting.residues(seen)
            for i, y, columns in zip(fitting.inputs, seen, fitting.columns, strict=True):
                here = (start * modes.of_input(i))[:, None] * complex_residues(poles, real)
                residues[:, part, i] = here * scale[part, i]
                free = max(rows[i].band.size - rows[i].outside.shape[1] - n, 1)
                rest = np.sqrt(np.sum((y - (columns @ real).T) ** 2, axis=1) / free)
                left[part, i] = rest * scale[part, i]
    return ModalModel(
        multipliers=poles.multipliers(), residues=residues, dt=data.dt, residual_std=left, outcome=outcome
    )


def _fittings(modes: Modes, rows: Sequence[Rows]) -> list[Fitting]:
    """Inputs that are fitted together: all of them where they share participations, and otherwise each alone."""
    every = list(range(len(rows)))
    return [Fitting.of(modes, group, rows) for group in ([[i] for i in every] if modes.shares is None else [every])]


def _looked_at(
    data: TimeResponses, scale: Floats, rows: Sequence[Rows], inputs: Sequence[int]
) -> Iterator[tuple[slice, list[Floats]]]:
    """The rows (outputs, rows) of each of the inputs, responses over `scale`, some outputs at a time."""
    step = max(1, BLOCK // (data.values.shape[2] * len(inputs)))
    for start in range(0, data.n_outputs, step):
        part = slice(start, start + step)
        yield part, [rows[i](data.values[part, i] / scale[part, i, None]) for i in inputs]
