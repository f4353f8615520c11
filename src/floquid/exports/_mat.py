"""Modes as a MATLAB file of version 5, which GNU Octave and Julia's MAT.jl read too."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np

from floquid._version import __version__
from floquid.core import PeriodicModel
from floquid.reconstruction import StateModel

_PLAIN = str.maketrans({"µ": "u", "μ": "u", "ε": "e", "°": "deg", "²": "^2", "³": "^3", "·": "."})
"""Units in ASCII: GNU Octave reads texts of other letters byte by byte, and cuts them."""

_TEXT = 116
"""Bytes at the head of the file that are free text."""


def mat_bytes(model: PeriodicModel, state: StateModel | None) -> bytes:
    """The file; what was not estimated is an empty matrix, and the same model gives the same bytes."""
    from scipy.io import savemat

    content: dict[str, Any] = {
        "exponents": model.exponents,
        "exponents_std": model.exponent_std,
        "covariance": model.covariance,
        "multipliers": model.multipliers,
        "frequencies_hz": model.frequencies_hz,
        "frequencies_hz_std": model.frequency_std_hz,
        "damping_ratios": model.damping_ratios,
        "damping_ratios_std": model.damping_ratio_std,
        "coefficients": model.coefficients,
        "coefficients_std": model.coefficient_std,
        "harmonics": model.harmonics.astype(np.float64),
        "period": model.period,
    }
    content |= {
        "channels": _cells([channel.name for channel in model.channels]),
        "units": _cells([channel.unit.translate(_PLAIN) for channel in model.channels]),
        "quantities": _cells([str(channel.quantity) for channel in model.channels]),
    }
    if state is not None:
        content |= {
            "times": state.times,
            "states": _cells(state.states),
            "A": np.moveaxis(state.system, 0, 2),
            "A_std": None if state.system_std is None else np.moveaxis(state.system_std, 0, 2),
            "Phi": np.moveaxis(state.transition, 0, 2),
            "Phi_std": None if state.transition_std is None else np.moveaxis(state.transition_std, 0, 2),
        }
    stream = BytesIO()
    empty = np.zeros((0, 0))
    savemat(stream, {name: empty if value is None else value for name, value in content.items()}, oned_as="column")
    whole = bytearray(stream.getbuffer())
    written = f"MATLAB 5.0 MAT-file, modes, by floquid {__version__}"
    whole[:_TEXT] = written.encode().ljust(_TEXT)
    return bytes(whole)


def _cells(words: Any) -> Any:
    """A column of texts as MATLAB has it."""
    cells = np.empty((len(words), 1), dtype=object)
    cells[:, 0] = list(words)
    return cells
