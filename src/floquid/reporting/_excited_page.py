"""The pages of records whose excitation goes on, and of modes that were fitted to measured transfer functions."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from floquid._checks import counted
from floquid.findings import Severity
from floquid.pipeline import AmbientAnalysis, ExcitedAnalysis
from floquid.reporting import _words as words
from floquid.reporting._case import Case, case_of
from floquid.reporting._chosen_figures import harmonic_source
from floquid.reporting._excited_figures import (
    harmonic_figure,
    left_out_figures,
    matrix_rows,
    measured_beside,
    measured_figures,
    paths_of,
    reach_figures,
    transfer_figures,
)
from floquid.reporting._look import Figure
from floquid.reporting._modes_figures import mode_figures, mode_source
from floquid.reporting._page import rendered
from floquid.reporting._system_figures import Truth, system_figures
from floquid.transfer import TransferFit
from floquid.views import mode_table, note_meanings, outcome_lines, spectra_of_modes

POINTS = 600  # frequencies of a curve, beside those measured
NOTHING: dict[str, list[Figure]] = {place: [] for place in ("harmonic", "transfer", "measured", "reach", "record")}
"""No figure at the places that not every page has."""
MANY = 1e6  # periods from which on their number says no more


def excited_page(case: Case, *, title: str | None, truth: Truth | None) -> str:
    """The whole page as text."""
    analysis: ExcitedAnalysis = case.analysis
    record, held_out = left_out_figures(case)
    chosen, harmonic, lengths = [], [], []
    if isinstance(analysis, AmbientAnalysis):
        spectra, lengths = spectra_of_modes(analysis), _lengths(analysis)
        chosen = [harmonic_source(spectra)]
        harmonic = [harmonic_figure(spectra, *chosen)]
    figures = mode_figures(case, mode_source(case), *chosen)
    figures |= NOTHING | {"harmonic": harmonic, "record": record}
    figures |= system_figures(analysis, truth)
    paths, matrix, harmonics, beside = [], [], [], []
    if analysis.inputs:
        found = analysis.transfer()
        paths = paths_of(found, analysis.noise, analysis.fit.samples.input_size)
        matrix, harmonics = matrix_rows(found, paths), found.harmonics.tolist()
        figures |= {"transfer": transfer_figures(found, paths), "reach": reach_figures(case)}
        measured = measured_beside(analysis, found)
        if isinstance(measured, str):
            beside = [measured]
        else:
            beside, lines = [str(finding) for finding in measured.findings], measured.transfer
            at, drawn = (
                analysis.transfer(hertz, lines.harmonics, sampled=True) for hertz in (lines.frequencies_hz, None)
            )
            figures["measured"] = measured_figures(lines, at, drawn, paths)
    rows, checked = mode_table(analysis), not np.isnan(analysis.held_out).any()
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
        lengths=lengths,
        inputs=analysis.inputs,
        state=analysis.state,
        refinement=analysis.refinement,
        parameters=[] if analysis.refinement is None else words.parameters(analysis.refinement),
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


def _lengths(analysis: AmbientAnalysis) -> list[str]:
    """The periods of a record that gives the damping of each mode to 10 %, a mode of each pair."""
    periods = analysis.lengths[list(analysis.model.upper_modes)] / analysis.model.period
    return [f"{float(f'{own:.3g}'):.0f}" if own < MANY else f"more than {MANY:.0f}" for own in periods]


def _checked(analysis: ExcitedAnalysis) -> list[tuple[str, str, str, str]]:
    """Of each output its name, its unit, the noise, and the error on samples left out."""
    return [
        (channel.name, channel.unit, f"{noise:.3g}", "not checked" if np.isnan(error) else f"{error:.3g}")
        for channel, noise, error in zip(analysis.model.channels, analysis.noise[:, 0], analysis.held_out, strict=True)
    ]


@dataclass(frozen=True, slots=True)
class _Settings:
    """What a fit of lines was told."""

    period: float
    hold: str
    harmonics: None = None  # of the shapes: found, not given


def lines_page(fit: TransferFit, *, title: str | None) -> str:
    """The whole page as text."""
    lines, model = fit.measured, fit.model
    sampled = lines.step is not None
    at = fit.transfer(sampled=sampled)
    hertz = lines.frequencies_hz
    drawn = fit.transfer(np.union1d(hertz, np.linspace(hertz[0], hertz[-1], POINTS)), sampled=sampled)
    assert lines.std is not None
    noise = np.sqrt(np.nanmean(np.abs(lines.std) ** 2, axis=(0, 2, 3)))[:, None]
    shown: Any = SimpleNamespace(
        model=model, noise=noise, records=(), settings=_Settings(model.period, fit.hold), findings=fit.findings,
        warnings=fit.warnings,
    )  # fmt: skip
    case, paths = case_of(shown), paths_of(at, noise, np.ones(len(lines.inputs)))
    measured = measured_figures(lines, at, drawn, paths, each=True)
    rows, ratio = mode_table(shown), fit.chi_square / max(fit.degrees, 1)
    worst = max((finding.severity for finding in fit.findings), key=list(Severity).index, default=Severity.NOTE)
    mark, sentence = {
        Severity.NOTE: ("passed", "The modes explain the lines."),
        Severity.WARNING: ("remainder", "The modes do not explain all of the lines."),
        Severity.FAILURE: ("failed", "The fit fails."),
    }[worst]
    there = np.isfinite(lines.values).any(axis=(0, 1, 2))
    return rendered(
        "excited.html.jinja",
        case,
        mode_figures(case, mode_source(case)) | NOTHING | {"measured": measured},
        title or "Modes of measured transfer functions",
        mark=mark,
        sentence=sentence,
        under=f"They leave {ratio:.3g} times the variance of the lines, {fit.degrees} degrees of freedom.",
        reasons=[],
        rows=rows,
        meanings=note_meanings(rows),
        bands=True,
        fails=False,
        summary=(
            f"{counted(len(case.modes), 'mode')} (order {model.order}) fitted to {np.count_nonzero(there)} lines from "
            f"{hertz[there][0]:.5g} to {hertz[there][-1]:.5g} Hz of {counted(len(lines.inputs), 'input')} and "
            f"{counted(len(lines.outputs), 'output')}, {counted(len(lines.harmonics), 'harmonic')}, at a period of "
            f"{model.period:.8g} s (ω/2π = {1.0 / model.period:.6g} Hz)."
        ),
        ambient=False,
        lengths=[],
        inputs=lines.inputs,
        matrix=matrix_rows(at, paths),
        harmonics=at.harmonics.tolist(),
        beside=[],
        paths_shown=len(paths),
        paths_left=len(lines.inputs) * len(lines.outputs) - len(paths),
        held_out=False,
        checked=[],
        hits=[],
        steps=words.steps(shown),
    )
