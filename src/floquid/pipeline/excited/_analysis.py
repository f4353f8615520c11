"""Results of the chains for records whose excitation goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import Rebuilt, frozen_array, input_error
from floquid._show import Drawings, Drawn, Told
from floquid.core import Channel, ConstantPeriod, PeriodicModel, Provenance, Record
from floquid.errors import FloquidError
from floquid.findings import Finding, Severity, failure, texts, warning
from floquid.innovations import Fit
from floquid.inputs import TransferFunctions, Uncertainty
from floquid.pipeline._settings import Settings
from floquid.pipeline._state import state_of
from floquid.pipeline.excited._lines import MOST_PERIODS
from floquid.reconstruction import Form, Names, Refinement, StateModel, reconstruct

HELD_OUT = 1.4
"""The error of prediction on samples left out, over the noise, from which on a model does not pass."""

UNPREDICTED = ("inputs_held_out", "ambient_held_out")
"""Findings on that error: the model does not pass, but has deviations."""

STILL = 3.0
"""Deviations within which a mode does not decay, and within which it is at a line."""

SHARP = 1e-3
"""The deviation of a frequency over the fundamental below which a mode at a line warns."""

SURE = 1.5e-4
"""That below which it fails: one in a hundred modes that do not decay is as near to some line by chance."""

ROUNDING = 1e-9
"""What is rounding of a frequency, over the fundamental."""

POINTS = 400
"""Frequencies of transfer functions where none are named, evenly spaced, beside those at resonances."""

BESIDE = (-3.0, -1.0, -0.5, 0.0, 0.5, 1.0, 3.0)
"""Frequencies beside a resonance, in half-widths of it."""

FAINT = 0.03
"""The share of the strongest way of an input through a mode below which its resonance is not sought."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExcitedAnalysis(Told, Drawn, Rebuilt):
    """Result for records whose excitation goes on: what those with measured inputs and of outputs alone share.

    Parameters
    ----------
    settings
        The options used.
    records
        The records used, inputs among their channels.
    model
        The periodic model, with its `inputs` where some were measured.
    fit
        The fit and its joint covariance, from which other deviations are made.
    noise
        The deviation of what is left of each output (outputs, 1) [units of the channels].
    held_out
        The rms error of prediction over that expected, of each output, on the last quarter of each record by a fit to
        the rest (outputs,); NaN where that was not asked for.
    findings
        What was done, and what a reader must know.
    state
        Φ, A(t) and B(t) with deviations, when states were asked for; None where they do not fit the modes, which a
        finding says.
    refinement
        The fit of A(t) with a structure, when one was asked for; its `state` is this one.
    """

    settings: Settings
    records: tuple[Record, ...]
    model: PeriodicModel
    fit: Uncertainty | Fit
    noise: NDArray[np.float64]
    held_out: NDArray[np.float64]
    findings: tuple[Finding, ...] = ()
    state: StateModel | None = None
    refinement: Refinement | None = None

    def __post_init__(self) -> None:
        self._freeze(noise=("outputs", 1))
        self._freeze(held_out=("outputs",), finite=False)

    def __repr__(self) -> str:
        model, checked = self.model, not np.isnan(self.held_out).any()
        verdict = ("passes" if self.passed else "does not pass") if checked else "not checked"
        size = f"order={model.order}, period={model.period:.4g} s, outputs={len(model.channels)}"
        return f"{type(self).__name__}({size}, inputs={len(self.inputs)}: {verdict})"

    def _figures(self) -> Drawings:
        found: Drawings = {"exponents": (self.model, {})}
        if self.inputs:
            found["transfer"] = (self.transfer, {})
        if self.state is not None:
            found["system_elements"] = (self.state, {"period": self.model.period, "channels": self.model.channels})
        return found

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """The channels that are measured inputs."""
        return () if self.model.inputs is None else self.model.inputs.channels

    @property
    def measured_clock(self) -> bool:
        """True where the angle of the shaft was measured."""
        return not isinstance(self.records[0].clock, ConstantPeriod)

    @property
    def passed(self) -> bool:
        """True where samples that were left out are predicted as expected, and nothing was found against the model."""
        return bool((self.held_out < HELD_OUT).all()) and not self.failed

    @property
    def failed(self) -> bool:
        """True where something was found against the model, samples left out aside."""
        return any(own.severity is Severity.FAILURE for own in self.findings)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the model does not pass, a sentence each; they are among the warnings. None where it was not checked."""
        return texts([own for own in self.findings if own.severity is Severity.FAILURE or own.code in UNPREDICTED])

    @property
    def synchronisation(self) -> tuple[str, ...]:
        """Notes on the clock of the records, and on what was done to them and found, a sentence each."""
        return texts(self.findings, Severity.NOTE)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to a reader of the result, a sentence each."""
        return (*texts(self.findings, Severity.FAILURE), *texts(self.findings, Severity.WARNING))

    @property
    def provenance(self) -> Provenance:
        """Sources and steps of the result."""
        return self.model.provenance

    def transfer(
        self,
        frequencies_hz: ArrayLike | None = None,
        harmonics: ArrayLike = (-2, -1, 0, 1, 2),
        *,
        sampled: bool = False,
    ) -> TransferFunctions:
        r"""The harmonic transfer functions from the measured inputs with their deviations.

        .. math:: u(t) = e^{i \Omega t} \;\to\; y(t) = \sum_m G_m(\Omega)\, e^{i (\Omega + m \omega) t}

        Parameters
        ----------
        frequencies_hz
            Ω/2π (frequencies,) [Hz]; by default up to twice the highest frequency of a mode, at most half the rate,
            closer together at resonances.
        harmonics
            The integers m (harmonics,).
        sampled
            True for that of samples, the hold of the inputs and what is folded included: what `measure_transfer` finds.

        Returns
        -------
        TransferFunctions
            G, with deviations by all that is uncertain in the model, to first order.

        Raises
        ------
        InputError
            No input was measured, or a frequency is no number.
        """
        of = f"{type(self).__name__}.transfer"
        if not self.inputs:
            raise input_error("self", of, "have measured inputs", "is of outputs alone", "Name them: `inputs=`.")
        hertz = _frequencies_of(frequencies_hz, self.model, self.records, of)
        turns = np.unique(np.atleast_1d(np.asarray(harmonics, np.int64)))
        return self.fit.transfer(self.model.channels, self.inputs, hertz, turns, sampled=sampled)

    def reconstruct(
        self,
        states: Names,
        *,
        form: Form = "second-order",
        delay: float | None = None,
        harmonics: Literal["auto", "model"] | int = "auto",
        times: ArrayLike | int = 50,
    ) -> StateModel:
        r"""The state transition matrix, A(t), and of measured inputs B(t), C(t) and D(t), in chosen channels.

        .. math:: \dot x = A(t)\, x + B(t)\, u, \qquad A(t) = (\dot\Psi + \Psi\Lambda)\, \Psi^{-1}, \qquad
                  B(t) = \Psi(t)\, b(t)

        as `floquid.reconstruct` gives them, which has the errors; without deviations where the model fails: what it
        leaves is no noise.

        Parameters
        ----------
        states, form, delay, harmonics, times
            Those of `floquid.reconstruct`.
        """
        found = reconstruct(self.model, states, form=form, delay=delay, harmonics=harmonics, times=times)
        return found.without_deviations() if self.failed else found


Kind = TypeVar("Kind", bound=ExcitedAnalysis)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class DrivenAnalysis(ExcitedAnalysis):
    """Result of `identify_driven`: of records with measured inputs, noise that of the sensors.

    Parameters
    ----------
    settings, records, model, fit, noise, held_out, findings, state, refinement
        Those of every `ExcitedAnalysis`.
    """

    fit: Uncertainty


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class AmbientAnalysis(ExcitedAnalysis):
    """Result of `identify_ambient`: of records whose excitation nobody measured, or not all of it.

    Coefficients of the model are those of a state of rms 1, the largest of each mode real and of no deviation.

    Parameters
    ----------
    settings, records, model, fit, noise, held_out, findings, state, refinement
        Those of every `ExcitedAnalysis`, the fit in innovations form.
    lengths
        Duration of a record that gives the damping of each mode to 10 % (modes,) [s].
    """

    fit: Fit
    lengths: NDArray[np.float64]

    def __post_init__(self) -> None:
        ExcitedAnalysis.__post_init__(self)
        self._freeze(lengths=("modes",), finite=False)

    def _figures(self) -> Drawings:
        return super(AmbientAnalysis, self)._figures() | {"harmonic_spectra": (self, {})}


def finished(analysis: Kind, periods_of_turn: float, report: Callable[[str], None]) -> Kind:
    """The result with findings on modes that are lines, and A(t) in the states of its settings where it has some.

    `periods_of_turn` are the periods of a revolution as far as they were said.
    """
    analysis = replace(analysis, findings=(*analysis.findings, *_lines_found(analysis, periods_of_turn)))
    if not analysis.settings.states:
        return analysis
    if analysis.failed and analysis.settings.structure:
        why = "A structure is fitted by the deviations of the model, and one that fails has none to quote."
        return replace(analysis, findings=(*analysis.findings, warning("states_unfit", reason=why)))
    try:
        state, refinement = state_of(analysis.model, analysis.settings, analysis.fit.estimates_at, report)
    except FloquidError as error:  # how many states the modes need was not known before the search
        missing = warning("states_unfit", reason=str(error).splitlines()[0])
        return replace(analysis, findings=(*analysis.findings, missing))
    if analysis.failed and state is not None:  # what the model leaves is no noise
        state = state.without_deviations()
    return replace(analysis, state=state, refinement=refinement)


def _lines_found(analysis: ExcitedAnalysis, periods_of_turn: float) -> tuple[Finding, ...]:
    """Findings on modes that do not decay at a fraction of the fundamental, as lines of a revolution are."""
    model = analysis.model
    std = model.exponent_std
    if std is None or analysis.settings.forced != "auto":
        return ()
    still = np.abs(model.exponents.real) < STILL * std.real
    still &= np.abs(model.exponents.real) * max(record.duration for record in analysis.records) < 1.0
    sharp = std.imag < SHARP * model.fundamental
    # The frequency of a real multiplier is none measured; no input reaches what drives the system itself.
    unreached = [own.numbers["frequency"] for own in analysis.findings if own.code.startswith("unreached")]
    apart = np.isclose(np.abs(model.exponents)[:, None], 2.0 * np.pi * np.array(unreached), rtol=1e-9).any(axis=1)
    known = (std.imag < SURE * model.fundamental) & (~model.real | apart)
    turns, found = model.exponents.imag / model.fundamental, []
    for count in range(2, MOST_PERIODS + 1):
        near = np.rint(turns * count).astype(np.int64)
        off = np.abs(turns * count - near) * model.fundamental / count
        at = still & sharp & (np.gcd(near, count) == 1) & (off <= STILL * std.imag + ROUNDING * model.fundamental)
        if at.any():
            hertz = np.unique(np.abs(model.exponents.imag[at])) / (2.0 * np.pi)
            told = failure if known[at].any() else warning
            real = bool(model.real[at].any())
            # Where the revolution was said they are weak, and were left out: their numbers in it.
            lines = np.unique(np.rint(np.abs(turns[at]) * periods_of_turn)).astype(int).tolist()
            forced = lines if periods_of_turn % count == 0.0 else []
            found.append(told("line_as_mode", frequencies=hertz.tolist(), periods=count, real=real, forced=forced))
    return tuple(found)


def _frequencies_of(
    asked: ArrayLike | None, model: PeriodicModel, records: tuple[Record, ...], of: str
) -> NDArray[np.float64]:
    """Frequencies of transfer functions [Hz]: those asked for, or some to beyond the highest mode (frequencies,)."""
    if asked is None:
        highest = max(2.0 * model.frequencies_hz.max(initial=0.0), 1.0 / model.period)
        most = min(highest, 0.5 * min(record.sample_rate for record in records))
        even, peaks = np.linspace(most / POINTS, most, POINTS), _peaks(model)
        asked = np.unique(np.concatenate([even, peaks[(peaks > 0.0) & (peaks < most)]]))
    return frozen_array(np.atleast_1d(np.asarray(asked, float)), "frequencies_hz", of, axes=("frequencies",))


def _peaks(model: PeriodicModel) -> NDArray[np.float64]:
    """Frequencies of the inputs at and beside the resonances of the modes [Hz], by every harmonic that is strong.

    An even grid misses the top of those that are narrower than its steps.
    """
    own = model.inputs
    assert own is not None
    strength = np.abs(own.coefficients * np.abs(model.coefficients).max(axis=(1, 2, 3), initial=0.0)[:, None, None])
    reached = (strength > FAINT * strength.max(axis=(0, 2), keepdims=True)).any(axis=1)
    rates = model.exponents.imag[:, None] - own.harmonics * model.fundamental
    beside = np.multiply.outer(np.abs(model.exponents.real), BESIDE)
    return (rates[:, :, None] + beside[:, None, :])[reached].ravel() / (2.0 * np.pi)
