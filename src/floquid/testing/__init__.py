"""Assertions for tests of identification: spectra are compared modulo the fundamental, never by array order."""

from floquid.testing._spectra import Pairing, assert_exponents_close, pair_exponents

__all__ = ["Pairing", "assert_exponents_close", "pair_exponents"]
