"""The power of each mode against what a fit makes of noise alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from floquid._arrays import Mask
from floquid.checks._check import Evidence, strongest
from floquid.findings import Finding

if TYPE_CHECKING:
    from floquid.checks._decays import Decays

EXPLAINED = 1e-9  # the probability at which noise passes for a mode, over all lines and decays that it is looked for at
LOOKS = 8  # decays that a mode may have been looked for at, on each line


def weak_modes(case: Decays, found: Evidence) -> tuple[Finding, ...]:
    r"""Each mode's power in the records over the noise, against what a fit makes of noise alone.

    .. math:: \frac{1}{\ell_r} \sum_{c,h} \frac{1}{\sigma_{c,h}^2}
              \sum_m |B_{r,c,h,m}|^2 \sum_k 2\, e^{2 \Re \lambda_r t_k}, \qquad \ell_r = \chi^2_{p_r, \alpha / n}

    a conjugate pair once, p its parameters and n the lines of the records, each looked at with several decays. The
    products of two harmonics are left out: they add up to nothing over a period. The least is `mode`, and has to be 1.
    """
    from scipy.special import chdtri

    model, own = case.model, np.flatnonzero(case.model.exponents.imag >= 0)
    if not len(own):
        return ()
    powers = np.array([_power(case, int(mode)) for mode in own])
    kept = (model.coefficients[own] != 0).any(axis=(1, 2)).sum(axis=1)
    looks = LOOKS * sum(record.n_samples for record in case.records)
    limits = chdtri(2 * case.responses * np.maximum(kept, 1) + 2, EXPLAINED / looks)
    shares = powers / limits
    if found.kept("mode", float(shares.min()), 1.0, at_least=True):
        return ()
    below = [k for (k,) in strongest(np.where(shares < 1.0, 2.0 - shares, 0.0))]
    return found.against("mode_weak", "mode", frequencies=model.frequencies_hz[own[below]], shares=shares[below])


def _power(case: Decays, mode: int) -> float:
    """The power of a mode, with its conjugate, in all records over the noise."""
    model, total = case.model, 0.0
    value = model.exponents[mode]
    for hit, (record, (times, _)) in enumerate(zip(case.records, case.instants, strict=True)):
        # A growing mode is counted from its end, so that nothing overflows.
        origin = times[-1] if value.real > 0 else times[0]
        there: Mask = ~np.isnan(record.values)
        decay = there @ np.exp(2.0 * value.real * (times - origin))
        sizes = np.abs(model.coefficients[mode, :, hit] * np.exp(value.real * origin)) / case.noise[:, hit, None]
        total += float(np.sum(sizes**2, axis=1) @ decay)
    return total if model.unpaired[mode] else 2.0 * total
