"""The rows as tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from benchmarks.order.random_systems import CLASSES
from benchmarks.order.run import Row


def robustness(rows: dict[str, list[Row]]) -> str:
    """One line a case: sizes, shares and the error over the bound."""
    heads = ["case", "outputs", "cycles", "draws", "modes told", "lost", "runs with a loss", "order right", "ambiguous"]
    heads += ["silently wrong", "order found", "error over bound", "of all modes", "s"]
    return _markdown(heads, [_line(case, of) for case, of in rows.items() if of])


def _line(case: str, rows: list[Row]) -> list[str]:
    must = sum(row.expected for row in rows)
    outputs, cycles = [r.n_outputs for r in rows], [n for r in rows for n in r.n_cycles]
    return [
        case,
        f"{min(outputs)}-{max(outputs)}",
        f"{min(cycles)}-{max(cycles)}",
        str(len(rows)),
        f"{must} of {sum(row.true for row in rows)}",
        str(sum(row.lost for row in rows)),
        _share(rows, lambda row: row.lost > 0),
        _share(rows, lambda row: row.right),
        _share(rows, lambda row: row.ambiguous),
        _share(rows, lambda row: row.silent),
        _share(rows, lambda row: row.order == row.true),
        _root(rows, lambda row: row.squares),
        _root(rows, lambda row: row.all_squares),
        f"{np.median([row.seconds for row in rows]):.2f}",
    ]


def _root(rows: list[Row], of: Callable[[Row], Sequence[float]]) -> str:
    """The root of the mean square over parts, modes and draws."""
    squares = np.concatenate([of(row) for row in rows])
    return f"{np.sqrt(squares.mean()):.3f}" if len(squares) else "-"


def order(rows: list[Row]) -> str:
    """Shares of systems in all, where every mode can be told, and by class."""
    told = [row for row in rows if row.told]
    groups: list[tuple[str, Sequence[Row]]] = [("all", rows), ("every mode can be told", told)]
    groups += [(name, [row for row in rows if name in row.classes]) for name in CLASSES]
    groups += [(f"{name}, told", [row for row in told if name in row.classes]) for name in CLASSES]
    groups.append(("plain", [row for row in rows if not row.classes]))
    groups += [(f"{low} to {high} modes", [r for r in rows if low <= r.n_modes <= high]) for low, high in MODES]
    groups += [(f"{low} to {high} outputs", [r for r in rows if low <= r.n_outputs <= high]) for low, high in OUTPUTS]
    heads = ["systems", "number", "right", "ambiguous", "silently wrong", "too many poles", "a mode lost"]
    lines = [
        [
            name,
            str(len(of)),
            _share(of, lambda row: row.right),
            _share(of, lambda row: row.ambiguous),
            _share(of, lambda row: row.silent),
            _share(of, lambda row: row.extra > 0),
            _share(of, lambda row: row.lost > 0),
        ]
        for name, of in groups
        if of
    ]
    return _markdown(heads, lines)


MODES = [(1, 1), (2, 4), (5, 10), (11, 20)]
OUTPUTS = [(1, 1), (2, 9), (10, 99), (100, 400)]


def _share(rows: Sequence[Row], of: Callable[[Row], bool]) -> str:
    count = sum(of(row) for row in rows)
    return f"{count} ({100.0 * count / len(rows):.1f} %)"


def _markdown(heads: list[str], lines: list[list[str]]) -> str:
    rows = [heads, ["---"] * len(heads), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)
