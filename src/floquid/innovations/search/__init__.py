"""The search for the modes of an innovations form: bands that grow, modes joined or left out, pairs near an axis."""

from floquid.innovations.search._fewer import GONE, alike
from floquid.innovations.search._near_axis import read_near_axis, with_near_blocks
from floquid.innovations.search._search import searched
