"""Hits on a system with known modes, and the Cramér-Rao bound of one shape for all of them, sharing no code."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from floquid import Channel, ConstantPeriod, Record


@dataclass(frozen=True)
class Hits:
    r"""Responses y = Re Σ w a_{r,h} Σ_m c_{r,m} e^{(λ_r + imω) t} of pairs (w = 2) and real multipliers (w = 1)."""

    exponents: np.ndarray
    shapes: np.ndarray  # (modes, channels, harmonics)
    states: np.ndarray  # (modes, hits)
    cycles: int
    phases: int = 8
    period: float = 1.0
    noise: float = 0.05

    @staticmethod
    def drawn(exponents, hits, cycles, *, channels=2, width=1, seed=1, **options):
        """Random shapes and states."""
        draw, lam = np.random.default_rng(seed), np.array(exponents, complex)

        def numbers(*shape):
            return draw.standard_normal(shape) + 1j * draw.standard_normal(shape)

        shapes = numbers(len(lam), channels, 2 * width + 1) * 0.5 ** np.abs(np.arange(-width, width + 1))
        states, real = numbers(len(lam), hits), lam.imag == 0.0
        shapes[real] = 0.5 * (shapes[real] + shapes[real, :, ::-1].conj())
        states[real] = states[real].real
        return Hits(lam, shapes, states, cycles, **options)

    @property
    def times(self):
        """The samples of a hit [s]."""
        return self.period / self.phases * np.arange(self.cycles * self.phases)

    @property
    def coefficients(self):
        """B (modes, channels, hits, harmonics)."""
        return self.shapes[:, :, None] * self.states[:, None, :, None]

    def responses(self):
        """Without noise (hits, channels, samples)."""
        width, t = self.shapes.shape[2] // 2, self.times
        turns = np.exp(2j * np.pi / self.period * np.outer(np.arange(-width, width + 1), t))
        weight = np.where(self.exponents.imag == 0.0, 1.0, 2.0)
        decays = weight[:, None] * np.exp(np.multiply.outer(self.exponents, t))
        return np.einsum("rcm,mt,rt,rh->hct", self.shapes, turns, decays, self.states, optimize=True).real

    def records(self, seed, *, other=None):
        """Noisy records; `other` has the shapes of the last hit."""
        draw, values = np.random.default_rng(seed), self.responses()
        if other is not None:
            values[-1] = replace(self, shapes=other).responses()[-1]
        values = values + self.noise * draw.standard_normal(values.shape)
        channels = [Channel(name=f"x{k}") for k in range(values.shape[1])]
        clock, rate = ConstantPeriod(period=self.period), self.phases / self.period
        return [Record(values=each, sample_rate=rate, channels=channels, clock=clock) for each in values]

    def bound(self):
        """Least deviations of exponents, and of coefficients B (modes, channels, hits, harmonics), pairs alone."""
        count, covariance, moved = self._covariance()
        std = np.sqrt(np.diag(covariance))
        real, imag = (np.sqrt(np.einsum("pb,pq,qb->b", m, covariance, m)) for m in (moved.real, moved.imag))
        return std[:count] + 1j * std[count : 2 * count], (real + 1j * imag).reshape(self.coefficients.shape)

    def bound_of_sum(self):
        """Least deviation of the real part of the sum of all coefficients."""
        _, covariance, moved = self._covariance()
        whole = moved.real.sum(axis=1)
        return float(np.sqrt(whole @ covariance @ whole))

    def _covariance(self):
        """Modes, Cramér-Rao covariance of exponents, shapes and states, and slopes of B by them."""
        count, hits = self.states.shape
        sizes = [count, self.shapes.size, count * (hits - 1)]

        def at(numbers):
            parts = np.split(numbers, np.cumsum(np.repeat(sizes, 2))[:-1])
            lam, shapes, states = (real + 1j * imag for real, imag in zip(parts[::2], parts[1::2], strict=True))
            whole = np.concatenate([self.states[:, :1], states.reshape(count, hits - 1)], axis=1)
            return replace(self, exponents=lam, shapes=shapes.reshape(self.shapes.shape), states=whole)

        own = np.concatenate(
            [
                part
                for each in (self.exponents, self.shapes.ravel(), self.states[:, 1:].ravel())
                for part in (each.real, each.imag)
            ]
        )
        steps = 1e-6 * np.eye(len(own))
        slopes, moved = [], []
        for step in steps:
            up, down = at(own + step), at(own - step)
            slopes.append((up.responses() - down.responses()).ravel() / 2e-6)
            moved.append((up.coefficients - down.coefficients).ravel() / 2e-6)
        slopes, moved = np.array(slopes), np.array(moved)
        covariance = np.linalg.inv(slopes @ slopes.T) * self.noise**2
        return count, covariance, moved
