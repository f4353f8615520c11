"""Turbines: of five megawatts with one soft blade, of two blades, and three blades about their orbit in gravity."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from benchmarks.simulators.machine import Floats, Machine, differences, stepped

from floquid import floquet

LINEARISED = Path(__file__).parents[2] / ".." / "shared" / "data" / "openfast_lin"
"""Linearisations of a turbine of five megawatts by an aeroelastic simulator."""

SOFT = 0.9
"""Stiffness of the soft blade in flap, over that of the others."""

GRAVITY = 9.81


@cache
def soft_blade() -> Machine:
    """Three blades of a turbine of five megawatts, one softer in flap by a tenth.

    A(t) is the trigonometric polynomial of first order through the linearisations at three azimuths.
    """
    found = floquet.read_openfast(str(LINEARISED))
    orders, parts = found.harmonics()
    states = len(parts)
    displacements = states // 2 + states % 2

    def matrix(t: float) -> Floats:
        a = np.real(parts @ np.exp(1j * orders * found.rotor_speed * t))
        a[displacements, 0] *= SOFT
        return a

    period, phases = 2.0 * np.pi / found.rotor_speed, 64
    return Machine(
        name="soft_blade",
        period=period,
        phases=phases,
        periods=60,
        transitions=stepped(matrix, period, phases),
        outputs=np.tile(np.eye(states)[:displacements], (phases, 1, 1)),
        blow=np.where(np.arange(states) < displacements, 1.0, 3.0),
    )


RADIUS = 20.0  # of the two blades [m]


def two_bladed(speed: float) -> Callable[[float], Floats]:
    r"""A(t) of two blades that flap and lag, on a tower that sways both ways and nods with its fore-aft motion.

    States are the sway to the side and fore and aft, the flap of both blades and their lag; then their rates.

    Blades are masses m at the radius l, measured in the rotor; the tower is measured on the ground. With ψ_j = Ωt + πj
    the axial motion of a blade is

    .. math:: w_j = (1 + \kappa l \cos\psi_j) v + l \beta_j,

    and its motion in the plane of the rotor is u + l sin(ψ_j + ζ_j), l cos(ψ_j + ζ_j), with aerodynamic damping of ẇ_j.
    """
    mass, radius, tower = 2500.0, RADIUS, 60e3
    nodding, twist, drag = 0.02, 0.15, 600.0
    flap, edge, fore, side = 5.3, 9.1, 3.3, 3.1
    inertia = mass * radius**2

    def matrix(t: float) -> Floats:
        m, d, k = (np.zeros((6, 6)) for _ in range(3))
        m[0, 0] = m[1, 1] = tower
        k[0, 0], k[1, 1] = tower * side**2, tower * fore**2
        d[0, 0], d[1, 1] = 0.02 * tower * side, 0.02 * tower * fore
        for blade, psi in enumerate(speed * t + np.pi * np.arange(2)):
            c, s = np.cos(psi), np.sin(psi)
            axial, rate, twice = (np.zeros(6) for _ in range(3))
            axial[[1, 2 + blade]] = 1.0 + nodding * radius * c, radius
            rate[1], twice[1] = -nodding * radius * speed * s, -nodding * radius * speed**2 * c
            m += mass * np.outer(axial, axial)
            d += mass * 2.0 * np.outer(axial, rate) + drag * np.outer(axial, axial)
            k += mass * np.outer(axial, twice) + drag * np.outer(axial, rate)
            lag = 4 + blade
            m[0, 0] += mass
            m[lag, lag] += inertia
            m[0, lag] += mass * radius * c
            m[lag, 0] += mass * radius * c
            d[0, lag] -= 2.0 * mass * radius * speed * s
            k[0, lag] -= mass * radius * speed**2 * c
            turn = np.array([[np.cos(twist), np.sin(twist)], [-np.sin(twist), np.cos(twist)]])
            spring = turn.T @ np.diag([flap**2, edge**2]) @ turn * inertia
            pair = np.ix_([2 + blade, lag], [2 + blade, lag])
            k[pair] += spring + np.diag([inertia * speed**2, mass * GRAVITY * radius * -c])
            d[pair] += np.diag([0.01 * inertia * flap, 0.012 * inertia * edge])
        a = np.zeros((12, 12))
        a[:6, 6:] = np.eye(6)
        a[6:, :6], a[6:, 6:] = -np.linalg.solve(m, k), -np.linalg.solve(m, d)
        return a

    return matrix


@cache
def two_blades() -> Machine:
    """Two blades that flap and lag on a tower, at 2 rad/s."""
    period, phases = np.pi, 48
    return Machine(
        name="two_blades",
        period=period,
        phases=phases,
        periods=60,
        transitions=stepped(two_bladed(2.0), period, phases),
        outputs=np.tile(np.eye(12)[:6], (phases, 1, 1)),
        blow=np.array([0.1, 0.1, 0.02, 0.02, 0.02, 0.02, 0.3, 0.3, 0.15, 0.15, 0.15, 0.15]),
    )


SUBSTEPS = 4
"""Steps of Runge and Kutta between samples: what is judged is the motion that these make."""


def _gravity_rates(t: float, x: Floats) -> Floats:
    """Rates of three lagging blades and a tower that sways (8, runs): angles and sway, then their rates.

    Blades are masses at a radius, on springs that stiffen with the cube of the angle, at large angles.
    """
    speed, mass, radius, tower = 1.0, 6e3, 30.0, 180e3
    edge, side, cubic = np.array([[3.7], [3.75], [3.66]]), 1.7, 900.0
    angles, rates = x[:3], x[4:7]
    psi = speed * t + 2.0 * np.pi / 3.0 * np.arange(3)[:, None] + angles
    c, s = np.cos(psi), np.sin(psi)
    alone = GRAVITY / radius * s - edge**2 * angles - cubic * angles**3 - 0.02 * edge * rates
    shaken = mass * radius * (s * (speed + rates) ** 2 - c * alone).sum(axis=0)
    sway = shaken - tower * (side**2 * x[3] + 0.03 * side * x[7])
    sway = sway / (tower + mass * (3.0 - (c**2).sum(axis=0)))
    return np.concatenate([x[4:], alone - c * sway / radius, sway[None]])


def _gravity_runs(starts: Floats, cycles: int, phases: int) -> Floats:
    """States at samples from initial states (8, runs) on: (samples + 1, 8, runs)."""
    step, x, out = 2.0 * np.pi / phases / SUBSTEPS, starts, [starts]
    for number in range(cycles * phases * SUBSTEPS):
        t = step * number
        one = _gravity_rates(t, x)
        two = _gravity_rates(t + 0.5 * step, x + 0.5 * step * one)
        three = _gravity_rates(t + 0.5 * step, x + 0.5 * step * two)
        x = x + step / 6.0 * (one + 2.0 * two + 2.0 * three + _gravity_rates(t + step, x + step * three))
        if (number + 1) % SUBSTEPS == 0:
            out.append(x)
    return np.array(out)


@cache
def gravity() -> Machine:
    """Three blades and a tower, not linear, about the orbit that gravity makes: measured before the blow."""
    period, phases, periods = 2.0 * np.pi, 32, 80

    def run(start: Floats, cycles: int = 1) -> Floats:
        return _gravity_runs(start[:, None], cycles, phases)[..., 0]

    start, steps = run(np.zeros(8), 20)[-1], np.full(8, 1e-4)
    for _ in range(3):
        over = differences(lambda x: run(x)[-1], start, steps) - np.eye(8)
        start = start - np.linalg.solve(over, run(start)[-1] - start)
    orbit = run(start)[:-1, :4].T

    def motion(deviation: Floats) -> Floats:
        return run(start + deviation, periods)[:-1, :4].T - np.tile(orbit, periods)

    return Machine(
        name="gravity",
        period=period,
        phases=phases,
        periods=periods,
        transitions=differences(run, start, steps),
        outputs=np.tile(np.eye(8)[:4], (phases, 1, 1)),
        blow=7e-5 * np.array([1.0, 1.0, 1.0, 10.0, 5.0, 5.0, 5.0, 20.0]),
        orbit=orbit,
        known=True,
        motion=motion,
    )
