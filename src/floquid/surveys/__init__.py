"""Modes over an operating point: tracks through results at several speeds, and the edges of instability."""

from floquid.surveys._points import point_of
from floquid.surveys._records import Matches as Matches
from floquid.surveys._records import match_records as match_records
from floquid.surveys._records import matches_of as matches_of
from floquid.surveys._survey import survey
from floquid.surveys._types import Edge, Link, Point, Survey, Track
from floquid.surveys._words import edge_words, point_rows, track_rows

__all__ = [
    "Edge", "Link", "Point", "Survey", "Track", "edge_words", "point_of", "point_rows", "survey", "track_rows",
]  # fmt: skip
