"""Transition matrices over many values of the parameters, held against those of one value at a time."""

import numpy as np
import pytest

from floquid import floquet
from floquid.errors import InputError
from floquid.systems import JeffcottRotor

UNIT = JeffcottRotor(speed=1.0)


def rotor(t, speed):
    return UNIT.system(t * speed)


def half_turn(speed):
    return np.pi / speed


@pytest.mark.parametrize("vectorised", [False, True])
@pytest.mark.parametrize(("start", "end"), [(0.0, 1.0), (0.3, 0.3), (-0.4, 2.7)])
def test_each_is_as_if_it_were_alone(vectorised, start, end):
    speeds = np.linspace(0.4, 1.2, 6).reshape(2, 3)
    found = floquet.transitions(rotor, half_turn, {"speed": speeds}, start=start, end=end, vectorised=vectorised)
    assert found.shape == (2, 3, 4, 4)
    for index in np.ndindex(2, 3):
        period = np.pi / speeds[index]
        one = JeffcottRotor(speed=speeds[index])
        exact = floquet.transition(one.system, period, [end * period], start=start * period)[0]
        assert found[index] == pytest.approx(exact, abs=1e-11)


def test_jumps_are_met_in_every_period():
    def switched(t, low, high):
        return [[low if t % 1.0 < 0.3 else high]]

    found = floquet.transitions(
        switched, 1.0, {"low": [[-1.0], [-2.0]], "high": [0.5, 1.0, 2.0]}, start=0.1, end=2.2, breaks=[0.0, 0.3]
    )
    low, high = np.array([[-1.0], [-2.0]]), np.array([0.5, 1.0, 2.0])
    assert found[..., 0, 0] == pytest.approx(np.exp(0.7 * low + 1.4 * high), rel=1e-11)


def test_units_of_the_states_are_given_back():
    scale = np.array([1e6, 1.0])

    def scaled(t, a):
        return scale[:, None] * np.array([[0.0, 1.0], [-a, -0.1 * np.cos(t)]]) / scale

    found = floquet.transitions(scaled, 2 * np.pi, {"a": [1.0]})[0]
    exact = floquet.monodromy(lambda t: [[0.0, 1.0], [-1.0, -0.1 * np.cos(t)]], 2 * np.pi)
    assert found == pytest.approx(scale[:, None] * exact / scale, rel=1e-10)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"parameters": {}}, "must map a name at least"),
        ({"parameters": {"speed": []}}, "must have a value at least"),
        ({"parameters": {"speed": [np.nan]}}, "must be finite"),
        ({"parameters": {"speed": "fast"}}, "must be numbers that broadcast"),
        ({"end": -1.0}, "`end` of `floquet.transitions` must not lie before `start` = 0"),
    ],
)
def test_wrong_arguments_are_refused(keywords, message):
    with pytest.raises(InputError, match=message):
        floquet.transitions(**({"system": rotor, "period": half_turn, "parameters": {"speed": [0.5]}} | keywords))


def test_overflow_is_refused():
    with pytest.raises(InputError, match="Φ overflows at a = 2000"):
        floquet.transitions(lambda t, a: [[a]], 1.0, {"a": [1.0, 2000.0]})
