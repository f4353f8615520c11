"""A time column is repaired, not trusted: one rate from the whole column, snapped to a nominal one where that is clear.

Times in a file are rounded (to the digits printed, to single precision), so a rate from the first two of them is wrong
by a part in hundreds, and the error grows along the record into a wrong phase. Here the rate is the slope of the line
through all times; see `_nominal_rate` for when it is replaced by a round number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats, Integers, Mask
from floquid._checks import counted
from floquid._show import Brief
from floquid.errors import InputError
from floquid.io import Source
from floquid.tables._nominal_rate import LineFit, Rounding, fit_line, nominal_rate, rounding

SECONDS = {
    **dict.fromkeys(["s", "sec", "secs", "second", "seconds"], 1.0),
    **dict.fromkeys(["ms", "msec", "millisecond", "milliseconds"], 1e-3),
    **dict.fromkeys(["us", "µs", "μs", "usec", "microsecond", "microseconds"], 1e-6),
    **dict.fromkeys(["ns", "nsec", "nanosecond", "nanoseconds"], 1e-9),
    **dict.fromkeys(["min", "minute", "minutes"], 60.0),
    **dict.fromkeys(["h", "hr", "hour", "hours"], 3600.0),
}
"""The units of time by their names, and no others."""

_SINCE_1970 = (
    (1e11, 1e-3, "ms", "milliseconds"),
    (1e14, 1e-6, "us", "microseconds"),
    (1e17, 1e-9, "ns", "nanoseconds"),
)
"""The least size of times without a unit that count from 1970, in which unit; the largest is a hundred times that."""

JITTER = 0.01
"""Steps by which a sum of a rounded step may wander from its line: at 40 samples a period that is 0.0016 rad."""

MAX_GROWTH = 2
"""Gaps are filled while the record stays within this multiple of its length: a crafted time allocates no more."""

_COARSE = 0.25  # rounding, in steps, from which the length of a gap can no longer be read off alone

_FARTHEST, _SHORTEST = 1e13, 1e-15
"""Bounds on a time and on a step [s]; beyond them the numbers are not times, and their squares overflow."""

_IGNORE = "pass `rate=` [Hz] to ignore the times."
_RESAMPLE = f"Resample onto even times first, or {_IGNORE}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeColumn(Brief):
    """The times as a file has them.

    Parameters
    ----------
    values, scale
        The times (samples,), in a unit in seconds; None where no unit is stated.
    label
        What they are called there.
    """

    values: NDArray[np.floating]
    scale: float | None
    label: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeAxis(Brief):
    """An even time axis: sample n at `start` + n/`sample_rate` [s].

    Parameters
    ----------
    sample_rate, start
        The rate [Hz] and the time of the first sample [s].
    rows
        True for each row of the file that is on the axis (all rows,), or None where all are.
    positions
        The sample that each of these rows becomes (rows,), or None when each follows the one before.
    notes
        How the axis was found, in sentences.
    """

    sample_rate: float
    start: float
    rows: Mask | None = None
    positions: Integers | None = None
    notes: tuple[str, ...] = ()

    def place(self, values: Floats) -> Floats:
        """The rows of the file, `values`, at their samples, NaN in the gaps (channels, samples); read-only."""
        if self.rows is not None:
            values = values[:, self.rows]
        if self.positions is not None:
            placed = np.full((len(values), int(self.positions[-1]) + 1), np.nan)
            placed[:, self.positions] = values
            values = placed
        values.flags.writeable = False
        return values


def repair(column: TimeColumn, source: Source) -> TimeAxis:
    """The even time axis behind a time `column` of a `source`.

    The times t_n are fitted by t_0 + k_n h with whole numbers k_n, least squares over the whole column. All k_n = n if
    that leaves residuals within the rounding of the column; otherwise steps of a whole number of h are gaps. Where the
    rounding is about as long as a step, a gap and a rounding look alike: see `_whole_steps`. Times without a unit are
    taken for seconds, or by their size for milliseconds since 1970, and a note says so.
    """
    column, since = _since_1970(column)
    scale = 1.0 if column.scale is None else column.scale
    with np.errstate(over="ignore", invalid="ignore"):  # refused below
        times = column.values.astype(np.float64, copy=False)
        times = times if scale == 1.0 else times * scale
    _check_order(times, column.label, source)
    rounded = rounding(column.values, scale)
    positions = np.arange(len(times), dtype=np.float64)
    line = fit_line(positions, times)
    whole = _whole_steps(times, rounded)
    if whole is not None or not _is_even(line, positions, rounded):
        positions = _positions_with_gaps(times, rounded, whole, column.label, source)
        line = fit_line(positions, times)
        if not _is_even(line, positions, rounded):
            raise _uneven(times, line, column.label, source)
    nominal = nominal_rate(positions, times, rounded, line)
    rate = 1.0 / line.step if nominal is None else nominal
    start = line.start if nominal is None else float(np.mean(times - positions / nominal))
    if abs(start - times[0]) <= rounded.coarsest + 4.0 * np.spacing(np.abs(times).max()):
        start = float(times[0])  # as printed: the line is no better than the rounding here
    notes = (*_notes(line, rounded, nominal, positions, times), *since)
    if column.scale is None:
        notes += (f"`{column.label}` has no unit: its times are taken for seconds (others would be `time [ms]`).",)
    has_gaps = positions[-1] + 1 > len(times)
    return TimeAxis(
        sample_rate=rate, start=start, positions=positions.astype(np.int64) if has_gaps else None, notes=notes
    )


def _since_1970(column: TimeColumn) -> tuple[TimeColumn, tuple[str, ...]]:
    """A `column` without a unit that by its size counts from 1970, counted from its first time; others as they are."""
    if column.scale is not None or not column.values.size:
        return column, ()
    low, high = float(np.min(column.values)), float(np.max(column.values))
    for least, scale, unit, name in _SINCE_1970:
        if least <= low <= high < 100.0 * least:
            first = np.datetime64(int(column.values[0]), unit)
            note = f"`{column.label}` has no unit: by their size its times are {name} since 1970, from {first} on."
            return replace(column, values=column.values - column.values[0], scale=scale), (note,)
    return column, ()


def _check_order(times: Floats, label: str, source: Source) -> None:
    if len(times) < 2:
        raise source.error("hold at least two samples", "holds one", "A rate cannot be had from one: export more.")
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        got = f"has {bad.size} in `{label}` that are not, the first of them {times[bad[0]]:g} at sample {bad[0] + 1}"
        raise source.error("have a finite time for every sample", got, f"Leave such rows out, or {_IGNORE}")
    if np.abs(times).max() > _FARTHEST or 0.0 < times[-1] - times[0] < _SHORTEST * len(times):
        must = "have times in seconds, or a time column with its unit in brackets"
        got = f"has times from {times[0]:.6g} s to {times[-1]:.6g} s in `{label}`"
        raise source.error(must, got, "Write the unit of the times in brackets, as in `time [ms]`.")
    steps = np.diff(times)
    back, repeated = np.flatnonzero(steps < 0), np.flatnonzero(steps == 0)
    if not back.size and not repeated.size:
        return
    at = int(back[0] if back.size else repeated[0])
    where = f"{times[at + 1]:.12g} s after {times[at]:.12g} s at sample {at + 2}"
    got, remedy = f"goes back in `{label}`: {where}", "Sort the rows, or cut the file there."
    if not back.size:
        got = f"repeats a time in `{label}` {repeated.size} times, first {where}"
        remedy = f"Export the times with more digits, leave the doubled rows out, or {_IGNORE}"
    raise source.error("have times that increase", got, remedy)


def _is_even(line: LineFit, positions: Floats, rounded: Rounding) -> bool:
    """True where some line runs within half the rounding of every time, or times are sums of a rounded step."""
    if line.step <= 0:
        return False
    half, size = 0.5 * rounded.quantum * (1.0 + 1e-6), np.abs(line.residuals)
    if (size <= half).all():
        return True
    # A clock in single precision adds up a step: each is even within the rounding, and their sum wanders. Samples that
    # jitter by as much are another thing: of a good record modes are found that are none.
    if size.max() <= JITTER * line.step and (np.abs(np.diff(line.residuals)) <= rounded.coarsest).all():
        return True
    most = 2.0 * float(half.max())
    if (size > most).any():
        return False

    from scipy.optimize import minimize_scalar

    def lacks(tilt: float) -> float:  # the fitted line is pulled by where rounding lies on one side, or is coarse
        rest = line.residuals - tilt * positions
        return float((rest - half).max() - (rest + half).min())

    tilt = 2.0 * most / float(positions[-1])
    return bool(minimize_scalar(lacks, bounds=(-tilt, tilt), options={"xatol": 1e-4 * tilt}).fun <= 1e-2 * half.max())


def _whole_steps(times: Floats, rounded: Rounding) -> float | None:
    """The step [s], if nearly all steps are exactly it and the others whole multiples that can only be gaps."""
    # For times rounded about as coarsely as they are spaced. 0.01, 0.02, 0.04, 0.05 s may be 100 Hz with a sample lost
    # or 80 Hz rounded; but rounding makes its longer steps at even distances, so three or more of those are rounding,
    # and what is irregular, or rare, is a gap.
    steps = np.diff(times)
    step = float(np.median(steps))
    if rounded.coarsest <= _COARSE * step:
        return None
    multiples = np.rint(steps / step)
    odd = np.flatnonzero(multiples != 1.0)
    off = multiples * step
    off -= steps
    exact = np.abs(off, out=off) <= 1e-3 * rounded.coarsest
    if not exact.all() or not 0 < odd.size <= max(0.1 * len(steps), 1.0) or odd.size > 0.5 * len(steps):
        return None
    between = np.diff(odd)
    if odd.size >= 3 and (multiples[odd] == 2.0).all():
        edges = max(odd[0], len(steps) - 1 - odd[-1])
        if np.ptp(between) <= 2 and edges <= between.max() + 2:
            return None
    return step


def _positions_with_gaps(times: Floats, rounded: Rounding, whole: float | None, label: str, source: Source) -> Floats:
    """The sample number k_n of each time, when some steps are whole multiples of the shortest."""
    steps = np.diff(times)
    width = int(min(16, max(1, len(steps) // 4)))  # several steps together: rounding is a smaller part of them
    step = float(np.median(times[width:] - times[:-width])) / width if whole is None else whole
    if whole is None and rounded.coarsest > _COARSE * step:
        must = "have times of more digits than one step, or no gaps"
        got = f"has uneven steps of about {step:.3g} s in `{label}`, with times {rounded.words}"
        raise source.error(must, got, f"If they are rounded, export more digits. {_RESAMPLE}")
    positions = np.zeros(len(times))
    for _ in range(2):  # the second time with the step of the whole column
        positions[1:] = np.cumsum(np.maximum(np.rint(steps / step), 1.0))
        if positions[-1] + 1 > MAX_GROWTH * len(times):
            raise source.error(
                "have evenly spaced times, with gaps shorter together than the record",
                f"has steps from {steps.min():.6g} s to {steps.max():.6g} s in `{label}`, the longest after sample "
                f"{int(np.argmax(steps)) + 1}",
                f"Cut the file at its gaps. {_RESAMPLE}",
            )
        step = fit_line(positions, times).step if whole is None else whole
    return positions


def _uneven(times: Floats, line: LineFit, label: str, source: Source) -> InputError:
    steps = np.diff(times)
    worst = int(np.argmax(np.abs(steps - np.median(steps))))
    got = (
        f"has steps from {steps.min():.6g} s to {steps.max():.6g} s in `{label}`, the oddest after sample {worst + 1}, "
        f"{np.abs(line.residuals).max() / line.step:.3g} of a step from even"
    )
    return source.error("have evenly spaced times (a gap must be a whole number of steps)", got, _RESAMPLE)


def _notes(
    line: LineFit, rounded: Rounding, nominal: float | None, positions: Floats, times: Floats
) -> tuple[str, ...]:
    fit = _with_error(1.0 / line.step, line.rate_std(rounded.coarsest))
    if nominal is None:
        first = (
            f"Sampling rate {fit} Hz: fitted to the whole time column ({rounded.words}); "
            "no round rate is clearly meant."
        )
    else:
        first = (
            f"Sampling rate {nominal:.12g} Hz: taken from the whole time column ({rounded.words}) and snapped to the "
            f"nominal {_round_words(nominal)} (fit: {fit} Hz)."
        )
    notes = [first]
    scatter = float((np.abs(line.residuals) - rounded.quantum).max()) / line.step
    if scatter > 1e-4:
        notes.append(f"The times scatter by up to {100 * scatter:.2g} % of a step about even ones; taken as even.")
    gaps = np.flatnonzero(np.diff(positions) > 1)
    if gaps.size:
        missing = int(positions[-1]) + 1 - len(positions)
        notes.append(
            f"The time column has {counted(gaps.size, 'gap')}, the first after {times[gaps[0]]:.9g} s: "
            f"{counted(missing, 'sample')} marked missing."
        )
    return tuple(notes)


def _round_words(rate: float) -> str:
    """«51200 Hz», or where it is the step that is round, that."""
    few = float(f"{rate:.7g}") == rate
    return f"{rate:.12g} Hz" if few else f"step of {1.0 / rate:.6g} s"


def _with_error(value: float, std: float) -> str:
    """«51199.9997 ± 0.0006»: the value to the last digit that its standard error leaves."""
    if std < 1e-12 * abs(value):
        return f"{value:.12g}"
    digits = min(max(-int(np.floor(np.log10(std))), 0), 15)
    return f"{value:.{digits}f} ± {std:.{digits}f}" if std < 1.0 else f"{value:.9g} ± {std:.2g}"
