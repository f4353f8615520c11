"""Sentences on a shaft: how steady its speed is, against what a periodic model needs, and what was repaired."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STEADY, USABLE = 0.01, 0.05
"""Wander of the speed, of its mean: below the one a periodic model holds, beyond the other it does not."""

BEYOND = 1.5
"""Revolutions outside the pulses that pass without a word: a record begins and ends between two pulses."""

GAP = 3.0
"""Revolutions without a pulse that are told of: what the speed did there is not in the deviation of the angle."""

ALIKE = 0.4
"""Correlation of neighbours in what is left over that is told of."""

ROUGH = 0.01
"""Scatter of pulses, in revolutions, that is too much for a good sensor on a shaft of steady speed."""


def verdict(wander: float, run: float, mean_speed: float) -> tuple[bool, str]:
    """Whether the speed is steady enough, and why: from the relative wander and the relative change over the record."""
    hz, cut = f"{mean_speed / (2.0 * np.pi):.6g} Hz", "Cut the record to a part of steady speed."
    if abs(run) > USABLE:
        word = "rises" if run > 0.0 else "falls"
        return False, (
            f"The speed {word} by {100.0 * abs(run):.3g} % of its mean of {hz} from one end to the other: exponents "
            f"change with it, and no periodic model holds. {cut}"
        )
    wanders = f"The speed wanders by {100.0 * wander:.2g} % (rms) about {hz}"
    if wander > USABLE:
        return False, f"{wanders}, more than {100.0 * USABLE:g} %: no periodic model holds. {cut}"
    if wander > STEADY:
        return True, (
            f"{wanders}: usable with care above {100.0 * STEADY:g} %, since the exponents themselves depend on speed."
        )
    if wander > 0.0:
        return True, f"{wanders}: steady enough for a periodic model."
    return True, f"The speed is constant at {hz} within what the evidence can tell."


def repairs(
    missing: int, doubled: int, rejected: int, used: int, what: str, absent: tuple[int, ...], lines: int
) -> list[str]:
    """What was wrong with the pulses and how it was put right."""
    said: list[str] = []
    if absent:
        which = ", ".join(str(line) for line in absent[:6]) + (f" and {len(absent) - 6} more" if absent[6:] else "")
        word = "lines" if absent[1:] else "line"
        said.append(f"No pulse ever comes from {word} {which} of {lines}: phase zero is the first line after the gap.")
    if missing:
        said.append(f"Missing beside {used} {what}: {missing}; the angle was counted on over them.")
    if doubled:
        said.append(f"Too many for the lines, and left out: {doubled} {what}.")
    if rejected:
        said.append(f"Far off the angle of the others, and left out: {rejected} {what}.")
    return said


def uneven(offsets: NDArray[np.float64], offsets_std: NDArray[np.float64]) -> list[str]:
    """What is said of lines that are unevenly spaced beyond what chance explains."""
    known = np.isfinite(offsets) & (offsets_std > 0.0)
    n = int(known.sum())
    if n < 2:
        return []
    from scipy.special import chdtrc

    if chdtrc(n - 1, float(np.sum((offsets[known] / offsets_std[known]) ** 2))) > 1e-3:
        return []
    worst = float(np.degrees(np.abs(offsets[known]).max()))
    share = 100.0 * worst / (360.0 / len(offsets))
    said = (
        f"The {n} lines are unevenly spaced, by up to {worst:.3g} deg or {share:.3g} % of their spacing: learned from "
        "the pulses and taken out."
    )
    return [said]


def gaps(times: NDArray[np.float64], mean_speed: float) -> list[str]:
    """What is said of stretches without evidence."""
    turns = np.diff(times) * mean_speed / (2.0 * np.pi)
    wide = np.flatnonzero(turns > max(GAP, 3.0 * float(np.median(turns))))
    if len(wide) == 0:
        return []
    worst = wide[np.argmax(turns[wide])]
    where = f"{times[worst]:.6g} and {times[worst + 1]:.6g} s, {turns[worst]:.3g} revolutions"
    more = f"; there are {len(wide) - 1} more such gaps" if len(wide) > 1 else ""
    return [f"Nothing tells the angle between {where}: a smooth curve bridges them{more}."]


def alike(residuals: NDArray[np.float64]) -> list[str]:
    """What is said of residuals that follow one another: a random error differs from pulse to pulse."""
    power = float(residuals @ residuals)
    correlation = float(residuals[1:] @ residuals[:-1]) / power if power > 0.0 else 0.0
    if correlation < max(ALIKE, 4.0 / np.sqrt(len(residuals))):
        return []
    said = (
        f"What is left over is alike from one to the next (correlation {correlation:.2g}): the speed changes faster "
        "than the curve can follow, or the sensor's error goes with the angle. The deviations stated are too small."
    )
    return [said]


def outside(before: float, after: float) -> list[str]:
    """What is said of a record that goes beyond the evidence by so many revolutions."""
    parts = [f"{many:.3g} revolutions {where} it" for many, where in ((before, "before"), (after, "after"))]
    parts = [part for part, many in zip(parts, (before, after), strict=True) if many > BEYOND]
    if not parts:
        return []
    by = " and ".join(parts)
    return [f"The record goes beyond the evidence of the angle, by {by}: there the speed is taken as constant."]
