"""A rotor as a test rig would see it: sampled out of step, on a wandering shaft, out of balance, with a tachometer."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import finite, input_error, integer, positive
from floquid._show import Brief
from floquid.core import Channel, Provenance, Record, TachometerSignal
from floquid.systems._jeffcott import JeffcottRotor

STEPS_PER_PERIOD = 200
"""Steps of the integration in a period of the system, at least: the error of the response is below 1e-9."""

TAYLOR = 9  # terms of the exponential of a step
SLOW = (3, 5, 8, 11)  # cycles of the speed's wander in `REFERENCE` periods
REFERENCE = 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class Run(Brief):
    r"""A run of a `JeffcottRotor` on a test rig.

    .. math::
        \dot\theta = \Omega \Big(1 + \sum_j a_j \cos(2\pi c_j t/(1024\,T) + \phi_j)\Big), \qquad
        \ddot u + C \dot u + K(\theta)\, u = e\, \dot\theta^2\, [\cos\theta, \sin\theta]^T

    with an impulse at the first sample, and the rotor on the orbit of its imbalance before it.

    Raises InputError where a number is out of its range.

    Parameters
    ----------
    rotor
        The rotor, at its mean speed.
    n_periods
        The length of the run, in periods of the system (half revolutions).
    samples_per_period
        Samples a period on average; it need not be a whole number.
    wander
        The root mean square of the speed's wander over the mean speed.
    imbalance
        The largest response to the imbalance over the largest free response, in the first channel.
    noise
        The deviation of white noise, as a share of the largest free response in each channel.
    impulse_deg
        The direction of the impulse, from X towards Y [deg].
    start_deg
        The angle of the shaft at the first sample [deg].
    pulse_deg
        The width of the tachometer's pulse, and its rise [deg].
    seed
        Seed of the noise and of the wander's phases.
    """

    rotor: JeffcottRotor = field(default_factory=JeffcottRotor)
    n_periods: int = 1024
    samples_per_period: float = 50.0 * 1.00371
    wander: float = 0.002
    imbalance: float = 5.0
    noise: float = 0.02
    impulse_deg: float = 45.0
    start_deg: float = 77.0
    pulse_deg: float = 18.0
    seed: int = 0

    def __post_init__(self) -> None:
        of = "Run"
        integer(self.n_periods, "n_periods", of, at_least=1)
        integer(self.seed, "seed", of, at_least=0)
        positive(self.samples_per_period, "samples_per_period", of)
        positive(self.pulse_deg, "pulse_deg", of, unit="deg")
        for name in ("start_deg", "impulse_deg"):
            finite(getattr(self, name), name, of, unit="deg")
        for name in ("wander", "imbalance", "noise"):
            if finite(getattr(self, name), name, of) < 0.0:
                raise input_error(name, of, "not be negative", f"is {getattr(self, name):g}")

    @property
    def sample_rate(self) -> float:
        """Samples a second [Hz]."""
        return self.samples_per_period / self.rotor.period

    @property
    def times(self) -> Floats:
        """The time of each sample (samples,) [s]."""
        return np.arange(int(self.n_periods * self.samples_per_period)) / self.sample_rate

    def angle(self, times: ArrayLike) -> Floats:
        """The angle of the shaft (times,) [rad]."""
        t, length = np.asarray(times, float), REFERENCE * self.rotor.period
        phases = np.random.default_rng([self.seed, 1]).uniform(0.0, 2.0 * np.pi, len(SLOW))
        total = np.deg2rad(self.start_deg) + self.rotor.speed * t
        for cycles, phase in zip(SLOW, phases, strict=True):
            rate = 2.0 * np.pi * cycles / length
            size = self.wander * np.sqrt(2.0 / len(SLOW))
            total = total + self.rotor.speed * size * (np.sin(rate * t + phase) - np.sin(phase)) / rate
        return total

    def record(self) -> Record:
        """The record, with a channel `tach` and the clock that goes with it (channels, samples)."""
        free, forced = self.responses()
        largest = np.abs(free).max(axis=1, keepdims=True)
        generator = np.random.default_rng([self.seed, 2])
        values = free + forced + self.noise * largest * generator.standard_normal(free.shape)
        tach = self._pulses() + 0.005 * generator.standard_normal(free.shape[1])
        words = f"simulation of {self!r}"
        return Record(
            values=np.concatenate([values, tach[None]]),
            sample_rate=self.sample_rate,
            channels=(*self.rotor.channels, Channel(name="tach", quantity="pulse", unit="V")),
            clock=TachometerSignal(channel="tach", periods_per_revolution=2),
            provenance=Provenance(sources=(words,)),
        )

    def responses(self) -> tuple[Floats, Floats]:
        """The free response to the impulse and the response to the imbalance, both (channels, samples)."""
        times = self.times
        outputs = self.rotor.outputs(self.angle(times) / self.rotor.speed)
        kick = np.deg2rad(self.impulse_deg)
        states = np.empty((len(times), 5, 2))
        states[0, :, 0] = [0.0, 0.0, np.cos(kick), np.sin(kick), 0.0]
        states[0, :, 1] = [*self._orbit(), 1.0] if self.imbalance else 0.0
        for k, propagator in enumerate(self._propagators(times)):
            np.matmul(propagator, states[k], out=states[k + 1])
        free, forced = (outputs @ states[:, :4]).transpose(2, 1, 0)
        return free, forced * self.imbalance * np.abs(free[0]).max() / (np.abs(forced[0]).max() or 1.0)

    def _pulses(self) -> Floats:
        """A pulse of five volts once a revolution, with edges of finite steepness."""
        off = np.angle(np.exp(1j * self.angle(self.times)))
        half = 0.5 * np.deg2rad(self.pulse_deg)
        return 2.5 * (np.tanh((off + half) / (0.25 * half)) - np.tanh((off - half) / (0.25 * half)))

    def _orbit(self) -> Floats:
        """The state on the orbit of the imbalance at the first sample, at the mean speed."""
        steps = 2 * STEPS_PER_PERIOD
        turn = np.eye(5)
        for propagator in self._propagators(np.linspace(0.0, 2.0 * np.pi / self.rotor.speed, steps + 1)):
            turn = propagator @ turn
        return np.linalg.solve(np.eye(4) - turn[:4, :4], turn[:4, 4])

    def _propagators(self, times: Floats) -> Floats:
        """Propagators of [u, u', 1] to the next of equidistant times (times - 1, 5, 5)."""
        # By Magnus' method of fourth order, two Gauss points a step.
        step = times[1] - times[0]
        per = max(1, int(np.ceil(STEPS_PER_PERIOD * step / self.rotor.period)))
        h = step / per
        starts = times[0] + h * np.arange(per * (len(times) - 1))
        first, second = (self._rates(starts + (0.5 + sign * np.sqrt(3.0) / 6.0) * h) for sign in (-1.0, 1.0))
        exponent = 0.5 * h * (first + second) + np.sqrt(3.0) / 12.0 * h**2 * (second @ first - first @ second)
        propagators = unit = np.eye(5)
        for k in range(TAYLOR, 0, -1):  # the steps are so short that the series is exact
            propagators = unit + exponent @ propagators / k
        inner = propagators.reshape(-1, per, 5, 5)
        whole = inner[:, 0]
        for k in range(1, per):
            whole = inner[:, k] @ whole
        return whole

    def _rates(self, times: Floats) -> Floats:
        """The rates of [u, u', 1] (times, 5, 5)."""
        angle, small = self.angle(times), 0.5e-4 * self.rotor.period
        speed = (self.angle(times + small) - self.angle(times - small)) / (2.0 * small)
        rates = np.zeros((len(times), 5, 5))
        rates[:, :4, :4] = self.rotor.system(angle / self.rotor.speed)
        rates[:, 2:4, 4] = speed[:, None] ** 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return rates
