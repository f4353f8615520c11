"""Identified periodic shapes over the period, with bands of their errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import frozen_array, input_error, integer
from floquid.core import PeriodicModel, channels_named
from floquid.periodic import participation
from floquid.plot._several import label_angle, legend_of_all
from floquid.plot._style import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILION, label_values, new_figure, plain, style
from floquid.views import shape_curves, upper_modes, with_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS = ((BLUE, "-"), (VERMILION, "--"), (GREEN, "-."), (ORANGE, ":"), (PURPLE, (0, (5, 1, 1, 1, 1, 1))))
"""Told apart by dashes as well as by colour."""

MODES, MOST, ROWS = 3, 6, 4
"""Modes drawn by default, and at most; rows by default, at most."""

INTERVAL = 1.96
"""The standard deviations to each side within which 95 % of estimates lie."""

LEAST = 1e-4
"""The smallest share of a harmonic that has a bar."""

FAINT = 0.02
"""Of a shape's largest value: below, its phase says nothing."""

POINTS = 181


def identified_shapes(
    model: PeriodicModel,
    channels: Sequence[str] | None,
    modes: Sequence[int] | None,
    hit: int,
    *,
    weights: ArrayLike | None,
    polar: bool,
    name: str,
) -> Figure:
    """The shapes of a model: a row for each mode and unit, and the parts of the harmonics."""
    if integer(hit, "hit", name, at_least=0) >= model.n_hits:
        raise input_error("hit", name, f"be less than {model.n_hits}", f"is {hit}", "Counting starts at 0.")
    listed = _listed(model, modes, name)
    weighted = _by_unit(model) if weights is None else frozen_array(weights, "weights", name, axes=_rows_of(model))
    rows = list(range(len(model.channels)))
    if channels is not None:
        rows = channels_named(model.channels, channels, argument="states", of=name)
    looks = _looks(model, rows, listed, hit)
    units = list(dict.fromkeys(model.channels[row].unit for row in looks))
    with style():
        figure = new_figure(7.0, 0.9 + 1.75 * len(listed) * len(units) + 0.1 * len(listed))
        panels = figure.subplots(len(listed) * len(units), 3, squeeze=False, width_ratios=(3, 3, 2.2))
        for place, mode in enumerate(listed):
            for number, unit in enumerate(units):
                three = panels[place * len(units) + number]
                own = {row: look for row, look in looks.items() if model.channels[row].unit == unit}
                _draw_shape(three[:2], model, mode, hit, own, unit, polar=polar)
                if number:
                    three[2].set_axis_off()
            first = panels[place * len(units)]
            _draw_harmonics(first[2], model, mode, weighted)
            first[0].set_title(_title(model, mode), loc="left")
        for line, three in enumerate(panels):
            for axes in three[:2]:
                label_angle(axes, None, name, steps=4)
                if line < len(panels) - 1:
                    axes.set_xlabel("")
                    axes.tick_params(labelbottom=False)
        panels[(len(listed) - 1) * len(units), 2].set_xlabel("harmonic $m$")
        figure.align_ylabels(panels[:, 0])
        figure.align_ylabels(panels[:, 1])
        legend_of_all(figure)
    return figure


def _listed(model: PeriodicModel, modes: Sequence[int] | None, of: str) -> list[int]:
    """The modes that are drawn: those asked for, or the strongest, in the order of the model."""
    upper = list(upper_modes(model))
    if modes is None:
        energy = np.sum(np.abs(model.coefficients) ** 2, axis=(2, 3))
        share = np.sum(energy / np.maximum(energy.max(axis=0), 1e-300), axis=1)
        units = len({channel.unit for channel in model.channels})
        return sorted(sorted(upper, key=lambda r: -share[r])[: max(1, min(MODES, ROWS // units))])
    chosen = [int(r) for r in modes if isinstance(r, (int, np.integer)) and 0 <= r < model.order]
    if len(chosen) != len(modes) or not 1 <= len(chosen) <= MOST:
        must = f"list one to {MOST} indices from 0 to {model.order - 1}"
        raise input_error("of", of, must, f"is {list(modes)!r:.60}")
    return chosen


def _looks(model: PeriodicModel, rows: list[int], modes: list[int], hit: int) -> dict[int, tuple[str, Any]]:
    """How each channel drawn is drawn: of each unit the strongest, as many as can be told apart."""
    sizes = np.sqrt(np.sum(np.abs(model.coefficients[modes][:, :, hit]) ** 2, axis=2)).max(axis=0)
    looks: dict[int, tuple[str, Any]] = {}
    for unit in dict.fromkeys(model.channels[row].unit for row in rows):
        own = sorted((row for row in rows if model.channels[row].unit == unit), key=lambda row: -sizes[row])
        looks |= {row: LOOKS[k] for k, row in enumerate(sorted(own[: len(LOOKS)]))}
    return looks


def _title(model: PeriodicModel, mode: int) -> str:
    """The number of the mode and its exponent with the deviations."""
    value, std, upper = model.exponents[mode], model.exponent_std, upper_modes(model)
    spread = complex(np.nan, np.nan) if std is None else complex(std[mode])
    number = f"mode {upper.index(mode) + 1}" if mode in upper else f"index {mode}"
    sign = "+" if value.imag >= 0.0 else "-"
    words = f"{with_error(value.real, spread.real)} {sign} {with_error(abs(value.imag), spread.imag)} i"
    return rf"{number}: $\lambda$ = {words} 1/s".replace("-", "−")


def _draw_shape(
    panels: Sequence[Axes] | NDArray[np.object_],
    model: PeriodicModel,
    mode: int,
    hit: int,
    looks: dict[int, tuple[str, Any]],
    unit: str,
    *,
    polar: bool,
) -> None:
    """The two parts of the shape in the channels of one unit, with their bands."""
    curves = shape_curves(model, mode, hit, POINTS)
    phase, largest = 360.0 * curves.turns, 0.0
    for row, (color, dashes) in looks.items():
        value = curves.values[row]
        std = None if curves.std is None else curves.std[row]
        parts, bands = _polar(value, std) if polar else _cartesian(value, std)
        largest = max(largest, float(np.nanmax(np.abs(parts[0]))), 0.0 if polar else float(np.nanmax(np.abs(parts[1]))))
        for axes, part, band in zip(panels, parts, bands, strict=True):
            axes.plot(phase, part, color=color, linestyle=dashes, linewidth=1.3, label=plain(model.channels[row].name))
            if band is not None:
                edge = {"color": color, "alpha": 0.25, "linewidth": 0.0}
                axes.fill_between(phase, part - INTERVAL * band, part + INTERVAL * band, **edge)
    if curves.std is not None:
        panels[0].fill_between([], [], [], color=GREY, alpha=0.4, linewidth=0.0, label="95 % intervals")
    for axes, name in zip(panels, ("size", "") if polar else ("Re", "Im"), strict=True):
        axes.margins(y=0.12)
        if name:
            label_values(axes, name, unit, largest)
    if polar:
        panels[0].set_ylim(bottom=0.0)
        panels[1].set_ylabel("phase [deg]")


Two = tuple[NDArray[np.float64], NDArray[np.float64]]
Bands = Two | tuple[None, None]


def _cartesian(value: NDArray[np.complex128], std: NDArray[np.complex128] | None) -> tuple[Two, Bands]:
    return (value.real, value.imag), (None, None) if std is None else (std.real, std.imag)


def _polar(value: NDArray[np.complex128], std: NDArray[np.complex128] | None) -> tuple[Two, Bands]:
    """Size and phase; their errors are those of a circle with the larger of the two deviations."""
    size, angle = np.abs(value), np.degrees(np.unwrap(np.angle(value)))
    angle = angle - 360.0 * np.round(angle.mean() / 360.0)
    seen = size > FAINT * max(float(size.max()), 1e-300)
    parts = size, np.where(seen, angle, np.nan)
    if std is None:
        return parts, (None, None)
    spread = np.maximum(std.real, std.imag)
    return parts, (spread, np.degrees(np.divide(spread, size, out=np.full_like(size, np.nan), where=seen)))


def _rows_of(model: PeriodicModel) -> tuple[int, int]:
    """How many channels and hits there are."""
    return len(model.channels), model.n_hits


def _by_unit(model: PeriodicModel) -> NDArray[np.float64]:
    """One over the largest coefficient of each unit (channels, hits): units cannot be added as they are."""
    largest = np.abs(model.coefficients).max(axis=(0, 2, 3), initial=0.0)
    units = np.array([channel.unit for channel in model.channels])
    sizes = np.array([largest[units == unit].max() for unit in units])
    weights = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    return np.repeat(weights[:, None], model.n_hits, axis=1)


def _draw_harmonics(axes: Axes, model: PeriodicModel, mode: int, weights: NDArray[np.float64]) -> None:
    """What each harmonic has of the mode's energy in all channels and hits, weighted."""
    from matplotlib.ticker import MaxNLocator

    harmonics, share = participation(model, mode, weights)
    shown = share >= LEAST
    axes.bar(harmonics[shown], share[shown], color=GREY, edgecolor=BLUE, linewidth=0.8, width=0.7)
    axes.set(yscale="log", ylim=(LEAST, 2.0), ylabel="part [-]")
    if shown.any():
        axes.set_xlim(int(harmonics[shown].min()) - 1.4, int(harmonics[shown].max()) + 1.4)
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
