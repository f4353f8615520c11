"""What was measured as a markdown table a kind of record, and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.methods.entries import METHODS
from benchmarks.methods.records import CASES

KINDS = {"free": "free decays", "driven": "measured inputs", "ambient": "outputs alone"}
COLORS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F", "#8C510A")
MARKS = {"Mathieu": "o", "rotor": "^"}
"""Of cases by their name, squares for others."""


def number(value: float | None) -> str:
    """Two or three digits, no exponents."""
    if value is None:
        return "–"
    return f"{value:.2f}" if value < 10.0 else f"{value:.0f}" if value < 1e5 else f"{value:.0e}"


def milliseconds(seconds: float | None) -> str:
    """Two digits, or whole milliseconds."""
    return "–" if seconds is None else f"{1e3 * seconds:.2g}" if seconds < 0.1 else f"{1e3 * seconds:.0f}"


def beside(row: dict[str, Any], seeds: int) -> str:
    """The runs that were lost, and how many there were where not all."""
    if row["lost"]:
        return f" ({row['lost']} of {row['runs']} lost)"
    return f" ({row['runs']})" if row["runs"] < seeds else ""


def table(rows: list[dict[str, Any]], kind: str, seeds: int) -> str:
    """A line a method: error over bound and runs lost on each record of a kind; times, errors of G and z of all."""
    cases = [name for name, case in CASES.items() if case.kind == kind]
    last = ["CPU [ms]", "error of G [%]", "z"] if kind == "driven" else ["CPU [ms]", "z"]
    heads = ["method", "order", "returns", *(CASES[name].name for name in cases), *last]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * 3 + "---:|" * (len(heads) - 3)]
    for method in (one for one in METHODS if one.kind == kind):
        own = {row["case"]: row for row in rows if row["method"] == method.name}
        cells = [method.name, method.order, method.returns]
        cells += [number(own[name]["error"]) + beside(own[name], seeds) if name in own else "" for name in cases]
        seen = [own[name] for name in cases if name in own]
        cells.append(" / ".join(milliseconds(row["seconds"]) for row in seen))
        if kind == "driven":
            cells.append(" / ".join(f"{100.0 * row['transfer']:.2g}" for row in seen if row["transfer"] is not None))
        cells.append(" / ".join(number(row["z"]) for row in seen if row["z"] is not None))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Error over bound against time, a panel a kind, a colour a method and a mark a record."""
    import matplotlib.style
    from matplotlib.figure import Figure

    look = {"svg.hashsalt": "methods", "svg.fonttype": "none", "font.size": 9}
    with matplotlib.style.context(["default", look]):
        drawn = Figure(figsize=(11.0, 6.0), layout="constrained")
        kinds = [kind for kind in KINDS if any(row["case"].startswith(kind) for row in rows)]
        panels = drawn.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
        for axes, kind in zip(panels, kinds, strict=True):
            cases = [name for name, case in CASES.items() if case.kind == kind]
            methods = [one.name for one in METHODS if one.kind == kind]
            methods = [name for name in methods if any(r["method"] == name and r["error"] for r in rows)]
            for color, name in zip(COLORS, methods, strict=False):
                own = [r for r in rows if r["method"] == name and r["error"] is not None]
                axes.plot(
                    [r["seconds"] for r in own],
                    [r["error"] for r in own],
                    color=color,
                    linewidth=0.6,
                    alpha=0.5,
                )
                for row in own:
                    mark = MARKS.get(CASES[row["case"]].name, "s")
                    axes.plot(row["seconds"], row["error"], mark, color=color, markersize=6)
                axes.plot([], [], color=color, linewidth=4, label=name)
            for name in (CASES[case].name for case in cases):
                axes.plot([], [], MARKS.get(name, "s"), color="#777777", label=name, linestyle="none")
            axes.axhline(1.0, color="#777777", linestyle="--", linewidth=0.8)
            axes.set(xscale="log", yscale="log", title=KINDS[kind], xlabel="CPU time [s]")
            axes.grid(color="#dddddd", linewidth=0.5)
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), frameon=False, fontsize=8.5)
        panels[0].set_ylabel("rms error of the exponents over the bound [-]")
        drawn.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
