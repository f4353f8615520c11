"""Modes over an operating point: tracks through results at several speeds, and the edges of instability."""

from floquid.surveys._survey import survey
from floquid.surveys._types import Edge, Link, Point, Survey, Track

__all__ = ["Edge", "Link", "Point", "Survey", "Track", "survey"]
