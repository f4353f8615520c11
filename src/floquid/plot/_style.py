"""The look of all figures, readable in print, in grey and by the colour-blind; the figures of a result as files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike

from floquid._checks import input_error, integer, wrong_value
from floquid.io import as_path, atomic_path
from floquid.pipeline import Analysis
from floquid.views import Ink, SpeedUnit, in_unit, shortened

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


Thing = TypeVar("Thing")

Into: TypeAlias = "Axes | Iterable[Axes] | None"
"""Canvas of a figure: axes of the caller, as many as it has panels, or a new figure."""

LONGEST = 38  # the longest text that fits beside or above the axes, in characters
PLAIN_FROM, PLAIN_TO = 5e-3, 1e4  # values of this size are written out
POINTS = 4000  # points that a curve is drawn with, at most: more look the same
SIZE = 9.0  # of all text [pt]
CLOSE_UPS, CLOSE_ACROSS = 12, 4  # panels close up, at most, and how many of them in a row
ACROSS, HANDLE = 100, 9  # characters that a row of a legend holds, and those that a handle and the gaps about it take

_LOOK = {
    "figure.constrained_layout.h_pad": 0.06,
    "figure.constrained_layout.w_pad": 0.06,
    # A size in words, such as "medium", would be looked up when the figure is drawn: under the reader's own settings.
    **dict.fromkeys(
        ["font.size", "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize"], SIZE
    ),
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.0,
    "legend.frameon": False,
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "none",
    "svg.hashsalt": "floquid",  # the same figure gives the same file
}


@dataclass(frozen=True, slots=True)
class Look:
    """Style of the points and the line of one of several results: a dot sits inside a ring where two agree."""

    points: dict[str, Any]
    line: dict[str, Any]


_RING = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "markersize": 5.0, "markeredgewidth": 0.9}
_DOT = {"linestyle": "none", "marker": "o", "markersize": 2.8, "markeredgewidth": 0.0}
_CROSS = {"linestyle": "none", "marker": "x", "markersize": 5.0, "markeredgewidth": 0.8}
_PLUS = {"linestyle": "none", "marker": "+", "markersize": 7.0, "markeredgewidth": 0.8}

LOOKS = tuple(
    Look({**points, "color": color}, {"color": color, "linestyle": dashes, "linewidth": width})
    for points, color, dashes, width in (
        (_RING, Ink.BLUE, "-", 1.4),
        (_DOT, Ink.VERMILION, "--", 0.9),
        (_CROSS, Ink.GREEN, "-.", 0.9),
        (_PLUS, Ink.PURPLE, ":", 1.2),
    )
)  # told apart by form as well as by colour


@contextmanager
def style() -> Iterator[None]:
    """The defaults of matplotlib with floquid's look over them, until the block ends."""
    import matplotlib.style

    with matplotlib.style.context(["default", _LOOK]):
        yield


@contextmanager
def drawing(
    height: float, into: Into, of: str, *, panels: Sequence[Sequence[int]] = ((0,),), legend: bool = True, **grid: Any
) -> Iterator[tuple[Figure, list[Axes]]]:
    """A figure of that `height` [in] and its panels to draw in, or the axes of the caller (`into`) and their figure.

    A new figure belongs to no window and no global list. `panels` are the numbers of the panels in rows and columns of
    a grid, each in all places that it takes, and `grid` what else `Figure.subplot_mosaic` takes. A `legend` of all
    panels stands above a new figure, and in the first of the caller's axes. Raises InputError where `into` are not as
    many axes as there are panels.
    """
    from matplotlib.figure import Figure

    with style():
        if into is None:
            figure: Any = Figure(figsize=(7.0, height), layout="constrained")
            own: list[Axes] = list(figure.subplot_mosaic([list(row) for row in panels], **grid).values())
            for axes in own:  # or the number of ticks would depend on the reader's own settings
                axes.tick_params(labelsize=SIZE)
        else:
            own = _given(into, 1 + max(map(max, panels)), of)
            figure = own[0].figure.figure  # that of a figure in a figure
        before = figure.axes
        yield figure, own
        entries: dict[str, Any] = {}
        for axes in [*own, *(one for one in figure.axes if one not in before)]:
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                entries.setdefault(label, handle)
        if into is None:
            figure.align_ylabels()
        if legend and entries:
            place: dict[str, Any] = {"loc": "outside upper center", "ncols": columns_that_fit(list(entries))}
            if into is not None:
                place = {"loc": "upper right"}
            (figure if into is None else own[0]).legend(list(entries.values()), list(entries), **place)


def grid_of(rows: int, columns: int = 1) -> list[list[int]]:
    """The numbers of the panels of a full grid, row by row."""
    return [list(range(row * columns, (row + 1) * columns)) for row in range(rows)]


def with_close_ups(count: int, heights: tuple[float, float]) -> tuple[int, dict[str, Any]]:
    """Rows of `count` panels close up below two large ones, and their layout for `drawing`, each row of a height."""
    rows = -(-count // CLOSE_ACROSS)
    below = 2 + np.arange(2 * rows * CLOSE_ACROSS).reshape(rows, 2 * CLOSE_ACROSS) // 2
    panels = np.vstack([np.repeat([[0, 1]], CLOSE_ACROSS, axis=1), below])
    panels[panels >= 2 + count] = -1
    ratios = (heights[0], *[heights[1]] * rows)
    return rows, {"panels": panels.tolist(), "height_ratios": ratios, "empty_sentinel": -1}


def short_tick(value: float, _: float) -> str:
    """A number at a tick, such as 2e−5."""
    return "0" if abs(value) < 1e-300 else f"{value:.3g}".replace("e-0", "e-").replace("-", "−")


def _given(into: Axes | Iterable[Axes], count: int, of: str) -> list[Axes]:
    """The caller's axes as a list, as many as the figure has panels."""
    from matplotlib.axes import Axes

    own = [into] if isinstance(into, Axes) else list(np.ravel(np.asarray(into, object)))
    must = "be axes of matplotlib" if count == 1 else f"be {count} axes of matplotlib, one for each panel"
    if not all(isinstance(one, Axes) for one in own) or not own:
        raise wrong_value("ax", of, must, into, f"For example: `figure.subplots({count})`.")
    if len(own) != count:
        raise input_error("ax", of, must, f"are {len(own)}", f"For example: `figure.subplots({count})`.")
    return own


def columns_that_fit(labels: list[str], across: int = ACROSS) -> int:
    """Columns of a legend that fits a width in characters, in as few rows as it can."""
    rows = 1
    while rows < len(labels) and _characters(labels, -(-len(labels) // rows)) > across:
        rows += 1
    return -(-len(labels) // rows)


def _characters(labels: list[str], columns: int) -> int:
    """The width of a legend in characters: it is filled column by column, the first ones longer by one if need be."""
    each, longer = divmod(len(labels), columns)
    ends = np.cumsum([each + (column < longer) for column in range(columns)])
    return sum(HANDLE + max(map(len, labels[end - each - (k < longer) : end])) for k, end in enumerate(ends))


def several(things: Thing | Mapping[str, Thing], kind: type[Thing], argument: str, of: str) -> dict[str, Thing]:
    """One thing under an empty name, or the things by name; an InputError unless there are as many as `LOOKS`."""
    if isinstance(things, kind):
        return {"": things}
    if (
        not isinstance(things, Mapping)
        or not 1 <= len(things) <= len(LOOKS)
        or not all(isinstance(thing, kind) for thing in things.values())
    ):
        word = kind.__name__
        must = f"be {'an' if word[0] in 'AEIO' else 'a'} {word}, or up to {len(LOOKS)} of them by name"
        raise wrong_value(argument, of, must, things, f'Pass e.g. {{"one": {word.lower()}}}.')
    return {str(name): thing for name, thing in things.items()}


def entitled(name: str, words: str) -> str:
    """An entry of a legend: the words, and whose they are."""
    return f"{plain(name)}, {words}" if name else words


def plain(text: str) -> str:
    """`text` without formulae by a dollar, cut in the middle where long, its underscore kept in matplotlib's legend."""
    hidden = "\u200b" if text.startswith("_") else ""
    return hidden + shortened(text, LONGEST).replace("$", r"\$")


def frequency_unit(*, angular: bool) -> tuple[float, str]:
    """Units in a cycle a second, and the unit of a frequency."""
    return (2.0 * np.pi, "rad/s") if angular else (1.0, "Hz")


def degrees_a_period(periods_per_revolution: int | None, of: str) -> float:
    """Turn of the phase, or of the shaft, in a period [deg]."""
    if periods_per_revolution is None:
        return 360.0
    return 360.0 / integer(periods_per_revolution, "periods_per_revolution", of, at_least=1)


def label_angle(axes: Axes, periods_per_revolution: int | None, of: str, steps: int = 8) -> None:
    """Label the lower axis of `axes`, with this number of steps: the phase of the period, or the angle of the shaft."""
    end = degrees_a_period(periods_per_revolution, of)
    name = "phase of the period" if periods_per_revolution is None else "shaft angle"
    axes.set(xlabel=f"{name} [deg]", xlim=(-end / 60.0, end * 61.0 / 60.0), xticks=np.linspace(0.0, end, steps + 1))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def label_values(axes: Axes, name: str, unit: str, largest: float) -> None:
    """Label the values of `axes`, with a power of a thousand in the unit when they are very large or small."""
    # The data stay as they are; only the numbers at the ticks are divided. matplotlib would write the power above the
    # axes, where it meets a title or another panel.
    power = 0
    if largest > 0.0 and not PLAIN_FROM <= largest < PLAIN_TO:
        power = 3 * int(np.floor(np.log10(largest) / 3.0))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value / 10.0**power:.6g}".replace("-", "−"))
    else:
        axes.ticklabel_format(axis="y", useOffset=False)
    factor = f"$10^{{{power}}}$" if power else ""
    words = " ".join(part for part in (factor, plain(unit) if not power or unit != "-" else "") if part)
    axes.set_ylabel(in_unit(plain(name), words) if name else "")


def whole_numbers(axis: Axis) -> None:
    """Put ticks at whole numbers alone."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(integer=True))


def plain_decades(axes: Axes) -> None:
    """Write 1, 2, 5, 10 … on a logarithmic axis of a few decades; of many, the powers of ten."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    few = high < 1e3 * max(low, 1e-300)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=12))
    axes.yaxis.set_major_formatter((lambda value, _: f"{value:g}") if few else LogFormatterSciNotation())
    axes.yaxis.set_minor_formatter(NullFormatter())


Format = Literal["png", "svg", "pdf"]

FIGURES = (
    "time_record",
    "spectra",
    "composite",
    "indicators",
    "exponents",
    "periodic_shapes",
    "synthesis",
    "synchronisation",
    "harmonic_spectra",
    "transfer",
    "system_elements",
    "speed",
)
"""The names of the figures that there may be, in the order in which `save_figures` writes them."""

# What would make two files of one figure differ.
_NO_DATE = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}


def save_figures(
    analysis: Analysis,
    folder: str | PathLike[str],
    *,
    truth: tuple[ArrayLike, ArrayLike] | None = None,
    formats: Sequence[Format] = ("png",),
    dpi: float = 150.0,
    speed_unit: SpeedUnit = "hz",
) -> tuple[Path, ...]:
    """Write every figure that the analysis allows, each under the name of its function (`FIGURES`).

    `synthesis` is of the channel and the hit in which a mode rises highest above the noise. `system_elements` needs an
    A(t), `speed` a tachometer, `transfer` measured inputs, and `harmonic_spectra` outputs alone. A scan over orders is
    not in an analysis: for its figure there is `stabilisation`. Each file appears whole or not at all.

    Returns the files written. Raises InputError where the folder does not exist or cannot be written to, a format is
    unknown, or the truth does not fit.

    Parameters
    ----------
    analysis
        What `identify` found.
    folder
        An existing folder; files of the same names in it are replaced.
    truth
        Instants after phase zero (times,) [s] and the true A at each (times, n, n), to be drawn beside the estimate.
    formats
        "png", "svg" or "pdf", or several.
    dpi
        Dots an inch of PNG.
    speed_unit
        The unit of the speed of the shaft, "hz" or "rpm".
    """
    of = "save_figures"
    place = as_path(folder, of=of, argument="folder")
    if isinstance(formats, str) or not all(form in get_args(Format) for form in formats):
        words = ", ".join(f'"{form}"' for form in get_args(Format))
        raise wrong_value("formats", of, f"be a list of {words}", formats, 'Pass e.g. ["png", "pdf"].')
    from threadpoolctl import threadpool_limits

    written, plots = [], analysis.plot
    options: dict[str, dict[str, Any]] = {"system_elements": {"truth": truth}, "speed": {"speed_unit": speed_unit}}
    options |= _options(analysis)
    for name in sorted(dir(plots), key=FIGURES.index):
        # The matrices are many and small: threads inside BLAS would wait for each other, as in `identify`.
        with threadpool_limits(limits=1, user_api="blas"):
            figure = getattr(plots, name)(**options.get(name, {}))
        for form in formats:
            path = place / f"{name}.{form}"
            _write(figure, path, form, dpi, of=of, argument="folder")
            written.append(path)
    return tuple(written)


def figure_of_fit(analysis: Analysis) -> tuple[str, Figure]:
    """The figure that says most of the fit, and its name in words."""
    # Of free responses the record with the model over it and the residual, of measured inputs the transfer functions,
    # of outputs alone the spectra with the lines of the modes.
    if analysis.decay is not None:
        return "the record, the model over it, and the residual", analysis.plot.synthesis(
            **_options(analysis)["synthesis"]
        )
    if analysis.inputs:
        found = analysis.transfer()
        size = np.abs(found.values).max(axis=(0, 3)) / analysis.noise
        row, column = np.unravel_index(int(np.argmax(size)), size.shape)
        return "transfer functions", analysis.plot.transfer(output=int(row), driven_by=int(column))
    return "harmonic power spectra", analysis.plot.harmonic_spectra()


def _options(analysis: Analysis) -> dict[str, dict[str, Any]]:
    """Options of figures by name: the channel and the hit that they are of."""
    row, hit = _strongest(analysis)
    return {
        "periodic_shapes": {"hit": hit},
        "synthesis": {"channel": analysis.model.channels[row].name, "hit": hit},
        "synchronisation": {"hit": hit},
    }


def _strongest(analysis: Analysis) -> tuple[int, int]:
    """The channel and hit of the largest response of a mode over the noise."""
    model, upper = analysis.model, analysis.model.upper_modes
    energy = np.sum(np.abs(model.coefficients[list(upper)]) ** 2, axis=3) / analysis.noise**2
    _, row, hit = np.unravel_index(int(np.argmax(energy)), energy.shape)
    return int(row), int(hit)


def save_figure(figure: Figure, path: str | PathLike[str], *, dpi: float = 150.0) -> Path:
    """Write one figure, whole or not at all; the same figure always gives the same file.

    `figure` is one of this package, and `dpi` the dots an inch of PNG. `path` is the file, ending in .png, .svg or
    .pdf, which is replaced. Returns the file written. Raises InputError where the ending is another, or the file cannot
    be written.
    """
    of = "save_figure"
    place = as_path(path, of=of)
    form = place.suffix[1:].lower()
    if form not in get_args(Format):
        words = ", ".join(f".{one}" for one in get_args(Format))
        raise input_error("path", of, f"end in one of {words}", f"is {place}", "The ending says the format.")
    _write(figure, place, form, dpi, of=of, argument="path")
    return place


def _write(figure: Figure, path: Path, form: str, dpi: float, *, of: str, argument: str) -> None:
    with atomic_path(path, of=of, argument=argument) as temporary, style():
        figure.savefig(temporary, format=form, dpi=dpi, metadata=_NO_DATE[form])
