"""Responses of known poles, and how well those could be told."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from benchmarks.truth import cramer_rao_bound
from numpy.typing import NDArray

from floquid.lifting import lift
from floquid.lti import TimeResponses
from floquid.sync import segment
from floquid.systems import JeffcottRotor

NOISE = 0.02
ROTOR = JeffcottRotor()


@dataclass(frozen=True)
class Case:
    """Responses, the logarithms of their upper multipliers (modes,), and the bound's deviations (2, modes)."""

    data: TimeResponses
    logs: NDArray[np.complex128]
    std: NDArray[np.float64]

    @property
    def order(self) -> int:
        """The number of poles, one by one."""
        return 2 * len(self.logs)


def _deviations(logs: NDArray, residues: NDArray, noise: NDArray, samples: int) -> NDArray[np.float64]:
    """The Cramér-Rao bound's deviations of the real and imaginary parts of `logs` (2, modes)."""
    both = np.exp(np.concatenate([logs, logs.conj()]))
    free = np.concatenate([residues, residues.conj()])[:, :, None]
    bound = cramer_rao_bound(both, free, noise[:, None], [samples], 1.0)
    std = np.sqrt(np.diag(bound)).reshape(2, -1)
    return std[:, : len(logs)]


@cache
def _rotor_truth() -> tuple[NDArray, NDArray]:
    """The upper logarithms from the equations, and their deviations, by least squares on a record without noise."""
    logs = ROTOR.exponents() * ROTOR.period
    logs = logs[logs.imag > 0]
    clean = lift(segment(ROTOR.simulate(noise=0.0)))
    values = clean.responses.values[:, 0]
    powers = np.exp(np.multiply.outer(np.arange(values.shape[1]), logs))
    parts = np.linalg.lstsq(np.concatenate([powers.real, powers.imag], axis=1), values.T, rcond=None)[0]
    residues = 0.5 * (parts[: len(logs)] - 1j * parts[len(logs) :])
    largest = np.abs(values).reshape(clean.n_channels, -1).max(axis=1)
    return logs, _deviations(logs, residues, NOISE * np.repeat(largest, clean.n_phases), values.shape[1])


def paper(seed: int) -> Case:
    """The paper's lifted record: 200 outputs of 1024 cycles, two modes, 2 % noise, which is estimated."""
    logs, std = _rotor_truth()
    return Case(lift(segment(ROTOR.simulate(noise=NOISE, seed=seed))).responses, logs, std)


def modes(number: int, seed: int, *, outputs: int = 60, samples: int = 300) -> Case:
    """Pairs of random shape, one in each of `number` bands of frequency, damping 0.01 to 0.05 a sample, 2 % noise."""
    generator = np.random.default_rng([number, seed])
    edges = np.linspace(0.05, np.pi - 0.05, number + 1)
    angles = edges[:-1] + np.diff(edges) * generator.uniform(0.15, 0.85, number)
    logs = -generator.uniform(0.01, 0.05, number) + 1j * angles
    return _ringing(logs, outputs, samples, generator)


def growing(outputs: int, cycles: int) -> Case:
    """The rotor's multipliers with shapes at random, in as many outputs and cycles as asked for."""
    return _ringing(_rotor_truth()[0], outputs, cycles, np.random.default_rng([outputs, cycles]))


def _ringing(logs: NDArray, outputs: int, samples: int, generator: np.random.Generator) -> Case:
    """Responses of these logarithms, made a block of outputs at a time: memory is measured beyond the data."""
    shapes = generator.standard_normal((outputs, len(logs))) + 1j * generator.standard_normal((outputs, len(logs)))
    powers = np.exp(np.multiply.outer(logs, np.arange(samples)))
    values, sigma = np.empty((outputs, 1, samples)), np.empty((outputs, 1))
    step = max(1, 2**19 // samples)
    for start in range(0, outputs, step):
        part = slice(start, start + step)
        block = (shapes[part] @ powers).real
        sigma[part] = NOISE * np.abs(block).max(axis=1, keepdims=True)
        block += sigma[part] * generator.standard_normal(block.shape)
        values[part, 0] = block
    values.flags.writeable = sigma.flags.writeable = False
    std = (
        _deviations(logs, 0.5 * shapes.T, sigma[:, 0], samples)
        if outputs * samples < 10**6
        else np.ones((2, len(logs)))
    )
    return Case(TimeResponses(values=values, dt=1.0, noise=sigma), logs, std)
