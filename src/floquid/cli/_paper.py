"""The paper's numbers on the terminal, and its figures in the folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rich.table import Table

from floquid.cli._terminal import print_title, terminal
from floquid.paper import Number, PaperFigure, page
from floquid.plot import save_figure

COLUMNS = ("printed", "corrected", "AMI", "max. likelihood")

LEGEND = (
    "corrected: the right value by the rotor's equations; of an error, what is left of it with exact residues. AMI and "
    "max. likelihood are ours: (19) is one standard deviation in the last digits, and without one the value is that of "
    "the first draw of the noise. All is without dimension: time is counted in 1/ω_n."
)


def files_of_paper(figures: Sequence[PaperFigure], rows: Sequence[Number]) -> dict[str, Callable[[Path], object]]:
    """The files of the comparison by name, each with a function that writes it to a path."""

    def picture(figure: PaperFigure) -> Callable[[Path], object]:
        return lambda path: save_figure(figure.figure, path)

    files = {_name(figure): picture(figure) for figure in figures}
    text = page(figures, rows, _name)
    return {"paper.md": lambda path: path.write_text(text, encoding="utf-8"), **files}


def _name(figure: PaperFigure) -> str:
    return f"figures/paper_{figure.number}.png"


def print_numbers(rows: Sequence[Number]) -> None:
    """The table of numbers, a part for each section of the paper, and the notes below."""
    console = terminal()
    notes = list(dict.fromkeys(number.note for number in rows if number.note))
    # The parts of the table stand under one another.
    widths = [max(len(number.cells[column]) for number in rows) for column in range(len(COLUMNS))]
    longest = min(max(len(number.what) for number in rows) + 5, max(20, console.width - sum(widths) - 10))
    for section in dict.fromkeys(number.section for number in rows):
        print_title(console, f"Section {section} of the paper, and ours")
        table = Table(box=None, pad_edge=False)
        table.add_column("", min_width=longest)
        for name, width in zip(COLUMNS, widths, strict=True):
            table.add_column(name, justify="right", no_wrap=True, min_width=width)
        for number in rows:
            if number.section != section:
                continue
            mark = f" [{notes.index(number.note) + 1}]" if number.note else ""
            table.add_row(number.what + mark, *number.cells)
            for words, *ours in number.over_draws:
                table.add_row(f"    {words}", "", "", *ours)
        console.print(table)
    console.print()
    console.print(LEGEND, style="dim")
    for place, note in enumerate(notes, start=1):
        console.print(f"[{place}] {note}", style="dim")
