"""Result of the chain, with every intermediate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._show import Brief, Drawings, Drawn, Told
from floquid.core import ConstantPeriod, Cycles, PeriodicModel, Provenance, Record
from floquid.findings import Finding, Severity, texts
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.order import Choice, indicators
from floquid.periodic import Fit, Periodicity
from floquid.pipeline._settings import Settings
from floquid.reconstruction import Refinement, StateModel
from floquid.sync import ShaftAngle
from floquid.validation import Validation

FAILED = 3.0  # times the noise that a fit leaves from which on it is no model of the record: then it has no deviations


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Analysis(Told, Drawn, Brief):
    """Result of `identify`, with every intermediate.

    `summary()` is the text of the terminal, a notebook shows the modes and the verdict, and `plot` has the figures:
    `analysis.plot.spectra()`.

    Parameters
    ----------
    settings
        The options used.
    records
        The records used, as they were measured, with their clocks.
    fit
        The fit: its model, the forced response beside it, and the free response that is left.
    cycles, lifted, modal
        The free response cut into periods, resampled to whole samples a period where it has none; lifted (and whitened
        along the record where the noise is coloured); and the modal model of the lifted responses.
    model
        The periodic model of the fit: exponents and shapes.
    state
        Φ and A(t), when states were asked for.
    refinement
        The fit of A(t) with a structure, when one was asked for; its `state` is this one.
    choice
        What speaks for the order found and against it; None where the order was given.
    shafts
        The angle of the shaft in each record that has a tachometer or an azimuth.
    periodicity
        Whether the response is that of a periodic system at all; None where it could not be tested.
    validation
        Whether the model can be believed; None where that was not asked for.
    findings
        What was done to the records and how well they are synchronised (notes), and what a reader of the result must
        know.
    """

    settings: Settings
    records: tuple[Record, ...]
    fit: Fit
    cycles: tuple[Cycles, ...]
    lifted: Lifted
    modal: ModalModel
    model: PeriodicModel
    state: StateModel | None = None
    refinement: Refinement | None = None
    choice: Choice | None = None
    shafts: tuple[ShaftAngle, ...] = ()
    periodicity: Periodicity | None = None
    validation: Validation | None = None
    findings: tuple[Finding, ...] = ()

    def __repr__(self) -> str:
        found, model = self.validation, self.model
        verdict = "not checked" if found is None else "passes" if found.passed else "does not pass"
        cycles = ", ".join(str(hit.n_cycles) for hit in self.cycles[:4]) + ", …" * (len(self.cycles) > 4)
        size = f"order={model.order}, period={model.period:.4g} s, {len(model.channels)} channels, {cycles} cycles"
        return f"Analysis({size}: {'fails' if self.failed else verdict})"

    def _figures(self) -> Drawings:
        whole = ["time_record", "spectra", "composite", "residues", "coefficients", "synthesis", "synchronisation"]
        found: Drawings = dict.fromkeys(whole, (self, {}))
        found["indicators"] = (lambda: indicators(self.lifted.responses, self.modal), {})
        found["exponents"] = (self.model, {})
        found["periodic_shapes"] = (self.model, {"weights": 1.0 / self.noise})
        if self.state is not None:
            found["system_elements"] = (self.state, {"period": self.model.period, "channels": self.model.channels})
        if self.shafts:
            found["speed"] = (self.shafts[0], {})
        return found

    @property
    def synchronisation(self) -> tuple[str, ...]:
        """Notes on how well the records are synchronised and what was done to them, a sentence each."""
        return texts(self.findings, Severity.NOTE)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to a reader of the result, a sentence each; that the model fails is the first."""
        return (*texts(self.findings, Severity.FAILURE), *texts(self.findings, Severity.WARNING))

    @property
    def clocks(self) -> tuple[ConstantPeriod | ShaftAngle, ...]:
        """Clock of each free response of the fit."""
        return clocks_of(self.fit.free, self.shafts)

    @property
    def constrained(self) -> bool:
        """True where the residues were constrained to their harmonics in the end."""
        return self.fit.constrained

    @property
    def misfit(self) -> float | None:
        """The rms of what the fit leaves over the level of its noise: 1 where only noise is left.

        The largest of all channels and hits. A little more has made the deviations of the model as much wider. None
        where residues were left free.
        """
        return self.fit.misfit

    @property
    def failed(self) -> bool:
        """True where the fit leaves so many times the noise that the model is none of the record."""
        return fails(self.fit)

    @property
    def passed(self) -> bool:
        """True where the model was validated and can be believed."""
        return self.validation is not None and self.validation.passed and not self.failed

    @property
    def reasons(self) -> tuple[str, ...]:
        """What validation has against the model, a sentence each; empty where nothing is left."""
        return () if self.validation is None else self.validation.reasons

    @property
    def period_std(self) -> float | None:
        """The deviation of the period [s]; None where it was given, and of a model that fails."""
        if self.failed or (self.fit.period_std is None and not self.shafts):
            return None
        return self.shafts[0].period_std if self.fit.period_std is None else self.fit.period_std

    @property
    def noise(self) -> NDArray[np.float64]:
        """The deviation of the noise (channels, hits) [units of the channels]."""
        return self.fit.noise

    @property
    def whitening(self) -> NDArray[np.float64] | None:
        """The filter of each channel along the record that made its noise white (channels, taps); None without one."""
        return self.fit.whitening

    @property
    def provenance(self) -> Provenance:
        """Sources and steps of the result."""
        return self.model.provenance


def fails(found: Fit) -> bool:
    """True where a fit leaves so many times the noise that its model is none of the record."""
    return found.misfit is not None and found.misfit >= FAILED


def clocks_of(responses: Sequence[Record], shafts: tuple[ShaftAngle, ...]) -> tuple[ConstantPeriod | ShaftAngle, ...]:
    """Clock of each response: the angle of its shaft, unless it has a constant period of its own."""
    return tuple(own.clock for own in responses if isinstance(own.clock, ConstantPeriod)) or shafts
