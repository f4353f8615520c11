"""Periodic shapes over the period, and the residues that they are made of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import Sealed, index, integer
from floquid.core import PeriodicModel
from floquid.lti import ModalModel
from floquid.periodic import assemble
from floquid.pipeline import Analysis
from floquid.views._names import check_analysis, paired


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expansion(Sealed):
    """The coefficients of a residue, of as many harmonics as a period has samples.

    Parameters
    ----------
    harmonics
        m (harmonics,).
    values
        The coefficients of the residue as identified, phase by phase (harmonics,) [unit of the channel].
    std
        The deviation of each, kept or not: the floor of noise, the root of the sum of the squares of those of the real
        and the imaginary part (harmonics,) [unit of the channel]; NaN where it is not known. None without deviations.
    kept
        Whether the model keeps it (harmonics,).
    """

    harmonics: Integers
    values: Complexes
    std: Floats | None
    kept: Mask

    @property
    def magnitudes(self) -> Floats:
        """The magnitudes of the coefficients (harmonics,) [unit of the channel]."""
        return np.abs(self.values)


def expansion(analysis: Analysis, mode: int, channel: int, hit: int = 0) -> Expansion:
    r"""The coefficients of the P harmonics up to the Nyquist frequency, |Im λ/ω + m| ≤ P/2.

    .. math:: B_m = \frac1P \sum_k R_k\, e^{-im\omega t_k}

    (Allen 2009, eq. 11, figure 7.) Of what `identify` found (`analysis`), for a `mode`, a `channel` and a `hit` counted
    from 0. Raises InputError where there is no such mode, channel or hit.
    """
    check_analysis(analysis, "expansion", channel=channel, hit=hit)
    model, phases = analysis.model, analysis.lifted.n_phases
    residue = identified_residue(analysis, mode, channel, hit)
    harmonics = _nyquist_band(model, mode, phases)
    angles = model.fundamental * np.multiply.outer(harmonics, analysis.lifted.phase_times)
    kept = np.isin(harmonics, model.harmonics[model.coefficients[mode, channel, hit] != 0])
    return Expansion(
        harmonics=harmonics,
        values=np.exp(-1j * angles) @ residue / phases,
        std=_floor(analysis, mode, channel, hit, harmonics),
        kept=kept,
    )


def identified_residue(analysis: Analysis, mode: int, channel: int, hit: int = 0) -> Complexes:
    r"""The residue of a mode at each phase, the delay taken off.

    .. math:: R_k = R^d_k\, e^{-\lambda t_k}

    (Allen 2009, eq. 9.) λ is on the branch of the model's exponent. Of whitened responses the filter's gain is taken
    off each of the P harmonics.

    It is (phases,) [unit of the channel], of what `identify` found (`analysis`), for a `mode`, a `channel` and a `hit`
    counted from 0. Raises InputError where there is no such mode, channel or hit.
    """
    of = "identified_residue"
    check_analysis(analysis, of, channel=channel, hit=hit)
    model, modal, lifted = analysis.model, analysis.modal, analysis.lifted
    index(mode, "mode", of, model.order)
    own = int(paired(model.multipliers, modal.multipliers)[mode])
    delayed = lifted.by_channel(modal.residues[own])[channel, :, hit]
    passed = lifted.phase_times + analysis.cycles[hit].first_cycle * model.period
    found = delayed * np.exp(-model.exponents[mode] * passed)
    if lifted.whitening is None:
        return found
    harmonics = _nyquist_band(model, mode, lifted.n_phases)
    turns = np.exp(1j * model.fundamental * np.multiply.outer(harmonics, lifted.phase_times))
    coefficients = turns.conj() @ found / lifted.n_phases
    gain = lifted.gain(model.exponents[mode] + 1j * model.fundamental * harmonics)[channel]
    return (coefficients / gain) @ turns


def _nyquist_band(model: PeriodicModel, mode: int, phases: int) -> Integers:
    """The P harmonics up to the Nyquist frequency, |Im λ/ω + m| ≤ P/2."""
    first = int(np.ceil(-0.5 * phases - model.exponents[mode].imag / model.fundamental))
    return np.arange(first, first + phases)


def _floor(analysis: Analysis, mode: int, channel: int, hit: int, harmonics: Integers) -> Floats | None:
    """The deviation of each coefficient of the free residues, kept or not, by one formula for all of them."""
    model, modal = analysis.model, _with_covariance(analysis)
    if model.coefficient_std is None or modal is None:
        return None
    whole = assemble(modal, analysis.lifted, harmonics=(analysis.lifted.n_phases - 1) // 2)
    assert whole.coefficient_std is not None
    # The branch may be another where two harmonics are nearly as strong.
    own = int(paired(model.multipliers, whole.multipliers)[mode])
    moved = round((whole.exponents[own].imag - model.exponents[mode].imag) / model.fundamental)
    deviations = np.abs(whole.coefficient_std[own, channel, hit])
    deviations = deviations * np.exp(-model.exponents[mode].real * analysis.cycles[hit].first_cycle * model.period)
    known = dict(zip((whole.harmonics + moved).tolist(), deviations.tolist(), strict=True))
    return np.array([known.get(int(m), 0.0) or np.nan for m in harmonics])


def _with_covariance(analysis: Analysis) -> ModalModel | None:
    """The modal model with the covariance of its poles: that of the model's exponents, where it has none of its own."""
    modal, model = analysis.modal, analysis.model
    if modal.residue_spread is None or modal.residue_slope is None:
        return None
    if modal.covariance is not None:
        return modal
    if model.covariance is None:
        return None
    own = paired(modal.multipliers, model.multipliers)
    both = np.concatenate([own, own + model.order])
    return replace(modal, covariance=model.covariance[np.ix_(both, both)])
