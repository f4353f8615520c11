"""The table of modes: its columns, decided here alone, and its rows in words, values with their deviations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import tau
from typing import Literal, TypeAlias

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid._checks import wrong_value
from floquid.core import Branch, PeriodicModel
from floquid.periodic import CONFIDENT, participation
from floquid.pipeline import Analysis
from floquid.views._names import grows

DampingUnit: TypeAlias = Literal["percent", "decrement"]
"""Units of damping: the damping ratio ζ in percent, or the logarithmic decrement δ = 2πζ/√(1 - ζ²)."""

MODE_NOTES = {
    "weak": "weakly determined",
    "μ<0": "a negative real multiplier, no pair",
    "μ>0": "a positive real multiplier, no pair",
    "grows": "unstable",
    "f?": "another line is over half as strong, and has another f and damping",
}
"""The words that a mode may deserve and what they mean; they are short, for a table has to fit 80 columns."""

BRANCHES = {
    "strongest": "of its strongest line",
    "slowest": "of the least |Im λ|",
    "symmetric": "on which its shape is even",
}
"""The branch on which an exponent is given, by the rule that chose it."""

RIVAL = 0.5  # share of the energy of the strongest line from which on another makes the branch a choice
CLEAR = 3.0  # deviations from which on a harmonic of a fit with one more at either end is shown
MANY = 1e6  # periods from which on their number says no more
MOST_DIGITS = 10  # after the point; beyond them a deviation says nothing that a reader could use


def with_error(value: float, std: float) -> str:
    """A value with its standard deviation in units of the last digits: -0.0020013(19) is -0.0020013 ± 0.0000019.

    The deviation `std` is zero of an exact `value`; without a finite one four digits stand alone.
    """
    if not np.isfinite(std) or std <= 0:
        return f"{value:.6g}" if std == 0 else f"{value:.4g}"
    digits = max(0, 1 - int(np.floor(np.log10(std))))
    return f"{value:.{digits}f}({round(std * 10**digits)})" if digits <= MOST_DIGITS else f"{value:.10g}"


def branch_of(analysis: Analysis) -> Branch:
    """The rule by which the exponents of an `analysis` are on their branches: that asked for, where there is such."""
    left = any(own.code == "branch_left" for own in analysis.findings)
    return "strongest" if left else analysis.settings.branch


def branch_words(analysis: Analysis) -> str:
    """The branch on which the exponents of an `analysis` are given, as in "the branch of its strongest line"."""
    return BRANCHES[branch_of(analysis)]


def mode_notes(analysis: Analysis, mode: int) -> list[str]:
    """The words of `MODE_NOTES` that a `mode` of an `analysis` deserves: none for an ordinary one."""
    model = analysis.model
    error = complex(np.nan, np.nan) if model.exponent_std is None else model.exponent_std[mode]
    real, multiplier = model.real[mode], model.multipliers[mode]
    _, shares = participation(model, mode, 1.0 / analysis.noise)
    strongest, chosen = np.sort(shares)[::-1], branch_of(analysis) == "strongest"
    deserved = {
        "weak": max(error.real, error.imag) > CONFIDENT * model.fundamental,
        "μ<0": real and multiplier.real < 0,
        "μ>0": real and multiplier.real >= 0,
        "grows": grows(model, mode),
        "f?": chosen and not real and len(strongest) > 1 and strongest[1] > RIVAL * strongest[0],
    }
    return [word for word in MODE_NOTES if deserved[word]]


@dataclass(frozen=True, slots=True)
class ModeColumn:
    """A column of the table of modes, alike on the terminal, on the page, in a DataFrame and in a file."""

    heading: str  # What stands above it, with the unit
    # From an analysis, the index of a mode, and whether derived values have deviations, to the words of a row
    cell: Callable[[Analysis, int, bool], str]
    # From a model to the numbers of all its modes (modes,) by their headings in files, None for those not estimated
    numbers: Callable[[PeriodicModel], dict[str, Floats | None]] = lambda _: {}
    # True where a terminal has no room for it, and where it is words instead of numbers
    on_page: bool = False
    is_text: bool = False


@dataclass(frozen=True, slots=True)
class ModeTable:
    """The modes in words: a row for each conjugate pair and each real mode, numbered from 1 by its place.

    Parameters
    ----------
    columns
        The columns that have any words.
    rows
        The cells of each mode in the order of the columns.
    """

    columns: tuple[ModeColumn, ...]
    rows: tuple[tuple[str, ...], ...]

    def __getitem__(self, heading: str) -> tuple[str, ...]:
        """The cells of the column with that heading; none where it has no words."""
        places = [place for place, column in enumerate(self.columns) if column.heading == heading]
        return tuple(row[place] for place in places for row in self.rows)


def mode_table(analysis: Analysis, *, derived: bool = True, damping_unit: DampingUnit = "percent") -> ModeTable:
    """The table of the modes of an analysis, in the order of the model, damping in the unit that is chosen.

    `analysis` is what `identify` found. Where `derived` is true, f and ζ have their standard deviations; a narrow
    table has no room for them. `damping_unit` is that of damping: "percent", or the logarithmic "decrement".
    """
    modes = analysis.model.upper_modes
    columns = [DECREMENT if own is PERCENT and damping_unit == "decrement" else own for own in COLUMNS]
    cells = {column: [column.cell(analysis, mode, derived) for mode in modes] for column in columns}
    used = [column for column in columns if any(cells[column])]
    return ModeTable(tuple(used), tuple(zip(*(cells[column] for column in used), strict=True)))


def mode_numbers(model: PeriodicModel) -> dict[str, Floats | None]:
    """The numbers of the modes of a `model` (modes,) by their headings with units, None for what was not estimated."""
    return {name: values for column in COLUMNS for name, values in column.numbers(model).items()}


def _std(model: PeriodicModel, mode: int) -> complex:
    return complex(np.nan, np.nan) if model.exponent_std is None else complex(model.exponent_std[mode])


def _determined(model: PeriodicModel, mode: int) -> bool:
    """False where a deviation exceeds the exponent itself: its digits say nothing."""
    std = _std(model, mode)
    return not max(std.real, std.imag) > abs(model.exponents[mode])


def _decay(analysis: Analysis, mode: int, _: bool) -> str:
    model = analysis.model
    value = with_error(model.exponents[mode].real, _std(model, mode).real)
    return value if _determined(model, mode) else "not determined"


def _frequency(analysis: Analysis, mode: int, _: bool) -> str:
    model = analysis.model
    value = with_error(abs(model.exponents[mode].imag), _std(model, mode).imag)
    return ("" if model.real[mode] else "±") + value if _determined(model, mode) else ""


def _hertz(analysis: Analysis, mode: int, derived: bool) -> str:
    model = analysis.model
    value, std = model.frequencies_hz[mode], model.frequency_std_hz if derived else None
    words = f"{value:.5g}" if std is None else with_error(value, std[mode])
    return words if _determined(model, mode) else "not determined"


def _damping(analysis: Analysis, mode: int, derived: bool) -> str:
    model = analysis.model
    ratio, std = 100.0 * model.damping_ratios[mode], model.damping_ratio_std if derived else None
    words = f"{ratio:.3g}" if std is None else with_error(ratio, 100.0 * std[mode])
    return words if _determined(model, mode) else ""


def _decrement(analysis: Analysis, mode: int, derived: bool) -> str:
    model = analysis.model
    if model.real[mode] or not _determined(model, mode):
        return ""
    value, slope = decrement(float(model.damping_ratios[mode]))
    std = model.damping_ratio_std if derived else None
    return f"{value:.3g}" if std is None else with_error(value, slope * std[mode])


def decrement(ratio: float) -> tuple[float, float]:
    """The logarithmic decrement of a damping ratio, and its derivative by that; infinite where nothing swings."""
    rest = 1.0 - ratio**2
    return (tau * ratio / rest**0.5, tau / rest**1.5) if rest > 0.0 else (np.inf, np.inf)


def check_damping_unit(unit: object, of: str) -> None:
    """Refuse in the name of the callable `of` a `unit` of damping that is none."""
    if unit not in ("percent", "decrement"):
        raise wrong_value("damping_unit", of, 'be "percent" or "decrement"', unit)


def _harmonics(analysis: Analysis, mode: int, _: bool) -> str:
    """The first and the last harmonic that it has."""
    kept, _shares = participation(analysis.model, mode, 1.0 / analysis.noise)
    if analysis.decay is None:
        clear = _clear(analysis.model, mode, kept)
        kept = kept[clear] if clear.any() else kept
    return f"{kept[0]}…{kept[-1]}" if len(kept) > 1 else "".join(map(str, kept))


def _length(analysis: Analysis, mode: int, _: bool) -> str:
    """The periods of a record that gives the damping to 10 %."""
    if analysis.lengths is None:
        return ""
    periods = float(analysis.lengths[mode] / analysis.model.period)
    return f"{float(f'{periods:.3g}'):.0f}" if periods < MANY else f"more than {MANY:.0f}"


DAMPING_WORDS: dict[DampingUnit, str] = {"percent": "ζ = -Re λ/|λ|", "decrement": "δ = -2π Re λ/|Im λ|"}
"""Formulas of the legend."""

PERCENT = ModeColumn(
    "ζ [%]",
    _damping,
    lambda model: {"damping ratio [-]": model.damping_ratios, "damping ratio std [-]": model.damping_ratio_std},
)
"""The damping ratio; DECREMENT stands in its place where that is asked for."""

DECREMENT = ModeColumn("δ", _decrement)

COLUMNS = (
    ModeColumn(
        "f [Hz]", _hertz,
        lambda model: {"frequency [Hz]": model.frequencies_hz, "frequency std [Hz]": model.frequency_std_hz},
    ),
    PERCENT,
    ModeColumn(
        "Re λ [1/s]", _decay,
        lambda model: {
            "exponent real [1/s]": model.exponents.real,
            "exponent real std [1/s]": None if model.exponent_std is None else model.exponent_std.real,
        },
    ),
    ModeColumn(
        "Im λ [rad/s]", _frequency,
        lambda model: {
            "exponent imag [rad/s]": model.exponents.imag,
            "exponent imag std [rad/s]": None if model.exponent_std is None else model.exponent_std.imag,
        },
    ),
    ModeColumn(
        "|μ|", lambda analysis, mode, _: f"{abs(analysis.model.multipliers[mode]):.4f}",
        lambda model: {"multiplier real [-]": model.multipliers.real, "multiplier imag [-]": model.multipliers.imag},
    ),
    ModeColumn(
        "folded",
        lambda analysis, mode, _: f"{abs(analysis.model.principal()[mode].imag) / analysis.model.fundamental:.4f}",
    ),
    ModeColumn("m", _harmonics),
    ModeColumn("periods for Re λ to 10 %", _length, on_page=True),
    ModeColumn("note", lambda analysis, mode, _: " ".join(mode_notes(analysis, mode)), is_text=True),
)  # fmt: skip
"""The columns in their order: one added here is on the terminal, on the page, in `analysis.modes` and in files."""


def _clear(model: PeriodicModel, mode: int, kept: Integers) -> Mask:
    """True of harmonics of a mode that rise above their deviations in some channel: fits have one more at each end."""
    own = np.isin(model.harmonics, kept)
    size, std = np.abs(model.coefficients[mode][..., own]), np.zeros(1)
    if model.coefficient_std is not None:
        std = np.abs(model.coefficient_std[mode][..., own])
    return np.asarray((size > CLEAR * std).any(axis=(0, 1)), bool)


def note_meanings(table: ModeTable) -> list[str]:
    """The "word: meaning" of each word in the notes of a `table` of modes."""
    used = {word for cell in table["note"] for word in cell.split()}
    return [f"{word}: {meaning}" for word, meaning in MODE_NOTES.items() if word in used]


def couple_words(model: PeriodicModel) -> list[str]:
    """The rows of the table of modes of a `model` that two by two may be one mode: a pair locked to the period."""
    # Two lags that no lock ever joined have shapes as much alike: seen by one channel, they are constants.
    rows = [[model.upper_modes.index(mode) + 1 for mode in couple] for couple in model.couples]
    return [f"rows {first} and {second}: shapes alike, as of one mode locked to the period" for first, second in rows]
