"""Search for impacts in the samples of a record: in its force, or in what an autoregressive model does not foretell.

Instants are sample numbers here. A blow is (first sample, first free sample, strength as a share of the strongest's,
whether it is more than one).
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from floquid._arrays import BLOCK, Floats, Mask
from floquid._checks import input_error
from floquid.core import runs_of
from floquid.fit import SURE, chi2_limit

Blow = tuple[int, int, float, bool]

LONGEST_MEMORY = 64  # samples that the model looks back at most
TERMS = 160  # coefficients a channel of the model at most: memory times channels
ROWS_A_TERM = 5  # samples a coefficient that the fit needs
MOST_ROWS = 10_000  # samples that the fit uses at most: more make it slower, not better

LEAST_ERROR = 1e-4
"""Prediction error that is never an impact, against the deviation of the channel, and that the fit takes for granted:
one of a record without noise would be exact and unstable."""

SIDED = 0.7
"""Share of the errors around an impact that lies ahead of it forwards and before it backwards: less is chatter."""

NEARBY = 16  # windows on each side over which the usual prediction error is taken

PASSES = 6  # fits, at most, without the rows that hold impacts: each finds fewer of them than the one before


def by_force(force: Floats, *, least: float, apart: int) -> list[Blow]:
    """Blows of a force (samples,): away from its resting level, by two thresholds."""
    away = np.abs(force - np.nanmedian(force)) if np.isfinite(force).any() else np.zeros(len(force))
    noise, largest = 1.4826 * float(np.nanmedian(away)), float(np.nanmax(away, initial=0.0))
    high = max(least * largest, 8.0 * noise)
    if not 0.0 < high < largest:
        return []
    low = min(max(0.01 * largest, 4.0 * noise), 0.5 * high)
    above = np.nan_to_num(away) > low
    runs = [(a, b, float(np.nanmax(away[a:b]))) for a, b in runs_of(above)]
    blows: list[Blow] = []
    for first, stop, size in (run for run in runs if run[2] >= high):
        if blows and first - blows[-1][1] <= apart:
            blows[-1] = (blows[-1][0], stop, max(blows[-1][2], size / largest), True)
        else:
            blows.append((first, stop, size / largest, False))
    return blows


def by_response(values: Floats, rows: list[int], *, least: float, apart: int) -> list[Blow]:
    """Blows that the rows of `values` (channels, samples) show by the errors of two predictions."""
    # The channels about their means, in units of their standard deviations.
    scaled = values[rows]
    scaled -= np.nanmean(scaled, axis=1, keepdims=True)
    scaled /= np.nanstd(scaled, axis=1, keepdims=True)
    complete: Mask = np.asarray(~np.isnan(scaled).any(axis=0))
    memory, whole = _memory(complete, len(rows))
    # A row is a stretch of the samples in order of time: it is copied as it lies.
    in_time = np.ascontiguousarray(np.nan_to_num(scaled, copy=False).T)
    del scaled
    window = max(4, memory // 2)
    free = whole
    errors = _errors(in_time, memory, whole, free)
    excess, limit = _excess(*errors, window, len(rows))
    for _ in range(PASSES):
        counted = np.concatenate([[0], np.cumsum(excess > limit)])
        # A row of the fit is n ... n + memory: free when no impact comes after its first and up to its last sample.
        now = whole & (counted[memory + 1 : -1] == counted[1 : -1 - memory])
        if (now == free).all() or now.sum() < ROWS_A_TERM * memory * len(rows):
            break
        free = now
        del errors, excess  # before others take as much memory
        errors = _errors(in_time, memory, whole, free)
        excess, limit = _excess(*errors, window, len(rows))
    alone = (1.0 + np.sqrt(chi2_limit(1, SURE) / len(rows))) ** 2
    return _blows(excess, limit, errors[:2], alone, memory + window, least=least, apart=apart)


def _memory(complete: Mask, channels: int) -> tuple[int, Mask]:
    """Memory of the model, and the mask of rows (samples - memory,) of the fit that miss no sample."""
    memory = max(1, min(LONGEST_MEMORY, TERMS // channels, len(complete) // (ROWS_A_TERM * channels + 1)))
    counted = np.concatenate([[0], np.cumsum(~complete)])
    while memory >= 2:
        whole = counted[memory + 1 :] == counted[: -1 - memory]
        if whole.sum() >= ROWS_A_TERM * memory * channels:
            return memory, whole
        memory //= 2
    need = 2 * (ROWS_A_TERM * channels + 1)
    must = f"have {need} samples or more with few missing, to find impacts in {channels} response channels"
    got = f"has {len(complete)}, and {int((~complete).sum())} of them miss a channel"
    remedy = "Leave channels with gaps out by `channels`, or give the instants of the impacts."
    raise input_error("record", "find_impacts", must, got, remedy)


def _errors(in_time: Floats, memory: int, whole: Mask, free: Mask) -> tuple[Floats, Floats, float]:
    """Squares of the errors of the predictions forwards and backwards (samples,), and the least that counts."""
    samples, channels = in_time.shape
    used = _used(in_time, memory, free)
    mean, gram = _moments(in_time, used if used.any() else free)
    filters = np.hstack([_filter(gram, channels, ahead=True), _filter(gram, channels, ahead=False)])
    # Single precision is far below the least error that counts.
    single, offset = filters.astype(np.float32), (mean @ filters).astype(np.float32)
    errors, moments = np.empty((samples - memory, 2 * channels), np.float32), np.zeros((2 * channels, 2 * channels))
    step = max(1, BLOCK // len(single))
    for first in range(0, len(errors), step):
        part = slice(first, first + step)
        block = in_time[first : first + step + memory].astype(np.float32).ravel()
        windows = sliding_window_view(block, (memory + 1) * channels)[::channels]
        # Windows that overlap are none for BLAS: copied, the product takes a third of the time.
        errors[part] = np.ascontiguousarray(windows) @ single - offset
        kept = errors[part][free[part]].astype(np.float64)
        moments += kept.T @ kept
    ahead, back = np.full((2, samples), np.nan)
    floor = 0.0
    for squares, own in ((ahead[memory:], slice(channels)), (back[:-memory], slice(channels, None))):
        covariance = moments[own, own] / free.sum() + LEAST_ERROR**2 * np.eye(channels)
        inverse = np.linalg.inv(covariance)
        for first in range(0, len(errors), step):
            part = slice(first, first + step)
            error = errors[part, own].astype(np.float64)
            squares[part] = np.einsum("nc,nc->n", error @ inverse, error) / channels
        squares[~whole] = np.nan
        floor = max(floor, LEAST_ERROR**2 * float(np.trace(inverse)) / channels)
    return ahead, back, floor


def _used(in_time: Floats, memory: int, free: Mask) -> Mask:
    """The `free` rows that are fitted: of stretches all along the record, closer together where it is loud.

    A response that is over long before the record is would be missed by stretches at even distances.
    """
    # Stretches are longer than the memory: their ends cost as much as their samples.
    stretch = 4 * memory
    many = MOST_ROWS // stretch
    starts = np.arange(0, len(free), stretch)
    if len(starts) <= many:
        return free
    power = np.einsum("nc,nc->n", in_time, in_time)[: len(free)]
    share = sum(part / part.sum() for part in (np.add.reduceat(rows, starts) for rows in (free * power, free * 1.0)))
    grid = np.cumsum(share)
    chosen = np.zeros(len(starts), bool)
    chosen[np.searchsorted(grid, (np.arange(many) + 0.5) / many * grid[-1])] = True
    return free & np.repeat(chosen, stretch)[: len(free)]


def _moments(in_time: Floats, free: Mask) -> tuple[Floats, Floats]:
    r"""The mean and the covariance of the `free` rows, stretches of the samples in time (samples, channels).

    .. math:: G_{i+1,j+1} = G_{i,j} + \sum_{[a,b)} (x_{b+i} x_{b+j}^T - x_{a+i} x_{a+j}^T)

    over the runs [a, b) of free rows: except for their ends, a row later is the same products one lag on.
    """
    (samples, channels), chosen = in_time.shape, np.flatnonzero(free)
    memory, number = samples - len(free), len(chosen)
    taken = np.concatenate([in_time[chosen], np.ones((number, 1))], axis=1).T
    gram = np.empty((memory + 1, channels, memory + 1, channels))
    mean = np.empty((memory + 1, channels))
    for lag in range(memory + 1):
        later = in_time.take(chosen + lag, axis=0)
        products = taken @ later
        gram[0, :, lag], mean[lag] = products[:-1], products[-1]
    gram[:, :, 0] = gram[0].transpose(1, 2, 0)
    edges = np.array(runs_of(free))
    starts, ends = (in_time[edges[:, side, None] + np.arange(memory)] for side in (0, 1))
    for lag in range(memory):
        gained = np.tensordot(ends[:, lag], ends, (0, 0)) - np.tensordot(starts[:, lag], starts, (0, 0))
        gram[lag + 1, :, 1:] = gram[lag, :, :-1] + gained
    size, mean = (memory + 1) * channels, mean.ravel() / number
    return mean, gram.reshape(size, size) / number - np.outer(mean, mean)


def _filter(gram: Floats, channels: int, *, ahead: bool) -> Floats:
    """Filter that makes the prediction error of a row's last (or first) sample out of the row, in order of time."""
    size = len(gram)
    target = slice(size - channels, size) if ahead else slice(0, channels)
    known = slice(0, size - channels) if ahead else slice(channels, size)
    ridge = LEAST_ERROR**2 * np.eye(size - channels)
    filters = np.zeros((size, channels))
    filters[target] = np.eye(channels)
    filters[known] = -np.linalg.solve(gram[known, known] + ridge, gram[known, target])
    return filters


def _excess(ahead: Floats, back: Floats, floor: float, window: int, channels: int) -> tuple[Floats, float]:
    """The mean square error ahead of each instant and back before it, over the usual; what only an impact exceeds."""
    reach = min(window, len(ahead))
    total, number = np.zeros(len(ahead) + 1), np.zeros(len(ahead) + 1, np.int32)
    for squares, forwards in ((ahead, True), (back, False)):
        there = np.isfinite(squares)
        for target, terms in ((total, np.where(there, squares, 0.0)), (number, there)):
            sums = np.zeros(len(target), target.dtype)
            np.cumsum(terms, out=sums[1:])
            if forwards:
                target[:-reach] += sums[reach:] - sums[:-reach]
                target[-reach:] += sums[-1] - sums[-reach:]
            else:
                target[reach:] += sums[reach:] - sums[:-reach]
                target[:reach] += sums[:reach]
    few = number < max(2, window // 4)
    total /= np.maximum(number, 1)
    mean = total
    mean[few] = np.nan
    sparse = mean[::window]
    padded = np.pad(sparse, NEARBY, constant_values=np.nan)
    around = sliding_window_view(padded, 2 * NEARBY + 1)
    usual = max(float(np.nanmedian(mean)), floor)
    nearby, step = np.empty(len(around)), max(1, BLOCK // around.shape[1])
    for first in range(0, len(around), step):
        part = around[first : first + step]
        # An all-missing neighbourhood takes what is usual elsewhere.
        filled = np.where(np.isfinite(part).any(axis=1, keepdims=True), part, usual)
        nearby[first : first + step] = np.maximum(np.nanmedian(filled, axis=1), usual)
    mean /= np.repeat(nearby, window)[: len(mean)]
    excess = np.nan_to_num(mean, copy=False)
    return excess, _limit(excess[::window], channels * window)


def _limit(excess: Floats, terms: int) -> float:
    """Threshold that only an impact exceeds, given the excess in every window and the number of squares in half of one.

    The scatter is that of white noise, or what the record shows where it is larger (chatter, a system not quite
    linear). Squared, since the upper tail of a sum of squares is longer than the lower.
    """
    shown = excess[excess > 0.0]
    scatter = 1.4826 * np.median(np.abs(shown - np.median(shown))) if len(shown) else 0.0
    return float((1.0 + np.sqrt(chi2_limit(1, SURE)) * max(np.sqrt(1.0 / terms), scatter)) ** 2)


def _blows(
    excess: Floats, limit: float, squares: tuple[Floats, Floats], alone: float, reach: int, *, least: float, apart: int
) -> list[Blow]:
    """Stretches above the limit as blows, those closer than `apart` as one."""
    spans: list[tuple[int, int]] = []
    for first, stop in runs_of(excess > limit):
        # A run spans what one impact disturbs, up to `reach` on either side of it.
        if spans and first - spans[-1][1] <= max(apart - 2 * reach, reach):
            spans[-1] = (spans[-1][0], stop)
        else:
            spans.append((first, stop))
    placed: list[Blow] = []
    for first, stop in spans:
        size = float(np.sqrt(excess[first:stop].max()))
        low, high = max(0, first - reach), min(len(squares[0]), stop + reach)
        start, end, sided = _place(*squares, low, high, alone)
        if sided >= SIDED:
            placed.append((start, end, size, stop - first > 2 * reach + 2))
    strongest = max((size for _, _, size, _ in placed), default=1.0)
    return [(a, b, size / strongest, double) for a, b, size, double in placed if size >= least * strongest]


def _place(ahead: Floats, back: Floats, low: int, high: int, alone: float) -> tuple[int, int, float]:
    """First sample of a blow, first after it that is free again, and how far its errors lie on their own sides.

    What is foretold forwards fails after the blow alone and backwards before it alone: the instant between the two is
    where the sum of the errors on their own sides is largest. A blow that lasts fails both, from its first sample to
    its last, as far as single errors stand out. Chatter fails both everywhere: its share is a half.
    """
    # Where one side has no prediction (an end of the record), the other must stand out of the noise to count.
    late, early = (np.nan_to_num(squares[low:high], nan=2.0) for squares in (ahead, back))
    own_side = np.concatenate([[0.0], np.cumsum(early - late)])
    # More than one instant where neither side has a prediction: somewhere among missing samples.
    between = np.flatnonzero(own_side == own_side.max())
    begun, over = np.flatnonzero(late > alone), np.flatnonzero(early > alone)
    start = int(np.concatenate([between[:1], begun[:1]]).min())
    end = int(np.concatenate([between[-1:], over[-1:] + 1]).max())
    late, early = (np.maximum(squares - 2.0, 0.0) for squares in (late, early))
    own, other = early[:start].sum() + late[end:].sum(), late[:start].sum() + early[end:].sum()
    return low + start, low + end, float(own / (own + other)) if own > 0.0 else 0.0
