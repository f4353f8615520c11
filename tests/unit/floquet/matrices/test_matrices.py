"""What the arithmetic, conversions and periods of periodic matrices refuse; periodic systems and their connections."""

import numpy as np
import pytest

from floquid.errors import InputError
from floquid.floquet import (
    FunctionMatrix,
    HarmonicMatrix,
    PeriodicSystem,
    PiecewiseMatrix,
)
from floquid.floquet.matrices import after_jumps

A = HarmonicMatrix.from_cosines(
    [[0.0, 1.0], [-2.0, -0.3]], [[[0.0], [0.0]], [[0.8], [0.0]]], [[[0.0], [0.1]], [[0.0], [0.0]]], period=2.0
)
JUMPING = FunctionMatrix(
    function=lambda t: np.array([[1.0, 2.0 if t % 1.0 < 0.3 else -1.0], [0.0, np.cos(2.0 * np.pi * t)]]),
    period=1.0,
    breaks=[0.0, 0.3],
)


TIMES = np.mod(0.3819660112501051 * np.arange(1, 120), 1.0) * 12.0 - 3.0


@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        (lambda: A + 1.0, r"`right` of `\+` must have shape \(rows, columns\), but has shape \(\)\.\n.*np\.eye"),
        (lambda: A - np.eye(3), r"`right` of `-` must have the shape \(2, 2\) of the left, but has shape \(3, 3\)"),
        (lambda: A * np.eye(2), r"`factor` of `\*` must be a finite number.*\n.*`@`"),
        (lambda: A @ np.eye(3), "`right` of `@` must have as many rows as the left has columns, 2"),
        (lambda: np.ones((1, 3)) @ A, r"`right` of `@` must have as many rows.*3, but has shape \(2, 2\)"),
        (lambda: A + JUMPING, r"`right` of `\+` must have the period of `left` to within 1e-12.*, 2 s, but has 1 s"),
        (lambda: JUMPING @ A, r"`right` of `@` must have the period of `left` to within 1e-12.*, 1 s, but has 2 s"),
        (lambda: A + JUMPING.at, r"`right` of `\+` must be an array of numbers"),
    ],
)
def test_what_cannot_be_is_refused(attempt, message):
    with pytest.raises(InputError, match=message):
        attempt()


def test_instants_that_differ_by_the_rounding_of_a_sum_are_one():
    """Of 10 000 equal parts, as sums and as products; two that are forty times as far apart are two."""
    length = 0.7 / 10_000
    products, sums = np.arange(10_000) * length, np.append(0.0, np.cumsum(np.full(9_999, length)))
    assert np.abs(products - sums).max() > 1e-13 * 0.7

    def over(edges):
        return PiecewiseMatrix(values=np.ones((1, 1, len(edges))), edges=edges, period=0.7)

    assert (over(products) + over(sums)).breaks.size == 10_000
    assert (over([0.0, 0.1]) + over([0.0, 0.1 + 1e-11])).breaks.size == 3


def test_a_sample_on_a_jump_is_the_value_after_it():
    """3 * 0.1 is not 0.3: rounding must not choose the side."""
    edges = np.array([1, 3, 6, 7]) * 0.1
    pieces = PiecewiseMatrix(values=np.arange(1.0, 5.0)[None, None], edges=edges, period=1.0)
    assert after_jumps(pieces, 0.1 * np.arange(10))[:, 0, 0].tolist() == [4, 1, 1, 2, 2, 2, 3, 4, 4, 4]


def test_rounding_makes_no_series_complex():
    """What cancels leaves the rounding of two conjugates alone, which is no series of a real matrix by itself."""
    turned = np.where(np.asarray(A.harmonics) > 0, 1.0 + 4e-13j, 1.0)
    almost = HarmonicMatrix(coefficients=np.asarray(A.coefficients) * turned, harmonics=A.harmonics, period=A.period)
    for rest in (A - almost, A @ A - almost @ A):
        assert np.abs(rest.at(TIMES)).max() < 1e-11


def test_a_system_has_one_period_and_names():
    twice = FunctionMatrix(function=JUMPING.function, period=2.0, breaks=[0.0, 0.3, 1.0, 1.3])
    system = PeriodicSystem(A=A, B=twice, C=[[1.0, 0.0]], states=["x", "v"], inputs=["left", "right"])
    assert system.period == 2.0
    assert {matrix.period for matrix in (system.A, system.B, system.C, system.D)} == {2.0}
    assert np.asarray(system.B.breaks) == pytest.approx([0.0, 0.3, 1.0, 1.3])
    assert (system.n_states, system.n_inputs, system.n_outputs) == (2, 2, 1)
    assert (system.states, system.inputs, system.outputs) == (("x", "v"), ("left", "right"), ("y1",))
    assert system.D.at(0.7).tolist() == [[0.0, 0.0]]
    free = PeriodicSystem(A=A)
    assert free.B is None
    assert free.D is None
    assert free.C.at(0.1).tolist() == [[1.0, 0.0], [0.0, 1.0]]


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"A": np.eye(2)}, r"`A` of `PeriodicSystem` must have a period where all is constant.*\n.*HarmonicMatrix"),
        ({"A": A @ np.ones((2, 3))}, r"`A` of `PeriodicSystem` must have shape \(n, n\) = \(2, 2\)"),
        ({"A": A, "B": np.ones((3, 1))}, r"`B` of `PeriodicSystem` must have shape \(n, inputs\) = \(2, 1\)"),
        ({"A": A, "C": np.ones((1, 3))}, r"`C` of `PeriodicSystem` must have shape \(outputs, n\) = \(1, 2\)"),
        ({"A": A, "B": A, "D": [[1.0]]}, r"`D` of `PeriodicSystem` must have shape \(outputs, inputs\) = \(2, 2\)"),
        ({"A": A, "D": [[1.0]]}, "`B` of `PeriodicSystem` must be given with D"),
        ({"A": A, "states": ["x"]}, "`states` of `PeriodicSystem` must have 2 names, but has 1"),
        ({"A": A, "states": "xy"}, "`states` of `PeriodicSystem` must be a list of names"),
        ({"A": A, "outputs": ["y", "y"]}, "`outputs` of `PeriodicSystem` must have distinct names"),
        (
            {"A": A, "B": HarmonicMatrix.from_cosines([[0.0], [0.0]], [[[1.0]]] * 2, [[[0.0]]] * 2, period=np.e)},
            r"`B` of `PeriodicSystem` must have the period of `A` to within 1e-12.*, 2 s, but has 2\.718\d+ s",
        ),
    ],
)
def test_systems_that_do_not_fit_are_refused(keywords, message):
    with pytest.raises(InputError, match=message):
        PeriodicSystem(**keywords)
