"""Many records: each identified by one of many workers, a row a mode in a table that a run goes on with.

`outcomes` is the one runner of jobs: here, in `pool`s of processes, or by any executor of `concurrent.futures`.
"""

from floquid.fleets._fleet import Fleet, fleet
from floquid.fleets._runner import outcomes, scheduled, time_left
from floquid.fleets._table import Kept, kept_results

__all__ = ["Fleet", "Kept", "fleet", "kept_results", "outcomes", "scheduled", "time_left"]
