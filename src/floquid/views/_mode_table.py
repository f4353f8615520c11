"""The table of modes, alike on the terminal and on the page: a row in words for each, values with their deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Integers, Mask
from floquid.core import PeriodicModel
from floquid.periodic import CONFIDENT, participation
from floquid.pipeline import Analysis
from floquid.views._modes import grows

MODE_NOTES = {
    "weak": "weakly determined",
    "μ<0": "a negative real multiplier, no pair",
    "μ>0": "a positive real multiplier, no pair",
    "grows": "unstable",
    "f?": "another of its lines is more than half as strong, so that another test may give the f and ζ of that line",
}
"""The words that a mode may deserve and what they mean; they are short, for a table has to fit 80 columns."""

RIVAL = 0.5  # share of the energy of the strongest line from which on another makes the branch a choice
CLEAR = 3.0  # deviations from which on a harmonic of a fit with one more at either end is shown
MOST_DIGITS = 10  # after the point; beyond them a deviation says nothing that a reader could use


def with_error(value: float, std: float) -> str:
    """A value with its standard deviation in units of the last digits: -0.0020013(19) is -0.0020013 ± 0.0000019.

    The deviation `std` is zero of an exact `value`; without a finite one four digits stand alone.
    """
    if not np.isfinite(std) or std <= 0:
        return f"{value:.6g}" if std == 0 else f"{value:.4g}"
    digits = max(0, 1 - int(np.floor(np.log10(std))))
    return f"{value:.{digits}f}({round(std * 10**digits)})" if digits <= MOST_DIGITS else f"{value:.10g}"


def mode_notes(analysis: Analysis, mode: int) -> list[str]:
    """The words of `MODE_NOTES` that a `mode` of an `analysis` deserves: none for an ordinary one."""
    model = analysis.model
    error = complex(np.nan, np.nan) if model.exponent_std is None else model.exponent_std[mode]
    real, multiplier = model.real[mode], model.multipliers[mode]
    _, shares = participation(model, mode, 1.0 / analysis.noise)
    strongest = np.sort(shares)[::-1]
    deserved = {
        "weak": max(error.real, error.imag) > CONFIDENT * model.fundamental,
        "μ<0": real and multiplier.real < 0,
        "μ>0": real and multiplier.real >= 0,
        "grows": grows(model, mode),
        "f?": not real and len(strongest) > 1 and strongest[1] > RIVAL * strongest[0],
    }
    return [word for word in MODE_NOTES if deserved[word]]


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


def mode_table(analysis: Analysis, *, derived: bool = True) -> tuple[ModeRow, ...]:
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
        if analysis.decay is None:
            clear = _clear(model, mode, kept)
            kept = kept[clear] if clear.any() else kept
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


def _clear(model: PeriodicModel, mode: int, kept: Integers) -> Mask:
    """True of harmonics of a mode that rise above their deviations in some channel: fits have one more at each end."""
    own = np.isin(model.harmonics, kept)
    size, std = np.abs(model.coefficients[mode][..., own]), np.zeros(1)
    if model.coefficient_std is not None:
        std = np.abs(model.coefficient_std[mode][..., own])
    return np.asarray((size > CLEAR * std).any(axis=(0, 1)), bool)


def note_meanings(rows: Sequence[ModeRow]) -> list[str]:
    """The "word: meaning" of each word in the notes of the `rows` of a table of modes."""
    used = {word for row in rows for word in row.notes.split()}
    return [f"{word}: {meaning}" for word, meaning in MODE_NOTES.items() if word in used]
