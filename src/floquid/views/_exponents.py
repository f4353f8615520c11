"""Exponents and shapes in figures: lines in a spectrum, poles on their branches, regions they lie in, and curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Indices, Integers
from floquid._checks import Sealed, an_instance, finite, frozen_array, index, input_error, integer
from floquid.core import PeriodicModel
from floquid.errors import FloquidError
from floquid.fit import WITHIN
from floquid.inputs import TransferFunctions
from floquid.lti import fit_residues
from floquid.order import OrderScan
from floquid.periodic import physical_exponents
from floquid.pipeline import Analysis
from floquid.views._names import check_analysis, frozen, paired

POINTS = 73

SINGULAR = 1e-12  # the ratio of the variances across and along a region up to which it is a line


def ellipse(centre: complex, covariance: ArrayLike, level: float = 0.95) -> Complexes:
    r"""The edge of the region of a complex estimate, in the plane.

    .. math:: (z - \hat z)^T C^{-1} (z - \hat z) = -2 \ln(1 - p)

    for an estimate of normal errors. Where a part has no error, the region is a line, and one normal number decides:
    to each side it is the quantile of (1 + p)/2 times the deviation.

    `centre` is the estimate, `covariance` C of its real and imaginary part (2, 2), and `level` the probability p that
    the region holds the true value. The edge is closed (points,). Raises InputError where the
    covariance is none, or the level no probability.
    """
    from scipy.special import ndtri

    of = "ellipse"
    matrix = frozen_array(covariance, "covariance", of, axes=(2, 2))
    if not 0.0 < finite(level, "level", of) < 1.0:
        raise input_error("level", of, "lie between 0 and 1", f"is {level:g}")
    turn = np.linspace(0.0, 2.0 * np.pi, POINTS)
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    if values[0] < -1e-9 * max(values[1], 0.0):
        raise input_error("covariance", of, "have no negative variance", f"has {values[0]:g} along one direction")
    line = values[0] <= SINGULAR * values[1]
    squared = float(ndtri(0.5 + 0.5 * level)) ** 2 if line else -2.0 * np.log1p(-level)
    root = vectors * np.sqrt(np.maximum(values, 0.0) * squared)
    real, imag = root @ np.array([np.cos(turn), np.sin(turn)])
    return np.asarray(centre + real + 1j * imag, dtype=np.complex128)


def exponent_ellipses(model: PeriodicModel, level: float = 0.95) -> Complexes | None:
    """The edges of the regions of the exponents of a `model` (modes, points) [1/s]; None without deviations.

    Each region holds the true exponent with the probability `level`.
    """
    if model.covariance is None:
        return None
    n = model.order
    parts = [model.covariance[np.ix_([r, r + n], [r, r + n])] for r in range(n)]
    return _edges(model.exponents, parts, level)


def in_strip(exponents: Complexes, fundamental: float) -> Complexes:
    """The `exponents` at |Im λ| modulo the `fundamental` ω, from zero to ω/2."""
    turns = exponents.imag / fundamental
    return np.asarray(exponents.real + 1j * fundamental * np.abs(turns - np.rint(turns)), np.complex128)


def region_on_branch(model: PeriodicModel, mode: int, exponent: complex) -> Complexes | None:
    """The edge of the region of 95 % of a mode about zero (points,) [1/s]; None without deviations.

    It is that on the branch of the `model`'s `mode`, or of its mirror image, that `exponent` is on.
    """
    if model.covariance is None:
        return None
    rows = [mode, mode + model.order]
    region = ellipse(0.0, model.covariance[np.ix_(rows, rows)])
    lam = complex(model.exponents[mode])
    turns = [(exponent.imag - imag) / model.fundamental for imag in (lam.imag, -lam.imag)]
    off = [abs(turn - round(turn)) for turn in turns]
    return region if off[0] <= off[1] else region.conj()


def multiplier_ellipses(model: PeriodicModel, level: float = 0.95) -> Complexes | None:
    r"""The regions of the multipliers, to first order.

    .. math:: \delta\mu = \mu\, (T\, \delta\lambda + \lambda\, \delta T)

    with δT where the period was estimated. Of a `model` there are the edges (modes, points) [-], None without
    deviations; each region holds the true multiplier with the probability `level`.
    """
    covariance = model.multiplier_covariance
    return None if covariance is None else _edges(model.multipliers, list(covariance), level)


def _edges(centres: Complexes, parts: list[Floats], level: float) -> Complexes:
    edges = np.array([ellipse(complex(z), c, level) for z, c in zip(centres, parts, strict=True)], np.complex128)
    edges = edges.reshape(len(parts), POINTS)
    edges.flags.writeable = False
    return edges


SEEN = 4.0  # deviations from which on a phase is known to 15°


def magnitude_bands(found: TransferFunctions, row: int, column: int) -> tuple[Floats, Floats, Floats, float]:
    """|G| of one path with its 95 % band (harmonics, frequencies), and where a logarithmic axis of it begins.

    What is smaller than the axis shows is not told from nothing: the band there goes on to its end. The path of `found`
    is from the input `column` to the output `row`, from 0.
    """
    value = found.values[:, row, column]
    size = np.abs(value)
    # The deviation of a magnitude lies between those of both parts.
    std = np.zeros(size.shape) if found.std is None else np.abs(found.std[:, row, column]) / np.sqrt(2.0)
    there = np.maximum(size, std)[np.isfinite(size) & (size > 0.0)]
    floor = 0.5 * float(there.min(initial=np.inf if there.size else 1.0))
    return size, np.maximum(size - WITHIN * std, floor), size + WITHIN * std, floor


def phase_degrees(found: TransferFunctions, row: int, column: int) -> Floats:
    """The phase of G of one path (harmonics, frequencies) [°], NaN where its magnitude is below four deviations.

    Where a curve would leap from one end of the scale to the other it is broken. The path of `found` is from the input
    `column` to the output `row`, from 0.
    """
    value = found.values[:, row, column]
    std = np.zeros(value.shape) if found.std is None else np.abs(found.std[:, row, column]) / np.sqrt(2.0)
    degrees = np.where((np.abs(value) > SEEN * std) & (value != 0), np.degrees(np.angle(value)), np.nan)
    degrees[:, 1:][np.abs(np.diff(degrees, axis=1)) > 180.0] = np.nan
    return degrees


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShapeCurves(Sealed):
    """The shape of a mode in every channel over one period.

    Parameters
    ----------
    turns
        The phase, 0 to 1 (points,) [periods].
    values
        The shape (channels, points) [units of the channels].
    std
        Its deviations, that of the real part as the real part, that of the imaginary part as the imaginary part
        (channels, points); None if not estimated.
    """

    turns: Floats
    values: Complexes
    std: Complexes | None


def shape_curves(model: PeriodicModel, mode: int, hit: int = 0, points: int = 91) -> ShapeCurves:
    r"""The shape of a mode over one period, both ends included.

    .. math:: R(t) = \sum_m B_m\, e^{im\omega t}

    (Allen 2009, eq. 11.) It is as the `model` has it, neither scaled nor turned, at `points` instants; `mode` and `hit`
    count from 0. Raises InputError where there is no such mode or hit.
    """
    of = "shape_curves"
    index(mode, "mode", of, model.order)
    index(hit, "hit", of, model.n_hits)
    turns = np.linspace(0.0, 1.0, integer(points, "points", of, at_least=2))
    times = turns * model.period
    std = model.shape_std(times, [mode])
    return ShapeCurves(
        turns=turns, values=model.shapes(times)[mode, :, hit], std=None if std is None else std[0, :, hit]
    )


def closed_period(times: Floats, period: float) -> tuple[Indices, Floats]:
    """The order of instants, and the instants in it: the first once more where they end within a period of it.

    `times` (times,) and the `period` are in the same unit; both results are (times,) or one more.
    """
    order = np.argsort(times)
    ordered = times[order]
    if ordered[-1] < ordered[0] + period * (1.0 - 1e-9):
        return np.append(order, order[0]), np.append(ordered, ordered[0] + period)
    return order, ordered
