"""Modes of a known A(t) as outputs see them: a periodic model without deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import input_error
from floquid.core import Channel, PeriodicModel, Provenance
from floquid.floquet.matrices import AbstractPeriodicMatrix, operand


def seen(
    exponents: Complexes,
    coefficients: Complexes,
    harmonics: Integers,
    period: float,
    outputs: AbstractPeriodicMatrix | ArrayLike,
    channels: Sequence[Channel | str] | None,
    point: Mapping[str, float] | None,
    of: str,
) -> PeriodicModel:
    """The model of modes with `coefficients` (modes, states, harmonics) in the outputs y = C(t) x, C the `outputs`.

    `harmonics` are -N to N; products beyond are left out. `channels` are y1, y2, ... by default, and `of` is the
    caller, for messages.
    """
    matrix = operand(outputs, "outputs", of)
    if matrix.shape[1] != coefficients.shape[1]:
        must = f"have shape (outputs, {coefficients.shape[1]})"
        raise input_error("outputs", of, must, f"has shape {matrix.shape}", "It has one column a state.")
    names = [f"y{row}" for row in range(1, matrix.shape[0] + 1)] if channels is None else channels
    return PeriodicModel(
        exponents=exponents,
        coefficients=_lines(matrix, coefficients, harmonics, period, of)[:, :, None],
        harmonics=harmonics,
        period=period,
        channels=names,
        provenance=Provenance(sources=("a known A(t)",)),
        point=point,
    )


def _lines(
    matrix: AbstractPeriodicMatrix | Floats, coefficients: Complexes, harmonics: Integers, period: float, of: str
) -> Complexes:
    """The harmonics of C(t) times the shapes (modes, outputs, harmonics)."""
    if not isinstance(matrix, AbstractPeriodicMatrix):
        return matrix @ coefficients
    turns = period / matrix.period
    if abs(turns - round(turns)) > 1e-9 * turns or round(turns) < 1:
        must = f"repeat with the period of A(t), {period:.9g} s"
        raise input_error("outputs", of, must, f"repeats every {matrix.period:.9g} s")
    count = 4 * len(harmonics)  # room for as many harmonics of C(t) again, without folding
    times = period * np.arange(count) / count
    waves = np.exp(2j * np.pi * np.multiply.outer(harmonics, np.arange(count)) / count)
    values = np.einsum("tcn,rnt->rct", matrix.at(times), coefficients @ waves)
    return np.asarray(values @ waves.conj().T / count, np.complex128)
