"""Responses to measured inputs: modes, the way inputs reach them, and harmonic transfer functions.

`searched` finds the modes of `Samples`, `Uncertainty` has the deviations of such a fit, its model and transfer
functions: `floquid.identify` is the chain.
"""

from floquid.inputs._block import parts_of as parts_of
from floquid.inputs._block import slopes_along_square as slopes_along_square
from floquid.inputs._estimates import Errors as Errors
from floquid.inputs._estimates import Term as Term
from floquid.inputs._estimates import driven_of as driven_of
from floquid.inputs._estimates import estimates_of as estimates_of
from floquid.inputs._estimates import selection_of as selection_of
from floquid.inputs._estimates import terms_of as terms_of
from floquid.inputs._free import fitted_freely as fitted_freely
from floquid.inputs._modes import RUNAWAY as RUNAWAY
from floquid.inputs._modes import InputMode as InputMode
from floquid.inputs._modes import answering as answering
from floquid.inputs._modes import input_gain as input_gain
from floquid.inputs._modes import runs_away as runs_away
from floquid.inputs._result import Uncertainty as Uncertainty
from floquid.inputs._result import sealed as sealed
from floquid.inputs._samples import LEAKAGE as LEAKAGE
from floquid.inputs._samples import Hold
from floquid.inputs._samples import Samples as Samples
from floquid.inputs._samples import samples_of as samples_of
from floquid.inputs._solver import Linearisation as Linearisation
from floquid.inputs._solver import linearise as linearise
from floquid.inputs._solver import slopes_of as slopes_of
from floquid.inputs._solver import solve as solve
from floquid.inputs._solver import state_slopes as state_slopes
from floquid.inputs._start import MOST_ROWS as MOST_ROWS
from floquid.inputs._start import bare_mode as bare_mode
from floquid.inputs._start import candidates as candidates
from floquid.inputs._start import chosen_together as chosen_together
from floquid.inputs._start import fitted_together as fitted_together
from floquid.inputs._start import on_branch as on_branch
from floquid.inputs._transfer import Grid as Grid
from floquid.inputs._transfer import TransferFunctions, transfer_functions
from floquid.inputs._transfer import modal_transfer as modal_transfer
from floquid.inputs._transfer import transfer_of as transfer_of
from floquid.inputs._transfer import turning as turning
from floquid.inputs.search import Limits as Limits
from floquid.inputs.search import Scores as Scores
from floquid.inputs.search import gain_of as gain_of
from floquid.inputs.search import nearly_one as nearly_one
from floquid.inputs.search import period_step as period_step
from floquid.inputs.search import phase_step as phase_step
from floquid.inputs.search import read_near_axis as read_near_axis
from floquid.inputs.search import searched as searched

__all__ = ["Hold", "TransferFunctions", "transfer_functions"]
