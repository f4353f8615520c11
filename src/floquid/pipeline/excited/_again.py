"""Fits of records whose excitation goes on, made of their modes again: what they linearise is not kept in a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.checks import Parted, first_part
from floquid.core import Record
from floquid.errors import IdentificationError
from floquid.innovations import Fit, Mode, predicted, reweighed, solve
from floquid.inputs import InputMode, Samples, Uncertainty, linearise
from floquid.inputs import solve as solve_driven
from floquid.pipeline._analysis import Analysis
from floquid.preparation import Settings, one_blas_thread, parted


def driven_fit(
    records: Sequence[Record], settings: Settings, modes: Sequence[InputMode], direct: Sequence[float]
) -> Uncertainty:
    """The fit of measured inputs to their records at its modes and the harmonics of its direct term."""
    with one_blas_thread():  # as when it was identified: the same to the last digit
        samples = parted(records, settings).samples
        return Uncertainty(samples, linearise(samples, modes, direct))


def ambient_fit(
    records: Sequence[Record],
    settings: Settings,
    modes: Sequence[Mode],
    columns: NDArray[np.float64],
    initial: NDArray[np.float64],
) -> Fit:
    """The fit of random excitation to its records at its modes, coefficients of known columns and first states.

    Raises IdentificationError where its predictor diverges.
    """
    with one_blas_thread():
        samples, acting = with_acting(parted(records, settings))
        at = predicted(samples, modes, columns, initial)
    if at is None:
        raise IdentificationError("The predictor of these modes diverges on these records.")
    return Fit(samples, reweighed(samples, at), acting)


def predicted_rest(analysis: Analysis) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The outputs by a fit to the first three quarters of each record alone (outputs, samples), and what that was of.

    Of outputs alone one sample ahead. Where nothing was left out (`validate`), by the fit to all samples. The mask is
    true where samples were fitted (samples,). NaN where nothing was measured.
    """
    fit = analysis.driven
    assert fit is not None
    samples = fit.samples
    part, mask = first_part(samples) if analysis.settings.validate else (samples, np.ones(samples.n_samples, bool))
    with one_blas_thread():
        if isinstance(fit, Uncertainty):
            own = fit.at if mask.all() else solve_driven(part, fit.at.modes, fit.at.direct)
            columns = linearise(samples, own.modes, own.direct).columns
            return np.where(samples.there, own.coefficients.T @ columns, np.nan), mask
        own, whole = fit.at, None
        start = None if mask.all() else predicted(part, own.modes, own.columns, own.initial, own.whitening[mask])
        if start is not None:
            own = solve(part, start, rough=True)
            whole = predicted(samples, own.modes, own.columns, own.initial, growing=True)
        innovations = (fit.at if whole is None else whole).innovations
        return np.where(
            samples.there, samples.values - innovations, np.nan
        ), mask if whole is not None else np.ones_like(mask)


def with_acting(own: Parted) -> tuple[Samples, int]:
    """The samples with the inputs that act at once as known columns, beside the offsets and the lines; how many do.

    A force acts on an acceleration at once. On other outputs it does not, and in a closed loop the input holds the
    innovation of the same sample.
    """
    acting = len(own.inputs) if any(channel.quantity == "acceleration" for channel in own.outputs) else 0
    samples = own.samples
    return replace(samples, known=np.concatenate([samples.known, samples.kept(samples.inputs[:acting])])), acting
