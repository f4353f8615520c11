"""`summary.json`: the result in the numbers that other programs want, format `floquid-summary/1`."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.core import PeriodicModel
from floquid.findings import as_mapping
from floquid.order import Choice
from floquid.periodic import ForcedResponse, PartialTests, Periodicity, participation
from floquid.pipeline import Analysis
from floquid.reconstruction import Refinement, StateModel, text_of
from floquid.validation import Validation


def summary(analysis: Analysis) -> dict[str, Any]:
    """The content of `summary.json`: plain numbers, lists and texts; what is not computed is None.

    Every exponent is listed, conjugates included; a complex number is [real, imaginary]. `participation` is the share
    of each of the mode's `harmonics` in the energy of its shape, channels weighted by the inverse of their noise.
    `forced` has the forced response beside the free one, `interference` each steady tone that was taken off,
    `synchronisation` what was done to the record and how well it is synchronised, `warnings` what a reader must know,
    `findings` both by code, severity and numbers. `validation` has the verdict on the model with its numbers and their
    limits. `noise_whitening` has the filter of each channel that took the colour of the noise off. `periodicity` says
    whether the response is that of a periodic system at all: probabilities, and the share of its mode that each
    harmonic has and would be seen at. `misfit` is what the fit leaves over its noise, null where there is none, and
    `failed` whether it is so much that the model fails: then no exponent and no shape has a deviation. `system` has
    A(t) over the period and its deviations, what its states are (`coordinates`), and, where it was fitted with a
    structure, that structure, its parameters, and how well it fits. It is ready for `json.dump`. `analysis` is what
    `identify` found.
    """
    model = analysis.model
    weights = 1.0 / analysis.noise
    return {
        "format": "floquid-summary/1",
        "period": model.period,
        "period_std": analysis.period_std,
        "misfit": analysis.misfit,
        "failed": analysis.failed,
        "order": model.order,
        "order_choice": None if analysis.choice is None else _choice(analysis.choice),
        "n_cycles": max(c.n_cycles for c in analysis.cycles),
        "n_phases": analysis.cycles[0].n_phases,
        "noise_whitening": None if analysis.whitening is None else analysis.whitening.tolist(),
        "modes": mode_entries(model, weights),
        "periodicity": None if analysis.periodicity is None else _periodicity(analysis.periodicity),
        "forced": None if analysis.fit.forced is None else _forced(analysis.fit.forced),
        "interference": [dict(own.numbers) for own in analysis.fit.findings if own.code == "interference"],
        "synchronisation": list(analysis.synchronisation),
        "system": None if analysis.state is None else _system(analysis.state, analysis.refinement),
        "validation": None if analysis.validation is None else _validation(analysis.validation),
        "warnings": list(analysis.warnings),
        "findings": [as_mapping(own) for own in analysis.findings],
    }


def _forced(forced: ForcedResponse) -> dict[str, Any]:
    """Harmonics of the revolution; coefficients [re, im] (channels, hits, harmonics); offset and drift a second."""
    return {
        "revolution": forced.revolution,
        "harmonics": forced.harmonics.tolist(),
        "coefficients": _pairs(forced.coefficients),
        "coefficients_std": None if forced.coefficient_std is None else _pairs(forced.coefficient_std),
        "offset": forced.offset.tolist(),
        "drift": forced.drift.tolist(),
    }


def _periodicity(found: Periodicity) -> dict[str, Any]:
    """The test over all, its parts, and sizes and limits (modes, harmonics); null where a harmonic was not tested."""

    def numbers(values: Floats) -> list[list[float | None]]:
        return [[float(value) if np.isfinite(value) else None for value in row] for row in values]

    def parts(of: PartialTests) -> dict[str, Any]:
        return {
            "statistic": of.statistics.tolist(),
            "degrees": of.degrees.tolist(),
            "p": of.p_values.tolist(),
            "p_adjusted": of.adjusted.tolist(),
        }

    return {
        "periodic": found.periodic,
        "p": found.p_value,
        "statistic": found.statistic,
        "degrees": found.degrees,
        "level": found.level,
        "power": found.power,
        "spacing_p": found.spacing_p,
        "harmonics": found.harmonics.tolist(),
        "exponents": _pairs(found.exponents),
        "channels": list(found.channels),
        "by_harmonic": parts(found.by_harmonic),
        "by_mode": parts(found.by_mode),
        "by_channel": parts(found.by_channel),
        "sizes": numbers(found.sizes),
        "limits": numbers(found.limits),
        "untested": found.untested.tolist(),
        "locked": found.locked.tolist(),
        "sentences": list(found.sentences),
    }


def _pairs(values: Complexes) -> list[Any]:
    return np.stack([values.real, values.imag], axis=-1).tolist()


def _choice(choice: Choice) -> dict[str, Any]:
    return {
        "ambiguous": choice.ambiguous,
        "reasons": list(choice.reasons),
        "doubts": list(choice.doubts),
        "findings": [as_mapping(own) for own in choice.findings],
    }


def mode_entries(model: PeriodicModel, weights: Floats) -> list[dict[str, Any]]:
    """The modes as `summary` has them; `weights` (channels, hits) are one over the noise."""
    columns = {
        "exponent": _pairs(model.exponents),
        "exponent_std": None if model.exponent_std is None else _pairs(model.exponent_std),
        "principal": _pairs(model.principal()),
        "multiplier": _pairs(model.multipliers),
        "multiplier_std": None if model.multiplier_std is None else _pairs(model.multiplier_std),
        "frequency_hz": model.frequencies_hz.tolist(),
        "frequency_std_hz": None if model.frequency_std_hz is None else model.frequency_std_hz.tolist(),
        "damping_ratio": model.damping_ratios.tolist(),
        "damping_ratio_std": None if model.damping_ratio_std is None else model.damping_ratio_std.tolist(),
    }
    listed = []
    for r in range(model.order):
        harmonics, shares = participation(model, r, weights)
        own = {name: None if values is None else values[r] for name, values in columns.items()}
        listed.append(own | {"harmonics": harmonics.tolist(), "participation": shares.tolist()})
    return listed


def _system(state: StateModel, refinement: Refinement | None) -> dict[str, Any]:
    return {
        "states": list(state.states),
        "coordinates": state.coordinates,
        "times": state.times.tolist(),
        "values": state.system.tolist(),
        "std": None if state.system_std is None else state.system_std.tolist(),
        "structure": None if refinement is None else _structure(refinement),
    }


def _structure(found: Refinement) -> dict[str, Any]:
    parameters = zip(found.names, found.parameters.tolist(), found.std.tolist(), strict=True)
    return {
        "text": text_of(found.structure),
        "chi_square": found.chi_square,
        "degrees": found.degrees,
        "p_value": found.p_value,
        "parameters": [{"name": name, "value": value, "std": std} for name, value, std in parameters],
        "reasons": list(found.reasons),
    }


def _validation(validation: Validation) -> dict[str, Any]:
    return {
        "passed": validation.passed,
        "fit": validation.metrics.get("fit"),
        "reasons": list(validation.reasons),
        "findings": [as_mapping(own) for own in validation.findings],
        "metrics": dict(validation.metrics),
        "criteria": {
            name: {"at_least" if own.at_least else "at_most": own.limit}
            | ({} if own.failing is None else {"failing": own.failing})
            for name, own in validation.criteria.items()
        },
    }
