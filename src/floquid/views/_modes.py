"""Choice of modes, channels and hits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Integers
from floquid._checks import index, input_error
from floquid.core import PeriodicModel
from floquid.fit import DEVIATIONS
from floquid.pipeline import Analysis


def grows(model: PeriodicModel, mode: int) -> bool:
    r"""True where a `mode` of the `model` grows beyond doubt, or as far as is known.

    .. math:: \Re\lambda > 4\,\sigma_{\Re\lambda}

    Without a deviation, :math:`\Re\lambda > 0`.
    """
    std = 0.0 if model.exponent_std is None else float(model.exponent_std[mode].real)
    return bool(model.exponents[mode].real > DEVIATIONS * (std if np.isfinite(std) else 0.0))


def check_analysis(analysis: Analysis, of: str, *, channel: int | None = None, hit: int = 0) -> None:
    """Refuse an `analysis` that is none, and a `channel` or a `hit` that it has not; `of` is the callable."""
    if not isinstance(analysis, Analysis):
        raise input_error("analysis", of, "be an Analysis", f"is {analysis!r:.60}", "Pass what `identify` gives.")
    index(hit, "hit", of, analysis.model.n_hits)
    if channel is not None:
        index(channel, "channel", of, len(analysis.model.channels))


def paired(one: Complexes, other: Complexes) -> Integers:
    """Index in `other` of each mode of `one` (modes of `one`,): each taken once, so that the differences are least."""
    from scipy.optimize import linear_sum_assignment

    off = np.abs(np.subtract.outer(one, other))
    found = np.argmin(off, axis=1)
    rows, columns = linear_sum_assignment(off)
    found[rows] = columns
    return found.astype(np.int64)


def frozen(values: NDArray) -> NDArray:
    """The array, read-only."""
    values.flags.writeable = False
    return values
