"""The lines that each mode has in the spectrum of a record, and the poles of a scan on the branches of their shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Sealed, an_instance, input_error
from floquid.errors import FloquidError
from floquid.lti import fit_residues
from floquid.order import OrderScan
from floquid.periodic import physical_exponents
from floquid.pipeline import Analysis
from floquid.views._names import check_analysis, frozen, paired


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Family(Sealed):
    """The lines |Im λ + mω| of one mode.

    Parameters
    ----------
    mode
        Which mode of the model, from 0.
    harmonics
        The harmonics m kept (lines,).
    omega
        Their frequencies |Im λ + mω| (lines,) [rad/s].
    share
        What each has of the energy of the mode's coefficients, channels weighted by the inverse of their noise
        (lines,) [-]; the shares sum to 1.
    """

    mode: int
    harmonics: Integers
    omega: Floats
    share: Floats


def families(analysis: Analysis) -> tuple[Family, ...]:
    r"""The lines of each mode, conjugates left out.

    .. math:: \Omega_m = |\Im\lambda + m\omega|, \qquad s_m = \frac{E_m}{\sum_n E_n}, \qquad
              E_m = \sum_{c,h} \frac{|B_{c,h,m}|^2}{\sigma_{c,h}^2}

    (Allen 2009, eq. 12.) Of a real multiplier, two harmonics turn at each frequency, one forwards and one backwards:
    they are one line.

    Of what `identify` found, one family a mode in the order of the model. Raises InputError where `analysis` is none.
    """
    check_analysis(analysis, "families")
    model = analysis.model
    weighted = np.abs(model.coefficients) / analysis.noise[None, :, :, None]
    energies = np.sum((weighted / max(float(weighted.max(initial=0.0)), 1e-300)) ** 2, axis=(1, 2))
    found = []
    for mode in model.upper_modes:
        rates = model.exponents[mode].imag + model.fundamental * model.harmonics
        kept = energies[mode] > 0.0
        if model.real[mode]:
            kept &= rates > -1e-9 * model.fundamental
        share = energies[mode][kept]
        found.append(
            Family(
                mode=mode,
                harmonics=model.harmonics[kept],
                omega=np.abs(rates[kept]),
                share=share / max(float(share.sum()), 1e-300) if len(share) else share,
            )
        )
    return tuple(found)


def end_of_lines(analysis: Analysis) -> float:
    """Half a fundamental above the highest line of an `analysis` [Hz]: beyond it are poles of noise alone."""
    nyquist = 0.5 * analysis.lifted.n_phases / analysis.lifted.period
    highest = max(
        (float(own.omega.max()) / (2.0 * np.pi) for own in families(analysis) if len(own.omega)), default=nyquist
    )
    return highest + 0.5 / analysis.lifted.period


def unfolded(scan: OrderScan, analysis: Analysis) -> tuple[Complexes, ...]:
    r"""The exponents of the poles of each order, each on the branch whose zeroth harmonic is the strongest.

    .. math:: \lambda = \frac{\ln\mu}{T} + i n \omega, \qquad
              n = \arg\max_n \sum_{c,h} \frac{1}{\sigma_{c,h}^2}
              \Big| \sum_k R_k\, e^{-(\ln\mu/T + i n\omega)\, t_k} \Big|^2

    Lifted responses fold all frequencies into the band from 0 to ω/2. The residues of a pole say where it was folded
    from; they are those of each order's poles, fitted to the lifted responses of the analysis. Poles of noise have no
    branch of their own, and scatter.

    `scan` is what `order.scan` found of `analysis.lifted.responses`, `analysis` what `identify` found. Of each order
    there are the exponents in the order of its poles (modes,) [1/s]; NaN where there is no residue to tell by. Raises
    InputError where it is no scan, or one of responses sampled at another period.
    """
    of = "unfolded"
    check_analysis(analysis, of)
    an_instance(scan, OrderScan, "scan", of, "Pass what `order.scan` gives.")
    period = analysis.lifted.period
    if abs(scan.indicators.dt - period) > 1e-6 * period:
        got = f"one of responses sampled every {scan.indicators.dt:.6g} s, and the period is {period:.6g} s"
        raise input_error("scan", of, "be one of the analysis", f"is {got}", "Scan `analysis.lifted.responses`.")
    return tuple(frozen(_exponents(model.multipliers, analysis)) for model in scan.models)


def _exponents(multipliers: Complexes, analysis: Analysis) -> Complexes:
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
