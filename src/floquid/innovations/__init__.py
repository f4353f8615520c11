"""Responses to excitation that nobody measured: a periodic system in innovations form, by prediction errors.

`repetition` tests whether a response repeats with the period given, `searched` finds the modes of `Samples`, with
measured inputs or without; `Fit` has the deviations of such a predictor, its model and transfer functions:
`floquid.identify` is the chain. `harmonic_spectra` and `h_oma` are the spectra of
modulated outputs, and operational modal analysis of them.
"""

from floquid.innovations._autoregression import first_innovations as first_innovations
from floquid.innovations._covariance import colour as colour
from floquid.innovations._covariance import reweighed as reweighed
from floquid.innovations._cyclic import CLEARLY as CLEARLY
from floquid.innovations._cyclic import Repetition as Repetition
from floquid.innovations._cyclic import left_over as left_over
from floquid.innovations._cyclic import repetition as repetition
from floquid.innovations._cyclic import turned_records as turned_records
from floquid.innovations._harmonic_spectra import HarmonicSpectra, HomaForm, h_oma, harmonic_spectra
from floquid.innovations._mode import Mode as Mode
from floquid.innovations._predictor import Predictor as Predictor
from floquid.innovations._predictor import predicted as predicted
from floquid.innovations._products import gap_of as gap_of
from floquid.innovations._result import Fit as Fit
from floquid.innovations._result import period_step as period_step
from floquid.innovations._result import phase_step as phase_step
from floquid.innovations._solve import solve as solve
from floquid.innovations.search import GONE as GONE
from floquid.innovations.search import alike as alike
from floquid.innovations.search import searched as searched

__all__ = ["HarmonicSpectra", "HomaForm", "h_oma", "harmonic_spectra"]
