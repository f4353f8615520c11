"""`summary.json`: a result in the numbers that other programs want."""

from __future__ import annotations

from typing import Any

from floquid._arrays import Floats
from floquid._json import for_json
from floquid.core import PeriodicModel
from floquid.findings import as_mapping
from floquid.order import Choice
from floquid.periodic import ForcedResponse, PartialTests, Periodicity, participation
from floquid.pipeline import AmbientAnalysis, Analysis, ExcitedAnalysis
from floquid.reconstruction import Refinement, StateModel, text_of
from floquid.validation import Validation


def summary(analysis: Analysis | ExcitedAnalysis) -> dict[str, Any]:
    """The content of `summary.json`: plain numbers, lists and texts for `json.dump`; what is not computed is None.

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
    structure, that structure, its parameters, and how well it fits.

    Where the excitation goes on, `inputs` has, of each mode, its `coefficients` b over the inputs' `harmonics` with
    deviations, and the `direct` term, and is null where none were measured; `system` has B(t), C(t) and D(t)
    beside A(t), its `inputs`, `outputs` and `direct` (times, …); `lengths` are the durations of a record
    that would give each damping to 10 % [s], null with measured inputs alone.

    `analysis` is what `identify`, `identify_driven` or `identify_ambient` found.
    """
    return for_json(_free(analysis) if isinstance(analysis, Analysis) else _excited(analysis))


def _free(analysis: Analysis) -> dict[str, Any]:
    """The summary of free responses."""
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
        "noise_whitening": analysis.whitening,
        "modes": mode_entries(model, weights),
        "periodicity": None if analysis.periodicity is None else _periodicity(analysis.periodicity),
        "forced": None if analysis.fit.forced is None else _forced(analysis.fit.forced),
        "interference": [dict(own.numbers) for own in analysis.fit.findings if own.code == "interference"],
        "synchronisation": analysis.synchronisation,
        "system": None if analysis.state is None else _system(analysis.state, analysis.refinement),
        "validation": None if analysis.validation is None else _validation(analysis.validation),
        "warnings": analysis.warnings,
        "findings": [as_mapping(own) for own in analysis.findings],
    }


def _excited(analysis: ExcitedAnalysis) -> dict[str, Any]:
    """The summary of a record whose excitation goes on."""
    model, own = analysis.model, analysis.model.inputs
    return {
        "format": "floquid-summary-driven/1",
        "period": model.period,
        "order": model.order,
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in model.channels],
        "modes": mode_entries(model, 1.0 / analysis.noise),
        "excitation": analysis.settings.excitation,
        "inputs": None
        if own is None
        else {
            "channels": [{"name": channel.name, "unit": channel.unit} for channel in own.channels],
            "hold": analysis.settings.hold,
            "harmonics": own.harmonics,
            "coefficients": own.coefficients,
            "coefficients_std": own.coefficient_std,
            "direct_harmonics": own.direct_harmonics,
            "direct": own.direct,
            "initial": own.initial,
        },
        "noise": analysis.noise[:, 0],
        "lengths": analysis.lengths if isinstance(analysis, AmbientAnalysis) else None,
        "system": None if analysis.state is None else _system(analysis.state, analysis.refinement),
        "held_out_error": analysis.held_out,
        "passed": analysis.passed,
        "warnings": analysis.warnings,
        "findings": [as_mapping(finding) for finding in analysis.findings],
    }


def _forced(forced: ForcedResponse) -> dict[str, Any]:
    """Harmonics of the revolution; coefficients [re, im] (channels, hits, harmonics); offset and drift a second."""
    return {
        "revolution": forced.revolution,
        "harmonics": forced.harmonics,
        "coefficients": forced.coefficients,
        "coefficients_std": forced.coefficient_std,
        "offset": forced.offset,
        "drift": forced.drift,
    }


def _periodicity(found: Periodicity) -> dict[str, Any]:
    """The test over all, its parts, and sizes and limits (modes, harmonics); null where a harmonic was not tested."""

    def parts(of: PartialTests) -> dict[str, Any]:
        return {
            "statistic": of.statistics,
            "degrees": of.degrees,
            "p": of.p_values,
            "p_adjusted": of.adjusted,
        }

    return {
        "periodic": found.periodic,
        "p": found.p_value,
        "statistic": found.statistic,
        "degrees": found.degrees,
        "level": found.level,
        "power": found.power,
        "spacing_p": found.spacing_p,
        "harmonics": found.harmonics,
        "exponents": found.exponents,
        "channels": found.channels,
        "by_harmonic": parts(found.by_harmonic),
        "by_mode": parts(found.by_mode),
        "by_channel": parts(found.by_channel),
        "sizes": found.sizes,
        "limits": found.limits,
        "untested": found.untested,
        "locked": found.locked,
        "sentences": found.sentences,
    }


def _choice(choice: Choice) -> dict[str, Any]:
    return {
        "ambiguous": choice.ambiguous,
        "reasons": choice.reasons,
        "doubts": choice.doubts,
        "findings": [as_mapping(own) for own in choice.findings],
    }


def mode_entries(model: PeriodicModel, weights: Floats) -> list[dict[str, Any]]:
    """The modes as `summary` has them; `weights` (channels, hits) are one over the noise."""
    columns = {
        "exponent": model.exponents,
        "exponent_std": model.exponent_std,
        "principal": model.principal(),
        "multiplier": model.multipliers,
        "multiplier_std": model.multiplier_std,
        "frequency_hz": model.frequencies_hz,
        "frequency_std_hz": model.frequency_std_hz,
        "damping_ratio": model.damping_ratios,
        "damping_ratio_std": model.damping_ratio_std,
    }
    listed = []
    for r in range(model.order):
        harmonics, shares = participation(model, r, weights)
        own = {name: None if values is None else values[r] for name, values in columns.items()}
        listed.append(own | {"harmonics": harmonics, "participation": shares})
    return for_json(listed)


def _system(state: StateModel, refinement: Refinement | None) -> dict[str, Any]:
    found = {
        "states": state.states,
        "coordinates": state.coordinates,
        "times": state.times,
        "values": state.system,
        "std": state.system_std,
        "structure": None if refinement is None else _structure(refinement),
    }
    if state.inputs is None:
        return found
    return found | {name: getattr(state, name) for name in ("inputs", "inputs_std", "outputs", "direct")}


def _structure(found: Refinement) -> dict[str, Any]:
    parameters = zip(found.names, found.parameters, found.std, strict=True)
    return {
        "text": text_of(found.structure),
        "chi_square": found.chi_square,
        "degrees": found.degrees,
        "p_value": found.p_value,
        "parameters": [{"name": name, "value": value, "std": std} for name, value, std in parameters],
        "reasons": found.reasons,
        "conditional_on": found.conditional_on,
    }


def _validation(validation: Validation) -> dict[str, Any]:
    return {
        "passed": validation.passed,
        "fit": validation.metrics.get("fit"),
        "reasons": validation.reasons,
        "findings": [as_mapping(own) for own in validation.findings],
        "metrics": validation.metrics,
        "criteria": {
            name: {"at_least" if own.at_least else "at_most": own.limit}
            | ({} if own.failing is None else {"failing": own.failing})
            for name, own in validation.criteria.items()
        },
    }
