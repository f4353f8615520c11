"""The factors by which a forced response follows a speed that wanders, beside that response by integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from floquid.periodic import followed

EXPONENT, SPEED = -1.0 + 4.0j, 6.0
TIMES = np.linspace(0.0, 60.0, 3000)


def deviation(times, size, pace):
    return size * (np.cos(pace * times) + np.cos(2.3 * pace * times + 1.0))


def steady(size, pace):
    """The state of a mode that turns with the shaft and is driven once a revolution, as the shaft sees it."""

    def rate(time, state):
        return (EXPONENT - 1j * SPEED * (1.0 + deviation(time, size, pace))) * state + 1.0

    start = np.array([1.0 / (1j * SPEED - EXPONENT)])
    return solve_ivp(rate, (-40.0, TIMES[-1]), start, t_eval=TIMES, method="DOP853", rtol=1e-12, atol=1e-14).y[0]


def beyond(response, size, pace):
    """What the factors do not hold of it, rms."""
    held = np.vstack([np.ones(len(TIMES)), followed(deviation(TIMES, size, pace))]).T
    return np.std(response - held @ np.linalg.lstsq(held, response, rcond=None)[0])


@pytest.mark.parametrize("pace", [0.2, 0.4])
def test_small_deviations_are_held_to_the_second_power_of_their_pace(pace):
    most, least = (beyond(steady(1e-4, own), 1e-4, own) for own in (pace, 0.5 * pace))
    assert least < most / 6.0


@pytest.mark.first(1)
@pytest.mark.parametrize("pace", [0.2, 0.4])
def test_their_squares_are_held_to_the_first_power(pace):
    def squares(pace):
        return beyond(steady(0.02, pace) + steady(-0.02, pace), 0.02, pace)

    assert squares(0.5 * pace) < squares(pace) / 3.0
