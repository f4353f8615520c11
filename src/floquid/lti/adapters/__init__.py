"""Other people's identifiers behind our contract: proof that any routine of modal identification plugs in.

Each needs a package of its own, which is loaded when the identifier is first used; without it the identifier refuses
its work and says what to install. All are given the responses over their noise, inputs stacked as outputs and cut to
the shortest, as their first `order` principal components, and give poles; residues are ours by least squares
(`floquid.lti.fit_residues`). None decides the order: wrap one, `MaximumLikelihood(initial=...)`, for estimates at the
statistical limit, or ask for an order.
"""

from floquid.lti.adapters._identifiers import BOPDMD, PyOMA2SSI, SdypyLSCF

__all__ = ["BOPDMD", "PyOMA2SSI", "SdypyLSCF"]
