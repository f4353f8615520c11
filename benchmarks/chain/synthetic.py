"""Cases made up: a turbine about its gravity orbit, real negative multipliers, and modes closer than they are wide."""

from __future__ import annotations

from functools import cache

import numpy as np
from benchmarks.chain.case import Case, Modes, noisy, response, synthetic
from numpy.typing import NDArray

from floquid import ConstantPeriod, Record, floquet

SPEED = 1.0
"""The turbine's [rad/s]."""

BLADES = (2.62, 2.70, 2.81)
"""Edgewise frequencies of the blades, not quite alike [rad/s]."""

TOWER = 0.83
DAMPING = (0.006, 0.010)
"""Damping ratios of blades and tower."""

STIFFENING, COUPLING, SHAKING = 0.35, 0.30, 0.06
"""What gravity adds to a blade's stiffness at the bottom of its turn, what the tower's acceleration does to a blade,
and what the blades' do to the tower."""

BLOW = np.array([0.0, 0.0, 0.0, 0.0, 1.0, -0.4, 0.2, 1.0])
"""The state after a blow on blades and tower: deflections of the three and of the tower, then their rates."""

GRAVITY = 5.0
"""The largest deflection on the orbit over the largest free one, of the first blade."""


def noised(
    modes: Modes,
    forced: tuple[NDArray[np.float64], NDArray[np.complex128]],
    samples: float,
    n_periods: int,
    noise: float,
    seed: int,
    ratio: float = 0.0,
    **options: object,
) -> Case:
    """The case of modes beside a forced response, sampled evenly.

    `forced` are harmonics of the period and their sizes (channels, harmonics); its largest in the first channel is
    `ratio` times the free one's.
    """
    times = np.arange(int(n_periods * samples)) * (modes.period / samples)
    angles = modes.fundamental * times
    free = response(modes.exponents, modes.coefficients, modes.harmonics, times, angles)
    turns, sizes = forced
    orbit = 2.0 * (sizes @ np.exp(1j * np.multiply.outer(turns, angles))).real
    if ratio:
        orbit *= ratio * np.abs(free[0]).max() / np.abs(orbit[0]).max()
    values, sigma = noisy(free + orbit, free, noise, seed)
    names = [f"channel {number + 1}" for number in range(len(values))]
    clock = ConstantPeriod(period=modes.period)
    record = Record(values=values, sample_rate=samples / modes.period, channels=names, clock=clock)
    return synthetic(modes, record, (times, angles), sigma, tuple(turns), options=options)


def turbine(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """A(t) of three blades, which gravity stiffens in turn, on a tower; deflections, then their rates (..., 8, 8)."""
    turned = SPEED * np.asarray(t, float)[..., None] + 2.0 * np.pi / 3.0 * np.arange(3)
    mass, stiffness, damping = (np.zeros((*turned.shape[:-1], 4, 4)) for _ in range(3))
    mass[..., range(4), range(4)] = 1.0
    mass[..., :3, 3], mass[..., 3, :3] = COUPLING * np.cos(turned), SHAKING * np.cos(turned)
    own = np.array([*BLADES, TOWER])
    stiffness[..., range(4), range(4)] = own**2
    stiffness[..., range(3), range(3)] -= STIFFENING * np.cos(turned)
    damping[..., range(4), range(4)] = 2.0 * own * np.array([DAMPING[0]] * 3 + [DAMPING[1]])
    a = np.zeros((*turned.shape[:-1], 8, 8))
    a[..., :4, 4:] = np.eye(4)
    a[..., 4:, :4], a[..., 4:, 4:] = -np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)
    return a


def weight(t: float) -> NDArray[np.float64]:
    """The rates of the states that gravity makes (8,)."""
    turned = SPEED * t + 2.0 * np.pi / 3.0 * np.arange(3)
    mass = np.eye(4)
    mass[:3, 3], mass[3, :3] = COUPLING * np.cos(turned), SHAKING * np.cos(turned)
    return np.concatenate([np.zeros(4), np.linalg.solve(mass, np.append(np.sin(turned), 0.0))])


@cache
def turbine_modes() -> Modes:
    """The turbine's modes after the blow, deflections alone."""
    found = floquet.modes(turbine, 2.0 * np.pi / SPEED)
    amounts = np.linalg.solve(found.shapes([0.0])[..., 0].T, BLOW.astype(complex))
    near = np.abs(found.harmonics) <= 12
    upper = found.exponents.imag > 0
    shapes = found.coefficients[upper][:, :4, near] * amounts[upper, None, None]
    return Modes(
        exponents=found.exponents[upper], coefficients=shapes, harmonics=found.harmonics[near], period=found.period
    )


@cache
def gravity_orbit() -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Harmonics of the turn on the orbit, and their sizes (deflections, harmonics), by integration over one turn."""
    from scipy.integrate import solve_ivp

    period, count = 2.0 * np.pi / SPEED, 64
    times = period * np.arange(count + 1) / count

    def run(start: NDArray[np.float64], share: float) -> NDArray[np.float64]:
        def rates(t: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
            return turbine(np.array(t)) @ x + share * weight(t)

        return solve_ivp(rates, (0.0, period), start, t_eval=times, method="DOP853", rtol=1e-11, atol=1e-12).y

    over = np.stack([run(column, 0.0)[:, -1] for column in np.eye(8)], axis=1)
    start = np.linalg.solve(np.eye(8) - over, run(np.zeros(8), 1.0)[:, -1])
    lines = np.fft.fft(run(start, 1.0)[:4, :-1], axis=1) / count
    lines[:, 0] *= 0.5
    harmonics = np.arange(13)
    return harmonics.astype(float), lines[:, harmonics]


def turbine_orbit(noise: float, seed: int) -> Case:
    """Three blades and a tower ring about their orbit in gravity, a turn a period, 32 samples each; it is left in."""
    return noised(turbine_modes(), gravity_orbit(), 32.0, 256, noise, seed, ratio=GRAVITY)


def shapes(rows: int, channels: int, falls: tuple[float, ...], seed: int) -> NDArray[np.complex128]:
    """Random coefficients, the harmonics of each mode of the sizes given (modes, channels, harmonics)."""
    generator = np.random.default_rng(seed)
    drawn = generator.standard_normal((2, rows, channels, len(falls)))
    return (drawn[0] + 1j * drawn[1]) * np.array(falls)


def two_real(noise: float, seed: int) -> Case:
    """Multipliers of -0.9 and -0.8, both half a turn from their conjugates, and an imbalance on their very lines."""
    modes = Modes(
        exponents=np.log([0.9, 0.8]) + 1j * np.pi,
        coefficients=shapes(2, 3, (0.3, 1.0, 0.3), 1),
        harmonics=np.array([-1, 0, 1]),
        period=1.0,
    )
    sizes = np.array([[1.0, 0.2], [0.6 - 0.5j, 0.1j], [0.3j, 0.2]])
    orbit = (np.array([0.5, 1.0]), sizes)
    return noised(modes, orbit, 20.0, 200, noise, seed, ratio=3.0, periods_per_revolution=2)


def two_close(samples: float, noise: float, seed: int) -> Case:
    """Two pairs a fifth of their decay apart modulo iω, two turns apart where they are strongest."""
    decay, omega = 0.05, 2.0 * np.pi
    exponents = np.array([-decay + 0.30j * omega, -1.1 * decay + 1j * (2.30 * omega + 0.2 * decay)])
    modes = Modes(
        exponents=exponents,
        coefficients=shapes(2, 3, (0.2, 1.0, 0.2), 2),
        harmonics=np.array([-1, 0, 1]),
        period=1.0,
    )
    nothing = (np.zeros(0), np.zeros((3, 0), complex))
    return noised(modes, nothing, samples, 300, noise, seed)


def two_close_lifted(noise: float, seed: int) -> Case:
    """The two, 20 samples a period."""
    return two_close(20.0, noise, seed)


def two_close_out_of_step(noise: float, seed: int) -> Case:
    """The two, 20.37 samples a period."""
    return two_close(20.37, noise, seed)
