"""The result of `identify`, one for every kind of record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import counted, input_error
from floquid._show import Brief, Drawings, Drawn, Told, late
from floquid.checks import Validation
from floquid.core import Channel, Cycles, PeriodicModel, PhaseClock, Provenance, Record
from floquid.findings import Finding, Severity, texts
from floquid.fit import EVIDENT
from floquid.inputs import TransferFunctions
from floquid.lifting import Lifted
from floquid.lti import AbstractIdentifier, ModalModel
from floquid.order import Choice, OrderScan, indicators
from floquid.order import scan as scan_orders
from floquid.periodic import Fit, ForcedResponse, Periodicity
from floquid.pipeline._deviations import Decay, Driven
from floquid.pipeline._frequencies import frequencies_of
from floquid.preparation import Settings, clocks_of
from floquid.reconstruction import AbstractStructure, Form, Names, Refinement, StateModel, reconstruct, refine
from floquid.sync import ShaftAngle

if TYPE_CHECKING:
    import pandas as pd

    from floquid.pipeline.draws import Bootstrap


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Analysis(Told, Drawn, Brief):
    """Result of `identify`, with every intermediate, of whatever kind the records are.

    `summary()` is the text of the terminal, a notebook shows the modes and the verdict, and `plot` has the figures:
    `analysis.plot.exponents()`. Of records without measured inputs `transfer` refuses, of those whose excitation goes
    on what is of decays alone: `cycles`, `lifted`, `modal`, `scan`.

    Parameters
    ----------
    settings
        The options used.
    records
        The records used, as they were measured, with their clocks, inputs among their channels.
    model
        The periodic model of the fit: exponents and shapes, with its `inputs` where some were measured. Of outputs
        alone the state of each mode has an rms of 1, and its largest coefficient is real and without deviation.
    decay
        The fit of free responses and what is seen of them; None where the excitation goes on.
    driven
        The fit of records whose excitation goes on; None of free responses.
    shafts
        The angle of the shaft in each record that has a tachometer or an azimuth.
    state
        Φ and A(t), with inputs B(t), when states were asked for; None where they do not fit the modes, which a finding
        says.
    refinement
        The fit of A(t) with a structure, when one was asked for; its `state` is this one.
    validation
        Whether the model can be believed; None where that was not asked for.
    findings
        What was done to the records and how well they are synchronised (notes), and what a reader of the result must
        know.
    """

    kind: ClassVar[str] = "analysis"  # by it the functions for a result are found
    settings: Settings
    records: tuple[Record, ...]
    model: PeriodicModel
    decay: Decay | None = None
    driven: Driven | None = None
    shafts: tuple[ShaftAngle, ...] = ()
    state: StateModel | None = None
    refinement: Refinement | None = None
    validation: Validation | None = None
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        if (self.decay is None) == (self.driven is None):
            got = "both are given" if self.decay is not None else "none is"
            raise input_error("decay", "Analysis", "be given, or `driven`", got, "`identify` makes an Analysis.")

    def __repr__(self) -> str:
        model = self.model
        sides = counted(len(model.channels), "channel")
        sides += f", {counted(len(self.inputs), 'input')}" if self.inputs else ""
        periods = ", ".join(f"{record.duration / model.period:.4g}" for record in self.records)
        size = f"order={model.order}, period={model.period:.4g} s, {sides}, {periods} periods"
        return f"Analysis({size}: {self.answer})"

    def _repr_html_(self) -> str:
        """The verdict and the table of modes as HTML, for a notebook."""
        return late("reporting", "fragment")(self)

    def _figures(self) -> Drawings:
        found: Drawings = {
            "exponents": (self.model, {}),
            "periodic_shapes": (self.model, {"weights": 1.0 / self.noise}),
        }
        if self.decay is not None:
            own = self.decay
            whole = ["time_record", "spectra", "composite", "synthesis", "synchronisation"]
            found |= dict.fromkeys(whole, (self, {}))
            found["indicators"] = (lambda: indicators(own.lifted.responses, own.modal), {})
        if self.inputs:
            found |= dict.fromkeys(["transfer", "nyquist"], (self.transfer, {}))
        if self.ambient:
            found["harmonic_spectra"] = (self, {})
        if self.state is not None:
            found["system_elements"] = (self.state, {"period": self.model.period, "channels": self.model.channels})
        if self.shafts:
            found["speed"] = (self.shafts[0], {})
        return found

    @property
    def fit(self) -> Fit | Driven:
        """The fit that the model is of."""
        found = self.driven if self.decay is None else self.decay.fit
        assert found is not None
        return found

    @property
    def ambient(self) -> bool:
        """True where excitation that nobody measured was taken account of."""
        return self.settings.excitation == "ambient"

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """The channels that are measured inputs."""
        return () if self.model.inputs is None else self.model.inputs.channels

    def _of_decay(self, name: str) -> Any:
        """A part of the decay, which records whose excitation goes on do not have."""
        if self.decay is None:
            got = "is of records whose excitation goes on"
            remedy = "Lifting takes samples a period apart for a free response: identify a decay, without `inputs`."
            raise input_error("self", f"Analysis.{name}", "be of free responses", got, remedy)
        return getattr(self.decay, name)

    @property
    def cycles(self) -> tuple[Cycles, ...]:
        """The free response cut into periods; InputError where the excitation goes on."""
        return self._of_decay("cycles")

    @property
    def lifted(self) -> Lifted:
        """The free response lifted; InputError where the excitation goes on."""
        return self._of_decay("lifted")

    @property
    def modal(self) -> ModalModel:
        """The modal model of the lifted responses; InputError where the excitation goes on."""
        return self._of_decay("modal")

    @property
    def choice(self) -> Choice | None:
        """Reasons for the order found and against it; None where the order was given, or the excitation goes on."""
        return None if self.decay is None else self.decay.choice

    @property
    def periodicity(self) -> Periodicity | None:
        """The test whether the response is that of a periodic system at all; None where it could not be made."""
        return None if self.decay is None else self.decay.periodicity

    @property
    def forced(self) -> ForcedResponse | None:
        """The forced response that was fitted beside the modes of free responses; None where there is none."""
        return None if self.decay is None else self.decay.fit.forced

    @property
    def interference(self) -> tuple[Finding, ...]:
        """Findings on steady tones that were taken off the response."""
        fitted = self.findings if self.decay is None else self.decay.fit.findings
        return tuple(own for own in fitted if own.code == "interference")

    @property
    def synchronisation(self) -> tuple[str, ...]:
        """Notes on how well the records are synchronised and what was done to them, a sentence each."""
        return texts(self.findings, Severity.NOTE)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to a reader of the result, a sentence each; those that make the model fail are the first."""
        return (*texts(self.findings, Severity.FAILURE), *texts(self.findings, Severity.WARNING))

    @property
    def clocks(self) -> tuple[PhaseClock, ...]:
        """Clock of each response that was fitted."""
        return clocks_of(self.responses, self.shafts)

    @property
    def responses(self) -> tuple[Record, ...]:
        """The responses that the model is of: of decays what is left without the forced response."""
        return self.records if self.decay is None else self.decay.fit.free

    @property
    def constrained(self) -> bool:
        """True where the residues were constrained to their harmonics in the end."""
        return self.decay is None or self.decay.fit.constrained

    @property
    def misfit(self) -> float | None:
        """The rms of what the fit of free responses leaves over the level of its noise: 1 where only noise is left.

        The largest of all channels and hits. A little more has made the deviations of the model as much wider. None
        where residues were left free, and where the excitation goes on: there the noise is what the fit leaves.
        """
        return None if self.decay is None else self.decay.fit.misfit

    @property
    def failed(self) -> bool:
        """True where something was found that makes the model wrong, samples left out aside."""
        return any(own.severity is Severity.FAILURE for own in self.findings)

    @property
    def passed(self) -> bool:
        """True where the model was validated and can be believed."""
        return self.validation is not None and self.validation.passed and not self.failed

    @property
    def answer(self) -> str:
        """The verdict on the model: an answer of its `validation`, "fails", or "not checked"."""
        if self.failed:
            return "fails"
        return "not checked" if self.validation is None else self.validation.answer

    @property
    def reasons(self) -> tuple[str, ...]:
        """Findings against the model, a sentence each, failures first; empty where nothing is left."""
        checked = () if self.validation is None else self.validation.findings
        return texts([*(own for own in self.findings if own.severity is Severity.FAILURE), *checked])

    @property
    def period_std(self) -> float | None:
        """The deviation of the period [s]; None where it was given, and of a model that fails."""
        fitted = None if self.decay is None else self.decay.fit.period_std
        if self.failed or (fitted is None and not self.shafts):
            return None
        return self.shafts[0].period_std if fitted is None else fitted

    @property
    def noise(self) -> Floats:
        """The deviation of the noise (channels, hits) [units of the channels].

        Where the excitation goes on there is one column: what is left of each output, or its innovations.
        """
        if self.decay is not None:
            return self.decay.fit.noise
        assert self.driven is not None
        found = np.array(self.driven.at.noise, float).reshape(-1, 1)
        found.flags.writeable = False
        return found

    @property
    def whitening(self) -> Floats | None:
        """The filter of each channel along the record that made its noise white (channels, taps); None without one."""
        return None if self.decay is None else self.decay.fit.whitening

    @property
    def lengths(self) -> Floats | None:
        """Duration of a record of outputs alone that gives the damping of each mode to 10 % (modes,) [s]; else None."""
        std = self.model.exponent_std
        if not self.ambient or std is None:
            return None
        duration = sum(record.n_samples / record.sample_rate for record in self.records)
        found = duration * (std.real / np.abs(self.model.exponents.real) / EVIDENT) ** 2
        found.flags.writeable = False
        return found

    @property
    def provenance(self) -> Provenance:
        """Sources and steps of the result."""
        return self.model.provenance

    @property
    def point(self) -> Mapping[str, float]:
        """The operating point of the records, by name; `speed_rpm` is that of the clock where they state none."""
        return self.model.point

    @property
    def modes(self) -> pd.DataFrame:
        """The modes as a table of pandas (`exports.modes_frame`): a row a conjugate pair or real mode."""
        return late("exports", "modes_frame")(self)

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
        of = "Analysis.transfer"
        if self.driven is None or not self.inputs:
            raise input_error("self", of, "have measured inputs", "has none", "Identify with them: `inputs=`.")
        hertz = frequencies_of(frequencies_hz, self.model, self.records, of)
        turns = np.unique(np.atleast_1d(np.asarray(harmonics, np.int64)))
        return self.driven.transfer(self.model.channels, self.inputs, hertz, turns, sampled=sampled)

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

    def refine(
        self, states: Names, structure: AbstractStructure | str = "auto", *, times: ArrayLike | int = 50
    ) -> Refinement:
        """A(t) with a structure, fitted to all that the model was estimated from, as `floquid.refine` does.

        Raises InputError where the model has no deviations to fit by, and as `floquid.refine` does.

        Parameters
        ----------
        states, structure, times
            Those of `floquid.refine`.
        """
        return refine(self.model, states, structure, times=times)

    def bootstrap(self, draws: int = 200, **options: Any) -> Bootstrap:
        """The spread of estimates over records drawn from the model: `floquid.bootstrap` of this result.

        Parameters
        ----------
        draws
            How many records are drawn.
        **options
            Those of `floquid.bootstrap`.
        """
        return late("pipeline", "bootstrap")(self, draws=draws, **options)

    def scan(
        self,
        identifier: AbstractIdentifier | None = None,
        orders: Sequence[int] | None = None,
        *,
        report: Callable[[str], None] = lambda _: None,
    ) -> OrderScan:
        """Poles of the lifted responses over many orders, with what stays when the order changes.

        Raises InputError where the excitation goes on, and as `floquid.order.scan` does.

        Parameters
        ----------
        identifier, orders, report
            Those of `floquid.order.scan`.
        """
        return scan_orders(self._of_decay("lifted").responses, identifier, orders, report=report)
