"""The poles of a scan on the branches on which their shapes are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.errors import FloquidError
from floquid.lti import fit_residues
from floquid.order import OrderScan
from floquid.periodic import physical_exponents
from floquid.pipeline import Analysis
from floquid.views._modes import checked, frozen, paired


def unfolded(scan: OrderScan, analysis: Analysis) -> tuple[NDArray[np.complex128], ...]:
    r"""The exponents of the poles of each order, each on the branch whose zeroth harmonic is the strongest.

    .. math:: \lambda = \frac{\ln\mu}{T} + i n \omega, \qquad
              n = \arg\max_n \sum_{c,h} \frac{1}{\sigma_{c,h}^2}
              \Big| \sum_k R_k\, e^{-(\ln\mu/T + i n\omega)\, t_k} \Big|^2

    Lifted responses fold all frequencies into the band from 0 to ω/2. The residues of a pole say where it was folded
    from; they are those of each order's poles, fitted to the lifted responses of the analysis. Poles of noise have no
    branch of their own, and scatter.

    Parameters
    ----------
    scan
        What `order.scan` found of `analysis.lifted.responses`.
    analysis
        What `identify` found.

    Returns
    -------
    tuple of numpy.ndarray
        Of each order, the exponents in the order of its poles (modes,) [1/s]; NaN where there is no residue to tell by.

    Raises
    ------
    InputError
        `scan` is no scan, or one of responses sampled at another period.
    """
    of = "unfolded"
    checked(analysis, of)
    if not isinstance(scan, OrderScan):
        raise input_error("scan", of, "be an OrderScan", f"is {scan!r:.60}", "Pass what `order.scan` gives.")
    period = analysis.lifted.period
    if abs(scan.indicators.dt - period) > 1e-6 * period:
        got = f"one of responses sampled every {scan.indicators.dt:.6g} s, and the period is {period:.6g} s"
        raise input_error("scan", of, "be one of the analysis", f"is {got}", "Scan `analysis.lifted.responses`.")
    return tuple(frozen(_exponents(model.multipliers, analysis)) for model in scan.models)


def _exponents(multipliers: NDArray[np.complex128], analysis: Analysis) -> NDArray[np.complex128]:
    """The exponents of poles (modes,), found among those of a fit that orders them its own way."""
    found = np.full(len(multipliers), np.nan + 0j)
    there = multipliers != 0
    if not there.any():
        return found
    try:
        modal = fit_residues(multipliers[there], analysis.lifted.responses)
    except FloquidError:
        return found
    physical = physical_exponents(modal, analysis.lifted)
    found[there] = physical[paired(multipliers[there], modal.multipliers)]
    return found
