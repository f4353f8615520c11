"""The paper's two ways to cut a Fourier series short: its largest terms, or those of the lowest harmonics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from floquid._checks import input_error, integer
from floquid.core import PeriodicModel


def dominant(model: PeriodicModel, count: int) -> PeriodicModel:
    """The model with the largest coefficients of each residue alone (Allen 2009, section 3.2).

    Each mode, channel and hit has its own choice. Modes must come in conjugate pairs: a coefficient of one is kept when
    its mirror image is kept in the other.

    Parameters
    ----------
    model
        The model, with at least `count` harmonics that reach as far below zero as above.
    count
        The number of coefficients kept of each residue.

    Returns
    -------
    PeriodicModel
        The model with the other coefficients, and their deviations, zero.

    Raises
    ------
    InputError
        There are not as many harmonics, or they are not symmetric about zero.
    """
    of = "dominant"
    if integer(count, "count", of, at_least=1) > len(model.harmonics):
        raise input_error("count", of, f"be at most the {len(model.harmonics)} harmonics", f"is {count}")
    if not np.array_equal(model.harmonics, -model.harmonics[::-1]):
        got = f"are {model.harmonics[0]} to {model.harmonics[-1]}"
        raise input_error(
            "model", of, "have harmonics symmetric about zero", f"they {got}", "Keep as many on each side."
        )
    size = np.abs(model.coefficients)
    # Where two are equal, conjugates must not choose differently.
    lower = model.exponents.imag < 0
    size = np.where(lower[:, None, None, None], size[..., ::-1], size)
    largest = np.argsort(-size, axis=-1, kind="stable")[..., :count]
    kept = np.zeros(size.shape, bool)
    np.put_along_axis(kept, largest, values=True, axis=-1)
    return _masked(model, np.where(lower[:, None, None, None], kept[..., ::-1], kept))


def lowest(model: PeriodicModel, most: int) -> PeriodicModel:
    """The model with the harmonics -most … most of each mode alone.

    Parameters
    ----------
    model
        The model.
    most
        The largest |m| kept.

    Returns
    -------
    PeriodicModel
        The model with the other coefficients, and their deviations, zero.
    """
    kept = np.abs(model.harmonics) <= integer(most, "most", "lowest", at_least=0)
    return _masked(model, np.broadcast_to(kept, model.coefficients.shape))


def _masked(model: PeriodicModel, kept: np.ndarray) -> PeriodicModel:
    std = model.coefficient_std
    return replace(
        model,
        coefficients=np.where(kept, model.coefficients, 0.0),
        coefficient_std=None if std is None else np.where(kept, std, 0.0),
    )
