"""The table of numbers, and the page with the figures, as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from floquid.paper._figures import PaperFigure
from floquid.paper._numbers import Number

COLUMNS = ("what", "printed", "corrected", "AMI", "maximum likelihood")

LEGEND = (
    "*Corrected* is the right value by the rotor's equations; of an error, what is left of it with exact residues. "
    "*AMI* and *maximum likelihood* are ours: (19) is one standard deviation in the last digits, and without one the "
    "value is that of the first draw of the noise. All is without dimension: time is counted in 1/ω_n, though axes and "
    "units say s."
)

INTRODUCTION = (
    "M. S. Allen, Frequency-Domain Identification of Linear Time-Periodic Systems using LTI Techniques (2009), section "
    "3: a rotor on an anisotropic shaft in anisotropic bearings, simulated and identified again by the paper's "
    "algorithm (AMI) and by maximum likelihood. Under each figure's title stands what the paper says of it, then what "
    "ours shows."
)


def table(rows: Sequence[Number]) -> str:
    """The numbers in `rows` as tables in Markdown, one a section of the paper, with their notes below."""
    lines: list[str] = []
    notes: list[str] = []
    section = None
    for number in rows:
        if number.section != section:
            section = number.section
            lines += ["", f"**Section {section}**", "", _row(COLUMNS), _row(["---", *["--:"] * 4])]
        what = number.what.strip()
        if number.note:
            if number.note not in notes:
                notes.append(number.note)
            what += f" [{notes.index(number.note) + 1}]"
        lines.append(_row(["&emsp;" * number.what.startswith(" ") + what, *number.cells]))
        lines += [_row([f"&emsp;{words}", "", "", ami, ml]) for words, ami, ml in number.over_draws]
    lines += ["", *(f"{place}. {note}" for place, note in enumerate(notes, start=1))]
    return "\n".join([LEGEND, *lines]) + "\n"


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def figure_text(figure: PaperFigure) -> str:
    """A heading of the `figure`, what the paper says of it and what is to be seen in ours, as Markdown."""
    return f"## Figure {figure.number}: {figure.title}\n\n> {figure.statement} ({figure.source})\n\n{figure.seen}\n"


def page(figures: Sequence[PaperFigure], rows: Sequence[Number], path: Callable[[PaperFigure], str]) -> str:
    """The whole comparison as a page of Markdown: the `figures`, each beside the paper's words, then the `rows`.

    `path` says where the picture of a figure is, as seen from the page.
    """
    parts = ["# The application of Allen's paper, redrawn and recomputed\n", f"{INTRODUCTION}\n"]
    for figure in figures:
        parts += [figure_text(figure), f"![Figure {figure.number}: {figure.title}]({path(figure)})\n"]
    parts += ["## Every number of section 3\n", table(rows)]
    return "\n".join(parts)
