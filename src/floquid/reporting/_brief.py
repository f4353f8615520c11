"""The brief: one printed page with the modes, the verdict, one picture of the fit, the record and the settings."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import fields, replace
from io import BytesIO
from typing import Any

from floquid.findings import Severity
from floquid.pipeline import Analysis
from floquid.plot import figure_of_fit, style
from floquid.reporting import _words as words
from floquid.reporting._case import Case
from floquid.reporting._page import filled, modes_of, title_of, verdict_of
from floquid.views import SpeedUnit, speed_texts

MOST_MODES, MOST_SENTENCES = 14, 4  # rows and sentences that leave room for the picture on a sheet of A4
DPI = 200  # sharp on paper


def brief_page(case: Case, *, title: str | None, unit: SpeedUnit) -> str:
    """The page as text: nothing in it moves, and nothing is loaded."""
    analysis: Analysis = case.analysis
    found = modes_of(analysis, case.damping)
    table = found["table"]
    sentences = [*analysis.reasons, *speed_texts(analysis.findings, unit, Severity.WARNING)]
    reasons, shown = len(analysis.reasons), sentences[:MOST_SENTENCES]
    name, figure = figure_of_fit(analysis)
    stream = BytesIO()
    with style():
        figure.savefig(stream, format="png", dpi=DPI)
    content: dict[str, Any] = verdict_of(analysis) | found
    content |= {
        "table": replace(table, rows=table.rows[:MOST_MODES]),
        "modes_left": max(0, len(table.rows) - MOST_MODES),
        "reasons": shown[:reasons],
        "warnings": shown[reasons:],
        "sentences_left": len(sentences) - len(shown),
        "picture": b64encode(stream.getvalue()).decode("ascii"),
        "described": name,
        "summary": words.summary_line(case, unit),
        "sources": words.sources(analysis),
        "settings": _given(analysis),
    }
    return filled("brief.html.jinja", title=title or title_of(case), **content)


def _given(analysis: Analysis) -> list[tuple[str, str]]:
    """The options that differ from those of a run without any."""
    usual = {field.name: field.default for field in fields(analysis.settings)}
    rows = words.settings_rows(analysis)
    return [(name, value) for name, value in rows if getattr(analysis.settings, name) != usual[name]]
