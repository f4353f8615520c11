"""Floquet analysis of a known A(t): the truth that identification is held against, and shares no code with.

Exponents are on the principal branch, -ω/2 < Im λ ≤ ω/2 with ω = 2π/period. Plain shooting: the state equation is
integrated over one period, which finds every multiplier to a small fraction of the largest; see `exponents`.
"""

from floquid.floquet._matrix import StateMatrix
from floquid.floquet._shooting import exponents, monodromy, multipliers, transition

__all__ = ["StateMatrix", "exponents", "monodromy", "multipliers", "transition"]
