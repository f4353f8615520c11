"""Maximum likelihood for free responses: the search for poles, the test of their number, what is left."""

from floquid.lti.likelihood._ensemble import Ensemble, brief, pooled_noise
from floquid.lti.likelihood._maximum_likelihood import Evidence, MaximumLikelihood
from floquid.lti.likelihood._residual import COLOURED, FEWEST

__all__ = ["COLOURED", "FEWEST", "Ensemble", "Evidence", "MaximumLikelihood", "brief", "pooled_noise"]
