"""Words and limits of options that `Settings` checks before the rooms that act on them are imported."""

from __future__ import annotations

from typing import Literal, TypeAlias

Hold: TypeAlias = Literal["zero", "first", "none"]
"""The input between its samples: held, linear, or acting at the samples alone."""

Form: TypeAlias = Literal["second-order", "first-order", "delayed"]
"""States of A(t) beside those that were named: their derivatives, none, or later samples of them."""

MOST_TIMES = 10_000
"""Instants of a period at most, where a number of them is asked for."""
