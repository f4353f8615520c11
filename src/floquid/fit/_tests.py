"""Tests of more or fewer parameters: limits of χ², gains of score tests, rises of Wald tests, and one criterion."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from floquid._arrays import Floats, Mask
from floquid.fit._algebra import ROUNDING, inverse_root

SURE = 1e-6
"""The probability at which noise may pass for something that is told: of thousands of looks at a record none errs."""

DEVIATIONS = 4.0  # deviations within which two values may be one: normal errors are beyond once in 16,000
WITHIN = 1.96  # deviations of a value within which it may be another one: its 95 % interval


RARE = 1e-3  # the probability at which noise may pass for what does little harm

SIGNIFICANT = 6.0
"""Deviations by which a period must differ before it counts as another one: of thousands of harmonics none errs."""

EVIDENT = 0.1
"""The deviation of a difference of two decays, over a decay, below which it says something that they are equal."""

QUIET = 1e-4  # the noise over the largest value below which a record says more than modes: a weak nonlinearity, for one
FAINT = 0.1  # the amplitude of what is left, over the noise, that counts as none: 1 % of its power
MISFIT = 1.3  # times the noise that a fit may leave: its level is an estimate
SLOW = 1.0  # the decay over a record [nepers] below which it hardly shows: what has one may be steady
MODES = 24  # modes, a pair counted once, that are looked for at most where what is left is no white noise
IN_VAIN = 2  # orders in a row that are no better before a search of the best one ends


@lru_cache(maxsize=4096)
def chi2_limit(degrees: float, probability: float) -> float:
    """The χ² of some degrees of freedom that noise exceeds with a probability."""
    from scipy.special import chdtri

    return float(chdtri(degrees, probability))


def score_gain(gradient: Floats, information: Floats, least: float, *, before: Floats | None = None) -> float:
    """The gain g' S⁻¹ g in twice the logarithm of the likelihood by parameters that are zero now (score test).

    S is their information less what all that is fitted takes of it; `before` is its diagonal before that. Directions
    below the share `least` of that are rounding.
    """
    scale = None if before is None else np.sqrt(np.where(before > np.finfo(float).tiny, before, 1.0))
    return float(np.sum((inverse_root(information, least, scale=scale).T @ gradient) ** 2))


def wald_rise(values: Floats, covariance: Floats) -> float:
    """The squared deviations v' C⁻¹ v of values from zero: the rise of χ² without them, to first order (Wald test).

    Zero where the covariance overflowed. Values of several independent channels (values, channels) add up.
    """
    return float(np.sum((inverse_root(covariance, ROUNDING).T @ values) ** 2))


def schwarz(log_likelihood: float, n_parameters: int, n_samples: int) -> float:
    """The criterion of Schwarz (1978), more is better: twice the log-likelihood less log N for each parameter."""
    return log_likelihood - n_parameters * float(np.log(n_samples))


def is_vague(std: Floats | float, decay: Floats | float) -> Mask:
    """True of decays that are not determined: their 95 % intervals hold zero, or they have none."""
    return ~np.less_equal(WITHIN * np.asarray(std), np.abs(decay))
