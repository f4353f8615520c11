"""The page of modes that were fitted to transfer functions measured line by line."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from floquid._checks import counted
from floquid.core import Branch
from floquid.findings import Severity, texts
from floquid.reporting import _words as words
from floquid.reporting._case import case_of
from floquid.reporting._driven_figures import matrix_rows, measured_figures, paths_of
from floquid.reporting._modes_figures import mode_figures, mode_source
from floquid.reporting._page import rendered
from floquid.transfer import TransferFit
from floquid.views import DAMPING_WORDS, DampingUnit, branch_words, mode_table, note_meanings

POINTS = 600  # frequencies of a curve, beside those measured


@dataclass(frozen=True, slots=True)
class _Settings:
    """Settings of a fit of lines."""

    period: float
    hold: str
    harmonics: None = None  # of the shapes: found, not given
    branch: Branch = "strongest"


def lines_page(fit: TransferFit, *, title: str | None, damping: DampingUnit) -> str:
    """The whole page as text, damping in a unit."""
    lines, model = fit.measured, fit.model
    sampled = lines.step is not None
    at = fit.transfer(sampled=sampled)
    hertz = lines.frequencies_hz
    drawn = fit.transfer(np.union1d(hertz, np.linspace(hertz[0], hertz[-1], POINTS)), sampled=sampled)
    assert lines.std is not None
    noise = np.sqrt(np.nanmean(np.abs(lines.std) ** 2, axis=(0, 2, 3)))[:, None]
    shown: Any = SimpleNamespace(
        model=model, noise=noise, records=(), settings=_Settings(model.period, fit.hold), findings=fit.findings,
        decay=None, whitening=None, lengths=None,
    )  # fmt: skip
    case, paths = case_of(shown, damping=damping), paths_of(at, noise, np.ones(len(lines.inputs)))
    measured = measured_figures(lines, at, drawn, paths, each=True)
    table, ratio = mode_table(shown, damping_unit=damping), fit.chi_square / max(fit.degrees, 1)
    worst = max((finding.severity for finding in fit.findings), key=list(Severity).index, default=Severity.NOTE)
    mark, sentence = {
        Severity.NOTE: ("passed", "The modes explain the lines."),
        Severity.WARNING: ("remainder", "The modes do not explain all of the lines."),
        Severity.FAILURE: ("failed", "The fit fails."),
    }[worst]
    there = np.isfinite(lines.values).any(axis=(0, 1, 2))
    return rendered(
        case,
        mode_figures(case, mode_source(case)) | {"measured": measured},
        title or "Modes of measured transfer functions",
        mark=mark,
        sentence=sentence,
        under=f"They leave {ratio:.3g} times the variance of the lines, {fit.degrees} degrees of freedom.",
        reasons=texts(fit.findings, Severity.FAILURE),
        warnings=texts(fit.findings, Severity.WARNING),
        table=table,
        damping=DAMPING_WORDS[damping].replace("-", "−"),
        meanings=note_meanings(table),
        branch=branch_words(case.analysis),
        bands=True,
        summary=(
            f"{counted(len(case.modes), 'mode')} (order {model.order}) fitted to {np.count_nonzero(there)} lines from "
            f"{hertz[there][0]:.5g} to {hertz[there][-1]:.5g} Hz of {counted(len(lines.inputs), 'input')} and "
            f"{counted(len(lines.outputs), 'output')}, {counted(len(lines.harmonics), 'harmonic')}, at a period of "
            f"{model.period:.8g} s (ω/2π = {1.0 / model.period:.6g} Hz)."
        ),
        inputs=lines.inputs,
        matrix=matrix_rows(at, paths),
        harmonics=at.harmonics.tolist(),
        paths_shown=len(paths),
        paths_left=len(lines.inputs) * len(lines.outputs) - len(paths),
        steps=words.steps(shown),
    )
