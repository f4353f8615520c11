"""Exponents and shapes by Hill's method: the state equation in truncated harmonics."""

from floquid.floquet.hill_method._hill import hill
from floquid.floquet.hill_method._hill_matrix import block_toeplitz, speeds
from floquid.floquet.hill_method._hill_modes import HillModes, HillOutcome, refuse_undamped
from floquid.floquet.hill_method._smoothing import smoothed
