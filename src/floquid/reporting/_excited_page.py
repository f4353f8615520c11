"""The page of records whose excitation goes on, with measured inputs or without."""

from __future__ import annotations

import numpy as np

from floquid._checks import counted
from floquid.pipeline import AmbientAnalysis, ExcitedAnalysis
from floquid.reporting import _words as words
from floquid.reporting._case import Case
from floquid.reporting._chosen_figures import (
    coefficient_source,
    coefficients_figure,
    link_modes,
    shape_figures,
    shape_source,
)
from floquid.reporting._excited_figures import (
    left_out_figures,
    matrix_rows,
    measured_beside,
    measured_figures,
    paths_of,
    reach_figures,
    transfer_figures,
)
from floquid.reporting._modes_figures import exponents_figure, mode_source, multipliers_figure
from floquid.reporting._page import rendered
from floquid.views import mode_table, note_meanings, outcome_lines


def excited_page(case: Case, *, title: str | None) -> str:
    """The whole page as text."""
    analysis: ExcitedAnalysis = case.analysis
    modes, shape, coefficients = mode_source(case), shape_source(case), coefficient_source(case)
    link_modes(modes, [shape, coefficients])
    record, held_out = left_out_figures(case)
    figures = {
        "shape": shape_figures(case, shape),
        "coefficients": [coefficients_figure(case, coefficients)],
        "plane": [exponents_figure(case, modes), multipliers_figure(case, modes)],
        "transfer": [],
        "measured": [],
        "reach": [],
        "record": record,
    }
    paths, matrix, harmonics, beside = [], [], [], []
    if analysis.inputs:
        found = analysis.transfer()
        paths = paths_of(found, analysis.noise, analysis.fit.samples.input_size)
        matrix, harmonics = matrix_rows(found, paths), found.harmonics.tolist()
        measured = measured_beside(analysis, found)
        beside = [measured] if isinstance(measured, str) else [str(finding) for finding in measured.findings]
        figures |= {
            "transfer": transfer_figures(found, paths),
            "measured": [] if isinstance(measured, str) else measured_figures(analysis, measured, paths),
            "reach": reach_figures(case),
        }
    rows, checked = mode_table(analysis), bool(np.isfinite(analysis.held_out).all())
    failed = not analysis.passed and (checked or any(own.severity.name == "FAILURE" for own in analysis.findings))
    sentence = "The model does not pass its checks." if failed else "The model passes its checks."
    lines = outcome_lines(analysis)
    return rendered(
        "excited.html.jinja",
        case,
        figures,
        title,
        mark="failed" if failed else "passed" if checked else "open",
        sentence=sentence if checked or failed else "The model was not checked: validation was switched off.",
        under=f"{lines['Verdict'][0].upper()}{lines['Verdict'][1:]}.",
        reasons=[],
        rows=rows,
        meanings=note_meanings(rows),
        bands=analysis.model.exponent_std is not None,
        fails=False,
        summary=_summary(case),
        ambient=isinstance(analysis, AmbientAnalysis),
        inputs=analysis.inputs,
        matrix=matrix,
        harmonics=harmonics,
        beside=beside,
        paths_shown=len(paths),
        paths_left=len(analysis.inputs) * len(analysis.model.channels) - len(paths),
        held_out=held_out,
        checked=_checked(analysis),
        hits=[],
        steps=words.steps(analysis),
    )


def _summary(case: Case) -> str:
    """The records and the result in one sentence."""
    analysis, model = case.analysis, case.analysis.model
    periods = sum(record.duration for record in analysis.records) / model.period
    sides = [counted(len(model.channels), "output")]
    sides += [counted(len(analysis.inputs), "measured input")] if analysis.inputs else []
    return (
        f"{counted(len(case.modes), 'mode')} (order {model.order}) found in "
        f"{counted(len(analysis.records), 'record')} of {' and '.join(sides)}, {periods:.6g} periods of "
        f"{model.period:.8g} s in all (ω/2π = {1.0 / model.period:.6g} Hz), "
        f"{analysis.records[0].sample_rate * model.period:.4g} samples a period."
    )


def _checked(analysis: ExcitedAnalysis) -> list[tuple[str, str, str, str]]:
    """Of each output its name, its unit, the noise, and the error on samples left out."""
    return [
        (channel.name, channel.unit, f"{noise:.3g}", f"{error:.3g}" if np.isfinite(error) else "not checked")
        for channel, noise, error in zip(analysis.model.channels, analysis.noise[:, 0], analysis.held_out, strict=True)
    ]
