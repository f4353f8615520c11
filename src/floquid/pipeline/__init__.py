"""The whole chain: `identify` takes records and `Settings` and gives an `Analysis`, with every intermediate kept."""

from floquid.pipeline._analysis import Analysis
from floquid.pipeline._doubts import CONFIDENT
from floquid.pipeline._identify import identify
from floquid.pipeline._settings import Settings

__all__ = ["CONFIDENT", "Analysis", "Settings", "identify"]
