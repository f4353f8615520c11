"""Modal identification of anonymous LTI responses. Knows nothing of records, channels or periods.

`MaximumLikelihood` takes `TimeResponses` and gives a `ModalModel`; it is started by ERA, or any other identifier, and
decides the order by test. Every algorithm honours `AbstractIdentifier`.
"""

from floquid.lti._era import ERA
from floquid.lti._exponentials import fit_residues
from floquid.lti._factor import SHORT, compress, weighted_blocks
from floquid.lti._poles import LARGEST_GROWTH, WHITE, composites
from floquid.lti._significance import noise_edge, white_noise_std
from floquid.lti._types import AbstractIdentifier, Composites, ModalModel, Outcome, OuterProducts, TimeResponses
from floquid.lti.ami import AMI
from floquid.lti.likelihood import COLOURED, FEWEST, Ensemble, Evidence, MaximumLikelihood, brief, pooled_noise
from floquid.lti.rational import LSCF, PolyLSCF

__all__ = [
    "AMI", "COLOURED", "ERA", "FEWEST", "LARGEST_GROWTH", "LSCF", "SHORT", "WHITE", "AbstractIdentifier", "Composites",
    "Ensemble", "Evidence", "MaximumLikelihood", "ModalModel", "Outcome", "OuterProducts", "PolyLSCF", "TimeResponses",
    "brief", "composites", "compress", "fit_residues", "noise_edge", "pooled_noise", "weighted_blocks",
    "white_noise_std",
]  # fmt: skip
