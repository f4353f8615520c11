"""The table of modes as LaTeX and as Markdown, in the words of the terminal."""

from __future__ import annotations

import re
from itertools import compress
from types import SimpleNamespace
from typing import Any

import numpy as np

from floquid.core import PeriodicModel
from floquid.pipeline import Analysis
from floquid.views import DampingUnit, ModeTable, mode_table, note_meanings

TEXT_TABLES = (".tex", ".md")  # the suffixes of tables for papers and pages

_LETTERS = {"λ": r"$\lambda$", "ζ": r"$\zeta$", "δ": r"$\delta$"}
_SPECIAL = str.maketrans({letter: f"\\{letter}" for letter in "%&#_$"})


def text_table(result: Analysis | PeriodicModel, suffix: str, unit: DampingUnit) -> str:
    """The modes of a `result` as a table in the language of its `suffix`, damping in a `unit`."""
    shown: Any = result
    if isinstance(result, PeriodicModel):  # a model alone says no noise: channels count alike
        noise = np.ones(result.coefficients.shape[1:3])
        shown = SimpleNamespace(model=result, noise=noise, decay=None, lengths=None)
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
