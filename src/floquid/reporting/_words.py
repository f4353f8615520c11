"""Texts of the page: the verdict, its numbers, the modes, what was done, and how to cite."""

from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np

from floquid._checks import counted
from floquid.findings import Severity
from floquid.pipeline import Analysis
from floquid.reconstruction import Refinement
from floquid.reporting._case import Case
from floquid.views import (
    SpeedUnit,
    cycle_words,
    passed_words,
    period_words,
    raw_noise,
    speed_texts,
    speed_words,
    whitening_words,
    with_error,
)

CRITERIA = {  # what each number of the validation is, and its unit
    "fit": ("share of the response predicted in cycles left out", "%"),
    "held_out_error": ("error of prediction on samples left out over what is expected, worst response", "-"),
    "held_out_stretch": ("error of that prediction over a stretch of the record", "-"),
    "period": ("own period against the period used, in standard deviations", "-"),
    "mode": ("power of the weakest mode over the most that a fit makes of noise", "-"),
    "tone": ("largest amplitude left at a harmonic of the revolution, over the noise", "-"),
    "harmonic": ("largest share of the response left in a harmonic beside a mode's band", "%"),
    "line": ("largest amplitude left at any other line, over the noise", "-"),
    "colour": ("squared autocorrelations of the residual", "-"),
    "multipliers": ("multipliers of A(t) against the model's, over what they may differ by", "-"),
    "liouville": ("integrated trace of A(t) against the exponents, over what it may differ by", "-"),
    "misfit": ("what the fit leaves over the level of its noise, worst response", "-"),
    "remainder": ("share of the response that these checks find left, in amplitude", "%"),
    "composition": ("largest relative difference of Φ(t + T), integrated, and Φ(t) Φ(T)", "-"),
}


def verdict(analysis: Analysis) -> tuple[str, str, str]:
    """A word for the page's style, the sentence, and its meaning for a reader."""
    found = analysis.validation
    if analysis.failed:
        return "failed", "The model fails.", "Do not use the numbers of this page:"
    if found is None:
        meaning = "Identify with validation to know whether it can be believed."
        return "open", "The model was not checked: validation was switched off.", meaning
    if not found.passed:
        meaning = "Do not use the numbers of this page before this is mended:"
        return "failed", "The model does not pass its checks.", meaning
    if found.findings:
        words = f"The model {found.answer}.", "That share of the response is beyond the noise, in amplitude:"
        return "remainder", *words
    words = passed_words(found)
    return "passed", "The model passes its checks.", f"{words[0].upper()}{words[1:]}"


def checks(analysis: Analysis) -> list[SimpleNamespace]:
    """The checks of the validation: what was measured, its value and limit, and whether it was met."""
    found = analysis.validation
    if found is None:
        return []
    rows = []
    for name in sorted(found.criteria, key=list(CRITERIA).index):
        criterion, (what, unit) = found.criteria[name], CRITERIA[name]
        value = found.metrics.get(name)
        factor, sign = (100.0, " %") if unit == "%" else (1.0, "")
        bound = f"{'at least' if criterion.at_least else 'at most'} {factor * criterion.limit:.4g}{sign}"
        told = "not computed" if value is None else f"{factor * value:.4g}{sign}"
        met = value is not None and criterion.met(value)
        rows.append(SimpleNamespace(what=what, value=told, limit=bound, met=met))
    return rows


def minus(text: str) -> str:
    """The text with true minus signs."""
    return text.replace("-", "−")


def summary_line(case: Case, unit: SpeedUnit) -> str:
    """The record and the result in one sentence, the speed of the shaft in a `unit`."""
    analysis, model = case.analysis, case.analysis.model
    periods = sum(record.duration for record in analysis.records) / model.period
    counts, told = f"{periods:.6g}", "in all "
    if analysis.decay is not None:
        cycles = cycle_words(analysis)
        counts, told = " and ".join([", ".join(cycles[:-1]), cycles[-1]] if len(cycles) > 1 else cycles), ""
    sides = [counted(len(model.channels), "channel" if analysis.decay is not None else "output")]
    sides += [counted(len(analysis.inputs), "measured input")] if analysis.inputs else []
    records, modes = counted(len(analysis.records), "record"), counted(len(case.modes), "mode")
    return (
        f"{modes} (order {model.order}) found in {records} of {' and '.join(sides)}, {counts} periods {told}of "
        f"{period_words(analysis)} s ({speed_words(analysis, unit)}), "
        f"{analysis.records[0].sample_rate * model.period:.4g} samples a period."
    )


def evidence(analysis: Analysis) -> list[tuple[str, list[str]]]:
    """Headings with sentences: the order, and whether anything is periodic."""
    found: list[tuple[str, list[str]]] = []
    if analysis.choice is not None:
        title = "How many modes: ambiguous" if analysis.choice.ambiguous else "How many modes: clear"
        found.append((title, [*analysis.choice.doubts, *analysis.choice.reasons]))
    elif analysis.settings.order is not None:
        found.append(("How many modes", [f"The order {analysis.settings.order} was given, not found."]))
    if analysis.periodicity is not None:
        found.append(("Is it periodic at all?", list(analysis.periodicity.sentences)))
    return found


def steps(analysis: Analysis, unit: SpeedUnit = "hz") -> list[str]:
    """Steps done to the records, in order, each once; the speed of the shaft in a `unit`."""
    done = [step for record in analysis.records for step in record.provenance.steps]
    done += speed_texts(analysis.findings, unit, Severity.NOTE)
    if words := whitening_words(analysis.whitening, analysis.model.channels):
        done.append(words)
    done += [step for step in analysis.model.provenance.steps if step not in done]
    return list(dict.fromkeys(((step[:1].upper() + step[1:]).rstrip(".") + ".") for step in done))


def sources(analysis: Analysis) -> list[str]:
    """Sources of the records."""
    return list(dict.fromkeys(source for record in analysis.records for source in record.provenance.sources))


def noise_table(analysis: Analysis) -> tuple[list[str], list[tuple[str, str, list[str]]]]:
    """The noise found: titles of columns, and of each channel its name, its unit and its cells."""
    # Of free responses the noise in each hit with its share of the peak; where the excitation goes on, what is left of
    # each output, and its error on samples left out.
    channels = analysis.model.channels
    if analysis.decay is None:
        of = "innovations, " if analysis.ambient else ""
        titles, cells = [f"{of}standard deviation"], [[f"{noise:.3g}"] for noise in analysis.noise[:, 0]]
        if analysis.validation is not None:
            titles.append("error on samples left out, over that expected")
            for row, error in zip(cells, analysis.validation.held_out_error[:, 0], strict=True):
                row.append(f"{error:.3g}")
        return titles, [(own.name, own.unit, row) for own, row in zip(channels, cells, strict=True)]
    rows, noise = [], raw_noise(analysis)
    for number, channel in enumerate(channels):
        cells = []
        for hit, cycles in enumerate(analysis.cycles):
            own = float(noise[number, hit])
            peak = float(np.abs(cycles.values[number]).max())
            cells.append(f"{own:.3g} ({100.0 * own / peak:.2g} %)" if peak > 0 else f"{own:.3g}")
        rows.append((channel.name, channel.unit, cells))
    hits = len(analysis.cycles)
    return ["standard deviation (of the peak)"] if hits == 1 else [f"hit {n}" for n in range(1, hits + 1)], rows


def settings_rows(analysis: Analysis) -> list[tuple[str, str]]:
    """Every option of the pipeline by its name."""
    return [(field.name, _told(getattr(analysis.settings, field.name))) for field in fields(analysis.settings)]


def _told(value: Any) -> str:
    if value is None:
        return "not given"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (tuple, list)):
        return ", ".join(str(one) for one in value) or "not given"
    return str(value) or "not given"


def parameters(found: Refinement) -> list[tuple[str, str]]:
    """The parameters of a structure with their deviations."""
    return [
        (name, minus(with_error(float(value), float(std))))
        for name, value, std in zip(found.names, found.parameters, found.std, strict=True)
    ]
