"""Former names, for one version: each warns and says the new one."""

from __future__ import annotations

import warnings
from typing import Any

from floquid.floquet.control import DiscretePeriodicSystem, LiftedSystem, lift, realise
from floquid.floquet.monodromy_matrix import FloquetLyapunov, floquet_lyapunov


def lyapunov(*arguments: Any, **options: Any) -> FloquetLyapunov:
    """The former name of `floquet_lyapunov`: with its `arguments` and `options`."""
    _warn("floquet.lyapunov", "floquet.floquet_lyapunov")
    return floquet_lyapunov(*arguments, **options)


def _lifted(self: DiscretePeriodicSystem, *arguments: Any, **options: Any) -> LiftedSystem:
    """The former method `lift`, with its `arguments` and `options`."""
    _warn("DiscretePeriodicSystem.lifted", "floquet.lift")
    return lift(self, *arguments, **options)


def _from_control(*arguments: Any, **options: Any) -> DiscretePeriodicSystem:
    """The former name of `realise`, with its `arguments` and `options`."""
    _warn("DiscretePeriodicSystem.from_control", "floquet.realise")
    return realise(*arguments, **options)


def _warn(old: str, new: str) -> None:
    warnings.warn(f"`{old}` is now `{new}`; the old name will go.", DeprecationWarning, stacklevel=3)


# Methods would have the type know what is made of it: they are put there from outside.
DiscretePeriodicSystem.lifted = _lifted  # type: ignore[attr-defined]
DiscretePeriodicSystem.from_control = staticmethod(_from_control)  # type: ignore[attr-defined]
