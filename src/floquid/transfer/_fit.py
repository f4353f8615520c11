"""A model of harmonic transfer functions that were measured: modes common to all of them, with deviations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt, frozen_array, input_error, positive
from floquid.core import PeriodicModel, Provenance, modelled
from floquid.errors import IdentificationError
from floquid.findings import Finding, Severity, failure, note, texts, warning
from floquid.fit import SURE, is_vague
from floquid.inputs import Errors, Grid, Hold, Limits, TransferFunctions, driven_of, estimates_of, sealed, transfer_of
from floquid.transfer._measured import MeasuredTransfer
from floquid.transfer._modal import Lines, Modal, near_real
from floquid.transfer._search import searched

DOUBTFUL = 3.0  # deviations off the axis within which a pair may be two real multipliers
WORSE = 1.3  # the χ² of a degree of freedom above which that is told: deviations of G are estimates themselves


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TransferFit(Rebuilt):
    """Modes fitted to harmonic transfer functions, with the joint covariance of all that was fitted.

    Parameters
    ----------
    measured
        What was fitted.
    model
        The periodic model with its inputs; of no scale of its own where G has none.
    modal, covariance
        The modes as fitted, and the joint covariance of their numbers and of the amplitudes of one output after
        another, from which deviations are made.
    hold, begins
        The input between its samples, and the times at which the records begin (records,) [s].
    chi_square, degrees
        The squares that are left over the variances of G, and how many are free. Where that is more than one a degree
        the covariance is widened by it.
    findings
        What was done, and what a reader must know.
    """

    kind: ClassVar[str] = "fitted"  # by it the functions for a result are found
    measured: TransferFunctions
    model: PeriodicModel
    modal: Modal
    covariance: Floats
    hold: Hold
    begins: Floats
    chi_square: float
    degrees: int
    findings: tuple[Finding, ...] = ()

    @property
    def period(self) -> float:
        """T [s], that of the model."""
        return self.model.period

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to a reader, a sentence each."""
        return (*texts(self.findings, Severity.FAILURE), *texts(self.findings, Severity.WARNING))

    def transfer(
        self, frequencies_hz: ArrayLike | None = None, harmonics: ArrayLike | None = None, *, sampled: bool = False
    ) -> TransferFunctions:
        """G of the model with deviations by all that is uncertain in it, to first order.

        `frequencies_hz` are Ω/2π (frequencies,) [Hz] and `harmonics` the integers m (harmonics,), by default those
        measured. With `sampled` it is that of samples: the same as was measured. Raises InputError where a frequency is
        no number, or that of samples is asked for where none were measured.
        """
        of, own = "TransferFit.transfer", self.measured
        if sampled and own.step is None:
            raise input_error("sampled", of, "be False", "is True, and G is of continuous time", "Leave it out.")
        hertz = own.frequencies_hz if frequencies_hz is None else np.atleast_1d(np.asarray(frequencies_hz, float))
        hertz = frozen_array(hertz, "frequencies_hz", of, axes=("frequencies",))
        turns = own.harmonics if harmonics is None else np.unique(np.atleast_1d(np.asarray(harmonics, np.int64)))
        grid = Grid(
            omega=2.0 * np.pi * hertz,
            harmonics=turns,
            fundamental=self.model.fundamental,
            held=(own.step, self.hold) if sampled and own.step is not None else None,
        )
        modal = self.modal
        errors, direct = _errors(modal, self.covariance, len(own.outputs)), dict(enumerate(modal.direct))
        return transfer_of(grid, modal.modes, modal.shapes, direct, errors, (own.outputs, own.inputs))


def fit_transfer(
    measured: MeasuredTransfer | TransferFunctions,
    *,
    period: float | None = None,
    hold: Hold = "zero",
    limits: Limits | None = None,
    report: Callable[[str], None] = lambda _: None,
) -> TransferFit:
    r"""Fit modes to harmonic transfer functions that were measured, weighted by their variance.

    .. math:: G_m(\Omega) = \sum_r \sum_l \frac{c_{r,m-l}\, b_{r,l}}{i (\Omega + l \omega) - \lambda_r} + D_m

    with conjugates. Exponents begin on a grid, one after another as long as χ² falls by more than noise makes it; the
    harmonics of each mode grow by the same test; one real multiplier or two take the place of pairs near their axis
    where noise explains the rest; all is finished by least squares. What rings at the start of
    records of repeats is fitted beside the modes where it is seen. G of the fit is nearer than the lines by the root of
    the numbers measured over those fitted: a fifth of their error needs twenty-five times as many.

    Raises InputError where G has no deviations, or the period is none; IdentificationError where no mode rises above
    the deviations.

    Parameters
    ----------
    measured
        G with its deviations: what `measure_transfer` returns, or lines that others have measured.
    period
        That of the system, T [s]; of lines that `measure_transfer` has measured the one it had.
    hold
        The input between its samples, where G is that of samples.
    limits
        Limits of the search.
    report
        Is told what is being done, a phrase a stage.
    """
    from scipy.special import chdtrc

    of = "fit_transfer"
    own, known, echoes, said = _parts(measured)
    period = known if period is None else period
    if period is None:
        raise input_error("period", of, "be given", "is not, and the lines have none", "Pass `period=` in s.")
    positive(period, "period", of, unit="s")
    if own.std is None:
        remedy = "A constant one will do where nothing is known: only its ratios count then."
        raise input_error("measured", of, "have deviations", "has none", remedy)
    lines = Lines(
        omega=2.0 * np.pi * own.frequencies_hz,
        harmonics=own.harmonics,
        values=own.values,
        std=own.std,
        fundamental=2.0 * np.pi / period,
        held=None if own.step is None else (own.step, hold),
        echoes=echoes,
        alive="measured_transient" in said,
    )
    report("searching for modes")
    found = searched(lines, limits or Limits(), report)
    if found is None:
        raise IdentificationError(
            "Identification ended without a result: no mode rises above the deviations of the transfer functions. "
            "Drive the system harder or for longer, at more lines near its resonances."
        )
    degrees = 2 * int(np.count_nonzero(lines.there)) - found.n_parameters
    ratio = found.cost / max(degrees, 1)
    covariance = found.covariance() * max(ratio, 1.0)
    on_axis = next(near_real(found.modal.modes, lambda: covariance, lines.fundamental, [], DOUBTFUL), None)
    misfit = degrees > 0 and ratio > WORSE and chdtrc(degrees, found.cost) < SURE
    for one in (found.modal, *found.modal.modes):
        sealed(one)
    model = _model(lines, found.modal, covariance, own)
    assert model.exponent_std is not None
    unknown = is_vague(model.exponent_std.real, model.exponents.real)
    hertz = np.unique(np.abs(model.exponents.imag[unknown])) / (2.0 * np.pi)
    return TransferFit(
        measured=own,
        model=model,
        modal=found.modal,
        covariance=frozen_array(covariance, "covariance", of, axes=("numbers", "numbers")),
        hold=hold,
        begins=frozen_array(lines.echoes[1], "begins", of, axes=("records",)),
        chi_square=found.cost,
        degrees=degrees,
        findings=(
            note("modes_of_lines", modes=len(found.modal.modes), ratio=ratio, degrees=degrees),
            *([warning("modes_of_lines_misfit", ratio=ratio)] if misfit else []),
            *([failure("modes_of_lines_real")] if on_axis else []),
            *([failure("modes_of_lines_undetermined", frequencies=hertz.tolist())] if hertz.size else []),
            *_flattened(said, model),
        ),
    )


def _parts(
    measured: MeasuredTransfer | TransferFunctions,
) -> tuple[TransferFunctions, float | None, tuple[Complexes, Floats], dict[str, Mapping[str, Any]]]:
    """G, its period where known, the echoes and begins of its records, and the numbers of its findings by code."""
    if isinstance(measured, MeasuredTransfer):
        said = {finding.code: finding.numbers for finding in measured.findings}
        return measured.transfer, measured.period, (measured.echoes, measured.begins), said
    none = np.zeros((0, len(measured.inputs), len(measured.frequencies_hz)), complex), np.zeros(0)
    return measured, None, none, {}


def _flattened(said: Mapping[str, Mapping[str, Any]], model: PeriodicModel) -> list[Finding]:
    """Finding on modes whose resonance is narrower than the window of polynomials: a failure where that is seen."""
    if "measured_polynomials" not in said:
        return []
    window, told = float(said["measured_polynomials"]["width"]), failure if "measured_flattened" in said else warning
    narrow = np.abs(model.exponents.real) < np.pi * window  # half-power width, 2|Re λ|/2π
    hertz = np.unique(np.abs(model.exponents.imag[narrow])) / (2.0 * np.pi)
    return [told("modes_of_lines_flattened", frequencies=hertz.tolist(), window=window)] if hertz.size else []


def _model(lines: Lines, modal: Modal, covariance: Floats, own: TransferFunctions) -> PeriodicModel:
    """The periodic model of a fit, each mode with its conjugate, with deviations."""
    whole = _errors(modal, covariance, len(own.outputs))
    begins, direct = lines.echoes[1][: len(modal.modes[0].initial)], dict(enumerate(modal.direct))
    return modelled(
        estimates_of(modal.modes, modal.shapes, whole, lines.fundamental),
        channels=own.outputs,
        provenance=Provenance(),
        driven=driven_of(modal.modes, own.inputs, direct, len(own.outputs), lines.fundamental, begins),
    )


def _errors(modal: Modal, covariance: Floats, outputs: int) -> Errors:
    """Errors of the free numbers of the modes, and of the amplitudes of each output."""
    return Errors.of_joint(covariance, sum(int(mode.free.sum()) for mode in modal.modes), outputs)
