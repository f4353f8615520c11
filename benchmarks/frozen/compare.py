"""Decisions of two days: where they differ, and whether the later one is better by the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from benchmarks.chain.case import wrapped
from benchmarks.frozen.run import PAIR, Decision, Mode

EQUAL, BETTER, WORSE, OTHER = "equal", "better", "worse", "other"
VERDICTS = (EQUAL, BETTER, WORSE, OTHER)

MOVED = 0.1
"""Deviations by which an exponent moves before it is another one: other rounding moves it by less."""

WIDER = 0.05
"""The relative change of a deviation from which on it is another one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """What differs between two decisions on one record: a phrase each, and what the truth says of it."""

    then: Decision
    now: Decision
    phrases: tuple[str, ...]
    verdict: str

    def __str__(self) -> str:
        return f"{self.now.name}: {self.verdict}: " + "; ".join(self.phrases)


def compared(then: Decision, now: Decision) -> Difference:
    """The difference of two decisions on one record."""
    phrases = tuple(_phrases(then, now))
    return Difference(then=then, now=now, phrases=phrases, verdict=_judged(then, now) if phrases else EQUAL)


def _phrases(then: Decision, now: Decision) -> list[str]:
    """What differs, then and now."""
    found = []
    names = ("outcome", "message", "passed", "against", "warned", "order", "found", "false")
    for name in names:
        before, after = getattr(then, name), getattr(now, name)
        if before != after:
            found.append(f"{name} {_shown(before)} → {_shown(after)}")
    if then.modes and now.modes:
        found += _modes(then, now)
    return found


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(str, value)) or "none"
    return "none" if value in ("", None) else str(value)


def _modes(then: Decision, now: Decision) -> list[str]:
    """Modes that are missing, new, of another kind, moved, or of other harmonics."""
    pairs = _paired(then.modes, now.modes, then.fundamental)
    lost = set(range(len(then.modes))) - {first for first, _ in pairs}
    new = set(range(len(now.modes))) - {second for _, second in pairs}
    found = [f"mode {_place(then.modes[number])} is missing" for number in sorted(lost)]
    found += [f"mode {_place(now.modes[number])} is new" for number in sorted(new)]
    for first, second in pairs:
        found += _mode(then.modes[first], now.modes[second], then.fundamental)
    return found


def _paired(then: Sequence[Mode], now: Sequence[Mode], omega: float) -> list[tuple[int, int]]:
    """Modes of both that are one, by assignment modulo iω: within both decays of each other."""
    from scipy.optimize import linear_sum_assignment

    gaps = np.array([[abs(_gap(one, other, omega)[0]) for other in now] for one in then])
    near = np.array([[abs(one.exponent[0]) + abs(other.exponent[0]) for other in now] for one in then])
    rows, columns = linear_sum_assignment(gaps)
    return [(int(k), int(n)) for k, n in zip(rows, columns, strict=True) if gaps[k, n] <= near[k, n]]


def _gap(then: Mode, now: Mode, omega: float) -> tuple[complex, int, int]:
    """From one exponent to the other modulo iω, by how many fundamentals, and -1 where it is to the conjugate."""
    straight = now.exponent[1] - then.exponent[1]
    mirrored = -now.exponent[1] - then.exponent[1]
    off = [float(wrapped(np.array(value), omega)) for value in (straight, mirrored)]
    number = 0 if then.kind != PAIR or now.kind != PAIR or abs(off[0]) <= abs(off[1]) else 1
    turns = round(((straight, mirrored)[number] - off[number]) / omega)
    return complex(now.exponent[0] - then.exponent[0], off[number]), turns, 1 - 2 * number


def _mode(then: Mode, now: Mode, omega: float) -> list[str]:
    """What differs between two modes that are one."""
    gap, turns, sign = _gap(then, now, omega)
    place, found = f"mode {_place(then)}", []
    if then.kind != now.kind:
        found.append(f"{place} {then.kind} → {now.kind}")
    elif turns or sign < 0:
        found.append(f"{place} counted from another branch, {turns:+d}")
    std = np.maximum(then.std, now.std)
    off = np.abs([gap.real, gap.imag]) > MOVED * std + 1e-9 * omega
    if off.any():
        with np.errstate(divide="ignore"):
            by = np.max(np.abs([gap.real, gap.imag])[off] / std[off])
        found.append(f"{place} moved by {by:.2g} deviations")
    if (np.abs(np.subtract(now.std, then.std)) > WIDER * std).any():
        found.append(f"{place} deviations {_numbers(then.std)} → {_numbers(now.std)}")
    for name, way in (("harmonics", 1), ("driven", -1)):
        before = set(getattr(then, name))
        after = {sign * m + way * turns for m in getattr(now, name)} if then.kind == now.kind else before
        if before != after:
            found.append(f"{place} {name} {_band(before)} → {_band(after)}")
    return found


def _place(mode: Mode) -> str:
    return f"{mode.exponent[0]:.4g}{mode.exponent[1]:+.5g}i"


def _numbers(values: tuple[float, float]) -> str:
    return ", ".join(f"{value:.2g}" for value in values)


def _band(harmonics: set[int]) -> str:
    """Harmonics as first..last where none between is missing."""
    values = sorted(harmonics)
    if len(values) > 2 and values[-1] - values[0] == len(values) - 1:
        return f"{values[0]}..{values[-1]}"
    return ",".join(map(str, values)) or "none"


def _judged(then: Decision, now: Decision) -> str:
    """Better or worse by what the truth says of both: defects, then false modes, then those found, then the verdict.

    Fewer false modes at the price of one that is lost is worse, and so is the reverse: a reason must stand beside it.
    """
    defects = _sign(then.outcome in DEFECTS, now.outcome in DEFECTS)
    counts = [_sign(then.false, now.false), -_sign(then.found, now.found)]
    for signs in ([defects], counts, [_wrong_verdict(then, now)]):
        if WORSE_SIGN in signs:
            return WORSE
        if -WORSE_SIGN in signs:
            return BETTER
    return OTHER


DEFECTS = ("failed", "no answer")
WORSE_SIGN = 1


def _sign(then: float, now: float) -> int:
    """1 where it rose."""
    return int(now > then) - int(now < then)


def _wrong_verdict(then: Decision, now: Decision) -> int:
    """1 where the verdict was right and is wrong, -1 the other way round: a model of false modes must not pass."""
    return _sign(*(bool(own.modes) and own.passed != right(own) for own in (then, now)))


def right(decision: Decision) -> bool:
    """True of a model that has all modes that must be found, and no confident one that is none."""
    return bool(decision.modes) and decision.found == decision.must and not decision.false


def sums(differences: Sequence[Difference], pace: float) -> str:
    """Counts of what became of the decisions, and by kind processor seconds and linearisations, then and now.

    `pace` is the calibration now over that of then, by which the seconds of then are multiplied.
    """
    counts = ", ".join(f"{sum(each.verdict == word for each in differences)} {word}" for word in VERDICTS)
    lines = [f"{len(differences)} decisions: {counts}.", "", "| kind | records | s then | s now | now over then |"]
    lines[-1] += " linearisations then | now |"
    lines.append("|" + "---|" * 7)
    kinds = list(dict.fromkeys(each.now.kind for each in differences))
    for kind in [*kinds, ""]:
        of = [each for each in differences if not kind or each.now.kind == kind]
        seconds = pace * sum(each.then.seconds for each in of), sum(each.now.seconds for each in of)
        counted = sum(each.then.linearisations for each in of), sum(each.now.linearisations for each in of)
        over = seconds[1] / seconds[0] if seconds[0] else float("nan")
        cells = (kind or "all", len(of), f"{seconds[0]:.1f}", f"{seconds[1]:.1f}", f"{over:.2f}", *counted)
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)
