"""Checks the deviations of an `Analysis` by drawing records from its model and identifying each of them."""

from floquid.pipeline.draws._bootstrap import Bootstrap, bootstrap
from floquid.pipeline.draws._redraw import Draw
from floquid.pipeline.draws._spread import DrawFile, Spread
