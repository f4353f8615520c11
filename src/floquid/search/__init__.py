"""Search over structures by one objective: moves, and the descent that accepts those by which it falls."""

from floquid.search._descend import GAP as GAP
from floquid.search._descend import HOPE as HOPE
from floquid.search._descend import LOOSE as LOOSE
from floquid.search._descend import NEAR as NEAR
from floquid.search._descend import REACH as REACH
from floquid.search._descend import SAME as SAME
from floquid.search._descend import SECONDS as SECONDS
from floquid.search._descend import Move as Move
from floquid.search._descend import Point as Point
from floquid.search._descend import Report as Report
from floquid.search._descend import Stages as Stages
from floquid.search._descend import descended as descended
from floquid.search._descend import longer as longer

__all__: list[str] = []
