"""The whole chain: `identify` takes records and `Settings` and gives an `Analysis`, with every intermediate kept.

`lifted` stops after lifting, and `find_poles` goes on from there to poles and noise.
"""

from floquid.periodic import CONFIDENT
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._find_poles import find_poles
from floquid.pipeline._identify import identify
from floquid.pipeline._lifted import lifted
from floquid.pipeline._settings import Settings

__all__ = ["CONFIDENT", "Analysis", "Settings", "find_poles", "identify", "lifted"]
