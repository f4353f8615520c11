"""The table: the words of each finding by its code, all stages together."""

from __future__ import annotations

from collections.abc import Callable

from floquid.findings._draws import DRAWS
from floquid.findings._fit import FIT, ORDER
from floquid.findings._inputs import AMBIENT, INPUTS
from floquid.findings._model import MODEL, SYSTEM
from floquid.findings._period import PERIOD
from floquid.findings._records import RECORDS, SHAFT
from floquid.findings._verdict import VERDICT

WORDS: dict[str, str | Callable[..., str]] = {
    **RECORDS,
    **SHAFT,
    **ORDER,
    **FIT,
    **INPUTS,
    **AMBIENT,
    **PERIOD,
    **MODEL,
    **SYSTEM,
    **VERDICT,
    **DRAWS,
}
"""A template that the numbers are put into, or a function of them."""
