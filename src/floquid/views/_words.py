"""Numbers and modes in words, alike on the terminal and on the page."""

from __future__ import annotations

import numpy as np

from floquid.core import PeriodicModel
from floquid.periodic import CONFIDENT
from floquid.views._modes import is_real

MODE_NOTES = {
    "weak": "weakly determined",
    "μ<0": "a negative real multiplier, no pair",
    "μ>0": "a positive real multiplier, no pair",
    "grows": "unstable",
}
"""The words that a mode may deserve and what they mean; they are short, for a table has to fit 80 columns."""

MOST_DIGITS = 10
"""After the point; beyond them a deviation says nothing that a reader could use."""


def with_error(value: float, std: float) -> str:
    """A value with its standard deviation in units of the last digits: -0.0020013(19) is -0.0020013 ± 0.0000019.

    Parameters
    ----------
    value
        The value.
    std
        Its standard deviation; without a finite positive one the value stands alone.

    Returns
    -------
    str
        The text.
    """
    if not np.isfinite(std) or std <= 0:
        return f"{value:.6g}"
    digits = max(0, 1 - int(np.floor(np.log10(std))))
    return f"{value:.{digits}f}({round(std * 10**digits)})" if digits <= MOST_DIGITS else f"{value:.10g}"


def mode_notes(model: PeriodicModel, mode: int) -> list[str]:
    """The words of `MODE_NOTES` that a mode deserves.

    Parameters
    ----------
    model
        The model.
    mode
        Which of its modes.

    Returns
    -------
    list of str
        The words; none for an ordinary mode.
    """
    error = complex(np.nan, np.nan) if model.exponent_std is None else model.exponent_std[mode]
    real, multiplier = is_real(model, mode), model.multipliers[mode]
    deserved = {
        "weak": max(error.real, error.imag) > CONFIDENT * model.fundamental,
        "μ<0": real and multiplier.real < 0,
        "μ>0": real and multiplier.real >= 0,
        "grows": model.exponents[mode].real > 4 * error.real,
    }
    return [word for word in MODE_NOTES if deserved[word]]
