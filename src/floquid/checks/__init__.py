"""Checks of a model of any kind of record: one list, one loop, and the verdict by them.

`CHECKS` is the list; each runs on the kinds that can answer it: `Decays`, `Driven` and `Ambient`. `validate` judges any
`PeriodicModel` against free responses.
"""

from floquid.checks._check import Check, Criterion, Evidence, Validation
from floquid.checks._decays import Decays
from floquid.checks._excited import Ambient, Driven, Excited, Parted
from floquid.checks._left_out import ALIVE, first_part, without_last
from floquid.checks._modes import MOST_PERIODS, repeats_of
from floquid.checks._residual import BESIDE, FAILED
from floquid.checks._verdict import CHECKS, findings_of, judged, validate

__all__ = ["CHECKS", "Check", "Criterion", "Validation", "validate"]
