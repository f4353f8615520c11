"""The table of modes as the terminal and the page have it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid.periodic import participation
from floquid.pipeline import Analysis, ExcitedAnalysis
from floquid.views._words import MODE_NOTES, mode_notes, with_error


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeRow:
    """A conjugate pair, or a real mode, in words.

    Parameters
    ----------
    number
        Its place in the table, from 1.
    decay, frequency
        Re λ [1/s] and Im λ [rad/s], each with its standard deviation.
    hertz, damping
        f [Hz] and ζ [%].
    multiplier, folded
        The size of the multiplier, and the imaginary part of the principal exponent over ω.
    harmonics
        The first and the last harmonic that it has.
    notes
        The words of `MODE_NOTES` that it deserves.
    """

    number: str
    decay: str
    frequency: str
    hertz: str
    damping: str
    multiplier: str
    folded: str
    harmonics: str
    notes: str


def mode_table(analysis: Analysis | ExcitedAnalysis, *, derived: bool = True) -> tuple[ModeRow, ...]:
    """The modes of an analysis, a row for each conjugate pair and for each real mode.

    The rows are in the order of the model. `analysis` is what `identify` found. Where `derived` is true, f and ζ have
    their standard deviations; a narrow table has no room for them.
    """
    model = analysis.model
    unknown = np.full(model.order, np.nan)
    std = unknown + 0j * unknown if model.exponent_std is None else model.exponent_std
    hertz, damping = (model.frequency_std_hz, model.damping_ratio_std) if derived else (None, None)
    rows = []
    for number, mode in enumerate(model.upper_modes, start=1):
        value, ratio = model.exponents[mode], 100.0 * model.damping_ratios[mode]
        kept, _ = participation(model, mode, 1.0 / analysis.noise)
        own = model.frequencies_hz[mode]
        rows.append(
            ModeRow(
                number=str(number),
                decay=with_error(value.real, std[mode].real),
                frequency=("" if model.real[mode] else "±") + with_error(abs(value.imag), std[mode].imag),
                hertz=f"{own:.5g}" if hertz is None else with_error(own, hertz[mode]),
                damping=f"{ratio:.3g}" if damping is None else with_error(ratio, 100.0 * damping[mode]),
                multiplier=f"{abs(model.multipliers[mode]):.4f}",
                folded=f"{abs(model.principal()[mode].imag) / model.fundamental:.4f}",
                harmonics=f"{kept[0]}…{kept[-1]}" if len(kept) > 1 else "".join(map(str, kept)),
                notes=" ".join(mode_notes(analysis, mode)),
            )
        )
    return tuple(rows)


def note_meanings(rows: Sequence[ModeRow]) -> list[str]:
    """The "word: meaning" of each word in the notes of the `rows` of a table of modes."""
    used = {word for row in rows for word in row.notes.split()}
    return [f"{word}: {meaning}" for word, meaning in MODE_NOTES.items() if word in used]
