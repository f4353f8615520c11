"""The chain for records with measured inputs."""

from floquid.pipeline.with_inputs._analysis import HELD_OUT, DrivenAnalysis
from floquid.pipeline.with_inputs._identify import identify_driven

__all__ = ["HELD_OUT", "DrivenAnalysis", "identify_driven"]
