"""What `floquid bootstrap` says: tables for a person, `bootstrap.json` for a program."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from floquid.cli._terminal import counted, print_title, print_whole, terminal
from floquid.pipeline import Analysis, Bootstrap, Spread
from floquid.views import upper_modes

FILES = ("bootstrap.json", "bootstrap.npz")

LEGEND = (
    "said: the deviation that the fit gave; drawn: that of the draws; ratio: drawn over said; 95 %: what holds so many "
    "of the draws"
)


def print_bootstrap(analysis: Analysis, found: Bootstrap, out: Path | None) -> None:
    """The modes, all elements together, the verdict, and where the draws are."""
    console = terminal()
    how = "identified from the beginning" if found.whole else "the same modes fitted anew"
    console.print(f"{counted(found.n_draws, 'record')} drawn from the model, seed {found.seed}: {how}.")
    if found.n_used < found.n_draws:
        console.print(f"What follows is of {found.n_used} of them.")
    print_title(console, "Modes")
    print_whole(console, _modes(analysis, found))
    console.print(f"{LEGEND}.", style="dim")
    if found.holds is not None:
        print_title(console, "Ratio over all elements")
        print_whole(console, _quantities(found))
    console.print()
    for reason in found.reasons:
        console.print(reason, style=None if found.holds is not False else "yellow")
    if out is None:
        console.print("Add --out DIR for bootstrap.json and every draw in bootstrap.npz.", style="dim")
    else:
        console.print(f"Written to {out}/: {', '.join(FILES)}", soft_wrap=True)


def _modes(analysis: Analysis, found: Bootstrap) -> Table:
    """Exponent, frequency and damping of each pair, a number a row."""
    table = Table(box=None)
    for name in ("", "", "estimate", "said", "drawn", "ratio", "95 %", ""):
        table.add_column(name, justify="left" if name == "" and not table.columns else "right", no_wrap=True)
    rows = (
        ("Re λ", found.exponents, np.real),
        ("Im λ", found.exponents, np.imag),
        ("f [Hz]", found.frequencies_hz, np.real),
        ("ζ", found.damping_ratios, np.real),
    )
    for number, mode in enumerate(upper_modes(analysis.model), start=1):
        for place, (name, spread, part) in enumerate(rows):
            std, ratio = part(spread.std[mode]), spread.ratio
            low, high = (part(end[mode]) for end in spread.interval())
            digits = 8 if std <= 0 else int(np.clip(1 - np.floor(np.log10(std)), 0, 10))
            table.add_row(
                str(number) if place == 0 else "",
                name,
                f"{part(spread.estimate[mode]):.{digits}f}",
                "-" if spread.asymptotic is None else f"{part(spread.asymptotic[mode]):.3g}",
                f"{std:.3g}",
                "-" if ratio is None or np.isnan(part(ratio[mode])) else f"{part(ratio[mode]):.3f}",
                f"{low:.{digits}f}",
                f"{high:.{digits}f}",
            )
    return table


def _quantities(found: Bootstrap) -> Table:
    """How the ratios of each quantity lie."""
    table = Table(box=None)
    table.add_column("")
    for name in ("number", "least", "median", "most", "not by chance"):
        table.add_column(name, justify="right", no_wrap=True)
    doubtful = found.doubtful
    for spread in found.quantities:
        ratios = spread.ratios()
        if len(ratios):
            wrong = int(doubtful[spread.name].sum()) if spread.name in doubtful else 0
            numbers = (f"{value:.3f}" for value in (ratios.min(), np.median(ratios), ratios.max()))
            table.add_row(spread.name, str(len(ratios)), *numbers, str(wrong))
    return table


def bootstrap_text(found: Bootstrap) -> str:
    """`bootstrap.json` as text: complex numbers are [real, imaginary]; what is not computed is null."""
    content = {
        "format": "floquid-bootstrap/1",
        "draws": found.n_draws,
        "used": found.n_used,
        "failed": [{"reason": words, "number": number} for words, number in found.failure_counts],
        "seed": found.seed,
        "whole": found.whole,
        "orders": {str(order): n for order, n in sorted(Counter(found.orders[found.orders > 0].tolist()).items())},
        "ratio_std": found.exponents.sampling_error,
        "holds": found.holds,
        "reasons": list(found.reasons),
        "quantities": {spread.name: _quantity(spread, found) for spread in found.quantities},
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _quantity(spread: Spread, found: Bootstrap) -> dict[str, Any]:
    low, high = spread.interval()
    return {
        "unit": spread.unit,
        "estimate": _listed(spread.estimate),
        "asymptotic_std": None if spread.asymptotic is None else _listed(spread.asymptotic),
        "std": _listed(spread.std),
        "bias": _listed(spread.bias),
        "low": _listed(low),
        "high": _listed(high),
        "ratio": None if spread.ratio is None else _listed(spread.ratio),
        "not_by_chance": int(found.doubtful[spread.name].sum()) if spread.name in found.doubtful else 0,
    }


def _listed(values: NDArray) -> Any:
    """Nested lists, complex numbers as pairs, and null for what is no number."""
    if np.iscomplexobj(values):
        values = np.stack([np.real(values), np.imag(values)], axis=-1)
    return _without_nan(np.asarray(values, float).tolist())


def _without_nan(values: Any) -> Any:
    if isinstance(values, list):
        return [_without_nan(value) for value in values]
    return values if np.isfinite(values) else None
