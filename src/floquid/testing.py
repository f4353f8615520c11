"""For tests of identification: spectra compared modulo the fundamental, never by order."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Indices
from floquid._checks import frozen_array, input_error, positive


class Pairing(NamedTuple):
    """The estimate that belongs to each true exponent, and its error.

    Attributes
    ----------
    permutation
        `estimated[permutation[k]]` belongs to `truth[k]` (truth,).
    differences
        Estimate less truth, moved to the strip -ω/2 < Im ≤ ω/2 (truth,) [1/s].
    """

    permutation: Indices
    differences: Complexes


def pair_exponents(estimated: ArrayLike, truth: ArrayLike, period: float) -> Pairing:
    r"""Pair exponents so that the sum of distances is smallest.

    .. math:: \min_\pi \sum_k \left| \hat\lambda_{\pi(k)} - \lambda_k \bmod i\omega \right|, \qquad \omega = 2\pi/T

    Returns the permutation and the wrapped differences; estimates without a partner are left out. `estimated` exponents
    (estimates,) and at most as many true ones `truth` (truth,) are on any branch [1/s], `period` is T [s]. Raises
    InputError where there are fewer estimates than true exponents, or a value is not finite.
    """
    of = "pair_exponents"
    fundamental = 2.0 * np.pi / positive(period, "period", of, unit="s")
    found = frozen_array(estimated, "estimated", of, axes=("estimates",), dtype=np.complex128)
    true = frozen_array(truth, "truth", of, axes=("truth",), dtype=np.complex128)
    if len(found) < len(true):
        got, remedy = f"holds {len(found)}", "To see which true exponents were missed, exchange the two arguments."
        raise input_error("estimated", of, f"hold at least the {len(true)} exponents of `truth`", got, remedy)
    from scipy.optimize import linear_sum_assignment

    apart = np.subtract.outer(found, true).T
    apart = apart - 1j * fundamental * np.ceil(apart.imag / fundamental - 0.5)
    rows, columns = linear_sum_assignment(np.abs(apart))
    return Pairing(permutation=columns, differences=apart[rows, columns])


def assert_exponents_close(actual: ArrayLike, expected: ArrayLike, period: float, *, atol: float) -> None:
    """Raise AssertionError unless the exponents agree, as sets and modulo iω, to `atol` [1/s] in both parts.

    `actual` and `expected` are on any branch, in any order, equal in number (modes,) [1/s], `period` is T [s].

    Raises AssertionError where the numbers of exponents differ, or a part differs by more than `atol`; InputError where
    a value is not finite.
    """
    found, wanted = np.atleast_1d(actual), np.atleast_1d(expected)
    if len(found) != len(wanted):
        raise AssertionError(f"{len(found)} exponents, but {len(wanted)} were expected:\n{found}\n{wanted}")
    pairing = pair_exponents(found, wanted, period)
    off = np.maximum(np.abs(pairing.differences.real), np.abs(pairing.differences.imag))
    if (off > atol).any():
        lines = [
            f"  expected {w:.10g}, found {f:.10g}: off by {d:.3g}"
            for w, f, d in zip(wanted, found[pairing.permutation], pairing.differences, strict=True)
        ]
        raise AssertionError(f"Exponents differ by up to {off.max():.3g}, over {atol:g}:\n" + "\n".join(lines))


__all__ = ["Pairing", "assert_exponents_close", "pair_exponents"]
