"""Responses to measured inputs: modes, the way inputs reach them, and harmonic transfer functions.

`searched` finds the modes of `Samples`, `Uncertainty` has the deviations of such a fit, `model_of` and `transfer_of`
make a model and transfer functions of both.
"""

from floquid.inputs._modes import InputMode
from floquid.inputs._result import Uncertainty, model_of, transfer_of
from floquid.inputs._samples import Hold, Samples, samples_of
from floquid.inputs._search import Limits, searched
from floquid.inputs._solver import Linearisation, linearise, slopes_of, solve, state_slopes
from floquid.inputs._transfer import TransferFunctions, transfer_functions

__all__ = [
    "Hold",
    "InputMode",
    "Limits",
    "Linearisation",
    "Samples",
    "TransferFunctions",
    "Uncertainty",
    "linearise",
    "model_of",
    "samples_of",
    "searched",
    "slopes_of",
    "solve",
    "state_slopes",
    "transfer_functions",
    "transfer_of",
]
