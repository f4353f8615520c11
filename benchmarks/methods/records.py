"""The records: systems whose exponents are known, their responses, and the bounds of the exponents."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from benchmarks.truth import cramer_rao_bound
from numpy.typing import NDArray
from tests.driven import Driven, ambient_of, mathieu, paper_rotor, record_of

from floquid import ConstantPeriod, Record
from floquid.inputs import Samples, samples_of
from floquid.systems import JeffcottRotor


@dataclass(frozen=True, kw_only=True)
class Case:
    """A record of a known system: its kind and name, samples a period, and what the others are told of it.

    `depth` is that of block rows of a subspace, `lags` the periods of correlations that are used.
    """

    kind: str
    name: str
    system: Driven
    periods: int
    phases: int
    noise: float
    depth: int
    lags: int = 0
    warm: int = 20
    seed: int = 0

    @property
    def order(self) -> int:
        """The number of exponents, which most methods must be given."""
        return len(self.system.A(0.0))

    @property
    def step(self) -> float:
        """The sampling interval."""
        return self.system.period / self.phases

    @cached_property
    def data(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Outputs (outputs, samples) and measured inputs (inputs, samples), of which there may be none."""
        none = np.zeros((0, self.periods * self.phases))
        if self.kind == "free":
            return free_decay(self), none
        if self.kind == "ambient":
            return ambient_of(self.system, self.periods, self.phases, self.noise, self.seed, self.warm), none
        return record_of(self.system, self.periods, self.phases, self.noise, self.seed)

    def response(self, inputs: NDArray[np.float64], number: int = 0) -> NDArray[np.float64]:
        """Outputs to other inputs, with the noise of this record on them (outputs, samples)."""
        noise = self.noise * self.data[0].std(axis=1, keepdims=True)
        values = self.system.response(inputs, self.phases)
        return values + noise * np.random.default_rng([self.seed, number]).standard_normal(values.shape)

    @cached_property
    def experiments(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Outputs and inputs of short experiments that begin while it rings, in one array (channels, number, samples).

        Each lasts a period and twice half of `depth`; all together hold as many samples as the record.
        """
        length = self.phases + 2 * (self.depth // 2)
        number, generator = self.periods * self.phases // length, np.random.default_rng([self.seed, 7])
        maps, seen = self.system.maps(self.phases), [self.system.C(k * self.step) for k in range(self.phases)]
        inputs = generator.standard_normal((len(self.data[1]), number, 2 * self.phases + length))
        state, outputs = np.zeros((self.order, number)), []
        for k in range(inputs.shape[2]):
            outputs.append(seen[k % self.phases] @ state)
            transition, forcing = maps[k % self.phases]
            state = transition @ state + forcing @ inputs[:, :, k]
        values = np.moveaxis(np.array(outputs), 0, 2)[:, :, 2 * self.phases :]
        noise = self.noise * self.data[0].std(axis=1)[:, None, None]
        return values + noise * generator.standard_normal(values.shape), inputs[:, :, 2 * self.phases :]

    def record(self, values: NDArray[np.float64] | None = None, inputs: NDArray[np.float64] | None = None) -> Record:
        """As a record: channels y…, then inputs u… ."""
        both = self.data if values is None else (values, inputs)
        return Record(
            values=np.concatenate(both),
            sample_rate=1.0 / self.step,
            channels=[f"{letter}{k}" for letter, own in zip("yu", both, strict=True) for k in range(len(own))],
            clock=ConstantPeriod(period=self.system.period),
        )

    @cached_property
    def samples(self) -> Samples:
        """As samples with an offset known beside."""
        values, inputs = self.data
        fundamental = 2.0 * np.pi / self.system.period
        return samples_of([values], [inputs], [0.0], step=self.step, fundamental=fundamental)


def free_decay(case: Case) -> NDArray[np.float64]:
    """The response to a blow, with noise of a share of the largest value of each output."""
    clean, generator = clean_decay(case), np.random.default_rng(case.seed)
    return clean + case.noise * np.abs(clean).max(axis=1, keepdims=True) * generator.standard_normal(clean.shape)


def clean_decay(case: Case) -> NDArray[np.float64]:
    """Without noise: that of the rotor is the paper's."""
    if case.name == "rotor":
        return JeffcottRotor().simulate(n_periods=case.periods, samples_per_period=case.phases, noise=0.0).values
    nothing = np.zeros((1, case.periods * case.phases))
    return case.system.response(nothing, case.phases, start=[0.0, 1.0])


def upper(exponents: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """One of each pair of conjugates, by frequency."""
    return np.sort_complex(1j * exponents[exponents.imag > 0.0]) / 1j


@cache
def truth(system: Driven) -> NDArray[np.complex128]:
    """The upper exponents from the equations, by Runge and Kutta's steps."""
    return upper(system.exponents())


def free_bound(case: Case) -> NDArray[np.float64]:
    """Cramér and Rao's deviations of the upper exponents, real and imaginary parts (2, modes), of the lifted record."""
    clean, exponents = clean_decay(case), truth(case.system)
    lifted = clean.reshape(len(clean), case.periods, case.phases).swapaxes(1, 2).reshape(-1, case.periods)
    powers = np.exp(np.multiply.outer(np.arange(case.periods), exponents * case.system.period))
    parts = np.linalg.lstsq(np.concatenate([powers.real, powers.imag], axis=1), lifted.T, rcond=None)[0]
    residues = 0.5 * (parts[: len(exponents)] - 1j * parts[len(exponents) :])
    both = np.concatenate([exponents, exponents.conj()])
    noise = np.repeat(case.noise * np.abs(clean).max(axis=1), case.phases)
    bound = cramer_rao_bound(
        np.exp(both * case.system.period),
        np.concatenate([residues, residues.conj()])[:, :, None],
        noise[:, None],
        [case.periods],
        case.system.period,
    )
    return np.sqrt(np.diag(bound)).reshape(2, -1)[:, : len(exponents)]


def periodic_modes(case: Case) -> tuple[NDArray, NDArray, NDArray]:
    """Upper exponents (modes,), c (modes, outputs, phases) and β (modes, inputs, phases) of the sampled system.

    z_{k+1} = e^{λh} z_k + β_k u_k, y_k = 2 Re Σ c_k z_k: Floquet's coordinates from the maps.
    """
    system, maps = case.system, case.system.maps(case.phases)
    whole = np.eye(case.order)
    for transition, _ in maps:
        whole = transition @ whole
    values, vectors = np.linalg.eig(whole)
    kept, roots = np.argsort(np.abs(np.angle(values)))[::-1], np.log(values.astype(complex)) / case.phases
    kept = np.array([k for k in kept if roots[k].imag > 0.0])[np.argsort([r.imag for r in roots if r.imag > 0.0])]
    shapes, seen, driven = vectors.astype(complex), [], []
    for k, (transition, forcing) in enumerate(maps):
        seen.append(system.C(k * case.step) @ shapes)
        shapes = transition @ shapes / np.exp(roots)
        driven.append(np.linalg.solve(shapes, forcing))
    c, b = np.moveaxis(np.array(seen), 0, 2), np.moveaxis(np.array(driven), 0, 2)
    return roots[kept] / case.step, c[:, kept].swapaxes(0, 1), b[kept]


def driven_bound(case: Case, highest: int = 2) -> NDArray[np.float64]:
    """Cramér and Rao's deviations of the upper exponents (2, modes), with these inputs, ordered as `truth`.

    Free beside λ are the harmonics of c and β up to `highest`, the first states and offsets; derivatives by filters.
    """
    from scipy.signal import lfilter

    exponents, c, b = periodic_modes(case)
    values, inputs = case.data
    angle = 2j * np.pi / case.phases * np.arange(values.shape[1])
    turns = [np.exp(m * angle) for m in range(-highest, highest + 1)]
    noise = case.noise * (values.std(axis=1) / np.sqrt(1.0 + case.noise**2))
    outputs, columns = len(values), []

    def add(parts: NDArray) -> None:
        """The derivative of all outputs by a complex number (outputs, samples)."""
        whole = (parts / noise[:, None]).ravel()
        columns.extend([2.0 * whole.real, -2.0 * whole.imag])

    def through(root: complex, signal: NDArray) -> NDArray:
        return lfilter([0.0, 1.0], [1.0, -root], signal)

    for exponent, shape, gain in zip(exponents, c, b, strict=True):
        root, seen = np.exp(exponent * case.step), np.tile(shape, case.periods)
        state = through(root, np.sum(np.tile(gain, case.periods) * inputs, axis=0).astype(complex))
        add(seen * case.step * root * through(root, state))
        add(seen * root ** np.arange(values.shape[1]))
        for turn in turns:
            for one in inputs:
                add(seen * through(root, turn * one))
            for output in range(outputs):
                add(np.eye(outputs)[output][:, None] * (turn * state))
    columns.extend(np.kron(np.diag(1.0 / noise), np.ones(values.shape[1])))
    jacobian = np.array(columns)
    gram = jacobian @ jacobian.T
    size = np.sqrt(np.diag(gram))
    spread = np.linalg.pinv(gram / np.outer(size, size), rcond=1e-10, hermitian=True) / np.outer(size, size)
    each = (len(columns) - outputs) // len(exponents)
    std = np.sqrt(np.diag(spread))
    own = np.array([[std[k * each], std[k * each + 1]] for k in range(len(exponents))]).T
    order = [int(np.argmin(np.abs(np.angle(np.exp((exponents - t) * case.system.period))))) for t in truth(case.system)]
    return own[:, order]


def sampled_transfer(system: Driven, phases: int, hertz: NDArray[np.float64], harmonics: list[int]) -> NDArray:
    """G (harmonics, outputs, inputs, frequencies) of samples, by the periodic response to each line, from the maps."""
    maps, n, step = system.maps(phases), len(system.A(0.0)), system.period / phases
    seen = [system.C(k * step) for k in range(phases)]
    found = []
    for frequency in hertz:
        turn = np.exp(2j * np.pi * frequency * step)
        whole, forcing = np.zeros((phases * n, phases * n), complex), []
        for k, (transition, forced) in enumerate(maps):
            own, after = slice(k * n, (k + 1) * n), (k + 1) % phases * n
            whole[after : after + n, own] -= transition
            whole[after : after + n, after : after + n] += turn * np.eye(n)
            forcing.append((after, forced))
        right = np.zeros((phases * n, forced.shape[1]), complex)
        for after, forced in forcing:
            right[after : after + n] = forced
        state = np.linalg.solve(whole, right).reshape(phases, n, -1)
        outputs = np.array([c @ own for c, own in zip(seen, state, strict=True)]) + system.D
        lines = np.fft.fft(outputs, axis=0) / phases
        found.append([lines[m % phases] for m in harmonics])
    return np.moveaxis(np.array(found), 0, -1)


def weak() -> Driven:
    """Mathieu's equation with a tenth of the variation: q = 0.05."""
    spring = 0.1
    return replace(
        mathieu(), A=lambda t: np.array([[0.0, 1.0], [-(2.0 - spring * np.cos(2.0 * t)), -0.1 * np.sqrt(2.0)]])
    )


MATHIEU, WEAK, ROTOR = mathieu(), weak(), paper_rotor()

CASES: dict[str, Case] = {
    f"{case.kind}, {case.name}": case
    for case in (
        Case(kind="free", name="Mathieu", system=MATHIEU, periods=40, phases=20, noise=0.02, depth=12),
        Case(kind="free", name="rotor", system=ROTOR, periods=1024, phases=50, noise=0.02, depth=12),
        Case(kind="driven", name="Mathieu", system=MATHIEU, periods=240, phases=16, noise=0.05, depth=24),
        Case(kind="driven", name="Mathieu, 60 periods", system=MATHIEU, periods=60, phases=16, noise=0.05, depth=12),
        Case(kind="driven", name="rotor", system=ROTOR, periods=128, phases=50, noise=0.02, depth=10),
        Case(kind="ambient", name="Mathieu", system=MATHIEU, periods=1000, phases=16, noise=0.02, depth=16, lags=7),
        Case(
            kind="ambient", name="Mathieu, q = 0.05", system=WEAK, periods=1000, phases=16, noise=0.02, depth=16, lags=7
        ),
        Case(
            kind="ambient", name="rotor", system=ROTOR, periods=512, phases=24, noise=0.02, depth=24, lags=40, warm=600
        ),
    )
}
"""One record of each kind of excitation and system; the paper's of the rotor where it is free."""
