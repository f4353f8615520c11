"""Words of findings on records of random excitation that nobody measured."""

from __future__ import annotations

from collections.abc import Callable

AMBIENT: dict[str, str | Callable[..., str]] = {
    "ambient_constant": "No harmonic of any shape but the largest rises above the noise: the record does not show that "
    "the system is periodic.",
    "ambient_single": "The mode at {frequency:.4g} Hz has one harmonic alone: it is likely the excitation's own, "
    "coloured there, or a part that the rotation does not reach.",
    "ambient_length": "The damping of the mode at {frequency:.4g} Hz is known to {share:.0%}: random excitation tells "
    "little of it. To 10 % it needs a record of {length:.3g} s, {periods:.3g} periods.",
    "ambient_undetermined": "The decay of the mode at {frequency:.4g} Hz is not determined: it dies in a period, or "
    "modes make up for one another. Random excitation does not tell how many there are.",
    "ambient_alike": "Two modes near {frequency:.4g} Hz differ by less than they decay: they may be one, or coloured "
    "excitation.",
    "ambient_held_out": "The last quarter of the record, left out of a fit, is predicted with {error:.3g} times the "
    "error of the rest: the system or its excitation is another one there.",
    "ambient_colour": "What is left is not white: {share:.1%} of its variance is predictable. Modes or harmonics are "
    "missing, or the system does not repeat with that period.",
}
"""By code."""
