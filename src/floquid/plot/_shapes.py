"""Periodic mode shapes over the period, and their harmonics: of a known A(t), and identified with bands of errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import frozen_array, index, input_error, wrong_value
from floquid.core import PeriodicModel, channels_named
from floquid.fit import WITHIN
from floquid.floquet import FloquetModes, multiplier_is_real, stability, state_participation, upper_modes
from floquid.periodic import participation
from floquid.plot._style import Into, drawing, grid_of, label_angle, label_values, plain, plain_decades
from floquid.views import Ink, shape_curves, with_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLORS, _DASHES = (
    (Ink.BLUE, Ink.VERMILION, Ink.GREEN, Ink.ORANGE, Ink.PURPLE),
    ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1))),
)
_LOOKS = tuple((_COLORS[k % 5], _DASHES[(k + k // 5) % 5]) for k in range(25))
"""Told apart by dashes as well as by colour; no two alike, since all channels of a figure share its legend."""

_CURVES = 5  # the most in one panel

_MODES, _MOST, _ROWS = 3, 6, 4  # modes drawn by default, and at most; rows by default, at most
_FAINT = 0.02  # of a shape's largest value: below, its phase says nothing
_SLIGHT = 1e-9  # of a mode: a state with less of it has no part in it
_LEAST = 1e-4  # the smallest share of a harmonic that has a bar

_POINTS = 361
_SHORT = 30


def periodic_shapes(
    modes: FloquetModes | PeriodicModel,
    states: Sequence[str] | None = None,
    of: Sequence[int] | None = None,
    *,
    hit: int = 0,
    weights: ArrayLike | None = None,
    ax: Into = None,
) -> Figure:
    """The periodic shapes of modes over the period, and the parts of their harmonics.

    Those of an identified model are in the units of the channels, with bands that hold the true value at each phase
    with 95 %: a row for each mode and unit, in real and imaginary part.

    Those of a known A(t) have a row a mode, by rising damping ratio, in magnitude and phase; each shape is scaled so
    that the strongest coefficient of its zeroth harmonic is one, in the units of the states. The states drawn are those
    that take most part in the modes.

    Raises InputError where `modes` is something else, there are not as many names as states, or a mode, channel or hit
    is not there.

    Parameters
    ----------
    modes
        What `floquet.modes` found, or the model that `identify` found.
    states
        The names of the states (n,); x1, x2, ... where not given. Of an identified model, the names of the channels to
        draw; all where not given, or of each unit the strongest five.
    of
        The indices of the modes, up to six; by default three, one of each pair: those that are damped least, of an
        identified model the strongest. Modes that only die away, such as those of filters, come after all that swing.
    hit
        Which of the hits, from 0, of an identified model.
    weights
        Of an identified model, what each channel counts for in the parts of the harmonics (channels, hits) [1/unit of
        the channel]: for the shares that tables give, `1/analysis.noise`. None: one over the largest coefficient of all
        channels of its unit, so that a channel counts by its size and not by how well it is known. All hits count.
    ax
        The axes to draw into, three for each row; a new figure when not given.
    """
    name = "periodic_shapes"
    if isinstance(modes, PeriodicModel):
        return _identified(modes, states, of, hit, weights, ax, name)
    if not isinstance(modes, FloquetModes):
        must = "be a FloquetModes or a PeriodicModel"
        raise wrong_value("modes", name, must, modes, "Pass floquet.modes(A, period) or analysis.model.")
    names = _names(modes, states, name)
    damping = _damping(modes)
    chosen = sorted(_asked(modes, of, name) or upper_modes(modes), key=lambda r: (damping[r], -modes.exponents[r].real))
    rows = chosen if of is not None else chosen[:_MODES]
    shares = state_participation(modes)
    # The states of the largest shares in any of the modes, in their own order.
    strongest = sorted(np.argsort(-shares[rows].max(axis=0), kind="stable")[:_CURVES].tolist())
    with _panels(1.3 + 1.75 * len(rows), len(rows), ax, name) as (figure, panels):
        for row, (r, three) in enumerate(zip(rows, panels, strict=True)):
            looks = {k: look for k, look in zip(strongest, _LOOKS, strict=False) if shares[r, k] > _SLIGHT}
            _draw_shape(three, modes, r, names, looks)
            _draw_harmonics(three[2], modes.harmonics, modes.participation[r])
            plain_decades(three[2])
            three[0].set_title(_title(modes, r), loc="left")
            for axes in three[:2]:
                label_angle(axes, None, name, steps=4)
                if row < len(rows) - 1:
                    axes.set_xlabel("")
        panels[-1][2].set_xlabel("harmonic $m$")
    return figure


@contextmanager
def _panels(height: float, rows: int, ax: Into, name: str) -> Iterator[tuple[Figure, list[list[Axes]]]]:
    """Rows of three panels each."""
    with drawing(height, ax, name, panels=grid_of(rows, 3), width_ratios=(3, 3, 2.2)) as (figure, own):
        yield figure, [own[3 * row : 3 * row + 3] for row in range(rows)]


def _damping(modes: FloquetModes) -> Floats:
    """The damping ratios (modes,), one for a mode that neither swings nor grows within its error."""
    margins = stability(modes).margins
    rests = (np.abs(modes.exponents.imag) <= margins) & (modes.exponents.real <= margins)
    return np.where(rests, 1.0, modes.damping_ratios.round(12))


def _asked(modes: FloquetModes | PeriodicModel, of: Sequence[int] | None, name: str) -> list[int]:
    """The modes that were asked for; none where none were."""
    if of is None:
        return []
    chosen = [int(r) for r in of if isinstance(r, (int, np.integer)) and 0 <= r < modes.order]
    if len(chosen) != len(of) or not 1 <= len(chosen) <= _MOST:
        raise wrong_value("of", name, f"list one to {_MOST} indices from 0 to {modes.order - 1}", list(of))
    return chosen


def _names(modes: FloquetModes, states: Sequence[str] | None, of: str) -> list[str]:
    count = modes.coefficients.shape[1]
    if states is None:
        return [f"x{k}" for k in range(1, count + 1)]
    if isinstance(states, str) or len(states) != count:
        got = f"is {states!r}" if isinstance(states, str) else f"has {len(states)}"
        raise input_error("states", of, f"hold {count} names", got)
    shown = [str(name).partition(" (internal DOF index")[0] for name in states]
    short = [name if len(name) <= _SHORT else f"{name[: _SHORT - 1]}…" for name in shown]
    return [f"{k + 1}: {name}" if short.count(name) > 1 else name for k, name in enumerate(short)]


def _title(modes: FloquetModes, mode: int) -> str:
    value = complex(modes.exponents[mode])
    if abs(value.real) <= stability(modes).margins[mode]:
        value = complex(0.0, value.imag)
    if multiplier_is_real(modes, mode):
        words = f"{value.real:.4g}" + (f" + {abs(value.imag):.4g}i" if value.imag else "")
    else:
        words = f"{value.real:.4g} ± {abs(value.imag):.4g}i"
    return rf"$\lambda$ = {words} 1/s".replace("-", "−")


def _draw_shape(
    panels: Sequence[Axes], modes: FloquetModes, mode: int, names: list[str], looks: dict[int, Any]
) -> None:
    """Magnitude and phase of the shape over the period, in each of the states that have a look."""
    shape = modes.shapes(np.linspace(0.0, modes.period, _POINTS))[mode]
    for k, (color, dashes) in looks.items():
        for axes, curve in zip(panels[:2], _polar(shape[k]), strict=True):
            phase = np.linspace(0.0, 360.0, _POINTS)
            axes.plot(phase, curve, color=color, linestyle=dashes, linewidth=1.3, label=plain(names[k]))
    for axes, label in zip(panels[:2], ("$|p|$ [unit of state]", r"$\angle p$ [deg]"), strict=True):
        axes.set_ylabel(label)
        axes.margins(y=0.12)
        axes.ticklabel_format(axis="y", useOffset=False)
    panels[0].set_ylim(bottom=0.0)
    _whole_turns(panels[1])


def _whole_turns(axes: Axes) -> None:
    """Ticks of a phase at multiples of 90 degrees where it turns far enough."""
    from matplotlib.ticker import MaxNLocator, MultipleLocator

    low, high = axes.get_ylim()
    if high - low < 40.0:  # what hardly turns is no drama
        middle = 0.5 * (low + high)
        low, high = middle - 20.0, middle + 20.0
        axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(
        MultipleLocator(90.0 * np.ceil((high - low) / 450.0)) if high - low > 200.0 else MaxNLocator(4)
    )


def _draw_harmonics(axes: Axes, harmonics: Integers, shares: Floats) -> None:
    """The part of each harmonic in the mean square of a shape."""
    from matplotlib.ticker import MaxNLocator

    shown = shares >= _LEAST
    axes.bar(harmonics[shown], shares[shown], color=Ink.SILVER, edgecolor=Ink.BLUE, linewidth=0.8, width=0.7)
    axes.set(yscale="log", ylim=(_LEAST, 2.0), ylabel="part of the mode")
    if shown.any():
        axes.set_xlim(int(harmonics[shown].min()) - 1.4, int(harmonics[shown].max()) + 1.4)
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))


def _identified(
    model: PeriodicModel,
    channels: Sequence[str] | None,
    modes: Sequence[int] | None,
    hit: int,
    weights: ArrayLike | None,
    ax: Into,
    name: str,
) -> Figure:
    """The shapes of a model: a row for each mode and unit, and the parts of the harmonics."""
    index(hit, "hit", name, model.n_hits)
    listed = _asked(model, modes, name) or _strongest(model)
    axes = (len(model.channels), model.n_hits)
    weighted = _by_unit(model) if weights is None else frozen_array(weights, "weights", name, axes=axes)
    rows = list(range(len(model.channels)))
    if channels is not None:
        rows = channels_named(model.channels, channels, argument="states", of=name)
    looks = _looks(model, rows, listed, hit)
    units = list(dict.fromkeys(model.channels[row].unit for row in looks))
    lines = len(listed) * len(units)
    with _panels(0.9 + 1.75 * lines + 0.1 * len(listed), lines, ax, name) as (figure, panels):
        for place, mode in enumerate(listed):
            for number, unit in enumerate(units):
                three = panels[place * len(units) + number]
                own = {row: look for row, look in looks.items() if model.channels[row].unit == unit}
                _draw_identified(three[:2], model, mode, hit, own, unit)
                if number:
                    three[2].set_axis_off()
            first = panels[place * len(units)]
            _draw_harmonics(first[2], *participation(model, mode, weighted))
            first[0].set_title(_title_with_errors(model, mode), loc="left")
        for line, three in enumerate(panels):
            for axes in three[:2]:
                label_angle(axes, None, name, steps=4)
                if line < len(panels) - 1:
                    axes.set_xlabel("")
                    axes.tick_params(labelbottom=False)
        panels[(len(listed) - 1) * len(units)][2].set_xlabel("harmonic $m$")
    return figure


def _strongest(model: PeriodicModel) -> list[int]:
    """The strongest modes, in the order of the model."""
    energy = np.sum(np.abs(model.coefficients) ** 2, axis=(2, 3))
    share = np.sum(energy / np.maximum(energy.max(axis=0), 1e-300), axis=1)
    units = len({channel.unit for channel in model.channels})
    upper = sorted(model.upper_modes, key=lambda r: -share[r])
    return sorted(upper[: max(1, min(_MODES, _ROWS // units))])


def _looks(model: PeriodicModel, rows: list[int], modes: list[int], hit: int) -> dict[int, tuple[str, Any]]:
    """Style of each channel that is drawn: of each unit the strongest, as many as can be told apart."""
    sizes = np.sqrt(np.sum(np.abs(model.coefficients[modes][:, :, hit]) ** 2, axis=2)).max(axis=0)
    looks: dict[int, tuple[str, Any]] = {}
    for unit in dict.fromkeys(model.channels[row].unit for row in rows):
        own = sorted((row for row in rows if model.channels[row].unit == unit), key=lambda row: -sizes[row])
        looks |= {row: _LOOKS[(len(looks) + k) % len(_LOOKS)] for k, row in enumerate(sorted(own[:_CURVES]))}
    return looks


def _title_with_errors(model: PeriodicModel, mode: int) -> str:
    """The number of the mode and its exponent with the deviations."""
    value, std, upper = model.exponents[mode], model.exponent_std, model.upper_modes
    spread = complex(np.nan, np.nan) if std is None else complex(std[mode])
    number = f"mode {upper.index(mode) + 1}" if mode in upper else f"index {mode}"
    sign = "+" if value.imag >= 0.0 else "-"
    words = f"{with_error(value.real, spread.real)} {sign} {with_error(abs(value.imag), spread.imag)} i"
    return rf"{number}: $\lambda$ = {words} 1/s".replace("-", "−")


def _draw_identified(
    panels: Sequence[Axes], model: PeriodicModel, mode: int, hit: int, looks: dict[int, tuple[str, Any]], unit: str
) -> None:
    """Real and imaginary part of the shape in the channels of one unit, with their bands."""
    curves = shape_curves(model, mode, hit, 181)
    phase, largest = 360.0 * curves.turns, 0.0
    for row, (color, dashes) in looks.items():
        value = curves.values[row]
        std = None if curves.std is None else curves.std[row]
        parts, bands = (value.real, value.imag), (None, None) if std is None else (std.real, std.imag)
        largest = max(largest, *(float(np.nanmax(np.abs(part))) for part in parts))
        for axes, part, band in zip(panels, parts, bands, strict=True):
            axes.plot(phase, part, color=color, linestyle=dashes, linewidth=1.3, label=plain(model.channels[row].name))
            if band is not None:
                edge = {"color": color, "alpha": 0.25, "linewidth": 0.0}
                axes.fill_between(phase, part - WITHIN * band, part + WITHIN * band, **edge)
    if curves.std is not None:
        panels[0].fill_between([], [], [], color=Ink.SILVER, alpha=0.4, linewidth=0.0, label="95 % intervals")
    for axes, name in zip(panels, ("Re", "Im"), strict=True):
        axes.margins(y=0.12)
        label_values(axes, name, unit, largest)


def _polar(value: Complexes) -> tuple[Floats, Floats]:
    """Size and phase, the phase where the size says something."""
    size, angle = np.abs(value), np.degrees(np.unwrap(np.angle(value)))
    angle = angle - 360.0 * np.round(angle.mean() / 360.0)
    return size, np.where(size > _FAINT * max(float(size.max()), 1e-300), angle, np.nan)


def _by_unit(model: PeriodicModel) -> Floats:
    """One over the largest coefficient of each unit (channels, hits): units cannot be added as they are."""
    largest = np.abs(model.coefficients).max(axis=(0, 2, 3), initial=0.0)
    units = np.array([channel.unit for channel in model.channels])
    sizes = np.array([largest[units == unit].max() for unit in units])
    weights = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    return np.repeat(weights[:, None], model.n_hits, axis=1)
