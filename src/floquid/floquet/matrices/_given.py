"""Checks of what periodic matrices are given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Floats
from floquid._checks import frozen_array, input_error, positive
from floquid.floquet.matrices._balancing import balance
from floquid.floquet.matrices._matrix import AbstractPeriodicMatrix

OFFSET = 0.381966  # off every simple fraction of the period, where jumps and zeros like to sit


def checked_period(period: float, of: str) -> float:
    """The period, whose fundamental is finite too."""
    length = positive(period, "period", of, unit="s")
    if not np.isfinite(4096.0 / length):
        raise input_error("period", of, "be long enough for a fundamental", f"is {length:g} s", "Check its unit.")
    return length


def checked_tolerance(tolerance: float, of: str, largest: float = 1e-3) -> float:
    """The tolerance, from 1e-14 to the `largest` that passes."""
    accuracy = positive(tolerance, "tolerance", of)
    if not 1e-14 <= accuracy <= largest:
        raise input_error("tolerance", of, f"lie in [1e-14, {largest:.0e}]".replace("e-0", "e-"), f"is {accuracy:g}")
    return accuracy


def as_array(value: ArrayLike, argument: str, of: str) -> NDArray[Any]:
    """The value given as an array, of whatever it holds."""
    try:
        return np.asarray(value)
    except ValueError:
        got = "has rows of unequal length"
        raise input_error(argument, of, "be an array", got, "Give each row as many numbers.") from None


def checked_breaks(breaks: ArrayLike, period: float, of: str) -> Floats:
    """The breaks sorted, each once, all in [0, period)."""
    instants = np.unique(frozen_array(breaks, "breaks", of, axes=("breaks",)))
    if instants.size and not (instants[0] >= 0.0 and instants[-1] < period):
        got = f"runs from {instants[0]:g} to {instants[-1]:g}"
        raise input_error("breaks", of, f"lie in [0, {period:g}) [s]", got, "Give each jump once, in the first period.")
    instants.flags.writeable = False
    return instants


def refuse_repeated_end(values: Floats, name: str, of: str) -> None:
    """Refuse samples whose last is the first again, as `linspace(0, T, P + 1)` makes them."""
    n_samples = values.shape[2]
    largest = np.abs(values).max(axis=2)
    parts = (values, values[..., :-1])
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows here is refused where the harmonics are made
        if n_samples < 5 or (np.abs(values[..., -1] - values[..., 0]) > 1e-12 * largest).any():
            return
        tails = [np.abs(np.fft.rfft(v, axis=2))[..., 3 * v.shape[2] // 8 :].max(axis=2) for v in parts]
        repeats = tails[0] > 100.0 * tails[1] + 1e-9 * largest
    if repeats.any():
        must = "hold each phase of the period once"
        remedy = "Leave out the repeated end, `A[:, :, :-1]`; or give `times` to `SampledMatrix`."
        raise input_error(name, of, must, f"ends with its first sample again, the {n_samples}th", remedy)


def named(names: Sequence[str] | None, count: int, letter: str, argument: str, of: str) -> tuple[str, ...]:
    """Distinct names, as many as they have to be; by default the letter and a number."""
    if names is None:
        return tuple(f"{letter}{i}" for i in range(1, count + 1))
    if isinstance(names, str) or not all(isinstance(name, str) and name for name in names):
        raise input_error(argument, of, "be a list of names", f"is {names!r}")
    if len(names) != count:
        raise input_error(argument, of, f"have {count} names", f"has {len(names)}")
    doubled = [name for name in dict.fromkeys(names) if list(names).count(name) > 1]
    if doubled:
        raise input_error(argument, of, "have distinct names", f"has {doubled[0]!r} twice", "Rename one of them.")
    return tuple(names)


def refuse_other_period(matrix: AbstractPeriodicMatrix, of: str) -> None:
    """Refuse a callable that is another matrix one period later."""
    times = probe_times(matrix.period)
    distance = np.abs(times[:, None] - np.asarray(matrix.breaks)[None, :])
    times = times[(distance > 1e-6 * matrix.period).all(axis=1)]
    now, later = matrix.at(times), matrix.at(times + matrix.period)
    differences = np.abs(later - now)
    # Entry by entry, whatever their units, and not below what rounding makes of entries that come and go.
    rounding = 1e-13 * np.abs(now).max()
    if now.shape[1] == now.shape[2]:
        scale, size = balance(now)
        rounding = 1e-13 * size * scale[:, None] / scale
    allowed = 1e-8 * np.abs(now).max(axis=0) + rounding
    over = (differences > allowed).any(axis=(1, 2))
    if over.any():
        worst, change = int(over.argmax()), differences.max(axis=(1, 2))
        got = f"A differs by {change[worst]:.3g} between t = {times[worst]:g} and one period of {matrix.period:g} later"
        remedy = (
            "Half a revolution is a period only in the fixed frame: check the period and the coordinates. Values in "
            "single precision are no periodic matrix: compute them in double."
        )
        raise input_error("period", of, "be a period of A(t)", got, remedy)


def probe_times(period: float, count: int = 16) -> Floats:
    """Instants spread over the period (times,) [s]."""
    return period * (np.arange(count) + OFFSET) / count
