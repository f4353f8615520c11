"""Exponents and shapes by Hill's method: the state equation in truncated harmonics."""

from floquid.floquet.hill_method._eigenpairs import block_toeplitz, smoothed, speeds
from floquid.floquet.hill_method._hill import STEPS, HillModes, HillOutcome, hill, most_harmonics, refuse_undamped
