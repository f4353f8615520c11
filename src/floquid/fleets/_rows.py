"""Rows of the table: one a mode of a record, or one with the reason why there is none."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid._json import for_json
from floquid._version import __version__
from floquid.periodic import CONFIDENT, participation
from floquid.pipeline import Analysis

COLUMNS = {
    "file": "string",
    "mode": "int32",
    "re": "float64",
    "im": "float64",
    "std_re": "float64",
    "std_im": "float64",
    "covariance": "float64",
    "multiplier_re": "float64",
    "multiplier_im": "float64",
    "frequency_hz": "float64",
    "damping_ratio": "float64",
    "harmonics": "list<int32>",
    "weak": "bool",
    "passed": "bool",
    "order": "int32",
    "period": "float64",
    "warnings": "list<string>",
    "reason": "string",
    "result": "string",
    "settings": "string",
    "floquid": "string",
    "size": "int64",
    "modified": "int64",
    "seconds": "float64",
}
"""Columns by name, with their types; behind them one of numbers for each quantity of the operating points."""

Row = dict[str, Any]


def rows_of(analysis: Analysis) -> list[Row]:
    """A row a mode of an analysis, of a conjugate pair the mode above the real axis; modes are numbered from 1."""
    model = analysis.model
    record = {
        "passed": analysis.passed,
        "order": model.order,
        "period": model.period,
        "warnings": [*analysis.warnings],
        "reason": analysis.reasons[0] if analysis.failed else None,
        **{name if name not in COLUMNS else f"point_{name}": float(value) for name, value in model.point.items()},
    }
    std, covariance, count = model.exponent_std, model.covariance, model.order
    rows = []
    for number, mode in enumerate(model.upper_modes, start=1):
        value, multiplier = complex(model.exponents[mode]), complex(model.multipliers[mode])
        error = complex(np.nan, np.nan) if std is None else complex(std[mode])
        rows.append(
            {
                "mode": number,
                "re": value.real,
                "im": value.imag,
                "std_re": error.real,
                "std_im": error.imag,
                "covariance": np.nan if covariance is None else float(covariance[mode, count + mode]),
                "multiplier_re": multiplier.real,
                "multiplier_im": multiplier.imag,
                "frequency_hz": float(model.frequencies_hz[mode]),
                "damping_ratio": float(model.damping_ratios[mode]),
                "harmonics": participation(model, mode, 1.0 / analysis.noise)[0].tolist(),
                "weak": std is None or max(error.real, error.imag) > CONFIDENT * model.fundamental,
                **record,
            }
        )
    return for_json(rows)


def lost(reason: str) -> list[Row]:
    """The row of a record without a result."""
    return [{"passed": False, "reason": reason}]


def labelled(rows: list[Row], record: Row) -> list[Row]:
    """The rows with the cells of their record, which says the version too."""
    return [{**row, **record, "floquid": __version__} for row in rows]
