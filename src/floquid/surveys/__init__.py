"""Modes over an operating point: tracks through results at several speeds, and the edges of instability."""

from floquid.surveys._points import NOT_READ as NOT_READ
from floquid.surveys._points import point_of
from floquid.surveys._survey import survey
from floquid.surveys._types import Edge, Link, Point, Survey, Track
from floquid.surveys._words import edge_words, point_rows, track_rows

__all__ = [
    "Edge", "Link", "Point", "Survey", "Track", "edge_words", "point_of", "point_rows", "survey", "track_rows",
]  # fmt: skip
