"""A rotor of four modes out of balance, on a test rig: struck once, with a tachometer that is a logic level."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from benchmarks.adversary.systems import Clock, System
from numpy.typing import NDArray

from floquid import Record, TachometerSignal

FREQUENCIES = (14.2, 21.6, 33.5, 57.7)  # [Hz]; apart modulo every speed of the table
DAMPING = (0.012, 0.010, 0.008, 0.006)  # shares of critical
DEPTH = 0.03  # of the stiffness, over a revolution
DURATION = 6.0  # [s]
NOISE = 0.002  # of each channel's largest free response
IMBALANCE = 1.0  # the largest steady response over the largest free one
VOLTS, HUM = 5.0, 0.005  # the tachometer's level and its noise [V]
AHEAD = 2.0  # the angle of the shaft at which a pulse begins [rad]
SLOW = (0.9, 2.2, 3.4)  # rates at which the speed wanders [rad/s]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """A run at a speed.

    Parameters
    ----------
    rpm
        The mean speed of the shaft.
    width
        The width of the pulse, a share of the revolution.
    rate
        Samples a second [Hz].
    wander
        The root mean square of the speed about its mean, over the mean.
    seed
        Seed of the noise.
    """

    rpm: float
    width: float = 0.05
    rate: float = 1024.0
    wander: float = 0.0
    seed: int = 0

    @property
    def speed(self) -> float:
        """The mean speed of the shaft [rad/s]."""
        return self.rpm * np.pi / 30.0

    @property
    def times(self) -> NDArray[np.float64]:
        """The time of each sample (samples,) [s]."""
        return np.arange(int(DURATION * self.rate)) / self.rate

    @property
    def clock(self) -> Clock:
        """The angle of the shaft over time."""
        largest = self.wander * self.speed * np.sqrt(2.0 * len(SLOW))  # of as many waves as there are rates
        return Clock(wander=largest, rates=SLOW, speed=self.speed)

    @property
    def mean_speed(self) -> float:
        """The mean speed over the record [rad/s]."""
        ends = self.clock(self.times[[0, -1]])
        return float((ends[1] - ends[0]) / self.times[-1])

    def exponents(self) -> NDArray[np.complex128]:
        """One Floquet exponent of each pair at the mean speed (modes,) [1/s]."""
        return system().modes(self.mean_speed).exponents

    def record(self) -> Record:
        """The record, with a channel `tach`, a pulse a revolution."""
        rotor, times, angles = system(), self.times, self.clock(self.times)
        free, steady = replace(rotor, force=0.0 * rotor.force), np.append(rotor.orbit(self.speed), 1.0)
        starts = np.stack([np.append(rotor.start, 0.0), steady], axis=1)
        states = rotor.moved(times, self.clock, starts)
        response, orbit = (free.seen(states[..., part], angles) for part in range(2))
        largest = np.abs(response).max(axis=1, keepdims=True)
        orbit *= IMBALANCE * largest.max() / np.abs(orbit).max()
        generator = np.random.default_rng(self.seed)
        values = response + orbit + NOISE * largest * generator.standard_normal(response.shape)
        pulses = VOLTS * (np.mod(angles - AHEAD, 2.0 * np.pi) < 2.0 * np.pi * self.width)
        pulses = pulses + HUM * generator.standard_normal(len(times))
        return Record(
            values=np.concatenate([values, pulses[None]]),
            sample_rate=self.rate,
            channels=[*(f"y{number}" for number in range(len(values))), "tach"],
            clock=TachometerSignal(channel="tach"),
        )


def system() -> System:
    """The rotor: four coupled degrees of freedom whose stiffness turns, seen by four sensors, two of which turn."""
    generator = np.random.default_rng(3)
    natural = 2.0 * np.pi * np.array(FREQUENCIES)
    basis = np.linalg.qr(generator.standard_normal((4, 4)))[0]
    varied = [natural[:, None] * (part + part.T) * natural for part in generator.standard_normal((2, 4, 4))]
    turning = np.zeros((4, 4))
    turning[2:] = 0.5 * generator.standard_normal((2, 4))
    return System(
        damping=basis @ np.diag(2.0 * np.array(DAMPING) * natural) @ basis.T,
        stiffness=basis @ np.diag(natural**2) @ basis.T,
        cosine=0.5 * DEPTH * basis @ varied[0] @ basis.T,
        sine=0.5 * DEPTH * basis @ varied[1] @ basis.T,
        outputs=basis.T + 0.2 * generator.standard_normal((4, 4)),
        turning=turning,
        start=np.concatenate([np.zeros(4), basis @ natural]),
        force=basis @ natural,
    )
