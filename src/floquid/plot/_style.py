"""One look for all figures: readable in print, in grey and by the colour-blind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from floquid.views import shortened

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette.
BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
GREY = "#999999"

LONGEST = 38
"""The longest text that fits beside or above the axes, in characters."""

PLAIN_FROM, PLAIN_TO = 5e-3, 1e4
"""Values of this size are written out."""

SIZE = 9.0
"""Of all text [pt]."""

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


@contextmanager
def style() -> Iterator[None]:
    """The defaults of matplotlib with floquid's look over them, until the block ends."""
    import matplotlib.style

    with matplotlib.style.context(["default", _LOOK]):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size [in], belonging to no window and no global list."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def finish(figure: Figure) -> None:
    """Give the figure the legend of its first axes, in a row of its own above them, where it covers nothing."""
    for axes in figure.axes:
        axes.tick_params(labelsize=SIZE)  # or else the number of ticks depends on the reader's own settings
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))


def plain(text: str) -> str:
    """`text` as it is: a dollar in a channel's name starts no formula, and of a long name the middle is left out.

    matplotlib leaves out of a legend what begins with an underscore; a space of no width stands before it.
    """
    hidden = "\u200b" if text.startswith("_") else ""
    return hidden + shortened(text, LONGEST).replace("$", r"\$")


def label_values(axes: Axes, name: str, unit: str, largest: float) -> None:
    """Label the values of `axes`, with a power of a thousand in the unit when they are very large or small.

    The data stay as they are; only the numbers at the ticks are divided. matplotlib would write the power above the
    axes, where it meets a title or another panel.
    """
    power = 0
    if largest > 0.0 and not PLAIN_FROM <= largest < PLAIN_TO:
        power = 3 * int(np.floor(np.log10(largest) / 3.0))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value / 10.0**power:.6g}".replace("-", "−"))
    else:
        axes.ticklabel_format(axis="y", useOffset=False)
    factor = f"$10^{{{power}}}$" if power else ""
    words = " ".join(part for part in (factor, plain(unit) if not power or unit != "-" else "") if part)
    axes.set_ylabel(f"{plain(name)} [{words}]" if name else "")
