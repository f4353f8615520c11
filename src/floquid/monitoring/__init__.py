"""Records of one machine against a baseline of it: charts of exponents, the instant of a change, periodic amounts."""

from floquid.monitoring._monitor import monitor
from floquid.monitoring._types import (
    CHARTED,
    LEAST,
    Amounts,
    Change,
    Charts,
    Monitor,
    Part,
    Trend,
    record_heads,
    record_rows,
    sentences,
)

__all__ = ["Amounts", "Change", "Charts", "Monitor", "Part", "Trend", "monitor"]
