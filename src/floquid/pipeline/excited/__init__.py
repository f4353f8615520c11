"""The chains for records whose excitation goes on: measured, or random and not measured."""

from floquid.pipeline.excited._again import ambient_fit as ambient_fit
from floquid.pipeline.excited._again import driven_fit as driven_fit
from floquid.pipeline.excited._again import predicted_rest as predicted_rest
from floquid.pipeline.excited._ambient import identify_ambient
from floquid.pipeline.excited._analysis import HELD_OUT, AmbientAnalysis, DrivenAnalysis, ExcitedAnalysis
from floquid.pipeline.excited._identify import identify_driven
from floquid.pipeline.excited._measure import measure_transfer

__all__ = [
    "HELD_OUT",
    "AmbientAnalysis",
    "DrivenAnalysis",
    "ExcitedAnalysis",
    "identify_ambient",
    "identify_driven",
    "measure_transfer",
]
