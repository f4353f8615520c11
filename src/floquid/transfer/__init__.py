"""Harmonic transfer functions measured line by line, and multisines designed for it.

`multisine` designs the excitation. `by_repeats` takes G from a response to one that repeats, `by_polynomials` from
that to any broad-band input: `floquid.measure_transfer` is the chain. `by_chirps` takes it from chirps, one a record,
its curvature penalised. `fit_transfer` fits modes to such lines, or to those that others have measured.
"""

from floquid.transfer._fit import TransferFit, fit_transfer
from floquid.transfer._measured import MeasuredTransfer, by_repeats, repeat_of
from floquid.transfer._modal import Modal
from floquid.transfer._multisine import Multisine, multisine
from floquid.transfer._polynomials import CURVATURE, by_chirps, by_polynomials

__all__ = ()
