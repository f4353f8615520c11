"""Transition matrices of many systems A(t; p) at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import finite, frozen_array, input_error
from floquid.floquet.monodromy_matrix import TOLERANCE
from floquid.floquet.stability_maps._family import family
from floquid.floquet.stability_maps._spectra import products

_CHUNK = 512  # points of one batch


def transitions(
    system: Callable[..., ArrayLike],
    period: float | Callable[..., ArrayLike],
    parameters: Mapping[str, ArrayLike],
    *,
    start: float = 0.0,
    end: float = 1.0,
    vectorised: bool = False,
    breaks: ArrayLike = (),
    tolerance: float = TOLERANCE,
    narrowest: float = 1.0 / 64.0,
) -> NDArray[np.float64]:
    r"""The transition matrices of many systems (..., n, n), in one batch.

    .. math:: \Phi(\varphi_1 T(p), \varphi_0 T(p); p), \qquad \dot x = A(t; p)\, x, \qquad A(t + T(p); p) = A(t; p)

    Parameters
    ----------
    system
        A(t; p): t [s] and the values of the parameters, in the order of `parameters`, -> (n, n) [1/s]. When
        `vectorised`: times and parameters, arrays that broadcast to a shape (...), -> (..., n, n).
    period
        The period T [s]; or, where it depends on the parameters, a callable of them, taking arrays when `vectorised`.
    parameters
        The names of the parameters and their values, arrays that broadcast to one shape (...).
    start, end
        The phases φ₀ and φ₁ between which it is integrated [periods], the second not before the first.
    vectorised, breaks, tolerance, narrowest
        As in `stability_map`.

    Raises
    ------
    InputError
        The parameters do not broadcast, `end` lies before `start`, a callable does not return what it must, A(t; p)
        does not have the period T(p) or cannot be integrated, or Φ overflows.

    Notes
    -----
    As `transition`, whose method and accuracy it has; the batch is what makes it quick for small systems.
    """
    of = "floquet.transitions"
    if not isinstance(parameters, Mapping) or not parameters:
        raise input_error("parameters", of, "map a name at least to its values", f"is {parameters!r:.60}")
    span = finite(start, "start", of), finite(end, "end", of)
    if span[1] < span[0]:
        raise input_error("end", of, f"not lie before `start` = {span[0]:g} [periods]", f"is {span[1]:g}")
    try:
        values = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in parameters.values()))
    except (TypeError, ValueError) as error:
        raise input_error("parameters", of, "be numbers that broadcast to one shape", f"are not ({error})") from None
    shape = values[0].shape
    points = frozen_array(
        np.stack([value.ravel() for value in values], axis=-1), "parameters", of, axes=("points", len(parameters))
    )
    if not len(points):
        raise input_error("parameters", of, "have a value at least", f"have shape {shape}")
    given = family(
        system,
        period,
        points,
        tuple(parameters),
        vectorised=vectorised,
        breaks=breaks,
        tolerance=tolerance,
        narrowest=narrowest,
        of=of,
    )
    parts = []
    for first in range(0, len(points), _CHUNK):
        chunk = points[first : first + _CHUNK]
        product, power, _ = products(given, chunk, given.periods(chunk), span)
        with np.errstate(over="ignore"):
            parts.append(np.ldexp(product * given.scale[:, None] / given.scale, power[:, None, None]))
    phi = np.concatenate(parts)
    if not np.isfinite(phi).all():
        where = given.words(points[int(np.argmin(np.isfinite(phi).all(axis=(1, 2))))])
        raise input_error("end", of, "come before Φ leaves the range of floating point", f"Φ overflows at {where}")
    return phi.reshape(*shape, *phi.shape[1:])
