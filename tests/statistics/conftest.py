"""Statistical assertions and the experiments they are made on, as fixtures.

Each assertion is a band that a right method leaves once in a thousand times at most, over all that it looks at; the
seeds are fixed, so a right method passes every time. `test_mutants.py` shows that broken estimators fail them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.stats import binom, chi2

from floquid import PeriodicModel, Record, identify
from floquid.core import ConstantPeriod
from floquid.lifting import lift
from floquid.lti import AbstractIdentifier, Outcome, TimeResponses
from floquid.sync import segment

RARE = 1e-3
"""The probability with which chance may leave a band, over all parameters together."""


class Assertions:
    """The helpers that right and broken estimators go through alike."""

    @staticmethod
    def pulls_have_unit_variance(pulls: NDArray) -> None:
        """Each column of pulls (draws, parameters), error over deviation, has a mean square of one and no bias.

        The sum of squares of a column is a chi-square of as many degrees as there are draws, whatever the columns have
        to do with one another (Bonferroni over columns).
        """
        draws, parameters = pulls.shape
        squares = np.sum(pulls**2, axis=0)
        low, high = chi2.ppf([RARE / (4 * parameters), 1.0 - RARE / (4 * parameters)], draws)
        assert squares.max() < high, f"a deviation is too small: mean square {squares.max() / draws:.3g}"
        assert squares.min() > low, f"a deviation is too large: mean square {squares.min() / draws:.3g}"
        bias = np.abs(pulls.sum(axis=0)).max() / np.sqrt(draws)
        assert bias**2 < chi2.ppf(1.0 - RARE / (2 * parameters), 1), f"a bias of {bias:.3g} deviations of the mean"

    @staticmethod
    def errors_have_the_covariance(errors: NDArray, covariances: NDArray) -> None:
        """Σ eᵀC⁻¹e over draws: errors (draws, parameters), covariances (draws, parameters, parameters)."""
        total = sum(float(e @ np.linalg.solve(c, e)) for e, c in zip(errors, covariances, strict=True))
        low, high = chi2.ppf([RARE / 2, 1.0 - RARE / 2], errors.size)
        assert low < total < high, f"mean square {total / errors.size:.3g} for {errors.size} degrees of freedom"

    @staticmethod
    def is_efficient(errors: NDArray, bound: NDArray, *, loss: float) -> None:
        """The errors (draws, parameters) are those of the Cramér-Rao bound, or up to `loss` times as large.

        Errors below the bound say that the bound is wrong: no unbiased estimator has them.
        """
        total = float(np.einsum("di,ij,dj->", errors, np.linalg.inv(bound), errors))
        low, high = chi2.ppf([RARE / 2, 1.0 - RARE / 2], errors.size)
        ratio = np.sqrt(total / errors.size)
        assert total < loss**2 * high, f"errors are {ratio:.3g} times the Cramér-Rao bound"
        assert total > low, f"errors are {ratio:.3g} times the Cramér-Rao bound: the bound is wrong"

    @staticmethod
    def happens_at_least(successes: int, trials: int, rate: float) -> None:
        """So few successes would be rare if each trial had the probability `rate`."""
        assert binom.cdf(successes, trials, rate) > RARE, f"{successes} of {trials}, but {rate:.3g} were promised"


@pytest.fixture
def assert_that() -> type[Assertions]:
    return Assertions


@dataclass(frozen=True)
class Experiment:
    """A known system, and records of its response with noise of known size."""

    truth: PeriodicModel
    n_cycles: int
    n_phases: int
    noise: NDArray
    """Standard deviations (channels, hits)."""

    def records(self, seed: int) -> list[Record]:
        """One record a hit."""
        generator = np.random.default_rng(seed)
        step = self.truth.period / self.n_phases
        values = self.truth.response(step * np.arange(self.n_cycles * self.n_phases))
        values = values + self.noise[:, :, None] * generator.standard_normal(values.shape)
        return [
            Record(
                values=values[:, hit],
                sample_rate=1.0 / step,
                channels=self.truth.channels,
                clock=ConstantPeriod(period=self.truth.period),
            )
            for hit in range(self.truth.n_hits)
        ]

    def upper(self, model: PeriodicModel) -> NDArray[np.intp]:
        """The position in `model` of each true mode of positive imaginary part, on the same branch."""
        wanted = self.truth.exponents[::2]
        assert model.order == self.truth.order, f"order {model.order}, not {self.truth.order}"
        off = np.abs(np.subtract.outer(wanted, model.exponents))
        return linear_sum_assignment(off)[1]

    def exponent_errors(self, model: PeriodicModel) -> tuple[NDArray, NDArray]:
        """Errors of the real, then the imaginary parts of the upper modes, and their covariance."""
        k = self.upper(model)
        off = model.exponents[k] - self.truth.exponents[::2]
        both = np.concatenate([k, k + model.order])
        return np.concatenate([off.real, off.imag]), model.covariance[np.ix_(both, both)]

    def coefficient_pulls(self, model: PeriodicModel) -> NDArray:
        """Errors over deviations of real and imaginary parts of every coefficient of the upper modes."""
        k = self.upper(model)
        assert model.harmonics.tolist() == self.truth.harmonics.tolist()
        off = model.coefficients[k] - self.truth.coefficients[::2]
        std = model.coefficient_std[k]
        return np.concatenate([(off.real / std.real).ravel(), (off.imag / std.imag).ravel()])

    def bound(self) -> NDArray:
        """The Cramér-Rao bound of the upper exponents (2 modes, 2 modes), residues free and noise known.

        By a dense Jacobian of each lifted response: slopes by the poles beside the real columns of the residues, whose
        information is then projected out.
        """
        clean = Experiment(self.truth, self.n_cycles, self.n_phases, 0.0 * self.noise)
        multipliers = self.truth.multipliers[::2]
        n, k = len(multipliers), np.arange(self.n_cycles)
        powers = multipliers ** k[:, None]
        columns = np.concatenate([powers.real, powers.imag], axis=1)
        information = np.zeros((2 * n, 2 * n))
        for hit, cycles in enumerate(segment(clean.records(0))):
            for channel, block in enumerate(cycles.values):
                for samples in block:
                    parts = np.linalg.lstsq(columns, samples, rcond=None)[0]
                    residues = parts[:n] - 1j * parts[n:]
                    slopes = k[:, None] * powers * residues * self.truth.period
                    jacobian = np.concatenate([slopes.real, -slopes.imag, columns], axis=1)
                    whole = jacobian.T @ jacobian / self.noise[channel, hit] ** 2
                    cross = whole[: 2 * n, 2 * n :]
                    inner = np.linalg.solve(whole[2 * n :, 2 * n :], cross.T)
                    information += whole[: 2 * n, : 2 * n] - cross @ inner
        return np.linalg.inv(information)

    def constrained_bound(self) -> NDArray:
        """The same with one shape for all hits, in the true band of harmonics, and a state a hit.

        It is less where modes decay fast, and where hits tell near modes apart.
        """
        upper, omega = self.truth.exponents[::2], 2.0 * np.pi / self.truth.period
        n, times = len(upper), self.truth.period / self.n_phases * np.arange(self.n_cycles * self.n_phases)
        exponentials = np.exp(np.multiply.outer(times, upper[:, None] + 1j * omega * self.truth.harmonics))
        whole = self.truth.coefficients[::2]
        shapes = whole[:, :, 0]
        states = np.einsum("rcm,rchm->rh", shapes.conj(), whole) / np.sum(np.abs(shapes) ** 2, axis=(1, 2))[:, None]
        assert np.allclose(whole, shapes[:, :, None] * states[:, None, :, None])
        rows = []
        for channel, hit in np.ndindex(self.noise.shape):
            responses = np.einsum("trm,rm->tr", exponentials, shapes[:, channel])
            of_shapes = np.zeros((len(times), *shapes.shape), complex)
            of_shapes[:, :, channel] = exponentials * states[:, hit, None]
            of_states = np.zeros((len(times), n, self.noise.shape[1] - 1), complex)
            if hit:
                of_states[:, :, hit - 1] = responses
            parts = (times[:, None] * responses * states[:, hit], of_shapes, of_states)
            slopes = [part.reshape(len(times), -1) for part in parts]
            real = [2.0 * own for slope in slopes for own in (slope.real, -slope.imag)]
            rows.append(np.concatenate(real, axis=1) / self.noise[channel, hit])
        jacobian = np.concatenate(rows)
        return np.linalg.inv(jacobian.T @ jacobian)[: 2 * n, : 2 * n]

    def lifted(self, seed: int):
        """The lifted responses with their true noise."""
        return lift(segment(self.records(seed))).with_noise(self.noise)


def make_experiment(
    exponents, *, noise=0.02, n_cycles=60, n_phases=12, channels=2, hits=1, width=2, seed=0, units=None
) -> Experiment:
    """Pairs with random shapes; noise is a share of the largest response, `units` scale the channels' noise."""
    generator = np.random.default_rng(seed)
    upper = np.asarray(exponents)
    size = (len(upper), channels, hits, 2 * width + 1)
    shapes = (generator.standard_normal(size) + 1j * generator.standard_normal(size)) * 0.3
    shapes[..., width] += 1.5 * np.exp(2j * np.pi * generator.uniform(size=size[:-1]))
    shapes *= 0.6 ** np.abs(np.arange(-width, width + 1))
    if hits > 1:
        # One system started in different ways: a hit has so much of the whole shape, and no shape of its own.
        share = generator.uniform(0.5, 1.5, (len(upper), 1, hits, 1)) * np.exp(
            2j * np.pi * generator.uniform(size=(len(upper), 1, hits, 1))
        )
        shapes = shapes[:, :, :1] * share
    truth = PeriodicModel(
        exponents=np.stack([upper, upper.conj()], axis=1).ravel(),
        coefficients=np.stack([shapes, shapes[..., ::-1].conj()], axis=1).reshape(2 * len(upper), *size[1:]),
        harmonics=np.arange(-width, width + 1),
        period=6.0,
        channels=[f"c{i}" for i in range(channels)],
    )
    largest = np.abs(truth.response(0.5 * np.arange(12 * n_cycles))).max(axis=2)
    factor = np.ones(channels) if units is None else np.asarray(units)
    return Experiment(truth, n_cycles, n_phases, noise * largest * factor[:, None])


@pytest.fixture(scope="session")
def experiment() -> Callable[..., Experiment]:
    return make_experiment


@pytest.fixture(scope="session")
def plain() -> Experiment:
    """Two pairs well apart, 2 % noise, two channels, 60 cycles: the chain takes a twentieth of a second."""
    return make_experiment([-0.03 + 0.85j, -0.02 + 0.32j])


@pytest.fixture(scope="session")
def chain() -> Callable[[list[Record]], PeriodicModel]:
    """The estimator as it is, with the true band of harmonics so that selection does not enter."""

    def estimate(records):
        return identify(records, harmonics=2, validate=False).model

    return estimate


class Orders:
    """Decays of known order, and how often an identifier tells it."""

    @staticmethod
    def ringing(logs, outputs, samples, noise, generator) -> TimeResponses:
        """Pairs of these logarithms with random residues, noise a share of each output's largest response."""
        size = (outputs, len(logs))
        residues = generator.standard_normal(size) + 1j * generator.standard_normal(size)
        values = (residues @ np.exp(np.multiply.outer(logs, np.arange(samples)))).real
        sigma = noise * np.abs(values).max(axis=1)
        values = values + sigma[:, None] * generator.standard_normal(values.shape)
        return TimeResponses(values=values[:, None], dt=1.0, noise=sigma[:, None])

    @staticmethod
    def fixed(logs, outputs, samples, *, noise, seed=0) -> TimeResponses:
        """The same residues for every seed, of unit parts, and noise of this deviation (rounding for none)."""
        residues = np.random.default_rng(2**32).standard_normal((2, outputs, len(logs)))
        values = ((residues[0] + 1j * residues[1]) @ np.exp(np.multiply.outer(logs, np.arange(samples)))).real
        values = values + noise * np.random.default_rng(seed).standard_normal(values.shape)
        return TimeResponses(values=values[:, None], dt=1.0, noise=np.full((outputs, 1), max(noise, 1e-9)))

    @classmethod
    def decays(cls, n_modes, *, outputs, samples, noise=0.02, seed=0) -> tuple[NDArray, TimeResponses]:
        """Random pairs, one in each of `n_modes` bands of frequency, of damping 0.01 to 0.05 a sample."""
        generator = np.random.default_rng(seed)
        edges = np.linspace(0.05, np.pi - 0.05, n_modes + 1)
        width = edges[1] - edges[0]
        angles = edges[:-1] + width * generator.uniform(0.15, 0.85, n_modes)
        logs = -generator.uniform(0.01, 0.05, n_modes) + 1j * angles
        return logs, cls.ringing(logs, outputs, samples, noise, generator)

    @staticmethod
    def is_right(logs: NDArray, data: TimeResponses, identifier: AbstractIdentifier) -> bool:
        """The right number of poles, and one within a twentieth of a radian of each true one."""
        found = identifier.extract(identifier.prepare(data))
        if found.outcome is not Outcome.SUCCESS or found.order != 2 * len(logs):
            return False
        off = np.abs(np.subtract.outer(logs, np.log(found.multipliers)))
        return bool(off.min(axis=1).max() < 0.05)

    @staticmethod
    def seen_in_noise(identifier: AbstractIdentifier, seeds) -> int:
        """How often white noise alone passes for a mode, over shapes of data."""
        shapes = [(100, 2, 100), (10, 1, 400), (1, 1, 200), (600, 1, 60), (3, 4, 30)]
        count = 0
        for seed in seeds:
            values = np.random.default_rng(seed).standard_normal(shapes[seed % len(shapes)])
            found = identifier.extract(identifier.prepare(TimeResponses(values=values, dt=1.0)))
            count += found.outcome is not Outcome.NO_MODE
        return count


@pytest.fixture(scope="session")
def orders() -> type[Orders]:
    return Orders
