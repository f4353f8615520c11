r"""A three-bladed turbine in its edgewise and side-side motion, one blade softer than the others.

.. math::
    I \ddot\zeta_k + c\,\dot\zeta_k + (\kappa_k + e S \dot\theta^2 - g S \cos\psi_k)\,\zeta_k + S \cos\psi_k\, \ddot x
        = g S \sin\psi_k - (I + e S)\,\ddot\theta

    M \ddot x + d\,\dot x + k x + S \sum_k (\cos\psi_k\, \ddot\zeta_k - 2\dot\theta \sin\psi_k\, \dot\zeta_k
        - (\dot\theta^2 \cos\psi_k + \ddot\theta \sin\psi_k)\,\zeta_k)
        = u\,(\dot\theta^2 \sin\psi_1 - \ddot\theta \cos\psi_1)

with x the tower top to the side, ζ_k the angle of blade k in the rotor's plane about a hinge near the hub, ψ_k = θ +
2πk/3 its azimuth (zero upwards) and u the imbalance of the rotor: rigid blades on springs, to first order in x and ζ.
(Coleman's model of a rotor on a flexible support, with gravity.) Run it to write `run.csv` and `truth.json`.
"""

import json
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import floquid as fq

HERE = Path(__file__).parent
SPEED = 12.0 / 60.0 * 2.0 * np.pi  # of the rotor, on average [rad/s]
LENGTH, MASS, OFFSET, GRAVITY = 60.0, 17700.0, 2.0, 9.81  # of a blade from its hinge [m, kg]; of the hinge [m]; [m/s²]
STATIC, INERTIA = MASS * LENGTH / 3.0, MASS * LENGTH**2 / 6.0  # of a blade that tapers to nothing [kg m, kg m²]
BLADE_HZ, SOFTER, BLADE_DAMPING = 1.08, 0.08, 0.006  # of a blade alone; the stiffness that the third one lacks
TOWER_HZ, TOWER_MASS, TOWER_DAMPING = 0.33, 300e3, 0.01
IMBALANCE = 1500.0  # [kg m]
WANDER = ((0.003, 150.0, 0.4), (0.001, 65.0, 2.0))  # share of the speed, period [s], phase
RATE, DURATION, NOISE = 10.0, 140.0, 0.01  # [Hz, s]; of each channel's largest free response
START = 1.9  # the azimuth at the first sample [rad]


def azimuths(angle: np.ndarray) -> np.ndarray:
    """The azimuth of each blade (..., 3) [rad]."""
    return np.asarray(angle)[..., None] + 2.0 * np.pi / 3.0 * np.arange(3)


def rates(angle, speed, acceleration) -> tuple[np.ndarray, np.ndarray]:
    """State matrix (..., 8, 8) and load (..., 8) of the states [x, ζ, x', ζ']."""
    psi = azimuths(angle)
    c, s = np.cos(psi), np.sin(psi)
    speed, acceleration = (np.asarray(v, float)[..., None] for v in (speed, acceleration))
    shape = c.shape[:-1]
    mass, damping, stiffness = (np.zeros((*shape, 4, 4)) for _ in range(3))
    load = np.zeros((*shape, 4))
    total = TOWER_MASS + 3.0 * MASS
    own = INERTIA * (2.0 * np.pi * BLADE_HZ) ** 2
    blade = np.arange(1, 4)
    mass[..., 0, 0] = total
    mass[..., 0, 1:] = mass[..., 1:, 0] = STATIC * c
    mass[..., blade, blade] = INERTIA
    damping[..., 0, 0] = 2.0 * TOWER_DAMPING * total * 2.0 * np.pi * TOWER_HZ
    damping[..., 0, 1:] = -2.0 * speed * STATIC * s
    damping[..., blade, blade] = 2.0 * BLADE_DAMPING * INERTIA * 2.0 * np.pi * BLADE_HZ
    stiffness[..., 0, 0] = total * (2.0 * np.pi * TOWER_HZ) ** 2
    stiffness[..., 0, 1:] = -STATIC * (speed**2 * c + acceleration * s)
    stiffness[..., blade, blade] = own * np.array([1.0, 1.0, 1.0 - SOFTER]) + OFFSET * STATIC * speed**2
    stiffness[..., blade, blade] -= GRAVITY * STATIC * c
    load[..., 0] = IMBALANCE * (speed**2 * s - acceleration * c)[..., 0]
    load[..., 1:] = GRAVITY * STATIC * s - (INERTIA + OFFSET * STATIC) * acceleration
    a, b = np.zeros((*shape, 8, 8)), np.zeros((*shape, 8))
    a[..., :4, 4:] = np.eye(4)
    a[..., 4:, :4] = -np.linalg.solve(mass, stiffness)
    a[..., 4:, 4:] = -np.linalg.solve(mass, damping)
    b[..., 4:] = np.linalg.solve(mass, load[..., None])[..., 0]
    return a, b


def system(t):
    """A(t) at the mean speed (..., 8, 8)."""
    return rates(SPEED * np.asarray(t, float), SPEED, 0.0)[0]


def exponents():
    """The true Floquet exponents at the mean speed, principal (8,) [1/s]."""
    return fq.floquet.exponents(fq.floquet.FunctionMatrix(function=system, period=2 * np.pi / SPEED, vectorised=True))


def turning(t):
    """Angle [rad], speed and acceleration of the shaft at the times `t` [s], each (times,)."""
    t = np.asarray(t, float)
    angle, speed, acceleration = START + SPEED * t, np.full_like(t, SPEED), np.zeros_like(t)
    for share, length, phase in WANDER:
        w = 2.0 * np.pi / length
        angle += SPEED * share / w * (np.sin(w * t + phase) - np.sin(phase))
        speed += SPEED * share * np.cos(w * t + phase)
        acceleration -= SPEED * share * w * np.sin(w * t + phase)
    return angle, speed, acceleration


def outputs(times, states, loaded):
    """Tower top acceleration and root moments (4, times) of `states` (times, 8), with or without the loads."""
    a, b = rates(*turning(times))
    accelerations = np.einsum("tij,tj->ti", a, states) + loaded * b
    own = INERTIA * (2.0 * np.pi * BLADE_HZ) ** 2 * np.array([1.0, 1.0, 1.0 - SOFTER])
    drag = 2.0 * BLADE_DAMPING * INERTIA * 2.0 * np.pi * BLADE_HZ
    moments = 1e-6 * (own * states[:, 1:4] + drag * states[:, 5:])
    return np.vstack([accelerations[None, :, 4], moments.T])


def responses():
    """Times, and the free and the forced response (4, times): the free one begins where the generator lets go."""
    times = np.arange(round(RATE * DURATION)) / RATE
    kicked = np.array([0.08, 0.012, -0.009, 0.010, 0.1, 0.06, 0.05, -0.05])

    def run(loaded, initial, instants):
        def slope(t, x):
            a, b = rates(*(v[0] for v in turning(np.array([t]))))
            return a @ x + loaded * b

        return solve_ivp(slope, instants[[0, -1]], initial, "DOP853", instants, rtol=1e-9, atol=1e-12).y.T

    before = np.arange(-4000, 1) / RATE  # long enough to forget where it began
    steady = run(1.0, np.zeros(8), before)[-1]
    free = outputs(times, run(0.0, kicked, times), 0.0)
    return times, free, outputs(times, run(1.0, steady, times), 1.0)


def main() -> None:
    """Write the record and the truth."""
    times, free, forced = responses()
    generator = np.random.default_rng(0)
    noise = NOISE * np.abs(free).max(axis=1, keepdims=True) * generator.standard_normal(free.shape)
    azimuth = np.degrees(turning(times)[0]) + 0.2 * generator.standard_normal(len(times))
    values = np.vstack([free + forced + noise, azimuth[None] % 360.0])
    names = ["tower acc [m/s2]", "root 1 [MN m]", "root 2 [MN m]", "root 3 [MN m]", "azimuth [deg]"]
    np.savetxt(
        HERE / "run.csv",
        np.vstack([times[None], values]).T,
        delimiter=",",
        header=",".join(["time [s]", *names]),
        comments="",
        fmt=["%.2f", "%.5f", "%.5f", "%.5f", "%.5f", "%.2f"],
    )
    true = [[float(e.real), float(e.imag)] for e in exponents()]
    (HERE / "truth.json").write_text(json.dumps({"speed": SPEED, "exponents": true}, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
