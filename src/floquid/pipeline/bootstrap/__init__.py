"""Checks the deviations of an `Analysis` by drawing records from its model and identifying each of them."""

from floquid.pipeline.bootstrap._bootstrap import AbstractDraws, Bootstrap, bootstrap
from floquid.pipeline.bootstrap._draws import Draw
from floquid.pipeline.bootstrap._spread import Spread
