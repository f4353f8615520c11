"""Modes over an operating point: tracks through results at several speeds, and the edges of instability."""

from floquid.surveys._objects import BRANCHES, Seen, branch_of, invariants, similarities, turn_between
from floquid.surveys._points import (
    KNOWN,
    NOT_READ,
    ObservedSystem,
    is_linearised,
    known_exponents,
    known_modes,
    objects_of,
    point_of,
)
from floquid.surveys._survey import survey
from floquid.surveys._tracking import Matches, assigned, match_records, matches_of
from floquid.surveys._types import Edge, Link, Point, Survey, Track
from floquid.surveys._words import (
    DAMPING,
    Damping,
    damping_of,
    edge_words,
    link_runs,
    look_of,
    looks,
    order_end,
    order_lines,
    point_rows,
    track_rows,
    unstable_spans,
)

__all__ = [
    "Edge", "Link", "ObservedSystem", "Point", "Survey", "Track", "edge_words", "is_linearised", "known_exponents",
    "known_modes", "point_of", "point_rows", "survey", "track_rows",
]  # fmt: skip
