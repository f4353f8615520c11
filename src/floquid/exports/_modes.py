"""Identified modes → the files of other programs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._checks import describe, input_error
from floquid.core import PeriodicModel
from floquid.exports._csv import csv_bytes
from floquid.exports._mat import mat_bytes
from floquid.exports._summary import mode_entries, summary
from floquid.exports._uff import uff_bytes
from floquid.io import as_path, atomic_path
from floquid.pipeline import Analysis

MODE_FORMATS = (".uff", ".unv", ".mat", ".csv", ".json")
"""The suffixes that `export_modes` knows."""


def export_modes(
    result: Analysis | PeriodicModel,
    path: str | PathLike[str],
    *,
    coordinates: Mapping[str, ArrayLike] | None = None,
) -> None:
    r"""Write the modes of a result to a file of another program, in the format of its suffix.

    The shape of mode r in hit h is :math:`\sum_m B_{r,h,m} e^{(\lambda_r + i m \omega) t}`.

    - `.uff`, `.unv`: universal file with datasets 151 (header), 15 (nodes) and 55 (data at nodes, complex eigenvalues
      of first order). Each coefficient B of a mode and a harmonic m is a shape of its own, of eigenvalue λ + imω, so
      that a program for time-invariant modes animates it. Of conjugates there is the one above the real axis. Numbers
      have six digits; the ID lines have λ, its deviation and the period in full.
    - `.mat`: MATLAB version 5: `exponents`, `coefficients` (modes, channels, hits, harmonics), `harmonics`, `period`,
      ..., and of A(t), where there is one, `A` and `Phi` (states, states, times), `times` and `states`.
    - `.csv`: a row for each coefficient: its mode, channel, hit and harmonic, with deviations. The units are in the
      heading, or in a column.
    - `.json`: of an analysis the content of `summary.json`, of a model its modes alone.

    Parameters
    ----------
    result
        What `identify` found, or its `model`.
    path
        The file to write; it may exist, and is replaced at the end, in one step.
    coordinates
        Where the nodes of a universal file are: x, y, z by the location of channels, or by their names where they have
        none. Others are at the origin.

    Raises
    ------
    InputError
        An argument is something else, the suffix is unknown, or the file cannot be written there.
    """
    of = "export_modes"
    if not isinstance(result, (Analysis, PeriodicModel)):
        got = f"is {describe(result)}"
        raise input_error("result", of, "be an Analysis or a PeriodicModel", got, "Pass what `identify` gave.")
    file = as_path(path, of=of)
    suffix = file.suffix.lower()
    if suffix not in MODE_FORMATS:
        got = f"{file} has the suffix {suffix!r}"
        raise input_error("path", of, "end in a known suffix", got, f"Use one of {', '.join(MODE_FORMATS)}.")
    model = result if isinstance(result, PeriodicModel) else result.model
    if coordinates is not None and suffix not in (".uff", ".unv"):
        got = f"{file} has no place for them"
        raise input_error("coordinates", of, "come with a universal file (.uff, .unv)", got, "Leave them out.")
    if suffix in (".uff", ".unv"):
        content = uff_bytes(model, coordinates or {})
    elif suffix == ".mat":
        content = mat_bytes(model, None if isinstance(result, PeriodicModel) else result.state)
    elif suffix == ".csv":
        content = csv_bytes(model)
    else:
        content = _json_bytes(result)
    _write(content, file)


def _write(content: bytes, file: Path) -> None:
    with atomic_path(file, of="export_modes") as temporary:
        temporary.write_bytes(content)


def _json_bytes(result: Analysis | PeriodicModel) -> bytes:
    content: dict[str, Any]
    if isinstance(result, Analysis):
        content = summary(result)
    else:
        content = {
            "format": "floquid-modes/1",
            "period": result.period,
            "order": result.order,
            "channels": [asdict(channel) for channel in result.channels],
            "modes": mode_entries(result, np.ones(result.coefficients.shape[1:3])),
        }
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()
