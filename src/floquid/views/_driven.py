"""Results of records whose excitation goes on beside the modes, a line each."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats
from floquid.core import ModelInputs
from floquid.findings import Severity, texts
from floquid.inputs import TransferFunctions
from floquid.pipeline import AmbientAnalysis, ExcitedAnalysis

_BAND = 1.96
"""Deviations of a 95 % band."""


def magnitude_bands(found: TransferFunctions, row: int, column: int) -> tuple[Floats, Floats, Floats, float]:
    """|G| of one path with its 95 % band (harmonics, frequencies), and where a logarithmic axis of it begins.

    What is smaller than the axis shows is not told from nothing: the band there goes on to its end. The path of `found`
    is from the input `column` to the output `row`, from 0.
    """
    value = found.values[:, row, column]
    size = np.abs(value)
    # The deviation of a magnitude lies between those of both parts.
    std = np.zeros(size.shape) if found.std is None else np.abs(found.std[:, row, column]) / np.sqrt(2.0)
    there = np.maximum(size, std)[np.isfinite(size) & (size > 0.0)]
    floor = 0.5 * float(there.min(initial=np.inf if there.size else 1.0))
    return size, np.maximum(size - _BAND * std, floor), size + _BAND * std, floor


def excited_lines(analysis: ExcitedAnalysis) -> dict[str, str]:
    """Name and words of each line on `analysis`: noise, order, period, the way inputs reach the modes, the verdict."""
    model, own = analysis.model, analysis.model.inputs
    order = [finding for finding in analysis.findings if finding.code == "excited_order"]
    notes = [finding for finding in analysis.findings if finding not in order]
    ambient = isinstance(analysis, AmbientAnalysis)
    lines = {
        "Innovations" if ambient else "Noise": ("each sample is predicted to " if ambient else "taken for white, ")
        + ", ".join(
            f"{value:.3g} {channel.unit} in {channel.name}"
            for value, channel in zip(analysis.noise[:, 0], model.channels, strict=True)
        ),
        "Order": f"{model.order}. {' '.join(texts(order))}" if order else "",
        "Period": f"{model.period:.10g} s, {'as given' if not analysis.measured_clock else 'the mean of the shaft'}",
        "Notes": " ".join(texts(notes, Severity.NOTE)),
        "Reach": "" if own is None else _reach(analysis, own),
        "Direct": ""
        if own is None or not own.direct.size
        else f"at harmonics {own.direct_harmonics[0]}…{own.direct_harmonics[-1]}",
        "Verdict": _verdict(analysis),
    }
    return {name: words for name, words in lines.items() if words}


def _reach(analysis: ExcitedAnalysis, own: ModelInputs) -> str:
    """The input and the harmonic that do most to each mode, by the rms of the input."""
    model = analysis.model
    size = analysis.fit.samples.input_size
    words = []
    for number, mode in enumerate(model.upper_modes, start=1):
        strength = np.abs(own.coefficients[mode]) * size[:, None]
        source, harmonic = np.unravel_index(int(np.argmax(strength)), strength.shape)
        turn = int(own.harmonics[harmonic])
        words.append(f"mode {number} by {own.channels[source].name}" + (f" at {turn:+d} a period" if turn else ""))
    return "; ".join(words)


def _verdict(analysis: ExcitedAnalysis) -> str:
    """Whether samples that were left out are predicted."""
    if not np.isfinite(analysis.held_out).all():
        return "not checked"
    error = f"{analysis.held_out.max():.3g}"
    if analysis.passed:
        return f"passed: the last quarter, left out of a fit, is predicted to {error} times the expected error at worst"
    return f"the model does not pass: the last quarter, left out of a fit, is {error} times further off than expected"
