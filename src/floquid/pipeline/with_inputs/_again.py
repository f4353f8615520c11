"""Fits of records whose excitation goes on, made of their modes again: what they linearise is not kept in a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.core import Record
from floquid.errors import IdentificationError
from floquid.innovations import Fit, Mode, predicted
from floquid.inputs import InputMode, Samples, Uncertainty, linearise
from floquid.pipeline._settings import Settings
from floquid.pipeline.preparation import blas_threads
from floquid.pipeline.with_inputs._prepare import Parted, parted


def driven_fit(
    records: Sequence[Record], settings: Settings, modes: Sequence[InputMode], direct: Sequence[float]
) -> Uncertainty:
    """The fit of `identify_driven` to its records at its modes and the harmonics of its direct term."""
    with blas_threads(records):  # in as many threads as when it was identified: the same to the last digit
        samples = parted(records, settings).samples
        return Uncertainty(samples, linearise(samples, modes, direct))


def ambient_fit(
    records: Sequence[Record],
    settings: Settings,
    modes: Sequence[Mode],
    columns: NDArray[np.float64],
    initial: NDArray[np.float64],
) -> Fit:
    """The fit of `identify_ambient` to its records at its modes, coefficients of known columns and first states.

    Raises IdentificationError where its predictor diverges.
    """
    with blas_threads(records):
        samples, acting = with_acting(parted(records, settings, "identify_ambient"))
        at = predicted(samples, modes, columns, initial)
    if at is None:
        raise IdentificationError("The predictor of these modes diverges on these records.")
    return Fit(samples, at, acting)


def with_acting(own: Parted) -> tuple[Samples, int]:
    """The samples with the inputs that act at once as known columns, beside the offsets and the lines; how many do.

    A force acts on an acceleration at once. On other outputs it does not, and in a closed loop the input holds the
    innovation of the same sample.
    """
    acting = len(own.inputs) if any(channel.quantity == "acceleration" for channel in own.outputs) else 0
    return replace(own.samples, known=np.concatenate([own.samples.known, own.samples.inputs[:acting]])), acting
