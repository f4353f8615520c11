"""Models against measurements: two sets of modes compared, and the parameters of a model fitted to results."""

from floquid.comparison._compare import compare
from floquid.comparison._parameters import Direction, Misfit, Parameter, Updated
from floquid.comparison._types import (
    RARE,
    ComparedPoint,
    Comparison,
    Pair,
    headings,
    missing_words,
    mode_labels,
    mode_number,
    pair_row,
    update_words,
    verdict,
)
from floquid.comparison._update import update

__all__ = [
    "ComparedPoint", "Comparison", "Direction", "Misfit", "Pair", "Parameter", "Updated", "compare", "headings",
    "missing_words", "mode_number", "pair_row", "update", "update_words", "verdict",
]  # fmt: skip
