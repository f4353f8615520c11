"""Exponents and shapes by Hill's method: the state equation in truncated harmonics."""

from floquid.floquet.hill_method._eigenpairs import block_toeplitz, smoothed, speeds
from floquid.floquet.hill_method._hill import HillModes, HillOutcome, hill, refuse_undamped
