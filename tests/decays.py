"""Analyses of free responses with other parts."""

from dataclasses import replace


def with_decay(analysis, **changes):
    """The analysis with these parts of its decay."""
    return replace(analysis, decay=replace(analysis.decay, **changes))
