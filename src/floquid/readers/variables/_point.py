"""The operating point that a file of variables states: its single numbers that mean nothing else."""

from __future__ import annotations

import numpy as np

from floquid.core import point_of
from floquid.readers.variables._by_name import KEYS, SCALE, TIME_NAMES, Variable, VariableFile
from floquid.tables import says_rate


def point_beside(file: VariableFile, variable: Variable) -> dict[str, float]:
    """The single finite numbers at the level of a `variable` and above, by name, without rates, times and scales."""
    found: dict[str, float] = {}
    for level in variable.levels:
        for one in file.variables.values():
            if one.levels[0] == level and one.name not in found and _is_quantity(one):
                with np.errstate(over="ignore"):  # a long double too large becomes infinite
                    found[one.name] = float(file.numbers(one.path).reshape(()))
    return point_of(found)


def _is_quantity(variable: Variable) -> bool:
    """True for a single number whose name says no rate, time, scale or word of ours."""
    name = variable.name
    known = name in (*KEYS, *TIME_NAMES) or says_rate(name) or SCALE.search(name)
    return variable.kind == "numbers" and variable.size == 1 and not known
