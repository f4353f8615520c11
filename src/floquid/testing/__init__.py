"""For tests of identification: the Cramér-Rao bound, and spectra compared modulo the fundamental, never by order.

`system_with_exponents` builds an A(t) backwards from the exponents it is to have.
"""

from floquid.testing._backwards import system_with_exponents
from floquid.testing._bounds import cramer_rao_bound
from floquid.testing._spectra import Pairing, assert_exponents_close, pair_exponents

__all__ = ["Pairing", "assert_exponents_close", "cramer_rao_bound", "pair_exponents", "system_with_exponents"]
