"""Search for modes and their harmonics: one objective, one list of moves, and the final fit."""

from floquid.periodic.search._evidence import LOUD, coloured, combinations_of, disagreement, evidence
from floquid.periodic.search._final import finished, read_as_modes
from floquid.periodic.search._objective import FASTEST, Point, SearchResult, kept_with
from floquid.periodic.search._one_shape import as_one_of_hits, of_shapes, with_one_shape
from floquid.periodic.search._policies import Bounds, lines, priced, searched, searched_white
from floquid.periodic.search._tests import own_step, period_step
