"""LSCF and poly-reference LSCF: spectra as ratios of polynomials with a common or a matrix denominator."""

from floquid.lti.rational._lscf import LSCF, PolyLSCF

__all__ = ["LSCF", "PolyLSCF"]
