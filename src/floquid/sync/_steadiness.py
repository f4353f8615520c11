"""Findings on a shaft: the steadiness of its speed against what a periodic model needs, and repairs."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats
from floquid.findings import Finding, note, warning

STEADY, USABLE = 0.01, 0.05
"""Wander of the speed, of its mean: below the one a periodic model holds, beyond the other it does not."""

BEYOND = 1.5  # revolutions outside the pulses that pass without a word: a record begins and ends between two pulses
GAP = 3.0  # revolutions without a pulse that are told of: what the speed did there is not in the deviation of the angle
ALIKE = 0.4  # correlation of neighbours in what is left over that is told of
ROUGH = 0.01  # scatter of pulses, in revolutions, that is too much for a good sensor on a shaft of steady speed


def verdict(wander: float, run: float, mean_speed: float) -> tuple[bool, Finding]:
    """True where the speed is steady enough, with the finding: from its relative wander and change over the record."""
    hz, percent = mean_speed / (2.0 * np.pi), 100.0 * wander
    if abs(run) > USABLE:
        return False, note("speed_runs", percent=100.0 * run, hz=hz)
    if wander > USABLE:
        return False, note("speed_wanders", percent=percent, hz=hz, limit=100.0 * USABLE)
    if wander > STEADY:
        return True, note("speed_usable", percent=percent, hz=hz, limit=100.0 * STEADY)
    return True, note("speed_steady", percent=percent, hz=hz) if wander > 0.0 else note("speed_constant", hz=hz)


def repairs(
    missing: int, doubled: int, rejected: int, used: int, what: str, absent: tuple[int, ...], lines: int
) -> list[Finding]:
    """Findings on pulses that were missing, doubled or rejected."""
    said = [note("absent_lines", absent=absent, lines=lines)] if absent else []
    if missing:
        said.append(note("pulses_missing", number=missing, used=used, what=what))
    wrong = {"pulses_doubled": doubled, "pulses_rejected": rejected}
    return said + [note(code, number=number, what=what) for code, number in wrong.items() if number]


def uneven(offsets: Floats, offsets_std: Floats) -> list[Finding]:
    """Finding on lines that are unevenly spaced beyond what chance explains."""
    known = np.isfinite(offsets) & (offsets_std > 0.0)
    n = int(known.sum())
    if n < 2:
        return []
    from scipy.special import chdtrc

    if chdtrc(n - 1, float(np.sum((offsets[known] / offsets_std[known]) ** 2))) > 1e-3:
        return []
    worst = float(np.degrees(np.abs(offsets[known]).max()))
    return [note("uneven_lines", lines=n, degrees=worst, percent=100.0 * worst / (360.0 / len(offsets)))]


def gaps(times: Floats, mean_speed: float) -> list[Finding]:
    """Finding on stretches without evidence."""
    turns = np.diff(times) * mean_speed / (2.0 * np.pi)
    wide = np.flatnonzero(turns > max(GAP, 3.0 * float(np.median(turns))))
    if len(wide) == 0:
        return []
    worst = wide[np.argmax(turns[wide])]
    first, last = times[worst : worst + 2]
    return [warning("angle_bridged", first=first, last=last, revolutions=turns[worst], more=len(wide) - 1)]


def alike(residuals: Floats) -> list[Finding]:
    """Finding on residuals that follow one another: a random error differs from pulse to pulse."""
    power = float(residuals @ residuals)
    correlation = float(residuals[1:] @ residuals[:-1]) / power if power > 0.0 else 0.0
    if correlation < max(ALIKE, 4.0 / np.sqrt(len(residuals))):
        return []
    return [warning("angle_alike", correlation=correlation)]


def outside(before: float, after: float) -> list[Finding]:
    """Finding on a record that goes beyond the evidence by so many revolutions."""
    before, after = (many if many > BEYOND else 0.0 for many in (before, after))
    return [note("beyond_angle", before=before, after=after)] if before or after else []
