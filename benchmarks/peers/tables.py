"""What was measured as markdown tables and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.peers.growth import slope

UNKNOWN = "MaximumLikelihood (order unknown)"


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(heads) + " |", "|" + "|".join(["---"] + ["---:"] * (len(heads) - 1)) + "|"]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def _number(value: float | None, form: str = ".2f") -> str:
    return "–" if value is None else format(value, form)


def _ms(seconds: float | None) -> str:
    return "–" if seconds is None else format(1e3 * seconds, ".0f" if seconds >= 0.0995 else ".1f")


def _reference(rows: list[dict[str, Any]]) -> float | None:
    return next((row["seconds"] for row in rows if row["name"] == UNKNOWN), None)


def paper(rows: list[dict[str, Any]]) -> str:
    """One line an entry."""
    heads = ["", "time [ms]", "of it `extract`", "time over ours", "error over bound", "lost", "what the user chose"]
    ours = _reference(rows)
    lines = []
    for row in rows:
        over = row["seconds"] / ours if ours and row["seconds"] else None
        error, lost = _number(row["error"]), f"{row['lost']} of {row['runs']}"
        extract = _ms(row["extract_seconds"]) if row["ours"] else ""
        lines.append([row["name"], _ms(row["seconds"]), extract, _number(over), error, lost, row["chosen"]])
    return _markdown(heads, lines)


def modes(table: dict[str, list[dict[str, Any]]]) -> str:
    """One line an entry, and three columns a number of modes."""
    names = list(dict.fromkeys(row["name"] for rows in table.values() for row in rows))
    heads = [""] + [f"{n} modes: {word}" for n in table for word in ("lost", "error", "ms")]
    lines = []
    for name in names:
        line = [name]
        for rows in table.values():
            row = next((r for r in rows if r["name"] == name), None)
            if row is None:
                line += ["too slow", "–", "–"]
            else:
                line += [f"{row['lost']} of {row['runs']}", _number(row["error"]), _ms(row["seconds"])]
        lines.append(line)
    return _markdown(heads, lines)


def growth(rows: list[dict[str, Any]]) -> str:
    """One line an entry: time and peak memory at each size, and the slopes of time."""
    sizes = list(dict.fromkeys((row["outputs"], row["cycles"]) for row in rows))
    heads = [
        "time [ms], peak beyond the data [MB]",
        *(f"{o} × {c}" for o, c in sizes),
        "slope, outputs",
        "slope, cycles",
    ]
    lines = []
    for name in dict.fromkeys(row["name"] for row in rows):
        own = {(r["outputs"], r["cycles"]): r for r in rows if r["name"] == name}
        cells = [_cell(own.get(size)) for size in sizes]
        slopes = [_number(_slope(own, axis)) for axis in (0, 1)]
        lines.append([name, *cells, *slopes])
    return _markdown(heads, lines)


def _cell(row: dict[str, Any] | None) -> str:
    if row is None or row["seconds"] is None:
        return "–"
    return f"{_ms(row['seconds'])}, {row['peak_bytes'] / 1e6:.0f}"


def _along(own: dict[tuple[int, int], dict[str, Any]], axis: int) -> tuple[list[int], list[float]]:
    """Sizes along one axis, the other being that of the paper, and the times."""
    fixed = 1024 if axis == 0 else 200
    points = sorted((s[axis], r["seconds"]) for s, r in own.items() if s[1 - axis] == fixed and r["seconds"])
    return [p[0] for p in points], [p[1] for p in points]


def _slope(own: dict[tuple[int, int], dict[str, Any]], axis: int) -> float | None:
    sizes, seconds = _along(own, axis)
    return slope(sizes, seconds) if len(sizes) > 1 else None


def figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Time against outputs and against cycles, on logarithmic axes, with the slopes."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "floquid", "font.size": 8}):
        drawing = Figure(figsize=(8.5, 3.6), layout="constrained")
        panels = drawing.subplots(1, 2, sharey=True)
        for axis, (panel, word) in enumerate(
            zip(panels, ("outputs, of 1024 cycles", "cycles of 200 outputs"), strict=True)
        ):
            for name in dict.fromkeys(row["name"] for row in rows):
                own = {(r["outputs"], r["cycles"]): r for r in rows if r["name"] == name}
                sizes, seconds = _along(own, axis)
                if not sizes:
                    continue
                told = f"{name} ({slope(sizes, seconds):.2f})" if len(sizes) > 1 else name
                panel.loglog(sizes, seconds, marker="o", linewidth=2.0 if name == UNKNOWN else 1.0, label=told)
            panel.set_xlabel(word)
            panel.grid(alpha=0.3, which="both")
            panel.legend(fontsize=6, title="slope in brackets", title_fontsize=6)
        panels[0].set_ylabel("time [s]")
        drawing.savefig(path, metadata={"Date": None})
