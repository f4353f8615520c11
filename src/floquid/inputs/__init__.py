"""Responses to measured inputs: modes, the way inputs reach them, and harmonic transfer functions.

`searched` finds the modes of `Samples`, `Uncertainty` has the deviations of such a fit, its model and transfer
functions: `floquid.identify` is the chain.
"""

from floquid.core import Hold
from floquid.inputs._estimates import Errors, driven_of, estimates_of, selection_of, terms_of
from floquid.inputs._free import fitted_freely
from floquid.inputs._modes import RUNAWAY, InputMode, input_gain, parts_of, runs_away, slopes_along_square
from floquid.inputs._result import DrivenFit, TransferParts, Uncertainty, sealed
from floquid.inputs._samples import LEAKAGE, Samples, samples_of
from floquid.inputs._slopes import slopes_in_parts
from floquid.inputs._solver import Linearisation, columns_at, linearise, numbers_of, slopes_of, solve, steps_of
from floquid.inputs._start import MOST_ROWS, answering, bare_mode, candidates, chosen_together, fitted_together
from floquid.inputs._transfer import Grid, TransferFunctions, modal_transfer, transfer_of, turning
from floquid.inputs.search import Limits, Scores, gain_of, nearly_one, period_step, phase_step, read_near_axis, searched

__all__ = ["Hold", "TransferFunctions"]
