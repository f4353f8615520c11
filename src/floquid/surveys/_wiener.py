"""Smooth functions of an operating point through estimates with deviations: Wiener processes integrated twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats, Integers

DEGREE = 2  # of the polynomial that is free: the process adds to its second derivative
AMPLITUDES = 25  # on a logarithmic grid with a flat prior
SMALLEST, LARGEST = 1e-7, 1e3  # amplitude over the size of the values: a polynomial, and anything at all
ROUNDING = 1e-9  # share of the size of the values below which a deviation is rounding
STEADY = 1e-4  # share of the values themselves below which their differences are rounding


@dataclass(frozen=True, slots=True, kw_only=True)
class Smooth:
    """Functions through values at a few points, each with an amplitude of its own.

    Parameters
    ----------
    x
        The points, scaled to a length of one (points,).
    y
        The values, scaled (functions, points).
    noise
        The covariance of the values, point by point within each function (functions * points, functions * points).
    scale
        Size of each function (functions,).
    grid, weights
        Amplitudes that were looked at, and the posterior of each (functions, amplitudes).
    """

    x: Floats
    y: Floats
    noise: Floats
    scale: Floats
    grid: Floats
    weights: Floats

    def draws(self, at: Floats, count: int, generator: np.random.Generator) -> Floats:
        """Functions drawn from the posterior (count, functions, places), at the scaled places `at`."""
        picked = np.stack([generator.choice(self.grid.shape[1], count, p=row) for row in self.weights], axis=1)
        kinds, of = np.unique(picked, axis=0, return_inverse=True)
        out = np.empty((count, len(self.y), len(at)))
        kernels = self._kernels(at)
        for number, kind in enumerate(kinds):
            mean, covariance = self._posterior(kind, *kernels)
            here = np.flatnonzero(of.ravel() == number)
            values, vectors = np.linalg.eigh(covariance)
            root = vectors * np.sqrt(np.maximum(values, 0.0))
            drawn = mean + generator.standard_normal((len(here), len(mean))) @ root.T
            out[here] = drawn.reshape(len(here), len(self.y), len(at))
        return out * self.scale[:, None]

    def misfit(self) -> float:
        """The rms of each point's distance from what the others predict, over its deviation; at least one."""
        best, count, total = self.weights.argmax(axis=1), len(self.x), 0.0
        for point in range(count):
            kept = np.arange(count) != point
            rows = np.flatnonzero(np.tile(kept, len(self.y)))
            noise = self.noise[np.ix_(rows, rows)]
            less = Smooth(
                x=self.x[kept], y=self.y[:, kept], noise=noise, scale=self.scale, grid=self.grid, weights=self.weights
            )
            mean, covariance = less._posterior(best, *less._kernels(self.x[[point]]))
            own = np.arange(len(self.y)) * count + point
            off = self.y[:, point] - mean
            total += float(off @ np.linalg.solve(covariance + self.noise[np.ix_(own, own)], off))
        return max(1.0, float(np.sqrt(total / (count * len(self.y)))))

    def _kernels(self, at: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Covariances of points, of points and places, and of places; the polynomials at points and at places."""
        own, cross, there = (kernel(a, b) for a, b in ((self.x, self.x), (self.x, at), (at, at)))
        basis, wanted = (np.kron(np.eye(len(self.y)), np.vander(x, DEGREE + 1)) for x in (self.x, at))
        return own, cross, there, basis.astype(np.float64), wanted.astype(np.float64)

    def _posterior(
        self, amplitudes: Integers, own: Floats, cross: Floats, there: Floats, basis: Floats, wanted: Floats
    ) -> tuple[Floats, Floats]:
        """Mean and covariance of all functions at places, given the place of each amplitude on its grid."""
        squares = np.diag(self.grid[np.arange(len(self.y)), amplitudes] ** 2)
        known, across = np.kron(squares, own) + self.noise, np.kron(squares, cross)
        size = max(float(np.abs(known).max()), 1e-300)  # or the polynomial would be lost beside it
        corner = np.zeros((basis.shape[1], basis.shape[1]))
        asked = np.concatenate([across, size * wanted.T])
        weights = np.linalg.solve(np.block([[known, size * basis], [size * basis.T, corner]]), asked)
        mean = weights[: self.y.size].T @ self.y.ravel()
        covariance = np.kron(squares, there) - asked.T @ weights
        return mean, 0.5 * (covariance + covariance.T)


def smooth(x: Floats, values: Floats, covariance: Floats) -> Smooth:
    """Functions through `values` (functions, points) at `x` (points,), by their covariance at each point.

    `covariance` (points, functions, functions) is that of the values of one point; points are independent.
    """
    from scipy.linalg import null_space

    count, points = values.shape
    contrasts: Floats = np.asarray(null_space(np.vander(x, DEGREE + 1).T))
    scale = np.maximum(np.maximum(np.ptp(values, axis=1), STEADY * np.abs(values).max(axis=1)), 1e-300)
    y = values / scale[:, None]
    noise = np.zeros((count, points, count, points))
    place = np.arange(points)
    noise[:, place, :, place] = covariance / np.multiply.outer(scale, scale)
    noise[np.arange(count)[:, None], place, np.arange(count)[:, None], place] += ROUNDING**2
    own = kernel(x, x)
    grid, weights = np.empty((2, count, AMPLITUDES))
    for row in range(count):
        spread = noise[row, :, row, :]
        lowest = max(SMALLEST, float(np.sqrt(np.diag(spread).min())))
        grid[row] = np.geomspace(min(lowest, 0.1 * LARGEST), LARGEST, AMPLITUDES)
        likelihood = np.array([_restricted(amplitude**2 * own + spread, contrasts, y[row]) for amplitude in grid[row]])
        weights[row] = np.exp(likelihood - likelihood.max())
    weights /= weights.sum(axis=1, keepdims=True)
    size = count * points
    return Smooth(x=x, y=y, noise=noise.reshape(size, size), scale=scale, grid=grid, weights=weights)


def _restricted(covariance: Floats, contrasts: Floats, y: Floats) -> float:
    """Logarithm of the likelihood of what no polynomial changes."""
    from scipy.linalg import cho_factor, cho_solve

    factor = cho_factor(contrasts.T @ covariance @ contrasts)
    left = contrasts.T @ y
    return -float(np.log(np.diag(factor[0])).sum() + 0.5 * left @ cho_solve(factor, left))


def kernel(a: Floats, b: Floats) -> Floats:
    r"""Covariance of a Wiener process integrated twice, from zero at -1 (len(a), len(b)).

    .. math:: \int_0^{\min(s, t)} \frac{(s - u)^2 (t - u)^2}{4}\, du
    """
    s, t = np.meshgrid(a + 1.0, b + 1.0, indexing="ij")
    low, high = np.minimum(s, t), np.maximum(s, t)
    gap = high - low
    return low**3 * (low**2 / 20.0 + low * gap / 8.0 + gap**2 / 12.0)
