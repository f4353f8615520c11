"""Periodic systems with inputs, and their responses by Runge and Kutta's steps: equations of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.signal import lfilter

from floquid import Channel, PeriodicModel, Record, multisine
from floquid.inputs import TransferFunctions, modal_transfer
from floquid.systems import JeffcottRotor

DATA = Path(__file__).parent / "data"

Matrix = Callable[[float], NDArray[np.float64]]


@dataclass(frozen=True)
class Driven:
    """x' = A(t) x + B(t) u, y = C(t) x + D u, of a period."""

    A: Matrix
    B: Matrix
    C: Matrix
    period: float
    D: float = 0.0

    def maps(self, phases):
        """Of each phase, the transition to the next one and what an input that is held adds to the state."""
        return _maps(self, phases)

    def response(self, inputs, phases, start=None):
        """The response (outputs, samples) to inputs that are held (inputs, samples)."""
        maps, step, samples = self.maps(phases), self.period / phases, inputs.shape[1]
        periods, states = -(-samples // phases), len(self.A(0.0))
        played = np.zeros((len(inputs), periods * phases))
        played[:, :samples] = inputs

        def through(own):
            """States from those at the beginnings of all periods on, a phase after the other."""
            for phase, (transition, forcing) in enumerate(maps):
                yield own
                own = transition @ own + forcing @ played[:, phase::phases]
            yield own

        (*_, forced), whole = through(np.zeros((states, periods))), self.transition(phases)
        begins = np.zeros((states, periods + 1))
        begins[:, 0] = 0.0 if start is None else start
        for number in range(periods):
            begins[:, number + 1] = whole @ begins[:, number] + forced[:, number]
        seen = [self.C(phase * step) @ own for phase, own in zip(range(phases), through(begins[:, :-1]), strict=False)]
        return np.stack(seen, axis=2).reshape(len(seen[0]), -1)[:, :samples] + self.D * inputs.sum(axis=0)

    def transition(self, phases):
        """From the state at the beginning of a period to that at its end."""
        whole = np.eye(len(self.A(0.0)))
        for transition, _ in self.maps(phases):
            whole = transition @ whole
        return whole

    def sampled_transfer(self, hertz, harmonics, phases):
        """G of samples, inputs held: steady responses by one linear system over the phases of a period."""
        maps, step = self.maps(phases), self.period / phases
        n, inputs = maps[0][1].shape
        seen = np.array([self.C(number * step) for number in range(phases)])
        found = []
        for frequency in hertz:
            ahead, system = np.exp(2j * np.pi * frequency * step), np.zeros((phases * n, phases * n), complex)
            for number, (transition, _) in enumerate(maps):
                own, later = slice(number * n, number * n + n), (number + 1) % phases * n
                system[own, own] -= transition
                system[own, later : later + n] += ahead * np.eye(n)
            states = np.linalg.solve(system, np.concatenate([forcing for _, forcing in maps]))
            lines = np.fft.fft(seen @ states.reshape(phases, n, inputs), axis=0) / phases
            found.append([lines[m % phases] + self.D * (m == 0) for m in harmonics])
        return np.moveaxis(np.array(found), 0, -1)

    def exponents(self, phases=40):
        """The exponents (modes,), on the principal branch."""
        return np.log(np.linalg.eigvals(self.transition(phases)).astype(complex)) / self.period

    def transfer(self, hertz, harmonics, order=16, points=128):
        """G (harmonics, outputs, inputs, frequencies) by the harmonic state space: Toeplitz matrices, one inverse."""
        omega, count = 2.0 * np.pi / self.period, 2 * order + 1
        times = self.period * np.arange(points) / points

        def toeplitz(matrix):
            lines = np.fft.fft(np.array([matrix(t) for t in times]), axis=0) / points
            return np.block([[lines[(row - column) % points] for column in range(count)] for row in range(count)])

        a, b, c = toeplitz(self.A), toeplitz(self.B), toeplitz(self.C)
        n, inputs, outputs = len(self.A(0.0)), self.B(0.0).shape[1], len(self.C(0.0))
        turning = np.kron(np.diag(np.arange(-order, order + 1)), np.eye(n)) * 1j * omega
        found = []
        for frequency in hertz:
            system = 2j * np.pi * frequency * np.eye(n * count) + turning - a
            whole = c @ np.linalg.solve(system, b[:, order * inputs : (order + 1) * inputs])
            found.append([whole[(order + m) * outputs : (order + m + 1) * outputs] for m in harmonics])
        values = np.moveaxis(np.array(found), 0, -1)
        values[[m == 0 for m in harmonics]] += self.D
        return values


@cache
def _maps(system, phases, inner=16):
    n, inputs = system.A(0.0).shape[0], system.B(0.0).shape[1]
    h = system.period / phases / inner
    begins = np.arange(phases) * h * inner

    def rates(times):
        own = np.array([system.A(t) for t in times]), np.array([system.B(t) for t in times])

        def moved(state):
            found = own[0] @ state
            found[:, :, n:] += own[1]
            return found

        return moved

    state = np.tile(np.eye(n, n + inputs), (phases, 1, 1))
    for step in range(inner):
        first, middle, last = (rates(begins + step * h + part * h) for part in (0.0, 0.5, 1.0))
        k1 = first(state)
        k2 = middle(state + 0.5 * h * k1)
        k3 = middle(state + 0.5 * h * k2)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + last(state + h * k3))
    return [(one[:, :n], one[:, n:]) for one in state]


@cache
def mathieu(direct=0.0, damping=0.05):
    """Mathieu's equation, a = 2, q = 0.5, five per cent damped, with a force."""
    return Driven(
        A=lambda t: np.array([[0.0, 1.0], [-(2.0 - np.cos(2.0 * t)), -2.0 * damping * np.sqrt(2.0)]]),
        B=lambda _: np.array([[0.0], [1.0]]),
        C=lambda _: np.array([[1.0, 0.0]]),
        period=np.pi,
        D=direct,
    )


@cache
def creeping(stiffness):
    """A mass on a weak spring with much damping: near 0.0145 its pair becomes two real multipliers."""
    return Driven(
        A=lambda t: np.array([[0.0, 1.0], [-(stiffness + 0.007 * np.cos(2.0 * t)), -0.24]]),
        B=lambda _: np.array([[0.0], [1.0]]),
        C=lambda _: np.array([[1.0, 0.0]]),
        period=np.pi,
    )


@cache
def pendulum():
    """A pendulum on its head, the pivot moved up and down too little to hold it: one multiplier is above 1."""
    return Driven(
        A=lambda t: np.array([[0.0, 1.0], [0.3 + 0.6 * np.cos(2.0 * t), -0.3]]),
        B=lambda _: np.array([[0.0], [1.0]]),
        C=lambda _: np.array([[1.0, 0.0]]),
        period=np.pi,
    )


@cache
def two_masses():
    """Two masses on springs that vary, a force on each, both seen, one from a frame that turns."""

    def a(t):
        stiffness = np.array([[1.3 + 0.4 * np.cos(t), -0.3], [-0.3, 5.2 + 0.8 * np.sin(t)]])
        return np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -np.diag([0.05, 0.12])]])

    return Driven(
        A=a,
        B=lambda t: np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.2 * np.cos(t)], [0.0, 1.0]]),
        C=lambda t: np.array([[1.0, 0.0, 0.0, 0.0], [0.3 * np.cos(t), 1.0, 0.0, 0.0]]),
        period=2.0 * np.pi,
    )


@cache
def parted():
    """Two masses whose higher pair split into two real multipliers, one that grows and one that decays fast."""
    low, high = 2.0 * np.pi * 14.0, 2.0 * np.pi * 31.0
    still, own = np.diag([low**2, high**2]), 0.8 * np.array([[low**2, 0.5 * low * high], [0.5 * low * high, high**2]])

    def a(t):
        stiffness, damping = still + own * np.cos(100.0 * np.pi * t), np.diag([0.06 * low, 0.06 * high])
        return np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]])

    return Driven(A=a, B=lambda _: np.eye(4)[:, 2:], C=lambda _: np.eye(4)[:2], period=0.02)


@cache
def paper_rotor():
    """The rotor of Allen's paper, a force on the mass along each axis that stands still."""
    rotor = JeffcottRotor()
    return Driven(
        A=rotor.system,
        B=lambda _: np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
        C=rotor.outputs,
        period=rotor.period,
    )


@cache
def flapping(lock=12.0, advance=0.3):
    """A blade that flaps in forward flight: at these numbers two real negative multipliers, gone within a period."""
    g = lock / 8.0

    def a(t):
        spring = 1.0 + g * (4.0 / 3.0 * advance * np.cos(t) + advance**2 * np.sin(2.0 * t))
        return np.array([[0.0, 1.0], [-spring, -g * (1.0 + 4.0 / 3.0 * advance * np.sin(t))]])

    return Driven(
        A=a,
        B=lambda t: np.array([[0.0], [g * (1.0 + 8.0 / 3.0 * advance * np.sin(t) + 2.0 * (advance * np.sin(t)) ** 2)]]),
        C=lambda _: np.array([[1.0, 0.0]]),
        period=2.0 * np.pi,
    )


@cache
def lag():
    """A lag of first order, its decay, its gain and what is seen of it periodic: one real positive multiplier."""
    return Driven(
        A=lambda t: np.array([[-0.5 + 0.4 * np.cos(2.0 * t)]]),
        B=lambda t: np.array([[1.0 + 0.6 * np.cos(2.0 * t)]]),
        C=lambda t: np.array([[1.0 + 0.4 * np.sin(2.0 * t)]]),
        period=np.pi,
    )


@cache
def mathieu_and_lag():
    """Mathieu's equation driven by a lag, too, and an output that sees both: a pair and a real multiplier."""
    whole = mathieu()

    def a(t):
        found = np.zeros((3, 3))
        found[:2, :2], found[1, 2], found[2, 2] = whole.A(t), 0.5, -0.7 + 0.3 * np.cos(2.0 * t)
        return found

    return Driven(
        A=a,
        B=lambda _: np.array([[0.0], [1.0], [1.0]]),
        C=lambda t: np.array([[1.0, 0.0, 0.0], [0.2, 0.0, 1.0 + 0.3 * np.cos(2.0 * t)]]),
        period=whole.period,
    )


def shaken(system, phases, turns, repeats, noise, seed, **design):
    """A multisine and the record of the response to its repeats (outputs, then inputs)."""
    count = system.B(0.0).shape[1]
    excitation = multisine(system.period, phases / system.period, turns=turns, inputs=count, seed=seed, **design)
    names = [f"F{number}" for number in range(count)]
    played = excitation.record(repeats, names)
    values, inputs = record_of(system, None, phases, noise, seed + 1000, played.values)
    whole = Record(
        values=np.concatenate([values, inputs]),
        sample_rate=played.sample_rate,
        channels=[*(f"y{number}" for number in range(len(values))), *names],
        clock=played.clock,
    )
    return excitation, whole, names


def record_of(system, periods, phases, noise, seed, inputs=None, start=None):
    """Outputs with white noise of a share of their rms (outputs, samples), and the inputs, white where not given."""
    generator = np.random.default_rng(seed)
    if inputs is None:
        inputs = generator.standard_normal((system.B(0.0).shape[1], periods * phases))
    values = system.response(inputs, phases, start)
    values = values + noise * values.std(axis=1, keepdims=True) * generator.standard_normal(values.shape)
    return values, inputs


def ambient_of(system, periods, phases, noise, seed, warm=20):
    """Outputs of random forces that nobody measures, in a steady state, with white noise of a share of their rms."""
    generator = np.random.default_rng(seed)
    forces = generator.standard_normal((system.B(0.0).shape[1], (periods + warm) * phases))
    values = system.response(forces, phases)[:, warm * phases :]
    return values + noise * values.std(axis=1, keepdims=True) * generator.standard_normal(values.shape)


def coloured(system, periods, phases, noise, seed, corner=0.5, warm=40):
    """The response to forces of a first-order low-pass, with lines of one and three a revolution (outputs, samples)."""
    generator = np.random.default_rng(seed)
    count, step = (periods + warm) * phases, system.period / phases
    decay, times = np.exp(-corner * step), step * np.arange((periods + warm) * phases)
    forces = lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], generator.standard_normal((2, count)), axis=1)
    forces += np.outer([0.5, 0.3], np.cos(times + 0.3)) + np.outer([0.4, 0.6], np.cos(3.0 * times + 1.0))
    values = system.response(forces, phases)[:, warm * phases :]
    return values + noise * values.std(axis=1, keepdims=True) * generator.standard_normal(values.shape)


def engine_record(name, noise, seed):
    """A record of `tests/data` with noise of a share of each output's response, less its orbit of outputs alone.

    With its period, its exponents, and the names of its inputs, of which outputs alone have none.
    """
    with np.load(DATA / f"{name}.npz") as file:
        own = dict(file)
    values, period, rate = own["values"].astype(float), float(own["period"]), float(own["sample_rate"])
    names, driven = [str(n) for n in own["channels"]], name.startswith("driven")
    outputs = len(values) - 2 * driven
    cycles = values[:outputs].reshape(outputs, -1, round(rate * period))
    size = (cycles - (0.0 if driven else cycles.mean(axis=1, keepdims=True))).std(axis=(1, 2))
    generator = np.random.default_rng(1000 + seed)
    values[:outputs] += noise * size[:, None] * generator.standard_normal(values[:outputs].shape)
    channels = [Channel(name=name, unit=str(unit)) for name, unit in zip(names, own["units"], strict=True)]
    return Record(values=values, sample_rate=rate, channels=channels), period, own["exponents"], names[outputs:]


def imbalance_of(system, periods, phases, turn=2, warm=400):
    """The steady response to a force that turns once in some periods, its rms over all outputs 1."""
    angle = 2.0 * np.pi / (phases * turn) * np.arange((periods + warm * turn) * phases)
    forces = np.array([np.cos(angle), np.sin(angle)])[: system.B(0.0).shape[1]]
    values = system.response(forces, phases)[:, warm * turn * phases :]
    return values / np.sqrt(np.mean(values**2))


def pulls(system, model):
    """Deviations by which the exponents of a model are off the nearest true ones, modulo iω (modes, 2)."""
    truth, rows = system.exponents(), []
    for value, own in zip(model.exponents, model.exponent_std, strict=True):
        gap = truth - value
        gap = gap.real + 1j * (gap.imag - model.fundamental * np.rint(gap.imag / model.fundamental))
        off = gap[np.abs(gap).argmin()]
        rows.append([abs(off.real) / own.real, abs(off.imag) / max(own.imag, 1e-9)])
    return np.array(rows)


def excitations(found):
    """The frequencies of the modes that may be the excitation's, as findings say."""
    codes = ("ambient_single", "ambient_fast", "ambient_real")
    told = [own for own in found.findings if own.code in codes]
    return {frequency for own in told for frequency in own.numbers["frequencies"]}


def strayed(model, truth):
    """The largest error of the exponents of a model over its deviation, by assignment to the true ones, modulo iω."""
    gap = model.exponents[:, None] - truth
    gap = gap.real + 1j * (gap.imag - model.fundamental * np.rint(gap.imag / model.fundamental))
    rows, columns = linear_sum_assignment(np.abs(gap))
    off, std = gap[rows, columns], model.exponent_std[rows]
    return max(np.abs(off.real / std.real).max(), np.abs(off.imag / std.imag).max())


def transfer_functions(model: PeriodicModel, hertz, turns) -> TransferFunctions:
    """G_m(Ω) = Σ_r Σ_l c_{r,m-l} b_{r,l} / (i(Ω + lω) - λ_r) + D_m of a model with inputs."""
    own, turns, hertz = model.inputs, np.array(turns), np.asarray(hertz, float)
    values = np.zeros((len(turns), len(model.channels), len(own.channels), len(hertz)), complex)
    for exponent, c, b in zip(model.exponents, model.coefficients[:, :, 0], own.coefficients, strict=True):
        at = 2.0 * np.pi * hertz
        values += modal_transfer(exponent, model.fundamental, (model.harmonics, c), (own.harmonics, b), turns, at)
    for turn, direct in zip(own.direct_harmonics, np.moveaxis(own.direct, 2, 0), strict=True):
        values[turns == turn] += direct[:, :, None]
    return TransferFunctions(
        frequencies_hz=hertz, harmonics=turns, values=values, std=None, outputs=model.channels, inputs=own.channels
    )
