"""For tests of identification: random systems with known truth, what must be found in them, and comparisons.

`random_system` draws a linear time-periodic system across `Ranges` and gives its records; `findable` says what any
identifier can tell of them, and what a good one must. Spectra are compared modulo the fundamental,
never by array order. `system_with_exponents` builds an A(t) backwards from the exponents it is to have.
"""

from floquid.testing._backwards import system_with_exponents
from floquid.testing._bounds import cramer_rao_bound
from floquid.testing._drawing import random_system
from floquid.testing._findable import Findable, findable
from floquid.testing._random_systems import CLASSES, RandomSystem, Ranges
from floquid.testing._spectra import Pairing, assert_exponents_close, pair_exponents

__all__ = [
    "CLASSES",
    "Findable",
    "Pairing",
    "RandomSystem",
    "Ranges",
    "assert_exponents_close",
    "cramer_rao_bound",
    "findable",
    "pair_exponents",
    "random_system",
    "system_with_exponents",
]
