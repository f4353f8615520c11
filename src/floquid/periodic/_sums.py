r"""Sums over time of products of modulated exponentials, from lifted responses.

A column is z_j = e^{(λ_e + imω)t}, with e the mode of column j. On lifted samples t = τ_p + nT, and
z_j = e^{(λ_e + imω)τ_p} μ_e^n since e^{imωT} = 1: every sum over samples of z̄_i z_j t^q is a sum of products of a sum
over cycles, one a pair of modes, and a sum over phases, one a pair of columns. No column is ever formed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.lifting import Lifted


@dataclass(frozen=True, slots=True)
class Columns:
    """Which columns there are: their modes (columns,) and harmonics (columns,), and the exponents (modes,) [1/s]."""

    exponents: NDArray[np.complex128]
    modes: NDArray[np.int64]
    harmonics: NDArray[np.int64]

    def rates(self, fundamental: float) -> NDArray[np.complex128]:
        """λ + imω of each column (columns,) [1/s]."""
        return self.exponents[self.modes] + 1j * fundamental * self.harmonics


@dataclass(frozen=True, slots=True)
class Sums:
    """The sums over one hit, for t^q with q = 0, 1, 2 (products) and q = 0, 1 (data)."""

    straight: tuple[NDArray[np.complex128], ...]
    """Σ z̄_i z_j t^q (columns, columns)."""
    crossed: tuple[NDArray[np.complex128], ...]
    """Σ z_i z_j t^q (columns, columns)."""
    seen: tuple[NDArray[np.complex128], ...]
    """Σ z̄_j r_c t^q (columns, channels), of what is left r."""
    left: NDArray[np.float64]
    """Σ r² (channels,)."""


def sums(lifted: Lifted, hit: int, columns: Columns, coefficients: NDArray[np.complex128]) -> Sums:
    """The sums of one hit, and of what the model 2 Re Σ B_j z_j leaves of its responses.

    Growing columns are counted from the end of the hit, so that no power overflows: `scales` has the factors.

    Parameters
    ----------
    lifted
        The lifted responses.
    hit
        Which hit.
    columns
        The columns.
    coefficients
        B (columns, channels) of the scaled columns.

    Returns
    -------
    Sums
        The sums, of the scaled columns.
    """
    length, period = int(lifted.responses.lengths[hit]), lifted.period
    times, starts = lifted.phase_times, np.asarray(np.arange(length) * period, np.float64)
    cycles = np.asarray(np.exp(np.multiply.outer(starts, columns.exponents)), np.complex128)
    grows = columns.exponents.real > 0
    cycles[:, grows] = np.exp(np.multiply.outer(starts - starts[-1], columns.exponents[grows]))
    # The imaginary part of the factor that was left out is no matter of size: it is in the coefficients.
    phases = np.exp(np.multiply.outer(times, columns.rates(2.0 * np.pi / period)))
    # Real and imaginary parts beside each other, and the same times nT: one real product a channel.
    parts = np.concatenate([cycles.real, -cycles.imag], axis=1)
    weights = np.concatenate([parts, starts[:, None] * parts], axis=1)
    folded = np.zeros((2, lifted.n_channels, lifted.n_phases, len(columns.exponents)), complex)
    left = np.zeros(lifted.n_channels)
    values = lifted.responses.values[:, hit, :length].reshape(lifted.n_channels, lifted.n_phases, length)
    for channel, block in enumerate(values):
        rest = block - _model(columns, coefficients[:, channel], phases, parts)
        left[channel] = np.einsum("pn,pn->", rest, rest)
        real, imag, late_real, late_imag = np.split(rest @ weights, 4, axis=1)
        folded[:, channel] = real + 1j * imag, late_real + 1j * late_imag
    own, late = folded[:, :, :, columns.modes]
    seen = (
        np.einsum("pj,cpj->jc", phases.conj(), own),
        np.einsum("pj,cpj->jc", phases.conj(), late + times[:, None] * own),
    )
    return Sums(
        straight=_products(cycles.conj(), cycles, phases.conj(), phases, starts, times, columns.modes),
        crossed=_products(cycles, cycles, phases, phases, starts, times, columns.modes),
        seen=seen,
        left=left,
    )


def scales(lifted: Lifted, hit: int, columns: Columns) -> NDArray[np.complex128]:
    """What the scaled columns are to be multiplied by to be e^{(λ + imω)t} (columns,)."""
    last = (int(lifted.responses.lengths[hit]) - 1) * lifted.period
    exponents = columns.exponents[columns.modes]
    return np.where(exponents.real > 0, np.exp(np.where(exponents.real > 0, exponents, 0.0) * last), 1.0 + 0j)


def _model(
    columns: Columns,
    coefficients: NDArray[np.complex128],
    phases: NDArray[np.complex128],
    parts: NDArray[np.float64],
) -> NDArray[np.float64]:
    """2 Re Σ B z of one channel (phases, cycles); `parts` are Re μ^n and -Im μ^n."""
    shapes: NDArray[np.complex128] = np.zeros((len(phases), len(columns.exponents)), complex)
    np.add.at(shapes.T, columns.modes, (coefficients * phases).T)
    return 2.0 * (np.concatenate([shapes.real, shapes.imag], axis=1) @ parts.T)


def _products(
    first: NDArray[np.complex128],
    second: NDArray[np.complex128],
    one: NDArray[np.complex128],
    other: NDArray[np.complex128],
    starts: NDArray[np.float64],
    times: NDArray[np.float64],
    modes: NDArray[np.int64],
) -> tuple[NDArray[np.complex128], ...]:
    """Σ (first one) (second other) t^q (columns, columns) for q = 0, 1, 2."""
    long = [(first * (starts**k)[:, None]).T @ second for k in range(3)]
    long = [part[modes][:, modes] for part in long]
    short = [(one * (times**k)[:, None]).T @ other for k in range(3)]
    return (
        long[0] * short[0],
        long[0] * short[1] + long[1] * short[0],
        long[0] * short[2] + 2.0 * long[1] * short[1] + long[2] * short[0],
    )
