"""The noise of the record itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.pipeline import Analysis


def colour(whitening: NDArray[np.float64]) -> NDArray[np.float64]:
    """How much more noise there is before the whitening filter of each channel (channels,) [-]."""
    gain = np.fft.fft(whitening, 512, axis=1)
    return np.asarray(np.sqrt(np.mean(np.abs(gain) ** -2.0, axis=1)), np.float64)


def raw_noise(analysis: Analysis) -> NDArray[np.float64]:
    """The deviation of the noise of the records, before any whitening filter.

    Parameters
    ----------
    analysis
        What `identify` found.

    Returns
    -------
    numpy.ndarray
        The deviations (channels, hits) [units of the channels]; where the noise is coloured, of all of it together.
    """
    if analysis.whitening is None:
        return analysis.noise
    return analysis.noise * colour(analysis.whitening)[:, None]
