"""Responses to excitation that nobody measured: a periodic system in innovations form, by prediction errors.

`repetition` tests whether a response repeats with the period given, `searched` finds the modes of `Samples`, with
measured inputs or without; `Fit` has the deviations of such a predictor, its model and transfer functions:
`floquid.identify` is the chain. `harmonic_spectra` and `h_oma` are the spectra of
modulated outputs, and operational modal analysis of them.
"""

from floquid.innovations._autoregression import first_innovations
from floquid.innovations._covariance import colour, reweighed
from floquid.innovations._cyclic import CLEARLY, FINE, left_over, repetition, turned_records
from floquid.innovations._harmonic_spectra import HarmonicSpectra, HomaForm, h_oma, harmonic_spectra
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, predicted
from floquid.innovations._products import gap_of
from floquid.innovations._result import Fit, period_step, phase_step, sized
from floquid.innovations._solve import solve
from floquid.innovations.search import GONE, alike, searched

__all__ = ["HarmonicSpectra", "HomaForm", "h_oma", "harmonic_spectra"]
