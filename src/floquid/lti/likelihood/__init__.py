"""Maximum likelihood for free responses: the search for poles, the test of their number, what is left."""

from floquid.lti.likelihood._ensemble import Ensemble, brief, pooled_noise
from floquid.lti.likelihood._evidence import Evidence
from floquid.lti.likelihood._maximum_likelihood import MaximumLikelihood

__all__ = ["Ensemble", "Evidence", "MaximumLikelihood", "brief", "pooled_noise"]
