"""The line of the shaft that each pulse is: pulses that are missing, doubled, unevenly spaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats, Indices, Integers
from floquid.core import longest_run

FEWEST_PHASES = 8  # samples a period, and instants a revolution, that are chosen at least where a sensor gives them
SPAN = 11  # the fewest intervals whose median is the local one: every second pulse but one may be wrong

DOUBT = 0.25
"""Line spacings, of an azimuth revolutions, that a pulse or a step may be off: half of one would be another line."""


@dataclass(frozen=True, slots=True)
class Counted:
    """The pulses that are kept, and the number of each."""

    kept: Indices  # the indices of the pulses kept (kept,)
    numbers: Integers  # line spacings from line 0 of the first revolution to each (kept,)
    missing: int  # pulses that should have come between the first and the last
    doubled: int  # pulses left out, one too many in its place
    absent: tuple[int, ...]
    """Lines that never gave a pulse: a missing tooth. Line 0 is then the first after the longest such gap."""
    doubtful: tuple[tuple[float, float], ...]
    """Gaps (first, last time) [s] in which the number of pulses lost is a guess."""


def count(times: Floats, lines: int) -> Counted:
    """Number the pulses at `times` (pulses,) [s] of a shaft with some lines a revolution."""
    kept = np.arange(len(times))
    numbers = np.arange(len(times))
    for _ in range(10):
        unit = _spacing(times[kept], numbers, lines)
        spacing = np.interp(0.5 * (times[1:] + times[:-1]), 0.5 * (times[kept][1:] + times[kept][:-1]), unit)
        found = _track(times, spacing, _pattern(times, spacing, lines))
        done = len(found[0]) == len(kept) and np.array_equal(found[0], kept) and np.array_equal(found[1], numbers)
        kept, numbers = found
        if done:
            break
    absent: tuple[int, ...] = ()
    if lines > 1:
        numbers, absent = _from_the_gap(numbers, lines)
    return Counted(
        kept=kept,
        numbers=numbers,
        missing=int(numbers[-1] - numbers[0] + 1 - len(numbers)),
        doubled=len(times) - len(kept),
        absent=absent,
        doubtful=_doubtful(times[kept], numbers, lines),
    )


def _spacing(times: Floats, numbers: Integers, lines: int) -> Floats:
    """The running median of the time from a line to the next (intervals,) [s], each taken over a revolution."""
    from scipy.ndimage import median_filter

    lag = min(lines, len(times) - 1)
    over = (times[lag:] - times[:-lag]) / np.maximum(numbers[lag:] - numbers[:-lag], 1)
    smooth = median_filter(over, size=min(max(SPAN, 4 * lag + 1), 2 * len(over) - 1), mode="reflect")
    centre = 0.5 * (times[lag:] + times[:-lag])
    return np.interp(0.5 * (times[1:] + times[:-1]), centre, smooth)


def _pattern(times: Floats, spacing: Floats, lines: int) -> tuple[int, Floats] | None:
    """First line, and the spacings of the lines from there on (lines,), of mean one: None when they are even."""
    if lines == 1 or len(times) < 3 * lines:
        return None
    whole = (times[lines:] - times[:-lines]) / (lines * spacing[: len(times) - lines])
    good = np.abs(whole - np.median(whole)) < DOUBT / lines
    begin, end = longest_run(good)
    turns = (end - begin + lines - 1) // lines
    if turns < 2:
        return None
    part = slice(begin, begin + turns * lines)
    shares = np.median((np.diff(times)[part] / spacing[part]).reshape(turns, lines), axis=0)
    return begin, shares / shares.mean()


def _track(times: Floats, spacing: Floats, pattern: tuple[int, Floats] | None) -> tuple[Indices, Integers]:
    """The pulses kept and their numbers, from interval to interval in units of the local spacing."""
    steps = np.diff(times) / spacing
    start, shares = pattern if pattern is not None else (0, np.ones(1))
    expected = shares[(np.arange(len(steps)) - start) % len(shares)]
    if (np.abs(steps - expected) < DOUBT).all():  # one by one
        return np.arange(len(times)), np.arange(len(times))
    position = np.concatenate([[0.0], np.cumsum(steps)])  # in line spacings, free of the speed
    forwards = _walk(position[start:], shares)
    backwards = _walk(-position[start::-1], shares[::-1])
    kept = np.concatenate([start - backwards[0][:0:-1], start + forwards[0]])
    numbers = np.concatenate([-backwards[1][:0:-1], forwards[1]])
    return kept, numbers - numbers[0]


def _walk(position: Floats, shares: Floats) -> tuple[Indices, Integers]:
    """Number the pulses at ascending positions from the first on; of two for one line, keep the better."""
    lines = len(shares)
    marks = np.concatenate([[0.0], np.cumsum(shares)])  # where lines are, from the first one on
    revolution = marks[-1]

    def place(number: int) -> float:
        return (number // lines) * revolution + marks[number % lines]

    def advance(number: int, step: float) -> int:
        """The number of the line nearest to `step` after line `number`."""
        target = place(number) + step
        turns = int(target // revolution)
        return turns * lines + int(np.argmin(np.abs(marks - (target - turns * revolution))))

    kept, numbers = [0], [0]
    for index in range(1, len(position)):
        last = kept[-1]
        number = advance(numbers[-1], position[index] - position[last])
        if number > numbers[-1]:
            kept.append(index)
            numbers.append(number)
            continue
        if len(kept) > 1:  # the one that agrees better with the pulses on either side
            errors = []
            for candidate in (last, index):
                gap = position[candidate] - position[kept[-2]]
                error = abs(gap - (place(numbers[-1]) - place(numbers[-2])))
                if index + 1 < len(position):
                    ahead = position[index + 1] - position[candidate]
                    following = advance(numbers[-1], ahead)
                    error += abs(ahead - (place(following) - place(numbers[-1])))
                errors.append(error)
            if errors[1] < errors[0]:
                kept[-1] = index
    return np.array(kept), np.array(numbers)


def _from_the_gap(numbers: Integers, lines: int) -> tuple[Integers, tuple[int, ...]]:
    """Numbers such that line 0 is the first after the longest run of lines that never gave a pulse."""
    seen = np.bincount(numbers % lines, minlength=lines) > 0
    if seen.all() or numbers[-1] - numbers[0] < 2 * lines:
        return numbers, ()
    best, zero = 0, 0
    for line in np.flatnonzero(seen):
        run = 0
        while not seen[(line - 1 - run) % lines]:
            run += 1
        if run > best:
            best, zero = run, int(line)
    shifted = numbers - zero
    return shifted, tuple(int(line) for line in np.sort((np.flatnonzero(~seen) - zero) % lines))


def _doubtful(times: Floats, numbers: Integers, lines: int) -> tuple[tuple[float, float], ...]:
    """Gaps before and after which the speeds differ by too much for the pulses lost in them to be counted."""
    steps = np.diff(numbers)
    doubts = []
    for gap in np.flatnonzero(steps > max(2, lines)):
        speeds = []
        for part in (slice(max(gap - 3 * lines, 0), gap + 1), slice(gap + 1, gap + 2 + 3 * lines)):
            if len(times[part]) > 1:
                speed = np.diff(numbers[part][[0, -1]])[0] / np.diff(times[part][[0, -1]])[0]
                speeds += [float(speed)]
        length = times[gap + 1] - times[gap]
        if len(speeds) == 2 and abs(speeds[1] - speeds[0]) * length > DOUBT:
            doubts.append((float(times[gap]), float(times[gap + 1])))
    return tuple(doubts)
