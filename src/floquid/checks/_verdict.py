"""The list of checks, and the verdict by them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from numpy.typing import ArrayLike

from floquid.checks._check import REMAINDER, Check, Evidence, Subject, Validation, looked_at
from floquid.checks._decays import decays_of
from floquid.checks._driving import driving, reach
from floquid.checks._excitation import repetition
from floquid.checks._left_out import left_out
from floquid.checks._modes import bands, limits, needed, partners, steady, weak_modes
from floquid.checks._period import period, phases
from floquid.checks._residual import colour, harmonics, level, lines, misfit, spikes, tones
from floquid.checks._system import system
from floquid.core import PeriodicModel, PhaseClock, Record
from floquid.findings import Finding
from floquid.reconstruction import StateModel


def _remainder(_: Subject, evidence: Evidence) -> tuple[Finding, ...]:
    evidence.kept("remainder", evidence.remainder, REMAINDER)
    return ()


CHECKS = (
    Check("needed", "Is each mode needed?", "seen", needed),
    Check("inputs", "Is it determined how each input reaches the modes?", "undriven"),
    Check("misfit", "Does the fit leave more than noise?", "misfit", misfit),
    # A wrong period, phase or angle is the cause of much else: it comes first.
    Check("period", "Is the period that of the response?", "period_off", period),
    Check("repetition", "Does the residual repeat with another period?", "other", repetition),
    Check("angle", "Is the angle of the shaft known well enough?", "vague_angles"),
    Check("phases", "Are all records at the phase of the first?", "phase_steps", phases),
    Check("reach", "Do the measured inputs reach each mode?", "coloured", reach),
    Check("driving", "Do the inputs alone drive the modes, at their instants, linearly?", "coloured", driving),
    Check("excitation", "Is each mode the system's, determined, and one?", "excitation"),
    Check("weak modes", "Is each mode stronger than what a fit makes of noise?", "left", weak_modes),
    Check("tones", "Are harmonics of the revolution left?", "left", tones),
    Check("harmonics", "Are harmonics of the modes left?", "left", harmonics),
    Check("lines", "Are other lines left?", "left", lines),
    Check("colour", "Is the residual white?", "colour", colour),
    Check("spikes", "Are there samples that are no noise?", "residual", spikes),
    Check("modes", "Is each mode determined, and likely one?", "doubts"),
    Check("partners", "Are negative multipliers even in number?", "shape", partners),
    Check("limits", "Did the search end at the most modes?", "seen", limits),
    Check("determined", "Is each decay determined?", "undetermined"),
    Check("bands", "Do the bands end below the highest harmonics?", "most", bands),
    Check("steady", "Is a mode a line of the revolution?", "turning", steady),
    Check("left out", "Are samples left out of a fit predicted by it?", "left_out", left_out),
    Check("A(t)", "Has A(t), integrated, the multipliers of the model?", "state", system),
    Check("remainder", "How much of the response is left beyond the noise?", "left", _remainder),
    Check("level", "Is the residual at the level of the noise?", "misfit", level),
)
"""All checks, in the order in which they are made."""


def findings_of(subject: Subject) -> tuple[Finding, ...]:
    """Findings against a model by the checks that no verdict is needed for."""
    return tuple(looked_at(subject, CHECKS, verdict=False).findings)


def judged(subject: Subject) -> Validation:
    """The verdict on a model."""
    return looked_at(subject, CHECKS, verdict=True).verdict(subject.shape)


def validate(
    model: PeriodicModel,
    records: Sequence[Record],
    clocks: Sequence[PhaseClock],
    *,
    noise: ArrayLike,
    state: StateModel | None = None,
    whitening: ArrayLike | None = None,
    periods_per_revolution: float = 1.0,
    misfit: float | None = None,
    in_phase: bool = False,
    report: Callable[[str], None] = lambda _: None,
) -> Validation:
    r"""The verdict on a model: cycles held out, what is left of the record, and A(t) integrated.

    Of each channel and hit, over the cycles in which the response is alive, held out in turn and predicted,

    .. math:: \mathrm{fit} = 1 - \sqrt{\frac{\max(\sum e\,r - \sigma^2 \chi^2_{n,\alpha},\, 0)}{\sum y^2 - n\sigma^2}}

    with e the error of prediction and r what the fit to all cycles leaves: Σ e r is the error with the prediction's own
    variance taken off, and all of it that noise explains counts as none. The residual is searched for tones at
    harmonics of the revolution, harmonics beside each mode's band, other lines, and colour (Ljung and Box 1978). Each
    mode is held against what a fit makes of noise alone. A(t) is integrated over two periods and held against the
    model's multipliers.

    Raises InputError where an argument is not possible, or does not belong to the model.

    Parameters
    ----------
    model, records, clocks
        The model, the free response as it was sampled, one record a hit with NaN for missing samples, and the clock of
        each.
    noise
        The deviation of the noise (channels, hits) [units of the channels]; with `whitening`, after the filter.
    state
        A(t) and Φ; None leaves them out.
    whitening
        The filter of each channel that makes its noise white (channels, taps); None where it is.
    periods_per_revolution
        Periods of the system in a revolution of the shaft, where no clock says it.
    misfit
        What the fit leaves over the level of its noise, if that was measured.
    in_phase
        True where the samples are values of splines in phase between events, whose noise has a colour of its own.
    report
        Called with a sentence on each stage.
    """
    more = {"state": state, "misfit": misfit, "in_phase": in_phase}
    case = decays_of(model, records, clocks, noise, whitening, periods_per_revolution, **more)
    report("checking the model on cycles left out")
    return judged(case)
