"""Harmonic transfer functions measured line by line, and multisines designed for it.

`multisine` designs the excitation. `by_repeats` takes G from a response to one that repeats, `by_polynomials` from
that to any broad-band input: `floquid.measure_transfer` is the chain. `by_chirps` takes it from chirps, one a record,
its curvature penalised. `fit_transfer` fits modes to such lines, or to those that others have measured.
"""

from floquid.transfer._fit import TransferFit as TransferFit
from floquid.transfer._fit import fit_transfer as fit_transfer
from floquid.transfer._measured import MeasuredTransfer as MeasuredTransfer
from floquid.transfer._modal import Modal as Modal
from floquid.transfer._multisine import Multisine as Multisine
from floquid.transfer._multisine import multisine as multisine
from floquid.transfer._polynomials import CURVATURE as CURVATURE
from floquid.transfer._polynomials import by_chirps as by_chirps
from floquid.transfer._polynomials import by_polynomials as by_polynomials
from floquid.transfer._repeats import by_repeats as by_repeats
from floquid.transfer._repeats import repeat_of as repeat_of

__all__ = ()
