"""Records of one machine against a baseline of it: charts of exponents, the instant of a change, periodic amounts."""

from floquid.monitoring._monitor import monitor
from floquid.monitoring._types import (
    CHARTED,
    Amounts,
    Change,
    Charts,
    Monitor,
    Part,
    Trend,
    amount_label,
    beside_baseline,
    over_limits,
    record_heads,
    record_rows,
    sentences,
    spans_of,
)

__all__ = ["Amounts", "Change", "Charts", "Monitor", "Part", "Trend", "monitor"]
