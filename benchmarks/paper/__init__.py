"""The application of Allen's paper (2009, section 3), redrawn and recomputed.

`reproduce` simulates its experiment and identifies it by AMI and by maximum likelihood; `figures` draws its figures
2 to 8 from that, each with the paper's words; `numbers` holds every number of the section against ours and against the
truth. `table` and `page` write them in Markdown.
"""

from benchmarks.paper._experiment import Draw, Reproduction, reproduce
from benchmarks.paper._figures import PaperFigure, figure_text, figures, page, table
from benchmarks.paper._numbers import Estimate, Number
from benchmarks.paper._rows import numbers

__all__ = [
    "Draw", "Estimate", "Number", "PaperFigure", "Reproduction", "figure_text", "figures", "numbers", "page",
    "reproduce", "table",
]  # fmt: skip
