"""Residues at each phase → harmonics of the periodic shapes, with their deviations."""

from floquid.periodic.expansion._expand import assemble, expansion, physical_exponents, strongest_branch
from floquid.periodic.expansion._free_estimates import participation, select_bands
