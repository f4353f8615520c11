"""A passive walker with the gait of a compass, about its limit cycle: two legs, contacts at each step."""

from __future__ import annotations

from functools import cache

import numpy as np
from benchmarks.simulators.machine import Floats, Machine, differences
from scipy.integrate import solve_ivp

SLOPE = 0.0525
LEG, HIP, BELOW, ABOVE = 5.0, 10.0, 0.5, 0.5
"""Masses of a leg and of the hip [kg], and the leg below and above its mass [m] (Goswami, Thuilot, Espiau 1998)."""

LENGTH = BELOW + ABOVE
GRAVITY = 9.81

SWINGING = 0.3
"""Time [s] within which no step ends: the foot that swings passes the other one meanwhile."""

HARD = 5e-4
"""The push [rad] from which on the response is percents off a linear one."""

GUESS = np.array([-0.2187, 0.3234, 1.0918, 0.3772])


def rates(_: float, x: Floats) -> Floats:
    """Rates of the angles of the leg that stands and of the one that swings, and of their rates (4,)."""
    apart, (stand, swing) = x[0] - x[1], x[2:]
    coupling = LEG * LENGTH * ABOVE
    mass = np.array(
        [
            [HIP * LENGTH**2 + LEG * BELOW**2 + LEG * LENGTH**2, -coupling * np.cos(apart)],
            [-coupling * np.cos(apart), LEG * ABOVE**2],
        ]
    )
    falls = GRAVITY * (HIP * LENGTH + LEG * BELOW + LEG * LENGTH) * np.sin(x[0])
    force = np.array(
        [
            coupling * np.sin(apart) * swing**2 + falls,
            -coupling * np.sin(apart) * stand**2 - LEG * ABOVE * GRAVITY * np.sin(x[1]),
        ]
    )
    return np.concatenate([x[2:], np.linalg.solve(mass, force)])


def stepped_over(x: Floats) -> Floats:
    """The state after the foot that swung has met the ground without a rebound and the other has left it."""
    (stand, swing), zero = x[:2], np.zeros(2)
    along, across = np.array([-np.cos(stand), -np.sin(stand)]), np.array([np.cos(swing), np.sin(swing)])

    def moves(below: float, above: float) -> Floats:
        """Velocity of a point by those of the foot that stood and the two rates (2, 4)."""
        return np.column_stack([np.eye(2), below * along, above * across])

    bodies = ((LEG, moves(BELOW, 0.0)), (HIP, moves(LENGTH, 0.0)), (LEG, moves(LENGTH, ABOVE)))
    mass = sum(weight * part.T @ part for weight, part in bodies)
    foot = moves(LENGTH, LENGTH)
    whole = np.block([[mass, -foot.T], [foot, np.zeros((2, 2))]])
    after = np.linalg.solve(whole, np.concatenate([mass @ np.concatenate([zero, x[2:]]), zero]))
    return np.array([swing, stand, after[3], after[2]])


def landing(_: float, x: Floats) -> float:
    """Zero where both feet are on the slope."""
    return float(x[0] + x[1] - 2.0 * SLOPE)


landing.terminal, landing.direction = True, 1.0  # type: ignore[attr-defined]


def walk(start: Floats, times: Floats) -> Floats:
    """States at instants (instants, 4) from a state within a step at the first."""
    out, x, now = np.empty((len(times), 4)), start, float(times[0])
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "dense_output": True}
    # A step that has just begun has both feet on the slope: its end is looked for later.
    begun, last = abs(landing(0.0, start)) < 1e-2 and start[0] < start[1], float(times[-1])
    while True:
        parts = []
        if begun:
            parts.append(solve_ivp(rates, (now, now + SWINGING), x, **options))
            now, x = float(parts[-1].t[-1]), parts[-1].y[:, -1]
        parts.append(solve_ivp(rates, (now, now + 2.0), x, events=landing, **options))
        if not len(parts[-1].t_events[0]):
            raise ValueError("the walker falls")
        for part in parts:
            inside = (times >= part.t[0]) & (times <= part.t[-1])
            if inside.any():
                out[inside] = part.sol(times[inside]).T
        now, x = float(parts[-1].t[-1]), stepped_over(parts[-1].y[:, -1])
        if now > last:
            return out
        begun = True


def gait() -> tuple[Floats, float]:
    """The state just after a step that the next one brings back, and how long a step takes."""

    def whole(part: Floats) -> Floats:
        return np.array([part[0], 2.0 * SLOPE - part[0], part[1], part[2]])

    def after(part: Floats) -> Floats:
        begin = solve_ivp(rates, (0.0, SWINGING), whole(part), method="DOP853", rtol=1e-11, atol=1e-13)
        end = solve_ivp(rates, (SWINGING, 3.0), begin.y[:, -1], events=landing, method="DOP853", rtol=1e-11, atol=1e-13)
        next_, duration = stepped_over(end.y[:, -1]), float(end.t[-1])
        return np.array([next_[0], next_[2], next_[3], duration])

    part = GUESS[[0, 2, 3]]
    for _ in range(10):
        jacobian = differences(lambda x: after(x)[:3], part, np.full(3, 1e-4))
        part = part - np.linalg.solve(jacobian - np.eye(3), after(part)[:3] - part)
    return whole(part), float(after(part)[3])


@cache
def walker(push: float = 1e-5) -> Machine:
    """The walker: angles and rates of the leg that stands and of the one that swings, sampled between its contacts.

    `push` is the deviation of the angles [rad]; that of the rates is three times as large [rad/s].
    """
    state, period = gait()
    phases, periods = 32, 30
    # A contact lies halfway between two samples.
    first = 0.5 * period / phases
    within = solve_ivp(rates, (0.0, first), state, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    times = period * np.arange(phases * periods + 1) / phases

    def run(start: Floats, cycles: int = 1) -> Floats:
        return walk(start, times[: phases * cycles + 1])

    orbit = run(within)[:-1].T

    def motion(deviation: Floats) -> Floats:
        return run(within + deviation, periods)[:-1].T - np.tile(orbit, periods)

    return Machine(
        name="walker" if push < HARD else "walker_pushed",
        period=period,
        phases=phases,
        periods=periods,
        transitions=differences(run, within, np.full(4, 1e-4)),
        outputs=np.tile(np.eye(4), (phases, 1, 1)),
        blow=push * np.array([1.0, 1.0, 3.0, 3.0]),
        orbit=orbit,
        known=True,
        motion=motion,
    )


def walker_pushed() -> Machine:
    """The same after a push that is not small: its response is some percent off that of a linear system."""
    return walker(1e-3)
