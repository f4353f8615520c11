"""What a case is: records, the truth about them, what must be found; and what synthetic records are made with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import qr

from floquid import Record

SURE = 2e-3
"""The share of the fundamental below which both deviations of a confident exponent are."""

APART = 5.0
"""The bounds by which a mode must be apart from every other one to be told from it."""

SIGNIFICANT = 1e-3
"""The share of a mode's largest coefficient from which on a harmonic counts in the bound."""

ROUNDED = 1e-9
"""The share of a column's size below which what is outside the span of others is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Records with noise, and what is true of them.

    Parameters
    ----------
    records
        One a hit.
    period
        The true period [s].
    exponents
        Every true exponent, conjugates both, on the branch of its strongest harmonic where that is known (modes,)
        [1/s].
    must
        Which of them must be found (modes,).
    bound
        The least deviation that each can have, real + 1j imaginary (modes,) [1/s]; None where it is not known.
    options
        What `identify` is given beside the records.
    declared
        The period that `identify` is told [s]; None where that is the true one.
    slack
        How far beside an exponent is right too, real + 1j imaginary (modes,) [1/s]: of systems that are not quite
        linear and periodic; None for none.
    sure
        The share of ω below which both deviations of a confident exponent are.
    """

    records: tuple[Record, ...]
    period: float
    exponents: NDArray[np.complex128]
    must: NDArray[np.bool_]
    bound: NDArray[np.complex128] | None = None
    options: dict[str, object] = field(default_factory=dict)
    declared: float | None = None
    slack: NDArray[np.complex128] | None = None
    sure: float = SURE

    @property
    def fundamental(self) -> float:
        """ω = 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period


@dataclass(frozen=True, slots=True, kw_only=True)
class Modes:
    """Modes of a real response: one of each conjugate pair, and every real multiplier.

    Parameters
    ----------
    exponents
        λ (modes,) [1/s].
    coefficients
        Of e^{λt + imθ}; the response is twice the real part of their sum (modes, channels, harmonics).
    harmonics
        m (harmonics,).
    period
        T [s].
    """

    exponents: NDArray[np.complex128]
    coefficients: NDArray[np.complex128]
    harmonics: NDArray[np.int64]
    period: float

    @property
    def fundamental(self) -> float:
        """ω = 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def real(self) -> NDArray[np.bool_]:
        """Which multipliers are real (modes,)."""
        twice = 2.0 * self.exponents.imag / self.fundamental
        return np.abs(twice - np.rint(twice)) < 1e-9

    def listed(self, values: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """What is said of each mode, and after it the conjugates of pairs."""
        return np.concatenate([values, values[~self.real].conj()])


def response(
    exponents: ArrayLike,
    coefficients: NDArray[np.complex128],
    harmonics: ArrayLike,
    times: NDArray[np.float64],
    angles: NDArray[np.float64],
) -> NDArray[np.float64]:
    """2 Re Σ B e^{λt + imθ}, t counted from the first sample's phase zero and θ turning by 2π a period.

    Parameters
    ----------
    exponents
        λ (modes,) [1/s].
    coefficients
        B (modes, channels, harmonics).
    harmonics
        m (harmonics,).
    times, angles
        t [s] and θ [rad] (samples,).

    Returns
    -------
    ndarray
        The response (channels, samples).
    """
    turned = np.exp(1j * np.multiply.outer(np.asarray(harmonics), angles))
    total = np.zeros((coefficients.shape[1], len(times)))
    for exponent, own in zip(np.asarray(exponents), coefficients, strict=True):
        total += 2.0 * ((own @ turned) * np.exp(exponent * times)).real
    return total


def noisy(
    values: NDArray[np.float64], free: NDArray[np.float64], noise: float, seed: int, *, colour: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The values with noise of a share of each channel's largest free response, and its deviation (channels,).

    `colour` is what is left of each sample of the noise in the next one; the deviation is that of the whole noise.
    """
    from scipy.signal import lfilter

    sigma = noise * np.abs(free).max(axis=1)
    white = np.random.default_rng([seed, 7]).standard_normal((len(values), values.shape[1] + 1000))
    drawn = lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], white, axis=1)[:, 1000:]
    return values + sigma[:, None] * drawn, sigma


def bound(
    modes: Modes,
    times: NDArray[np.float64],
    angles: NDArray[np.float64],
    sigma: NDArray[np.float64],
    turns: Sequence[float] = (),
) -> NDArray[np.complex128]:
    """The Cramér-Rao bound of the exponents, shapes held to their significant harmonics and unknown otherwise.

    Parameters
    ----------
    modes
        The true modes.
    times, angles
        Of each sample (samples,).
    sigma
        The deviation of the white noise (channels,).
    turns
        Harmonics of the system's period that a forced response of unknown size has beside, 0 for an offset.

    Returns
    -------
    ndarray
        Deviations, real + 1j imaginary part (modes,) [1/s]; the latter is 0 for a real multiplier.
    """
    columns = [
        np.exp(exponent * times + 1j * m * angles)
        for exponent, own in zip(modes.exponents, significant(modes), strict=True)
        for m in modes.harmonics[own]
    ]
    basis = span_of([*columns, *(np.exp(1j * turn * angles) for turn in turns)])
    total: NDArray[np.float64] | float = 0.0
    shapes = np.exp(1j * np.multiply.outer(modes.harmonics, angles))
    for channel, deviation in enumerate(sigma):
        slopes = 2.0 * times * (modes.coefficients[:, channel] @ shapes) * np.exp(np.outer(modes.exponents, times))
        outside = beside(np.concatenate([slopes.real, -slopes[~modes.real].imag]), basis)
        total = total + outside @ outside.T / deviation**2
    return deviations(np.asarray(total), modes.real)


def significant(modes: Modes) -> NDArray[np.bool_]:
    """Which harmonics of each mode count in the bound (modes, harmonics)."""
    sizes = np.abs(modes.coefficients).max(axis=1)
    return sizes > SIGNIFICANT * sizes.max(axis=1, keepdims=True)


def span_of(columns: Sequence[NDArray[np.complex128]]) -> NDArray[np.float64]:
    """An orthonormal basis of what the real and imaginary parts of columns make up (samples, rank)."""
    linear = np.concatenate([np.real(columns), np.imag(columns)])
    size = np.linalg.norm(linear, axis=1)
    seen = size > ROUNDED * size.max()
    basis, triangle, _ = qr((linear[seen] / size[seen, None]).T, mode="economic", pivoting=True)
    reach = np.abs(np.diag(triangle))
    return basis[:, reach > ROUNDED * reach[0]]


def beside(slopes: NDArray[np.float64], basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """The part of slopes (slopes, samples) outside the span of a basis; zero where it is rounding."""
    outside = slopes - (slopes @ basis) @ basis.T
    outside -= (outside @ basis) @ basis.T
    outside[np.linalg.norm(outside, axis=1) < ROUNDED * np.linalg.norm(slopes, axis=1)] = 0.0
    return outside


def deviations(total: NDArray[np.float64], real: NDArray[np.bool_]) -> NDArray[np.complex128]:
    """The least deviations by Fisher's information, real + 1j imaginary part (modes,) [1/s]; infinite without any.

    Parameters are the real parts of the exponents, the imaginary parts of those of pairs, and whatever else is unknown.
    """
    known = np.diag(total) > 0.0
    scale, least = np.sqrt(np.diag(total)[known]), np.full(len(total), np.inf)
    values, vectors = np.linalg.eigh(total[np.ix_(known, known)] / np.outer(scale, scale))
    # A direction without information has a very large variance, where a pseudoinverse has none.
    least[known] = np.sqrt(vectors**2 @ (1.0 / np.maximum(values, 1e-12))) / scale
    found = least[: len(real)].astype(complex)
    found[~real] = least[: len(real)][~real] + 1j * least[len(real) : len(real) + int(np.sum(~real))]
    return found


def tellable(exponents: NDArray[np.complex128], least: NDArray[np.complex128], fundamental: float) -> NDArray[np.bool_]:
    """Which exponents must be found: their bounds are small, and the next one is several bounds away (modes,)."""
    gaps = np.subtract.outer(exponents, exponents)
    gaps = np.abs(gaps.real + 1j * wrapped(gaps.imag, fundamental))
    np.fill_diagonal(gaps, np.inf)
    largest = np.maximum(least.real, np.abs(least.imag))
    return (largest < SURE * fundamental) & (gaps.min(axis=1, initial=np.inf) > APART * largest)


def wrapped(values: NDArray[np.float64], fundamental: float) -> NDArray[np.float64]:
    """Imaginary parts modulo the fundamental, nearest to zero."""
    return values - fundamental * np.rint(values / fundamental)


def synthetic(
    modes: Modes,
    record: Record,
    sampled: tuple[NDArray[np.float64], NDArray[np.float64]],
    sigma: NDArray[np.float64],
    turns: Sequence[float] = (),
    **more: object,
) -> Case:
    """The case of known modes, which must be found as far as their bounds say; `sampled` are times and angles."""
    least = bound(modes, *sampled, sigma, turns)
    exponents, least = modes.listed(modes.exponents), modes.listed(least)
    least = least.real + 1j * np.abs(least.imag)
    must = tellable(exponents, least, modes.fundamental)
    return Case(records=(record,), period=modes.period, exponents=exponents, must=must, bound=least, **more)
