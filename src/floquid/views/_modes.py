"""Which mode, channel and hit is meant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, integer
from floquid.core import PeriodicModel
from floquid.pipeline import Analysis

EVIDENT = 4.0
"""Standard deviations from which on a growth is one."""


def upper_modes(model: PeriodicModel) -> tuple[int, ...]:
    """The modes of a model, one of each conjugate pair: the one of positive imaginary part, or a real one.

    Parameters
    ----------
    model
        The model.

    Returns
    -------
    tuple of int
        Their indices, ascending.
    """
    lam, near = model.exponents, 1e-9 * model.fundamental
    paired = (np.abs(np.subtract.outer(lam, lam.conj())) < near).any(axis=1)
    return tuple(int(r) for r in np.flatnonzero((lam.imag >= -near) | ~paired))


def is_real(model: PeriodicModel, mode: int) -> bool:
    """Whether the multiplier of a mode is real: twice the imaginary part is a whole number of fundamentals.

    Parameters
    ----------
    model
        The model.
    mode
        Which of its modes.

    Returns
    -------
    bool
        Whether it is.
    """
    half_turns = 2.0 * model.exponents[mode].imag / model.fundamental
    return abs(half_turns - np.rint(half_turns)) < 1e-9


def grows(model: PeriodicModel, mode: int) -> bool:
    r"""Whether a mode grows beyond doubt, or as far as is known.

    .. math:: \Re\lambda > 4\,\sigma_{\Re\lambda}

    Without a deviation, :math:`\Re\lambda > 0`.

    Parameters
    ----------
    model
        The model.
    mode
        Which of its modes.

    Returns
    -------
    bool
        Whether it does.
    """
    std = 0.0 if model.exponent_std is None else float(model.exponent_std[mode].real)
    return bool(model.exponents[mode].real > EVIDENT * (std if np.isfinite(std) else 0.0))


def below(value: int, end: int, argument: str, of: str) -> int:
    """An index of something of which there are `end`.

    Raises
    ------
    InputError
        It is no index, or too large.
    """
    if integer(value, argument, of, at_least=0) >= end:
        raise input_error(argument, of, f"be less than {end}", f"is {value}", "Counting starts at 0.")
    return int(value)


def checked(analysis: Analysis, of: str, *, channel: int | None = None, hit: int = 0) -> None:
    """Refuse what is no analysis, channel or hit."""
    if not isinstance(analysis, Analysis):
        raise input_error("analysis", of, "be an Analysis", f"is {analysis!r:.60}", "Pass what `identify` gives.")
    below(hit, analysis.model.n_hits, "hit", of)
    if channel is not None:
        below(channel, len(analysis.model.channels), "channel", of)


def paired(one: NDArray[np.complex128], other: NDArray[np.complex128]) -> NDArray[np.int64]:
    """Which of `other` each of `one` is (modes of `one`,): each taken once, so that the differences are least.

    Two modes that have one multiplier would both find the same one otherwise. Where `other` has too few, those left
    over take the nearest.
    """
    from scipy.optimize import linear_sum_assignment

    off = np.abs(np.subtract.outer(one, other))
    found = np.argmin(off, axis=1)
    rows, columns = linear_sum_assignment(off)
    found[rows] = columns
    return found.astype(np.int64)


def frozen(values: NDArray) -> NDArray:
    """The array, read-only."""
    values.flags.writeable = False
    return values
