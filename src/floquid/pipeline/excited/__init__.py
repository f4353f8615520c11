"""Identification of records whose excitation goes on: measured, or random and not measured."""

from floquid.pipeline.excited._ambient import ambient_fit, driven_fit, identified_ambient, predicted_rest
from floquid.pipeline.excited._identify import identified_driven
from floquid.pipeline.excited._measure import measure_transfer

__all__ = ["identified_ambient", "identified_driven", "measure_transfer"]
