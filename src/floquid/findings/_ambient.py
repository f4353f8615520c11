"""Words of findings on records of random excitation that nobody measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from floquid.findings._phrases import both


def _at(frequencies: Sequence[float]) -> str:
    """Modes by their frequencies: «mode at 0.2 Hz»."""
    return f"mode{'s' if len(frequencies) > 1 else ''} at {both([f'{own:.4g}' for own in frequencies])} Hz"


AMBIENT: dict[str, str | Callable[..., str]] = {
    "ambient_constant": "No harmonic of any shape but the largest rises above the noise: the record does not show that "
    "the system is periodic.",
    "ambient_single": lambda frequencies: (
        f"One harmonic alone: {_at(frequencies)}. Likely the excitation's own, coloured there, or a part that the "
        "rotation does not reach."
    ),
    "ambient_length": "Random excitation tells little of damping: that at {frequency:.4g} Hz is known to {share:.0%}, "
    "and to 10 % it needs {seconds:.3g} s, {periods:.3g} periods.",
    "ambient_undetermined": lambda frequencies: (
        f"The decay is not determined: {_at(frequencies)}. It dies in a period, or modes make up for one another; "
        "random excitation does not tell how many there are."
    ),
    "ambient_alike": lambda frequencies: (
        f"Nearer to each other than they decay: {_at(frequencies)}. They may be one, or coloured excitation."
    ),
    "ambient_held_out": "The last quarter of the record, left out of a fit, is predicted with {error:.3g} times the "
    "error of the rest: the system or its excitation is another one there.",
    "ambient_colour": "What is left is not white: {share:.1%} of its variance is predictable. Modes or harmonics are "
    "missing, or the system does not repeat with that period.",
}
"""By code."""
