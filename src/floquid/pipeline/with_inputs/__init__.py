"""The chains for records whose excitation goes on: measured, or random and not measured."""

from floquid.pipeline.with_inputs._again import ambient_fit as ambient_fit
from floquid.pipeline.with_inputs._again import driven_fit as driven_fit
from floquid.pipeline.with_inputs._again import predicted_rest as predicted_rest
from floquid.pipeline.with_inputs._ambient import identify_ambient
from floquid.pipeline.with_inputs._analysis import HELD_OUT, AmbientAnalysis, DrivenAnalysis, ExcitedAnalysis
from floquid.pipeline.with_inputs._identify import identify_driven
from floquid.pipeline.with_inputs._measure import measure_transfer

__all__ = [
    "HELD_OUT",
    "AmbientAnalysis",
    "DrivenAnalysis",
    "ExcitedAnalysis",
    "identify_ambient",
    "identify_driven",
    "measure_transfer",
]
