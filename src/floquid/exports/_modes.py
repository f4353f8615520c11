"""Identified modes → the files of other programs."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from io import StringIO
from itertools import compress, product
from os import PathLike
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._checks import input_error, wrong_value
from floquid.core import PeriodicModel
from floquid.exports._formats import PLAIN, mat_cells, mat_file, mat_names, mat_structs, uff_bytes
from floquid.exports._summary import mode_entries, summary
from floquid.io import as_path, atomic_path, load_package
from floquid.pipeline import Analysis, Settings
from floquid.reconstruction import StateModel
from floquid.views import DampingUnit, ModeTable, check_damping_unit, mode_numbers, mode_table, note_meanings

if TYPE_CHECKING:
    import pandas as pd

TEXT_TABLES = (".tex", ".md")  # the suffixes of tables for papers and pages

MODE_FORMATS = (".uff", ".unv", ".mat", ".csv", ".json", *TEXT_TABLES)
"""The suffixes that `export_modes` knows."""


def export_modes(
    result: Analysis | PeriodicModel,
    path: str | PathLike[str],
    *,
    coordinates: Mapping[str, ArrayLike] | None = None,
    lines: Sequence[Sequence[str]] | None = None,
    damping_unit: DampingUnit = "percent",
) -> None:
    r"""Write the modes of a result to a file of another program, in the format of its suffix.

    The shape of mode r in hit h is :math:`\sum_m B_{r,h,m} e^{(\lambda_r + i m \omega) t}`.

    - `.uff`, `.unv`: universal file with datasets 151 (header), 15 (nodes) and 55 (data at nodes, complex eigenvalues
      of first order). Each coefficient B of a mode and a harmonic m is a shape of its own, of eigenvalue λ + imω. A
      program for time-invariant modes can animate it. Of conjugates there is the one above the real axis. Numbers have
      six digits; the ID lines have λ, its deviation and the period in full. With `coordinates` there is a dataset 82,
      the lines that a viewer draws between nodes.
    - `.mat`: MATLAB version 5: `exponents`, `coefficients` (modes, channels, hits, harmonics), `harmonics`, `period`,
      ..., of measured inputs `input_coefficients` (modes, inputs, harmonics), `input_harmonics`, `direct` (channels,
      inputs, harmonics), `direct_harmonics`, ..., and of A(t), where there is one, `A` and `Phi` (states, states,
      times), `times` and `states`, with measured inputs also `B` (states, inputs, times), `C` and `D`. The struct array
      `modes` has an element a conjugate pair or real mode: `modes(1).frequency_hz`, `.damping_ratio`, and the shape by
      the names of channels, `modes(1).shape.tip_x` (hits, harmonics).
    - `.csv`: a row for each coefficient: its mode, channel, hit and harmonic, with deviations. The units are in the
      heading, or in a column.
    - `.tex`, `.md`: the table of modes as the terminal prints it, for LaTeX and Markdown; the damping in
      `damping_unit`, "percent" or the logarithmic "decrement".
    - `.json`: of an analysis the content of `summary.json`, of a model its modes alone.

    `result` is what `identify` found, or its `model`; the file `path` may
    exist, and is replaced at the end, in one step. `coordinates` say where the nodes of a universal file are: x, y, z
    by the location of channels, or by their names where they have none; others are at the origin. `lines` are lists of
    such names, each drawn from one to the next; by default one line through all that have coordinates, in their order.
    Raises InputError where an argument is something else, the suffix is unknown, or the file cannot be written there.
    """
    of = "export_modes"
    if not isinstance(result, (Analysis, PeriodicModel)):
        raise wrong_value("result", of, "be an Analysis or a PeriodicModel", result, "Pass what `identify` gave.")
    file = as_path(path, of=of)
    suffix = file.suffix.lower()
    if suffix not in MODE_FORMATS:
        got = f"{file} has the suffix {suffix!r}"
        raise input_error("path", of, "end in a known suffix", got, f"Use one of {', '.join(MODE_FORMATS)}.")
    model: PeriodicModel = result.model
    analysis: Any = None if model is result else result
    if coordinates is not None and suffix not in (".uff", ".unv"):
        got = f"{file} has no place for them"
        raise input_error("coordinates", of, "come with a universal file (.uff, .unv)", got, "Leave them out.")
    if lines is not None and coordinates is None:
        remedy = "Pass where the nodes are, too."
        raise input_error("lines", of, "come with coordinates", "is given without them", remedy)
    check_damping_unit(damping_unit, of)
    if suffix in (".uff", ".unv"):
        content = uff_bytes(model, coordinates or {}, [list(coordinates or {})] if lines is None else lines)
    elif suffix in TEXT_TABLES:
        content = text_table(model, analysis, suffix, damping_unit).encode()
    elif suffix == ".mat":
        content = mat_bytes(model, None if analysis is None else analysis.state)
    elif suffix == ".csv":
        content = csv_bytes(model)
    else:
        content = _json_bytes(model, analysis)
    with atomic_path(file, of=of) as temporary:
        temporary.write_bytes(content)


def modes_frame(result: Analysis | PeriodicModel) -> pd.DataFrame:
    """The modes of a result as a table of pandas: a row a conjugate pair or real mode, numbered as on the terminal.

    Columns are those of the `.csv` file of `export_modes`, with units in their headings; NaN is what was not estimated.
    `result` is what `identify` found, or its `model`. Raises InputError where pandas is not installed.
    """
    pandas = load_package("pandas", "modes_frame")
    model = result.model
    upper = list(model.upper_modes)
    columns = {
        name: np.full(len(upper), np.nan) if values is None else values[upper]
        for name, values in mode_numbers(model).items()
    }
    return pandas.DataFrame(columns, index=pandas.RangeIndex(1, len(upper) + 1, name="mode"))


def _json_bytes(result: PeriodicModel, analysis: Analysis | None) -> bytes:
    content: dict[str, Any]
    if analysis is not None:
        content = summary(analysis)
    else:
        content = {
            "format": "floquid-modes/1",
            "period": result.period,
            "order": result.order,
            "channels": [asdict(channel) for channel in result.channels],
            "modes": mode_entries(result, np.ones(result.coefficients.shape[1:3])),
        }
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()


_COEFFICIENT = ("coefficient real", "coefficient imag", "coefficient real std", "coefficient imag std")


def csv_bytes(model: PeriodicModel) -> bytes:
    """The table: numbers to their last digit, an empty cell where something was not estimated."""
    stream = StringIO(newline="")
    table = csv.writer(stream, lineterminator="\n")
    columns = mode_numbers(model)
    table.writerow(("mode", *columns, "channel", "unit", "hit", "harmonic", "harmonic frequency [Hz]", *_COEFFICIENT))
    for mode in range(model.order):
        own = _csv_cells(None if values is None else values[mode] for values in columns.values())
        kept = np.flatnonzero((model.coefficients[mode] != 0).any(axis=(0, 1)))
        for row, channel in enumerate(model.channels):
            words = (_harmless(channel.name), _harmless(channel.unit))
            for hit, place in product(range(model.n_hits), kept.tolist()):
                where = (hit + 1, int(model.harmonics[place]))
                table.writerow(
                    (mode + 1, *own, *words, *where, *_csv_cells(_coefficient(model, mode, row, hit, place)))
                )
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


def _csv_cells(values: Iterable[float | None]) -> list[str]:
    return ["" if value is None else repr(float(value)) for value in values]


def _harmless(word: str) -> str:
    """A word that a spreadsheet does not take for a formula which does something."""
    acts = word[:1] in ("=", "+", "-", "@") and any(letter in word for letter in "(|!")
    return f"'{word}" if acts else word


def mat_bytes(model: PeriodicModel, state: StateModel | None) -> bytes:
    """The file; what was not estimated is an empty matrix, and the same model gives the same bytes."""
    content: dict[str, Any] = {
        "exponents": model.exponents,
        "exponents_std": model.exponent_std,
        "covariance": model.covariance,
        "multipliers": model.multipliers,
        "frequencies_hz": model.frequencies_hz,
        "frequencies_hz_std": model.frequency_std_hz,
        "damping_ratios": model.damping_ratios,
        "damping_ratios_std": model.damping_ratio_std,
        "coefficients": model.coefficients,
        "coefficients_std": model.coefficient_std,
        "harmonics": model.harmonics.astype(np.float64),
        "period": model.period,
    }
    content |= {
        "channels": mat_cells([channel.name for channel in model.channels]),
        "units": mat_cells([channel.unit.translate(PLAIN) for channel in model.channels]),
        "quantities": mat_cells([str(channel.quantity) for channel in model.channels]),
    }
    if (own := model.inputs) is not None:
        content |= {
            "inputs": mat_cells([channel.name for channel in own.channels]),
            "input_units": mat_cells([channel.unit.translate(PLAIN) for channel in own.channels]),
            "input_coefficients": own.coefficients,
            "input_coefficients_std": own.coefficient_std,
            "input_harmonics": own.harmonics.astype(np.float64),
            "direct": own.direct,
            "direct_harmonics": own.direct_harmonics.astype(np.float64),
            "initial": own.initial,
        }
    if state is not None:
        content |= {
            "times": state.times,
            "states": mat_cells(state.states),
            "A": np.moveaxis(state.system, 0, 2),
            "A_std": None if state.system_std is None else np.moveaxis(state.system_std, 0, 2),
            "Phi": np.moveaxis(state.transition, 0, 2),
            "Phi_std": None if state.transition_std is None else np.moveaxis(state.transition_std, 0, 2),
        }
        if state.inputs is not None and state.outputs is not None and state.direct is not None:
            content |= {
                "B": np.moveaxis(state.inputs, 0, 2),
                "B_std": None if state.inputs_std is None else np.moveaxis(state.inputs_std, 0, 2),
                "C": np.moveaxis(state.outputs, 0, 2),
                "D": np.moveaxis(state.direct, 0, 2),
            }
    return mat_file(content | {"modes": _mode_structs(model)}, "modes")


def _mode_structs(model: PeriodicModel) -> Any:
    """The modes as a struct array of MATLAB, the shape of each by the names of channels."""
    names = mat_names([channel.name for channel in model.channels])
    found = []
    for mode in model.upper_modes:
        own = {
            "frequency_hz": (model.frequencies_hz, model.frequency_std_hz),
            "damping_ratio": (model.damping_ratios, model.damping_ratio_std),
            "exponent": (model.exponents, model.exponent_std),
            "multiplier": (model.multipliers, model.multiplier_std),
        }
        numbers = {
            name + end: np.zeros((0, 0)) if part is None else part[mode]
            for name, both in own.items()
            for end, part in zip(("", "_std"), both, strict=True)
        }
        shape = {name: model.coefficients[mode, row] for row, name in enumerate(names)}
        found.append(numbers | {"is_real": bool(model.real[mode]), "shape": shape})
    return mat_structs(found)


_LETTERS = {"λ": r"$\lambda$", "ζ": r"$\zeta$", "δ": r"$\delta$"}
_SPECIAL = str.maketrans({letter: f"\\{letter}" for letter in "%&#_$"})


def text_table(model: PeriodicModel, analysis: Analysis | None, suffix: str, unit: DampingUnit) -> str:
    """The modes of a `model` as a table in the language of a `suffix`, damping in a `unit`."""
    shown: Any = analysis
    if analysis is None:  # a model alone says no noise: channels count alike
        noise = np.ones(model.coefficients.shape[1:3])
        shown = SimpleNamespace(model=model, noise=noise, decay=None, lengths=None, findings=(), settings=Settings())
    table = mode_table(shown, damping_unit=unit)
    used = [not column.on_page for column in table.columns]
    headings = ["mode", *(column.heading for column in compress(table.columns, used))]
    rows = [[str(number), *compress(row, used)] for number, row in enumerate(table.rows, start=1)]
    return (_latex if suffix == ".tex" else _markdown)(headings, rows, table)


def _markdown(headings: list[str], rows: list[list[str]], table: ModeTable) -> str:
    """The table as Markdown; a bar inside a cell would end it."""
    words = [column.heading for column in table.columns if column.is_text]
    marks = ["---" if heading in words else "---:" for heading in headings]
    lines = [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |" for cells in (headings, *rows)]
    return "\n".join([lines[0], f"|{'|'.join(marks)}|", *lines[1:], "", *_legend(table)]) + "\n"


def _latex(headings: list[str], rows: list[list[str]], table: ModeTable) -> str:
    """The table as LaTeX, for the package booktabs."""
    words = [column.heading for column in table.columns if column.is_text]
    columns = "".join("l" if heading in words else "r" for heading in headings)
    head, *body = (" & ".join(map(_cell, cells)) + r" \\" for cells in (headings, *rows))
    return "\n".join(
        [
            *(f"% {words}" for words in _legend(table)),
            r"% \usepackage{booktabs}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            head,
            r"\midrule",
            *body,
            r"\bottomrule",
            r"\end{tabular}",
            "",
        ]
    )


def _legend(table: ModeTable) -> list[str]:
    """The meaning of the cells, in words."""
    meanings = "".join(f" {meaning}." for meaning in note_meanings(table))
    return [f"±: a conjugate pair; in brackets: one standard deviation, in the last digits.{meanings}"]


def _cell(text: str) -> str:
    """A cell as LaTeX: numbers in mathematics, words as they are."""
    if re.fullmatch(r"[±\d.()e+…-]+", text):
        return f"${text.replace('±', chr(92) + 'pm ').replace('…', chr(92) + 'ldots ')}$"
    escaped = text.translate(_SPECIAL).replace("|μ|", r"$|\mu|$").replace("μ<0", r"$\mu<0$").replace("μ>0", r"$\mu>0$")
    return re.sub("[λζδ]", lambda match: _LETTERS[match[0]], escaped)
