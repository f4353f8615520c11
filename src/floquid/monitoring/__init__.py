"""Records of one machine against a baseline of it: charts of exponents, the instant of a change, periodic amounts."""

from floquid.monitoring._monitor import monitor
from floquid.monitoring._types import Amounts, Change, Charts, Monitor, Part, Trend
from floquid.monitoring._words import CHARTED as CHARTED
from floquid.monitoring._words import change_words as change_words
from floquid.monitoring._words import feature_change as feature_change
from floquid.monitoring._words import record_heads as record_heads
from floquid.monitoring._words import record_rows as record_rows
from floquid.monitoring._words import sentences as sentences

__all__ = ["Amounts", "Change", "Charts", "Monitor", "Part", "Trend", "monitor"]
