"""Shapes over the path of a scanning sensor for other programs: a row a position."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid.shapes import PathShapes

_POSITIONS = 201  # a hundredth of the path's amplitude apart


def path_columns(found: PathShapes) -> dict[str, list[Any]]:
    """Positions x on the path, and real and imaginary part of each shape `found` of each channel there."""
    positions = np.linspace(-1.0, 1.0, _POSITIONS)
    columns = {"x": positions.tolist()}
    for exponent, shapes in zip(found.exponents.tolist(), found.at(positions), strict=True):
        for channel, values in zip(found.channels, shapes, strict=True):
            name = f"{channel.label} at {abs(exponent) / (2.0 * np.pi):.6g} Hz"
            columns |= {f"{name}, real": values.real.tolist(), f"{name}, imag": values.imag.tolist()}
    return columns
