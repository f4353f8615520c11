"""Steps to a least squares that is known, counted."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from floquid.fit import Ends, Normal, Steps, levenberg_marquardt

START = np.array([-1.2, 1.0])


@dataclass(frozen=True)
class At:
    """A point of Rosenbrock's valley, least at (1, 1)."""

    p: np.ndarray

    @property
    def rest(self) -> np.ndarray:
        return np.array([10.0 * (self.p[1] - self.p[0] ** 2), 1.0 - self.p[0]])

    @property
    def cost(self) -> float:
        return float(self.rest @ self.rest)


@dataclass
class Count:
    """The numbers of trials and of matrices."""

    trials: int = 0
    matrices: int = 0
    gains: list[float] = field(default_factory=list)


def steps_of(count: Count, **more) -> Steps[At]:
    def normal(at: At) -> Normal:
        count.matrices += 1
        slopes = np.array([[20.0 * at.p[0], -10.0], [1.0, 0.0]])
        return Normal(matrix=slopes.T @ slopes, gradient=slopes.T @ at.rest)

    def moved(at: At, step: np.ndarray) -> At | None:
        count.trials += 1
        return At(at.p + step)

    def noted(_: At, gains: list[float]) -> bool:
        count.gains = list(gains)
        return False

    return Steps(**({"normal": normal, "moved": moved, "enough": noted} | more))


def test_the_valley_is_walked_to_its_end_and_a_trial_that_is_rejected_costs_no_matrix():
    count = Count()
    found = levenberg_marquardt(At(START), steps_of(count), Ends(steps=100, deviations=1e-9))
    assert found.p == pytest.approx([1.0, 1.0], abs=1e-8)
    assert count.trials < 60
    assert count.matrices <= len(count.gains) + 1 < count.trials
    assert min(count.gains) >= 0.0


def test_a_fit_ends_by_each_of_its_ends():
    count = Count()
    levenberg_marquardt(At(START), steps_of(count), Ends(steps=3))
    assert count.matrices == 3
    last = levenberg_marquardt(At(START), steps_of(Count()), Ends(steps=100, gain=0.5))
    assert 0.0 < last.cost < At(START).cost
    stopped = levenberg_marquardt(At(START), steps_of(Count(), enough=lambda at, _: at.cost < 4.0), Ends(steps=100))
    assert 0.1 < stopped.cost < 4.0
    nowhere = At(START)
    assert levenberg_marquardt(nowhere, steps_of(Count(), moved=lambda *_: None), Ends(steps=100)) is nowhere


def test_a_parameter_that_does_nothing_stays():
    def normal(at: At) -> Normal:
        return Normal(matrix=np.diag([1.0, 0.0]), gradient=np.array([1.0 - at.p[0], 0.0]))

    @dataclass(frozen=True)
    class Flat(At):
        @property
        def rest(self) -> np.ndarray:
            return 1.0 - self.p[:1]

    steps = Steps(normal=normal, moved=lambda at, step: Flat(at.p + step))
    found = levenberg_marquardt(Flat(START), steps, Ends(steps=20, deviations=1e-9))
    assert found.p == pytest.approx([1.0, START[1]])


def test_a_matrix_that_serves_is_not_made_again():
    """Of a parabola every step gains what it lets expect: one matrix is enough."""
    matrix, best = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([0.3, -0.7])
    made = []

    @dataclass(frozen=True)
    class Parabola(At):
        @property
        def cost(self) -> float:
            return float((self.p - best) @ matrix @ (self.p - best))

    def gradient(at: At) -> np.ndarray:
        return matrix @ (best - at.p)

    def normal(at: At) -> Normal:
        made.append(at)
        return Normal(matrix=1.2 * matrix, gradient=gradient(at))  # the model is not exact: several steps

    steps = Steps(normal=normal, moved=lambda at, step: Parabola(at.p + step), gradient=gradient)
    found = levenberg_marquardt(Parabola(START), steps, Ends(steps=50, deviations=1e-8))
    assert found.p == pytest.approx(best, abs=1e-7)
    assert len(made) == 1


def test_a_step_that_is_limited_goes_as_far_as_it_may():
    moves = []

    def limited(at: At, step: np.ndarray, _normal: Normal, _damping: float) -> np.ndarray:
        moves.append(step * min(1.0, 0.1 / np.abs(step).max()))
        return moves[-1]

    found = levenberg_marquardt(At(START), steps_of(Count(), limited=limited), Ends(steps=200, deviations=1e-9))
    assert found.p == pytest.approx([1.0, 1.0], abs=1e-8)
    assert max(np.abs(step).max() for step in moves) <= 0.1 + 1e-15


def test_a_kept_matrix_takes_up_the_curvature_that_a_step_has_shown():
    """Along the step it is that of the cost; what a singular matrix knows nothing of stays so."""
    generator = np.random.default_rng(0)
    slopes = generator.standard_normal((8, 4)) @ np.diag([1.0, 1.0, 1.0, 0.0])
    normal, step = Normal(matrix=slopes.T @ slopes, gradient=np.zeros(4)), np.array([0.3, -0.1, 0.2, 0.0])
    change = 1.7 * normal.matrix @ step + [0.0, 0.1, 0.0, 0.0]
    turned = normal.turned(step, change)
    assert np.allclose(turned.matrix @ step, change)
    assert np.linalg.eigvalsh(turned.matrix)[1] > 0.0
    assert np.allclose(turned.matrix[3], 0.0)
    assert normal.turned(step, -change) is normal


def test_steps_by_a_matrix_that_secants_changed_are_those_of_its_own_directions():
    generator = np.random.default_rng(1)
    slopes = generator.standard_normal((30, 6))
    normal = Normal(matrix=slopes.T @ slopes, gradient=np.zeros(6))
    for _ in range(3):
        step = generator.standard_normal(6)
        normal = normal.turned(step, normal.matrix @ step + 0.3 * slopes.T @ (slopes @ step) ** 3 / 30.0)
    own = Normal(matrix=normal.matrix, gradient=np.zeros(6), given=normal.scale)
    pull, some = generator.standard_normal(6), np.array([1, 0, 0, 1, 0, 0], bool)
    assert np.allclose(normal.step(0.1, pull), own.step(0.1, pull))
    assert np.allclose(normal.covariance(0.1, some), own.covariance(0.1, some))
    assert normal.promised(pull) == pytest.approx(own.promised(pull))
