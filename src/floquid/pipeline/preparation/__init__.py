"""From records and settings to the responses and their clocks, and the refusals before any long work."""

from floquid.pipeline.preparation._before import begun, faults_of, from_sample, mended
from floquid.pipeline.preparation._driven import refuse_driven
from floquid.pipeline.preparation._mended import NO_RESPONSE
from floquid.pipeline.preparation._own_names import own_names
from floquid.pipeline.preparation._prepare import (
    Prepared,
    blas_threads,
    clocked,
    prepare,
    uneven_speed,
    without_clock,
)
from floquid.pipeline.preparation._refuse import NO_NEWS, name_of, refuse_few, refuse_period, refuse_unlike

__all__ = [
    "NO_NEWS", "NO_RESPONSE", "Prepared", "begun", "blas_threads", "clocked", "faults_of", "from_sample", "mended",
    "name_of", "prepare", "refuse_driven", "refuse_few", "refuse_period", "refuse_unlike", "uneven_speed",
    "without_clock",
]  # fmt: skip
