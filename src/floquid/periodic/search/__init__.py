"""Search for modes and bands: moves decided by scores, lines of the residual, the final fit."""

from floquid.periodic.search._evidence import coloured, combinations_of, evidence
from floquid.periodic.search._final import finished
from floquid.periodic.search._moves import without_needless
from floquid.periodic.search._near_axis import read_apart
from floquid.periodic.search._new_lines import with_lines
from floquid.periodic.search._rounds import begun, searched, searched_white
from floquid.periodic.search._scores import period_step
from floquid.periodic.search._state import Limits, SearchResult, State
