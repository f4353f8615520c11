"""Results of several records: kept in a folder with their tables, told, and drawn."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from floquid._bar import bar
from floquid._checks import input_error
from floquid.cli.output.folder import RESULT, ResultFolder, result_folder
from floquid.cli.output.terminal import print_files, terminal
from floquid.store import save

PAGE, FIGURES = "report.html", "figures/"


def refuse_beside_identified(out: Path | None, of: str) -> None:
    """Refuse a folder that holds a result of an identification, which has a page of its own."""
    if out is not None and (out / RESULT).exists():
        must = "be a folder without a result of `floquid identify`, whose report.html would be replaced"
        raise input_error("--out", of, must, f"{out} holds {RESULT}", "Choose another folder.")


def keep(folder: ResultFolder | None, found: Any, names: Sequence[str], texts: Sequence[str]) -> None:
    """Write the result and its `texts` under their `names` into a folder, if there is one, together."""
    if folder is None:
        return
    save(found, folder.unfinished / names[0])
    for name, text in zip(names[1:], texts, strict=False):
        folder.write(name, text)
    folder.publish()


def tell(
    found: Any,
    printed: Callable[[Console, Any], None],
    *,
    out: Path | None,
    names: Sequence[str],
    json: str | None,
    why: str,
    options: Mapping[str, Mapping[str, Any]] | None = None,
    page: Mapping[str, Any] | None = None,
) -> None:
    """Print the result, or its `json` alone; then draw it into the folder `out`.

    `names` are those of all files of the folder; `why` says what they are kept for. `options` are those of each figure,
    `page` those of the page.
    """
    if json is None:
        printed(terminal(), found)
    else:
        sys.stdout.write(json)
        sys.stdout.flush()
    if out is not None:
        _draw(out, found, names, options or {}, page or {})
    if json is None:
        drawn = [name for name in names if name.startswith(FIGURES)]
        kept = [name for name in names if name not in {PAGE, *drawn} and not name.endswith(".parquet")]
        print_files(out, [PAGE, *kept, FIGURES], why)


def _draw(
    out: Path, found: Any, names: Sequence[str], options: Mapping[str, Mapping[str, Any]], page: Mapping[str, Any]
) -> None:
    """Draw the figures and the page into the folder."""
    from floquid.plot import save_figure
    from floquid.reporting import report as write_report

    with bar(True) as report, result_folder(out, names) as folder:
        report("drawing the figures")
        (folder.unfinished / FIGURES).mkdir()
        for name in names:
            if name.startswith(FIGURES) and (function := Path(name).stem) in dir(found.plot):
                save_figure(getattr(found.plot, function)(**options.get(function, {})), folder.unfinished / name)
        report("drawing the report")
        write_report(found, folder.unfinished / PAGE, **page)
        folder.publish()
