"""Modes over an operating point: tracks through results at several speeds, and the edges of instability."""

from floquid.surveys._known import KNOWN as KNOWN
from floquid.surveys._known import ObservedSystem, is_linearised, known_exponents, known_modes
from floquid.surveys._objects import BRANCHES as BRANCHES
from floquid.surveys._objects import Seen as Seen
from floquid.surveys._objects import branch_of as branch_of
from floquid.surveys._objects import invariants as invariants
from floquid.surveys._objects import similarities as similarities
from floquid.surveys._objects import turn_between as turn_between
from floquid.surveys._points import NOT_READ as NOT_READ
from floquid.surveys._points import objects_of as objects_of
from floquid.surveys._points import point_of
from floquid.surveys._records import Matches as Matches
from floquid.surveys._records import match_records as match_records
from floquid.surveys._records import matches_of as matches_of
from floquid.surveys._survey import survey
from floquid.surveys._tracking import assigned as assigned
from floquid.surveys._types import Edge, Link, Point, Survey, Track
from floquid.surveys._words import DAMPING as DAMPING
from floquid.surveys._words import Damping as Damping
from floquid.surveys._words import damping_of as damping_of
from floquid.surveys._words import edge_words, point_rows, track_rows
from floquid.surveys._words import look_of as look_of
from floquid.surveys._words import order_lines as order_lines

__all__ = [
    "Edge", "Link", "ObservedSystem", "Point", "Survey", "Track", "edge_words", "is_linearised", "known_exponents",
    "known_modes", "point_of", "point_rows", "survey", "track_rows",
]  # fmt: skip
