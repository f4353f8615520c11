"""Harmonic transfer functions as measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt
from floquid.core import Channel
from floquid.findings import Finding, Severity, texts
from floquid.inputs import Samples, TransferFunctions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredTransfer(Rebuilt):
    """Harmonic transfer functions measured line by line, with deviations, and how far they can be trusted.

    They are those of samples: the hold of the input and what it folds are in them. `DrivenAnalysis.transfer` with
    `sampled=True` gives the same of a model.

    Parameters
    ----------
    transfer
        G with its deviations; NaN where an input has no line, or no power.
    period
        That of the system [s].
    method
        "repeats", "polynomials" or "chirps", which gives no deviations.
    noise
        The deviation of a line of the response, as an amplitude (outputs, frequencies) [units of the outputs].
    coherence
        The share of the power of the response at those frequencies that the inputs explain (outputs, frequencies).
    nonlinear
        The power where a linear system has none, over that of the noise (outputs,): 1 of a linear one; NaN where the
        inputs leave no such lines, or the transient is in them.
    echoes, begins
        What one unit in the spectrum of the response of each record adds to G (records, inputs, frequencies), and the
        times at which the records begin (records,) [s]: what rings there is fitted with them. Of repeats alone.
    findings
        What was done, and what a reader must know.
    """

    kind: ClassVar[str] = "measured"  # by it the functions for a result are found
    transfer: TransferFunctions
    period: float
    method: str
    noise: Floats
    coherence: Floats
    nonlinear: Floats
    echoes: Complexes
    begins: Floats
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        lines = ("outputs", "frequencies")
        self._freeze(finite=False, noise=lines, coherence=lines, nonlinear=("outputs",), begins=("records",))
        self._freeze(dtype=np.complex128, finite=False, echoes=("records", "inputs", "frequencies"))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to a reader, a sentence each."""
        return (*texts(self.findings, Severity.FAILURE), *texts(self.findings, Severity.WARNING))


def measured_of(
    samples: Samples,
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    lines: tuple[Integers, int],
    harmonics: Integers,
    g: tuple[Complexes, Complexes | None],
    **rest: Any,
) -> MeasuredTransfer:
    """G of samples and its deviations at some lines of a spectrum, with the rest of what was measured."""
    places, count = lines
    transfer = TransferFunctions(
        frequencies_hz=places / (count * samples.step),
        harmonics=harmonics,
        values=g[0],
        std=g[1],
        outputs=channels[0],
        inputs=channels[1],
        step=samples.step,
    )
    return MeasuredTransfer(transfer=transfer, period=2.0 * np.pi / samples.fundamental, **rest)
