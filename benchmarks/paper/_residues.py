"""Residues of a mode, phase by phase, and their Fourier coefficients: figures 6 and 7 of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Sealed, index, input_error
from floquid.core import PeriodicModel, channels_named
from floquid.lti import ModalModel
from floquid.periodic import assemble
from floquid.pipeline import Analysis
from floquid.plot._style import (
    LOOKS,
    Into,
    degrees_a_period,
    drawing,
    entitled,
    grid_of,
    label_angle,
    label_values,
    plain,
    several,
)
from floquid.views import Ink, in_unit
from floquid.views._names import check_analysis, paired

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHORT, LINE = 10, 18
"""The longest name of a channel that stands beside its unit, and the longest line of another, in characters."""

PARTS = ("real", "imag")


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


def residues(
    analysis: Analysis | Mapping[str, Analysis],
    mode: int = 0,
    channels: Sequence[str] | None = None,
    *,
    hit: int = 0,
    periods_per_revolution: int | None = None,
    ax: Into = None,
) -> Figure:
    r"""The residue of a mode at each phase, and the smooth shape of the harmonics kept, both over the period.

    .. math:: R_k = R^d_k\, e^{-\lambda t_k}, \qquad R(t) = \sum_m B_m\, e^{im\omega t}

    (Allen 2009, eqs. 9 and 11, figure 6.) λ is on the branch of the model's exponent: on another the same residues
    would turn once or more a period.

    One row a channel, the real part on the left and the imaginary part on the right. Raises InputError where there is
    no such mode, channel or hit.

    Parameters
    ----------
    analysis
        What `identify` found, or several analyses of the same channels by name.
    mode
        Which mode of the model, from 0; of several analyses, that of the first, and the modes of the others that are
        nearest to it.
    channels
        The names of the channels; all when not given.
    hit
        Which of the hits, from 0.
    periods_per_revolution
        Draw against the angle of the shaft, which turns once in this many periods; not given, against the phase.
    ax
        The axes to draw into, two for each channel; a new figure when not given.
    """
    of = "residues"
    named = several(analysis, Analysis, "analysis", of)
    shown = next(iter(named.values())).model.channels
    rows = list(range(len(shown)))
    if channels is not None:
        rows = channels_named(shown, channels, argument="channels", of=of)
    if not rows:
        raise input_error("channels", of, "name at least one channel", "is empty")
    modes = _chosen_modes(named, mode, hit, of)
    height = 1.1 + 1.45 * len(rows)
    with drawing(height, ax, of, panels=grid_of(len(rows), 2), sharex=True) as (figure, panels):
        for pair, row in zip(zip(panels[::2], panels[1::2], strict=True), rows, strict=True):
            _draw_residue(pair, named, modes, row, hit, degrees_a_period(periods_per_revolution, of))
        for axes, part in zip(panels[:2], ("real part", "imaginary part"), strict=True):
            axes.set_title(part)
        for axes in panels[-2:]:
            label_angle(axes, periods_per_revolution, of, steps=4)
    return figure


def coefficients(
    analysis: Analysis | Mapping[str, Analysis],
    mode: int = 0,
    channel: str | None = None,
    *,
    hit: int = 0,
    periods_per_revolution: int | None = None,
    ax: Into = None,
) -> Figure:
    r"""The magnitude of every Fourier coefficient of a residue, the kept ones marked, and the residue itself.

    .. math:: B_m = \frac1P \sum_k R_k\, e^{-im\omega t_k}

    (Allen 2009, eq. 11, figure 7.) Those of the P harmonics below the Nyquist frequency are drawn: circles, and stems
    for those that the model keeps. The broken line is one standard deviation of a coefficient, where it is known; what
    lies at it is noise. Below, the real and the imaginary part of the residue, as `residues` draws them.

    The coefficients above, the parts of the residue below. `channel` is the name of the channel, the first when not
    given; `analysis`, `mode`, `hit` and `periods_per_revolution` are as of `residues`; `ax` are three axes.
    Raises InputError where there is no such mode, channel or hit, or the axes do not fit.
    """
    of = "coefficients"
    named = several(analysis, Analysis, "analysis", of)
    shown = next(iter(named.values())).model.channels
    row = 0 if channel is None else channels_named(shown, [channel], argument="channel", of=of)[0]
    modes = _chosen_modes(named, mode, hit, of)
    with drawing(5.4, ax, of, panels=((0, 0), (1, 2)), height_ratios=(1.25, 1.0)) as (figure, (axes, *panels)):
        deviations = []
        for look, (name, one) in zip(LOOKS, named.items(), strict=False):
            found = expansion(one, modes[name], row, hit)
            kept = found.kept
            axes.plot(found.harmonics, found.magnitudes, **look.points, label=entitled(name, "identified"))
            if kept.any():
                stems = {"color": look.line["color"], "linewidth": 2.0 * look.line["linewidth"]}
                words = entitled(name, "harmonics kept")
                axes.vlines(found.harmonics[kept], 0.0, found.magnitudes[kept], **stems, label=words)
            deviations += [] if found.std is None else [(found.harmonics, found.std)]
        for harmonics, std in deviations:
            axes.plot(harmonics, std, color=Ink.SILVER, linestyle="--", label="one standard deviation")
        _log_axis(axes, in_unit(f"|B| of {plain(shown[row].name)}", plain(shown[row].unit)))
        _draw_residue(panels, named, modes, row, hit, degrees_a_period(periods_per_revolution, of))
        for one, part in zip(panels, ("real part", "imaginary part"), strict=True):
            one.set_title(part)
            label_angle(one, periods_per_revolution, of, steps=4)
    return figure


def _chosen_modes(named: dict[str, Analysis], mode: int, hit: int, of: str) -> dict[str, int]:
    """The index of the mode in each analysis: that of the first, and those nearest to it."""
    first = next(iter(named.values())).model
    index(mode, "mode", of, first.order)
    index(hit, "hit", of, min(one.model.n_hits for one in named.values()))
    names = [channel.name for channel in first.channels]
    modes = {}
    for name, analysis in named.items():
        if [channel.name for channel in analysis.model.channels] != names:
            raise input_error("analysis", of, "hold analyses of the same channels", f"{name!r} has others")
        modes[name] = int(np.argmin(np.abs(analysis.model.exponents - first.exponents[mode])))
    return modes


def _draw_residue(
    panels: Sequence[Axes], named: dict[str, Analysis], modes: dict[str, int], row: int, hit: int, degrees: float
) -> None:
    """The real and the imaginary part of one channel's residue on the two `panels`."""
    channel = next(iter(named.values())).model.channels[row]
    for axes, part in zip(panels, PARTS, strict=True):
        for look, (name, one) in zip(LOOKS, named.items(), strict=False):
            period, mode = one.model.period, modes[name]
            times = np.linspace(0.0, period, 361)
            points = getattr(identified_residue(one, mode, row, hit), part)
            smooth = getattr(one.model.shapes(times)[mode, row, hit], part)
            phase = (one.lifted.phase_times / period % 1.0) * degrees
            axes.plot(phase, points, **look.points, label=entitled(name, "identified"))
            axes.plot(times / period * degrees, smooth, **look.line, label=entitled(name, "harmonics kept"))
        axes.margins(y=0.1)
        largest = float(np.abs(axes.dataLim.intervaly).max())
        # A row is low: a long name takes several lines, or it would meet that of the row below.
        name = channel.name if part == "real" else ""
        if len(name) > SHORT:
            name = "\n".join([*wrap(name, LINE), ""])
        label_values(axes, name, channel.unit, largest)


def _log_axis(axes: Axes, name: str) -> None:
    """A logarithmic axis of magnitudes over the harmonics, its bottom below the smallest of them."""
    values = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in axes.lines])
    smallest = np.nanmin(values[values > 0])
    axes.set(yscale="log", xlabel=r"harmonic $m$ of the residue", ylabel=name)
    axes.set_ylim(bottom=0.6 * smallest)
    axes.margins(x=0.02)
