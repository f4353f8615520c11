"""`summary.json`: a result in the numbers that other programs want."""

from __future__ import annotations

from typing import Any

from floquid._arrays import Floats
from floquid._json import attributes, for_json
from floquid.core import ModelInputs, PeriodicModel
from floquid.findings import as_mapping
from floquid.order import Choice
from floquid.periodic import ForcedResponse, PartialTests, Periodicity, participation
from floquid.pipeline import Analysis
from floquid.reconstruction import Refinement, StateModel, text_of


def summary(analysis: Analysis) -> dict[str, Any]:
    """The content of `summary.json`: plain numbers, lists and texts for `json.dump`; what is not computed is None.

    Every exponent is listed, conjugates included; a complex number is [real, imaginary]. `participation` is the share
    of each of the mode's `harmonics` in the energy of its shape, channels weighted by the inverse of their noise.
    `forced` has the forced response, `interference` each steady tone that was taken off, `synchronisation` the
    preparation of the record. `warnings` are sentences; `findings` hold them and the notes by code, severity and
    numbers. `validation` has the verdict on the model with its numbers and their limits. `noise_whitening` has the
    filter of each channel that took the colour of the noise off. `periodicity` says whether the response is that of a
    periodic system at all: probabilities, and the share of its mode that each harmonic has and would be seen at.
    `misfit` is what the fit leaves over its noise, null where there is none, and `failed` whether it is so much that
    the model fails: then no exponent and no shape has a deviation. `system` has A(t) over the period and its
    deviations, and its states (`coordinates`). Where it was fitted with a structure, it has that structure, its
    parameters, and the quality of the fit.

    `point` is the operating point by quantity. `excitation` is free, inputs or ambient. `inputs` has, of each mode, its
    `coefficients` b over the inputs' `harmonics` with deviations, and the `direct` term, and is null where none were
    measured; `system` then has B(t), C(t) and D(t) beside A(t), its `inputs`, `outputs` and `direct` (times, …).
    `lengths` are the durations of a record of outputs alone that would give each damping to 10 % [s]. What is of free
    responses alone is null of others.

    `analysis` is what `identify` found.
    """
    model, decay = analysis.model, analysis.decay
    choice, tested, forced = analysis.choice, analysis.periodicity, analysis.forced
    found = {
        "format": "floquid-summary/2",
        "excitation": "ambient" if analysis.ambient else "inputs" if analysis.inputs else "free",
        "period": model.period,
        "period_std": analysis.period_std,
        "point": dict(model.point),
        "misfit": analysis.misfit,
        "failed": analysis.failed,
        "order": model.order,
        "order_choice": None if choice is None else _choice(choice),
        "n_cycles": None if decay is None else max(hit.n_cycles for hit in decay.cycles),
        "n_phases": None if decay is None else decay.cycles[0].n_phases,
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in model.channels],
        "noise": analysis.noise,
        "noise_whitening": analysis.whitening,
        "modes": mode_entries(model, 1.0 / analysis.noise),
        "inputs": None if model.inputs is None else _inputs(model.inputs, analysis.settings.hold),
        "lengths": analysis.lengths,
        "periodicity": None if tested is None else _periodicity(tested),
        "forced": None if forced is None else _forced(forced),
        "interference": [dict(own.numbers) for own in analysis.interference],
        "synchronisation": analysis.synchronisation,
        "system": None if analysis.state is None else _system(analysis.state, analysis.refinement),
        "validation": None if analysis.validation is None else _validation(analysis),
        "warnings": analysis.warnings,
        "findings": [as_mapping(own) for own in analysis.findings],
    }
    return for_json(found)


def _inputs(own: ModelInputs, hold: str) -> dict[str, Any]:
    """The way of the measured inputs to the modes, and their direct term."""
    return {
        "channels": [{"name": channel.name, "unit": channel.unit} for channel in own.channels],
        "hold": hold,
        **attributes(own, "harmonics", "coefficients"),
        "coefficients_std": own.coefficient_std,
        **attributes(own, "direct_harmonics", "direct", "initial", "begins"),
    }


def _forced(forced: ForcedResponse) -> dict[str, Any]:
    """Harmonics of the revolution; coefficients [re, im] (channels, hits, harmonics); offset and drift a second."""
    found = attributes(forced, "revolution", "harmonics", "coefficients")
    return found | {"coefficients_std": forced.coefficient_std} | attributes(forced, "offset", "drift")


def _periodicity(found: Periodicity) -> dict[str, Any]:
    """The test over all, its parts, and sizes and limits (modes, harmonics); null where a harmonic was not tested."""

    def parts(of: PartialTests) -> dict[str, Any]:
        return {"statistic": of.statistics, "degrees": of.degrees, "p": of.p_values, "p_adjusted": of.adjusted}

    return {
        "periodic": found.periodic,
        "p": found.p_value,
        **attributes(
            found, "statistic", "degrees", "level", "power", "spacing_p", "harmonics", "exponents", "channels"
        ),
        **{name: parts(getattr(found, name)) for name in ("by_harmonic", "by_mode", "by_channel")},
        **attributes(found, "sizes", "limits", "untested", "locked", "sentences"),
    }


def _choice(choice: Choice) -> dict[str, Any]:
    findings = [as_mapping(own) for own in choice.findings]
    return attributes(choice, "ambiguous", "reasons", "doubts") | {"findings": findings}


def mode_entries(model: PeriodicModel, weights: Floats) -> list[dict[str, Any]]:
    """The modes as `summary` has them; `weights` (channels, hits) are one over the noise."""
    columns = {
        "exponent": model.exponents,
        "exponent_std": model.exponent_std,
        "principal": model.principal(),
        "multiplier": model.multipliers,
        "multiplier_std": model.multiplier_std,
        "multiplier_interval": model.multiplier_interval,
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
        **attributes(state, "states", "coordinates", "times"),
        "values": state.system,
        "std": state.system_std,
        "structure": None if refinement is None else _structure(refinement),
    }
    return found if state.inputs is None else found | attributes(state, "inputs", "inputs_std", "outputs", "direct")


def _structure(found: Refinement) -> dict[str, Any]:
    parameters = zip(found.names, found.parameters, found.std, strict=True)
    return {
        "text": text_of(found.structure),
        **attributes(found, "chi_square", "degrees", "p_value"),
        "parameters": [{"name": name, "value": value, "std": std} for name, value, std in parameters],
        **attributes(found, "reasons", "conditional_on"),
    }


def _validation(analysis: Analysis) -> dict[str, Any]:
    validation = analysis.validation
    assert validation is not None
    return {
        "passed": analysis.passed,
        "fit": validation.metrics.get("fit"),
        "held_out_error": validation.held_out_error,
        "reasons": analysis.reasons,
        "findings": [as_mapping(own) for own in validation.findings],
        "metrics": validation.metrics,
        "criteria": {
            name: {"at_least" if own.at_least else "at_most": own.limit}
            | ({} if own.failing is None else {"failing": own.failing})
            for name, own in validation.criteria.items()
        },
    }
