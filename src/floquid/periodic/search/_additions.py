"""Structures from peaks of the residual: further harmonics of modes, of the forced response, and modes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats
from floquid.fit import HALF_DIGITS
from floquid.periodic.least_squares import PLAIN, ModeParameters, RecordBlock, Residual, complex_of, forced_entries
from floquid.periodic.search._objective import Point
from floquid.periodic.search._peaks import Peak, peaks
from floquid.search import CANDIDATES, GAP, Move


def residuals(point: Point) -> list[Residual]:
    """Residual of each block."""
    columns = point.entries.columns()
    return [
        Residual.of(*block.residual(columns, complex_of(linear.coefficients)), low)
        for block, linear, low in zip(point.blocks, point.solution.linear, point.floors, strict=True)
    ]


def additions(
    point: Point, forced: Floats, most: int, *, loud: float = 1.0, room: bool = True, width: int | None = None
) -> Iterator[Iterator[Move]]:
    """Structures with what peaks of the residual may be: three together, the harmonics among them, one by one."""
    rest, price = residuals(point), point.price
    least = price.mode(real=False) + float(price.harmonics(np.array([True]))[0])
    # Far from a loud mode its skirts are above the noise there: by one level for all bands the loudest is first.
    for levels in (rest, [residual.level() for residual in rest]):
        _, candidates = peaks(point.blocks, levels, point.period, most=CANDIDATES)
        candidates = [peak for peak in candidates if peak.gain > loud * max(peak.limit, least)]
        if not candidates:
            return
        yield _moves(point, rest, candidates, forced, most, room=room, width=width)


def _moves(
    point: Point,
    residuals: Sequence[Residual],
    candidates: Sequence[Peak],
    forced: Floats,
    most: int,
    *,
    room: bool,
    width: int | None,
) -> Iterator[Move]:
    entries, price = point.entries, point.price.of(point.entries)
    line = 4.0 * np.pi / max(residual.span for residual in residuals)

    def move(name: str, trial: ModeParameters, gain: float) -> Iterator[Move]:
        more = point.price.of(trial) - price
        if gain > more:
            yield Move(more - gain, name, trial)

    several, total = entries, 0.0
    for peak in candidates:
        known = _known(entries, peak, forced, line, most, bands=width is None)
        if known is not None:
            yield from move("harmonic", known, peak.gain)
        if not room:
            continue
        alone = _alone(point, residuals, peak)
        if width:
            alone = replace(alone, bands=np.array([[-width, width]]))
        wider = _known(several, peak, forced, line, most, bands=width is None)
        several = several.joined(alone) if wider is None else wider
        total += peak.gain
        yield from move("new mode", entries.joined(alone), peak.gain)
    if total and len(candidates) > 1 and several is not entries:
        yield from move("new modes", several, total)


def _alone(point: Point, residuals: Sequence[Residual], peak: Peak) -> ModeParameters:
    """The exponential of a peak fitted to the residual."""
    alone = ModeParameters.made([peak.exponent], [(0, 0)], point.entries.fundamental)
    grids = [
        RecordBlock(
            times=np.asarray(residual.taken * residual.step, np.float64),
            values=residual.values[:, residual.taken],
            hit=block.hit,
            rows=block.rows,
            noise=block.noise,
        )
        for block, residual in zip(point.blocks, residuals, strict=True)
    ]
    with suppress(np.linalg.LinAlgError):
        return Point.at(grids, point.floors, point.price, alone).settled().entries
    return alone


def _known(
    entries: ModeParameters, peak: Peak, forced: Floats, line: float, most: int, *, bands: bool
) -> ModeParameters | None:
    """The entries with the harmonic, forced or of a mode, that a peak may be; None where it is of none."""
    omega, frequency = entries.fundamental, peak.exponent.imag
    if len(forced) and abs(peak.exponent.real) < line:
        turn = forced[int(np.argmin(np.abs(forced * omega - frequency)))]
        there = entries.offsets[entries.fixed & (entries.factors == PLAIN)]
        if abs(turn * omega - frequency) < line and not (np.abs(there - turn) < HALF_DIGITS).any():
            return entries.joined(forced_entries([turn], omega))
    best, least = None, np.inf
    for entry in np.flatnonzero(~entries.fixed) if bands else ():
        low, high = entries.bands[entry]
        value = entries.exponents[entry] + 1j * omega * entries.offsets[entry]
        for sign in (1.0, -1.0) if not entries.real[entry] else (1.0,):
            m = round((sign * frequency - value.imag) / omega)
            off = abs(sign * frequency - value.imag - m * omega)
            if off > line + abs(value.real) or low <= m <= high or not low - GAP <= m <= high + GAP:
                continue
            if abs(m + (0 if entries.real[entry] else round(value.imag / omega))) <= most and off < least:
                wider = entries.bands.copy()
                wider[entry] = min(low, m), max(high, m)
                best, least = replace(entries, bands=wider), off
    return best
