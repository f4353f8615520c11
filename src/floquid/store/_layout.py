"""Layout of a result file by type: its datasets by the names of fields, "axes; unit" each, and its groups."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from floquid.checks import Validation
from floquid.comparison import ComparedPoint, Comparison, Direction, Misfit, Pair, Updated
from floquid.core import CLOCKS, Channel, Estimates, Gains, ModelInputs, PeriodicModel, Provenance, Record
from floquid.innovations import Mode
from floquid.inputs import InputMode, TransferFunctions
from floquid.lti import Composites, ModalModel
from floquid.monitoring import Amounts, Change, Charts, Monitor, Part, Trend
from floquid.order import Choice
from floquid.periodic import Fit, ForcedResponse, PartialTests, Periodicity
from floquid.pipeline import Analysis
from floquid.reconstruction import Refinement, StateModel
from floquid.surveys import Edge, Point, Survey, Track
from floquid.sync import AngleSpline, ShaftAngle
from floquid.transfer import MeasuredTransfer, TransferFit

VERSION = 4

KINDS: dict[str, Any] = {own.kind: own for own in (Survey, Comparison, Updated, Monitor, MeasuredTransfer, TransferFit)}
"""Types of results by the attribute `kind` of their files; that of an analysis has none."""

ABSENT = (
    "later", "point", "fitted", "rounded", "shapes", "turn", "branch", "begins", "agreement", "whirl_interval",
    "leak_interval", "confidence", "marks",
)  # fmt: skip
"""Fields that files from before them lack."""

FLAGS = (
    "alarm", "along", "baseline", "constrained", "counted", "cycles", "extrapolated", "fitted", "independent",
    "is_converged", "kept", "mirrored", "passed", "real", "shared", "speed_dependent", "steady", "weak",
)  # fmt: skip
"""HDF5 has no truth values: these are 0 and 1."""

TEXTS = (
    "name", "quantity", "unit", "location", "direction", "sources", "steps", "names", "states", "channel", "channels",
    "outcome", "coordinates", "jitter_unit", "at_least", "kind", "structure", "findings", "warnings", "method",
    "hold", "place", "files", "reason", "over", "notes", "marks",
)  # fmt: skip
"""Names of datasets of text, beside those of fields that are declared as such."""

_UNIT = "that of the channel"

SHAPE, DIRECT = "outputs, harmonics; that of the output", "outputs, inputs; that of the output over the input"
"""Places of the amplitudes of a mode that was fitted to lines, and of the direct term at one harmonic."""

LAYOUT: dict[type, dict[str, str | type | list[type]]] = {
    Channel: dict.fromkeys(("name", "quantity", "unit", "location", "direction", "place"), "channels"),
    Provenance: {"sources": "sources", "steps": "steps"},
    Record: {
        "values": f"channels, samples; {_UNIT}",
        "sample_rate": "; Hz",
        "start": "; s",
        "channels": Channel,
        "provenance": Provenance,
        "point": dict,
    },
    **{kind: {own.name: own.metadata.get("stored", "") for own in fields(kind)} for kind in CLOCKS},
    ModalModel: {
        "multipliers": "modes",
        "residues": f"modes, outputs, inputs; {_UNIT}",
        "dt": "; s",
        "covariance": "2 modes, 2 modes; 1/s^2",
        "residue_spread": "inputs, modes, modes",
        "residue_slope": "inputs, modes, modes",
        "residual_std": f"outputs, inputs; {_UNIT}",
        "outcome": "",
        "stats": dict,
        "composites": Composites,
    },
    Composites: {"angles": "lines; rad/period", "data": "lines", "model": "lines", "difference": "lines"},
    Choice: {"findings": "findings"},
    PeriodicModel: {
        "exponents": "modes; 1/s",
        "coefficients": f"modes, channels, hits, harmonics; {_UNIT}",
        "harmonics": "harmonics",
        "period": "; s",
        "covariance": "2 modes, 2 modes; 1/s^2",
        "coefficient_std": f"modes, channels, hits, harmonics; {_UNIT}",
        "estimates": Estimates,
        "unselected": Estimates,
        "channels": Channel,
        "provenance": Provenance,
        "inputs": ModelInputs,
        "point": dict,
    },
    ModelInputs: {
        "channels": Channel,
        "coefficients": "modes, inputs, harmonics; 1/s over that of the input",
        "harmonics": "harmonics",
        "coefficient_std": "modes, inputs, harmonics; 1/s over that of the input",
        "direct": "channels, inputs, harmonics; that of the channel over that of the input",
        "direct_harmonics": "harmonics",
        "initial": "modes, records",
        "begins": "records; s",
    },
    Analysis: {"model": PeriodicModel, "state": StateModel, "findings": "findings"},
    TransferFunctions: {
        "frequencies_hz": "frequencies; Hz",
        "harmonics": "harmonics",
        **dict.fromkeys(
            ("values", "std"), "harmonics, outputs, inputs, frequencies; that of the output over the input"
        ),
        "outputs": Channel,
        "inputs": Channel,
        "step": "; s",
    },
    MeasuredTransfer: {
        "transfer": TransferFunctions,
        "period": "; s",
        "method": "",
        "noise": "outputs, frequencies; that of the output",
        "coherence": "outputs, frequencies",
        "nonlinear": "outputs",
        "echoes": "records, inputs, frequencies",
        "begins": "records; s",
        "findings": "findings",
    },
    TransferFit: {
        "measured": TransferFunctions,
        "model": PeriodicModel,
        "covariance": "numbers, numbers",
        "hold": "",
        "begins": "records; s",
        "chi_square": "",
        "degrees": "",
        "findings": "findings",
    },
    Survey: {
        "over": "",
        "confidence": "",
        "notes": "sentences",
        "warnings": "sentences",
        "unlinked": "modes, point and mode",
        "points": [Point],
        "tracks": [Track],
        "edges": [Edge],
        "shapes": "json",
    },
    Point: {
        "values": dict,
        "files": "files",
        "marks": "marks",
        "passed": "",
        "weak": "modes",
        "reason": "",
        "whirl": "modes, two",
        "names": "modes",
        "blades": "modes, four",
        **dict.fromkeys(("whirl_interval", "leak_interval"), "modes, ends"),
        "agreement": "modes",
        "model": PeriodicModel,
    },
    Track: {
        "name": "",
        "points": "places",
        "modes": "places, multipliers",
        **dict.fromkeys(("exponents", "exponent_std"), "places, multipliers; 1/s"),
        **dict.fromkeys(("shifts", "mirrored", "weak", "confidence", "mac", "cost", "runner_up"), "places"),
        **dict.fromkeys(("whirl", "whirl_std", "names", "name_share", "leak", "leak_std"), "places"),
        **dict.fromkeys(("whirl_interval", "leak_interval"), "places, ends"),
    },
    Edge: {
        **dict.fromkeys(("value", "std", "kind", "direction"), ""),
        **dict.fromkeys(("interval", "between"), "ends"),
        "tracks": "tracks",
    },
    Comparison: {
        **dict.fromkeys(("a", "b", "over", "chi2", "dof", "p", "independent"), ""),
        **dict.fromkeys(("missing_in_a", "missing_in_b"), "modes, point and mode"),
        "warnings": "sentences",
        "points": [ComparedPoint],
        "pairs": [Pair],
    },
    ComparedPoint: {
        "value": "",
        **dict.fromkeys(("model_a", "model_b"), PeriodicModel),
        **dict.fromkeys(("modes_a", "modes_b"), "objects, multipliers"),
        "macs": "objects of a, objects of b",
        "turn": "",
    },
    Pair: {
        **dict.fromkeys(("point", "a", "b", "z", "mac", "mac_noise", "counted"), ""),
        **dict.fromkeys(("exponent_a", "exponent_b", "difference", "std"), "; 1/s"),
    },
    Updated: {
        **dict.fromkeys(("values", "start", "used"), Mapping),
        "covariance": "parameters, parameters",
        **dict.fromkeys(("chi2", "dof", "p", "steps", "is_converged"), ""),
        "unidentifiable": [Direction],
        "misfits": [Misfit],
        "warnings": "sentences",
    },
    Direction: {"weights": Mapping, "std": ""},
    Misfit: {"point": "", "mode": "", "frequency_hz": "; Hz", "z": ""},
    Monitor: {
        **dict.fromkeys(("files", "x", "baseline", "alarm", "reasons"), "records"),
        **dict.fromkeys(("over", "rate"), ""),
        "covariates": "covariates",
        "conditions": "records, covariates",
        "charts": Charts,
        "amounts": Amounts,
        "change": Change,
        "warnings": "sentences",
    },
    Charts: {
        **dict.fromkeys(("features", "units"), "features"),
        **dict.fromkeys(("values", "std", "residual", "residual_std"), "records, features; that of the feature"),
        **dict.fromkeys(("t2", "t2_limit", "ewma", "ewma_limit", "directed", "directed_limit"), "records"),
        **dict.fromkeys(("leverage", "extrapolated"), "records"),
        "terms": "terms",
        "scatter_directions": "",
    },
    Amounts: {
        **dict.fromkeys(("value", "std", "low", "high", "carried_by", "average", "average_limit"), "records"),
        "along": "",
        "trend": Trend,
    },
    Trend: dict.fromkeys(("slope", "std", "p_value"), ""),
    Change: {"index": "", "interval": "ends", "kind": "", "gain": "", "carried_by": [Part]},
    Part: dict.fromkeys(("feature", "unit", "size", "std"), ""),
    InputMode: {
        "exponent": "; 1/s",
        "real": "",
        "reach": "harmonics of the inputs",
        "gains": "inputs, harmonics of the inputs; 1/s over that of the input",
        "turns": "harmonics",
        "initial": "records",
        "sizes": "inputs",
    },
    Mode: {
        "exponent": "; 1/s",
        "real": "",
        "turns": "harmonics",
        "shape": f"channels, harmonics; {_UNIT}",
        "reach": "harmonics of the inputs",
        "gains": "inputs and innovations, harmonics of the inputs",
    },
    Estimates: {
        "exponents": "modes; 1/s",
        "real": "modes",
        "fundamental": "; rad/s",
        "modes": "terms",
        "harmonics": "terms",
        "coefficients": f"terms, channels, hits; {_UNIT}",
        "covariance": "parameters, parameters; 1/s^2",
        "slopes": f"terms, channels, hits, parameters; {_UNIT} times s",
        "spread": "blocks, 2 terms, 2 terms",
        "blocks": "channels, hits",
        "scales": f"terms, channels, hits; {_UNIT}",
        "drift": "blocks, 2 terms, 2 terms; s",
        "bend": "terms, channels, hits; s",
        "shared": "",
        "gains": Gains,
    },
    Gains: {
        "harmonics": "harmonics of the inputs",
        "coefficients": "modes, inputs, harmonics of the inputs; 1/s over that of the input",
        "slopes": "modes, inputs, harmonics of the inputs, parameters",
    },
    Fit: {
        "noise": f"channels, hits; {_UNIT}",
        "period_std": "; s",
        "own_period": "difference and deviation",
        "constrained": "",
        "misfit": "",
        "whitening": "channels, taps",
        "findings": "findings",
        "warnings": "findings",
        "later": "hits",
    },
    ForcedResponse: {
        "harmonics": "harmonics",
        "coefficients": f"channels, hits, harmonics; {_UNIT}",
        "coefficient_std": f"channels, hits, harmonics; {_UNIT}",
        "offset": f"channels, hits; {_UNIT}",
        "offset_std": f"channels, hits; {_UNIT}",
        "drift": f"channels, hits; {_UNIT} a second",
        "drift_std": f"channels, hits; {_UNIT} a second",
        "revolution": "; s",
        "speed_dependent": "",
    },
    ShaftAngle: {
        "periods_per_revolution": "",
        "times": "pulses; s",
        "residuals": "pulses; rad",
        "lines": "pulses",
        "kept": "pulses",
        "jitter": "; that of jitter_unit",
        "jitter_unit": "",
        "geometry": "lines; rad",
        "geometry_std": "lines; rad",
        **dict.fromkeys(("n_pulses", "missing", "doubled", "rejected", "wander", "steady"), ""),
        "rounded": "; s",
        "findings": "findings",
        "spline": AngleSpline,
    },
    AngleSpline: {
        "first": "; s",
        "last": "; s",
        "slope": "; rad/s",
        "knots": "knots",
        "coefficients": "coefficients; rad",
        "degree": "",
        "covariance": "coefficients, coefficients; rad^2",
    },
    Validation: {
        "passed": "",
        "findings": "findings",
        **dict.fromkeys(("fit", "held_out_error", "colour"), "channels, hits"),
        "turns": "tones",
        "tones": "channels, hits, tones",
        "modes": "lines",
        "harmonics": "lines",
        "lines": "channels, hits, lines",
        "metrics": dict,
    },
    Periodicity: {
        **dict.fromkeys(("statistic", "p_value", "level", "power", "degrees", "spacing_p"), ""),
        "harmonics": "harmonics",
        "exponents": "modes; 1/s",
        "channels": "channels",
        "sizes": "modes, harmonics",
        "limits": "modes, harmonics",
        "untested": "cases, mode and harmonic",
        "locked": "modes",
        **dict.fromkeys(("by_harmonic", "by_mode", "by_channel"), PartialTests),
    },
    PartialTests: dict.fromkeys(("statistics", "p_values", "adjusted", "degrees"), "parts"),
    StateModel: {
        "times": "times; s",
        "transition": "times, states, states",
        "system": "times, states, states; 1/s in the units of the states",
        "condition": "times",
        "states": "states",
        "system_std": "times, states, states; 1/s in the units of the states",
        "coordinates": "",
        "transition_std": "times, states, states",
        "provenance": Provenance,
        "inputs": "times, states, inputs",
        "outputs": "times, channels, states",
        "direct": "times, channels, inputs",
        "inputs_std": "times, states, inputs",
    },
    Refinement: {
        "parameters": "parameters; 1/s to a power, in the units of the states",
        "names": "parameters",
        "covariance": "parameters, parameters",
        "exponents": "modes; 1/s",
        "exponent_std": "modes; 1/s",
        "chi_square": "",
        "degrees": "",
        "p_value": "",
        "findings": "findings",
    },
}
