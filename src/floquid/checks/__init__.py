"""Checks of a model of any kind of record: one list, one loop, and the verdict by them.

`CHECKS` is the list; each runs on the kinds that can answer it: `Decays`, `Driven` and `Ambient`. `validate` judges any
`PeriodicModel` against free responses.
"""

from floquid.checks._check import MISFIT as MISFIT
from floquid.checks._check import Check, Criterion, Validation
from floquid.checks._check import Evidence as Evidence
from floquid.checks._decays import Decays as Decays
from floquid.checks._excited import Ambient as Ambient
from floquid.checks._excited import Driven as Driven
from floquid.checks._excited import Excited as Excited
from floquid.checks._excited import Parted as Parted
from floquid.checks._left_out import first_part as first_part
from floquid.checks._left_out import without_last as without_last
from floquid.checks._modes import MOST_PERIODS as MOST_PERIODS
from floquid.checks._residual import FAILED as FAILED
from floquid.checks._verdict import CHECKS, validate
from floquid.checks._verdict import findings_of as findings_of
from floquid.checks._verdict import judged as judged

__all__ = ["CHECKS", "Check", "Criterion", "Validation", "validate"]
