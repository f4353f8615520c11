"""Modes as a text table: a row for each coefficient."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from io import StringIO
from itertools import product

import numpy as np

from floquid.core import PeriodicModel

_MODE = (
    "exponent real [1/s]",
    "exponent imag [rad/s]",
    "exponent real std [1/s]",
    "exponent imag std [rad/s]",
    "frequency [Hz]",
    "frequency std [Hz]",
    "damping ratio [-]",
    "damping ratio std [-]",
    "multiplier real [-]",
    "multiplier imag [-]",
)
_COEFFICIENT = ("coefficient real", "coefficient imag", "coefficient real std", "coefficient imag std")


def csv_bytes(model: PeriodicModel) -> bytes:
    """The table: numbers to their last digit, an empty cell where something was not estimated."""
    stream = StringIO(newline="")
    table = csv.writer(stream, lineterminator="\n")
    table.writerow(("mode", *_MODE, "channel", "unit", "hit", "harmonic", "harmonic frequency [Hz]", *_COEFFICIENT))
    for mode in range(model.order):
        own = _cells(_numbers(model, mode))
        kept = np.flatnonzero((model.coefficients[mode] != 0).any(axis=(0, 1)))
        for row, channel in enumerate(model.channels):
            words = (_harmless(channel.name), _harmless(channel.unit))
            for hit, place in product(range(model.n_hits), kept.tolist()):
                where = (hit + 1, int(model.harmonics[place]))
                table.writerow((mode + 1, *own, *words, *where, *_cells(_coefficient(model, mode, row, hit, place))))
    text = stream.getvalue()
    # A spreadsheet takes a file for universal text by its mark alone; where all is ASCII there is no need of one.
    return text.encode("ascii" if text.isascii() else "utf-8-sig")


def _coefficient(model: PeriodicModel, mode: int, row: int, hit: int, place: int) -> tuple[float | None, ...]:
    """The frequency of one harmonic [Hz], its coefficient, and the deviation of that."""
    value = complex(model.coefficients[mode, row, hit, place])
    std = None if model.coefficient_std is None else complex(model.coefficient_std[mode, row, hit, place])
    rate = float(model.exponents[mode].imag + model.harmonics[place] * model.fundamental)
    deviation = (None, None) if std is None else (std.real, std.imag)
    return (rate / (2.0 * np.pi), value.real, value.imag, *deviation)


def _numbers(model: PeriodicModel, mode: int) -> tuple[float | None, ...]:
    """The numbers of one mode, in the order of the heading."""
    exponent, multiplier = complex(model.exponents[mode]), complex(model.multipliers[mode])
    std = None if model.exponent_std is None else complex(model.exponent_std[mode])
    frequency = None if model.frequency_std_hz is None else float(model.frequency_std_hz[mode])
    damping = None if model.damping_ratio_std is None else float(model.damping_ratio_std[mode])
    return (
        exponent.real,
        exponent.imag,
        None if std is None else std.real,
        None if std is None else std.imag,
        float(model.frequencies_hz[mode]),
        frequency,
        float(model.damping_ratios[mode]),
        damping,
        multiplier.real,
        multiplier.imag,
    )


def _cells(values: Iterable[float | None]) -> list[str]:
    return ["" if value is None else repr(float(value)) for value in values]


def _harmless(word: str) -> str:
    """A word that a spreadsheet does not take for a formula which does something."""
    acts = word[:1] in ("=", "+", "-", "@") and any(letter in word for letter in "(|!")
    return f"'{word}" if acts else word
