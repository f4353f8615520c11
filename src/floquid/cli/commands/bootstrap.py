"""`floquid bootstrap`: whether the deviations of a saved result hold, by drawing records from its model."""

from __future__ import annotations

import hashlib
import sys
from collections import Counter
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from floquid._checks import counted, input_error
from floquid._json import attributes
from floquid.cli.arguments.shared import Format, OptionalWhole, OutputFolder, Saved, Seed, Whole
from floquid.cli.output.folder import ResultFolder, identified_in, maybe_folder, result_file
from floquid.cli.output.terminal import json_text, new_table, print_files, print_title, print_whole, terminal
from floquid.pipeline import Bootstrap, DrawFile, Spread
from floquid.pipeline import bootstrap as bootstrap_analysis

OF = "floquid bootstrap"

KEPT = ".floquid-draws.npz"
"""The draws of a run that was cut short: the next one goes on from them, and removes them in the end."""

FILES = ("bootstrap.json", "bootstrap.npz")

LEGEND = (
    "said: the deviation that the fit gave; drawn: that of the draws; ratio: drawn over said; 95 %: the interval that "
    "holds 95 % of the draws"
)


def bootstrap(
    result: Saved,
    *,
    draws: Whole = 200,
    seed: Seed = 0,
    workers: OptionalWhole = None,
    whole: Annotated[bool, Parameter(negative=())] = False,
    out: OutputFolder = None,
    format: Format = "text",  # noqa: A002
) -> None:
    """Check the standard deviations of a result: draw records from its model, fit each anew, and see the spread.

    Parameters
    ----------
    draws
        How many records are drawn, at least 20; of 200 a deviation is known to 5 %.
    workers
        How many processes share the draws; one for each processor when not given. The numbers do not depend on it.
    whole
        Identify each record from the beginning, the order too, instead of fitting the same modes again.
    out
        A folder for bootstrap.json and bootstrap.npz, which holds every draw. A run that was cut short goes on there.
    format
        text prints tables; json prints bootstrap.json alone.
    """
    for option, value, least in (("--draws", draws, 20), ("--seed", seed, 0), ("--workers", workers, 1)):
        if value is not None and value < least:
            raise input_error(option, OF, f"be at least {least}", f"is {value}")
    file = result_file(result)
    with maybe_folder(out, FILES) as folder:
        key, analysis = _key(file, seed, whole=whole), identified_in(file, OF)
        while key != (now := _key(file, seed, whole=whole)):  # another program has put a new result there meanwhile
            key, analysis = now, identified_in(file, OF)
        kept = None if out is None else DrawFile(path=out / KEPT, key=key)
        if kept is not None and (done := len(kept.read())):
            words = f"{min(done, draws)} of {draws} draws were done by a run that was cut short: going on from there."
            terminal(stderr=True).print(words)
        found = bootstrap_analysis(
            analysis, draws=draws, seed=seed, workers=workers, whole=whole, kept=kept, progress=True
        )
        text = _text(found)
        if folder is not None:
            _write(folder, found, text)
            (folder.path / KEPT).unlink(missing_ok=True)
    if format == "json":
        sys.stdout.write(text)
        return
    print_drawn(terminal(), found)
    print_files(out, FILES, "for bootstrap.json and every draw in bootstrap.npz")


def _key(file: Path, seed: int, *, whole: bool) -> str:
    """Key of the draws: the result, the seed, what is fitted, and the code."""
    content = hashlib.sha256(file.read_bytes()).hexdigest()
    return f"floquid {version('floquid')}, {content}, seed {seed}, {'whole' if whole else 'held'}"


def _write(folder: ResultFolder, found: Bootstrap, text: str) -> None:
    """Write the files into the folder, where they take their names together."""
    folder.write(FILES[0], text)
    arrays: dict[str, Any] = {spread.name: spread.draws for spread in found.quantities}
    arrays["orders"] = found.orders
    np.savez_compressed(folder.unfinished / FILES[1], **arrays)  # plain arrays all
    folder.publish()


def print_drawn(console: Console, found: Bootstrap) -> None:
    """Print the modes, all elements together, and the verdict."""
    how = "identified from the beginning" if found.whole else "the same modes fitted anew"
    console.print(f"{counted(found.n_draws, 'record')} drawn from the model, seed {found.seed}: {how}.")
    if found.n_used < found.n_draws:
        console.print(f"What follows is of {found.n_used} of them.")
    print_title(console, "Modes")
    print_whole(console, _modes(found))
    console.print(f"{LEGEND}.", style="dim")
    if found.holds is not None:
        print_title(console, "Ratio over all elements")
        print_whole(console, _quantities(found))
    console.print()
    for reason in found.reasons:
        console.print(reason, style=None if found.holds is not False else "yellow")


def _modes(found: Bootstrap) -> Table:
    """Exponent, frequency and damping of each pair, a number a row."""
    table = new_table([""], ["", "estimate", "said", "drawn", "ratio", "95 %", ""])
    rows = (
        ("Re λ", found.exponents, np.real),
        ("Im λ", found.exponents, np.imag),
        ("f [Hz]", found.frequencies_hz, np.real),
        ("ζ", found.damping_ratios, np.real),
    )
    for number, mode in enumerate(np.flatnonzero(found.exponents.distinct), start=1):
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
    """Least, median and largest ratio of each quantity."""
    table = new_table([""], ["number", "least", "median", "most", "not by chance"])
    for spread in found.quantities:
        ratios = spread.ratios()
        if len(ratios):
            numbers = (f"{value:.3f}" for value in (ratios.min(), np.median(ratios), ratios.max()))
            table.add_row(spread.name, str(len(ratios)), *numbers, str(_doubtful(spread, found)))
    return table


def _doubtful(spread: Spread, found: Bootstrap) -> int:
    """Number of ratios of a quantity that chance does not explain."""
    return int(found.doubtful[spread.name].sum()) if spread.name in found.doubtful else 0


def _text(found: Bootstrap) -> str:
    """`bootstrap.json` as text: complex numbers are [real, imaginary]; what is not computed is null."""
    content = {
        "format": "floquid-bootstrap/1",
        "draws": found.n_draws,
        "used": found.n_used,
        "failed": [{"reason": words, "number": number} for words, number in found.failure_counts],
        **attributes(found, "seed", "whole"),
        "orders": {str(order): n for order, n in sorted(Counter(found.orders[found.orders > 0].tolist()).items())},
        "ratio_std": found.exponents.sampling_error,
        **attributes(found, "holds", "reasons"),
        "quantities": {spread.name: _quantity(spread, found) for spread in found.quantities},
    }
    return json_text(content)


def _quantity(spread: Spread, found: Bootstrap) -> dict[str, Any]:
    low, high = spread.interval()
    return {
        **attributes(spread, "unit", "estimate"),
        "asymptotic_std": spread.asymptotic,
        **attributes(spread, "std", "bias"),
        "low": low,
        "high": high,
        "ratio": spread.ratio,
        "not_by_chance": _doubtful(spread, found),
    }
