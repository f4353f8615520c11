"""A switched converter, a cracked rotor and a strip that a laser scans."""

from __future__ import annotations

from functools import cache

import numpy as np
from benchmarks.simulators.machine import Floats, Machine, stepped
from scipy.linalg import expm

DUTY = 0.45
"""The share of a period in which the switch is closed."""


@cache
def converter() -> Machine:
    """A boost converter behind a filter, of fixed duty cycle, between its switchings exactly (Middlebrook, Cuk 1976).

    States are the filter's current and voltage, the choke's current and the output's voltage. Each part has its
    resistance; the voltages that are measured have the drop over that of their capacitors.
    """
    source, loss_in, choke_in, cap_in, esr_in = 24.0, 0.05, 60e-6, 47e-6, 0.05
    loss, choke, cap, esr, load, switch, diode = 0.06, 60e-6, 40e-6, 0.03, 12.0, 0.03, 0.04
    period, phases, periods = 1.0 / 10e3, 40, 80
    shared = load / (load + esr)

    def piece(closed: bool) -> tuple[Floats, Floats]:
        """A with the source in its last column (5, 5), and C (4, 4)."""
        own = loss + (switch if closed else diode + shared * esr)
        node = np.array([esr_in, 1.0, -esr_in, 0.0])
        out = np.array([0.0, 0.0, 0.0 if closed else shared * esr, shared])
        a = np.zeros((5, 5))
        a[0, :4], a[0, 0], a[0, 4] = -node / choke_in, -(loss_in + esr_in) / choke_in, source / choke_in
        a[1, [0, 2]] = 1.0 / cap_in, -1.0 / cap_in
        a[2, :4] = node / choke
        a[2, 2] -= own / choke
        a[2, 3] -= 0.0 if closed else shared / choke
        a[3, 2], a[3, 3] = 0.0 if closed else shared / cap, -1.0 / (cap * (load + esr))
        return a, np.array([[1.0, 0, 0, 0], node, [0, 0, 1.0, 0], out])

    (on, seen_on), (off, seen_off) = piece(True), piece(False)
    switching = DUTY * period
    # The first sample is half a sampling interval after the switch closes: no sample is at a switching.
    times = period * (np.arange(phases + 1) + 0.5) / phases

    def over(t: float) -> Floats:
        if t > period:
            return over(t - period) @ over(period)
        return expm(on * t) if t <= switching else expm(off * (t - switching)) @ expm(on * switching)

    whole = np.array([over(t) for t in times]) @ np.linalg.inv(over(times[0]))
    outputs = np.array([seen_on if t < switching else seen_off for t in times[:-1]])
    start = np.linalg.solve(np.eye(4) - whole[-1, :4, :4], whole[-1, :4, 4])
    orbit = np.einsum("sij,sj->is", outputs, (whole[:-1] @ np.append(start, 1.0))[:, :4])
    return Machine(
        name="converter",
        period=period,
        phases=phases,
        periods=periods,
        transitions=whole[:, :4, :4],
        outputs=outputs,
        blow=np.array([1.0, 2.0, 1.0, 2.0]),
        orbit=orbit,
    )


@cache
def cracked() -> Machine:
    """A disc on a shaft with a crack that breathes with its weight, in bearings that differ, about its orbit.

    The stiffness across the crack falls by a third where it is open: (1 + cos Ωt) / 2 of that (Mayes, Davies 1984).
    States are the disc's and the bearings' motion on the ground, across and upwards, and their rates.
    """
    speed, disc, bearing = 60.0, 1.0, 0.3
    shaft, open_, crossed = 90.0**2, 0.33, 0.1
    holds, damped = np.array([150.0**2, 180.0**2]) * bearing, np.array([9.0, 12.0])
    loss = 2.0 * 0.006 * 90.0

    def stiffness(t: float) -> Floats:
        c, s = np.cos(speed * t), np.sin(speed * t)
        turn = np.array([[c, s], [-s, c]])
        return shaft * (np.eye(2) - 0.5 * (1.0 + c) * turn.T @ np.diag([open_, crossed]) @ turn)

    def matrix(t: float) -> Floats:
        k = stiffness(t)
        a = np.zeros((8, 8))
        a[:4, 4:] = np.eye(4)
        a[4:6, :2], a[4:6, 2:4] = -k / disc, k / disc
        a[6:, :2], a[6:, 2:4] = k / bearing, -(k + np.diag(holds)) / bearing
        drag = loss * np.eye(2)
        a[4:6, 4:6], a[4:6, 6:] = -drag / disc, drag / disc
        a[6:, 4:6], a[6:, 6:] = drag / bearing, -(drag + np.diag(damped)) / bearing
        return a

    def forced(t: float) -> Floats:
        """The matrix with weight and imbalance in its last column (9, 9)."""
        a = np.zeros((9, 9))
        a[:8, :8] = matrix(t)
        a[4:6, 8] = 5e-5 * speed**2 * np.array([np.cos(speed * t + 1.0), np.sin(speed * t + 1.0)])
        a[5, 8] -= 9.81
        a[7, 8] -= 9.81
        return a

    period, phases = 2.0 * np.pi / speed, 32
    whole = stepped(forced, period, phases)
    start = np.linalg.solve(np.eye(8) - whole[-1, :8, :8], whole[-1, :8, 8])
    orbit = (whole[:-1] @ np.append(start, 1.0))[:, :4].T
    return Machine(
        name="cracked",
        period=period,
        phases=phases,
        periods=80,
        transitions=whole[:, :8, :8],
        outputs=np.tile(np.eye(8)[:4], (phases, 1, 1)),
        blow=np.array([0.0, 0.0, 0.0, 0.0, 0.2, 0.2, 0.2, 0.2]),
        orbit=orbit,
    )


@cache
def strip() -> Machine:
    """Four bending modes of a strip held at its ends, seen by one laser that moves along it and back each period."""
    turns, damping = np.array([1.37, 3.42, 6.18, 9.71]), np.array([0.012, 0.006, 0.004, 0.003])
    period, phases = 0.1, 64
    omega = 2.0 * np.pi / period * turns
    half = [
        expm(np.array([[0.0, 1.0], [-(w**2), -2.0 * z * w]]) * period / phases)
        for w, z in zip(omega, damping, strict=True)
    ]
    step = np.zeros((8, 8))
    for mode, each in enumerate(half):
        step[np.ix_([mode, 4 + mode], [mode, 4 + mode])] = each
    places = 0.45 + 0.3 * np.cos(2.0 * np.pi * np.arange(phases) / phases)
    outputs = np.zeros((phases, 1, 8))
    # A laser measures the rate.
    outputs[:, 0, 4:] = np.sin(np.pi * np.multiply.outer(places, np.arange(1, 5)))
    powers = [np.eye(8)]
    for _ in range(phases):
        powers.append(step @ powers[-1])
    return Machine(
        name="strip",
        period=period,
        phases=phases,
        periods=60,
        transitions=np.array(powers),
        outputs=outputs,
        blow=np.concatenate([np.zeros(4), np.ones(4)]),
    )
