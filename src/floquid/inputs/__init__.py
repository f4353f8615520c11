"""Responses to measured inputs: modes, the way inputs reach them, and harmonic transfer functions."""

from floquid.inputs._modes import InputMode
from floquid.inputs._result import Uncertainty, model_of, transfer_of
from floquid.inputs._samples import Hold, Samples, samples_of
from floquid.inputs._search import Limits, searched
from floquid.inputs._solver import Linearisation, covariance, linearise, solve
from floquid.inputs._transfer import TransferFunctions, transfer_functions
