"""`floquid bootstrap`: whether the deviations of a saved result hold, by drawing records from its model."""

from __future__ import annotations

import hashlib
import sys
from contextlib import nullcontext
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from floquid._checks import input_error
from floquid.cli._bootstrap_output import FILES, bootstrap_text, print_bootstrap
from floquid.cli._folder import ResultFolder, result_file, result_folder
from floquid.cli._options import Debug, Format, OptionalWhole, OutputFolder, Place, Whole
from floquid.cli._terminal import terminal
from floquid.pipeline import Bootstrap
from floquid.pipeline import bootstrap as bootstrap_analysis
from floquid.store import DrawFile, load

OF = "floquid bootstrap"

KEPT = ".floquid-draws.npz"
"""The draws of a run that was cut short: the next one goes on from them, and removes them in the end."""


def bootstrap(
    result: Place,
    *,
    draws: Whole = 200,
    seed: Whole = 0,
    workers: OptionalWhole = None,
    whole: Annotated[bool, Parameter(negative=())] = False,
    out: OutputFolder = None,
    format: Format = "text",  # noqa: A002
    debug: Debug = False,
) -> None:
    """Check the standard deviations of a result: draw records from its model, fit each anew, and see the spread.

    Parameters
    ----------
    result
        A result.h5 that `floquid identify --out DIR` wrote, or the folder that it is in.
    draws
        How many records are drawn, at least 20; of 200 a deviation is known to 5 %.
    seed
        The seed of the noise.
    workers
        How many processes share the draws; one for each processor when not given. The numbers do not depend on it.
    whole
        Identify each record from the beginning, the order too, instead of fitting the same modes again.
    out
        A folder for bootstrap.json and bootstrap.npz, which holds every draw. A run that was cut short goes on there.
    format
        text prints tables; json prints bootstrap.json alone.
    debug
        Show the traceback of an error.
    """
    del debug
    _check(draws, seed, workers)
    file = result_file(result)
    with nullcontext() if out is None else result_folder(out, FILES) as folder:
        key, analysis = _key(file, seed, whole=whole), load(file)
        while key != (now := _key(file, seed, whole=whole)):  # another program has put a new result there meanwhile
            key, analysis = now, load(file)
        kept = None if out is None else DrawFile(path=out / KEPT, key=key)
        if kept is not None and (done := len(kept.read())):
            words = f"{min(done, draws)} of {draws} draws were done by a run that was cut short: going on from there."
            terminal(stderr=True).print(words)
        found = bootstrap_analysis(
            analysis, draws=draws, seed=seed, workers=workers, whole=whole, kept=kept, progress=True
        )
        text = bootstrap_text(found)
        if folder is not None:
            _write(folder, found, text)
            (folder.path / KEPT).unlink(missing_ok=True)
    if format == "json":
        sys.stdout.write(text)
        return
    print_bootstrap(analysis, found, out)


def _key(file: Path, seed: int, *, whole: bool) -> str:
    """What the draws depend on: the result, the seed, what is fitted, and the code."""
    content = hashlib.sha256(file.read_bytes()).hexdigest()
    return f"floquid {version('floquid')}, {content}, seed {seed}, {'whole' if whole else 'held'}"


def _check(draws: int, seed: int, workers: int | None) -> None:
    """Refuse numbers that cannot be, before anything is read."""
    for option, value, least in (("--draws", draws, 20), ("--seed", seed, 0), ("--workers", workers, 1)):
        if value is not None and value < least:
            raise input_error(option, OF, f"be at least {least}", f"is {value}")


def _write(folder: ResultFolder, found: Bootstrap, text: str) -> None:
    """Write the files into the folder, where they take their names together."""
    (folder.unfinished / FILES[0]).write_text(text, encoding="utf-8")
    arrays: dict[str, Any] = {spread.name: spread.draws for spread in found.quantities}
    arrays["orders"] = found.orders
    np.savez_compressed(folder.unfinished / FILES[1], **arrays)  # plain arrays all
    folder.publish()
