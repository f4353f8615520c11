"""Identification of records whose excitation goes on: measured, or random and not measured."""

from floquid.pipeline.excited._ambient import ambient_fit as ambient_fit
from floquid.pipeline.excited._ambient import driven_fit as driven_fit
from floquid.pipeline.excited._ambient import identified_ambient
from floquid.pipeline.excited._ambient import predicted_rest as predicted_rest
from floquid.pipeline.excited._identify import identified_driven
from floquid.pipeline.excited._measure import measure_transfer

__all__ = ["identified_ambient", "identified_driven", "measure_transfer"]
