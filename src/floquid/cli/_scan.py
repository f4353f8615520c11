"""`floquid scan`: which poles stay when the order changes, and what can be seen before any model."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

from floquid._checks import input_error
from floquid.cli._folder import ResultFolder, result_folder
from floquid.cli._options import Debug, Format, OptionalWhole, OutputFolder, RecordFiles, SettingsFile, split
from floquid.cli._progress import progress
from floquid.cli._records import check_files, read_records
from floquid.cli._scan_output import FILES, Scanned, print_scan, scan_text
from floquid.cli._setting_options import RECORDS, RecordOptions, given
from floquid.cli._settings import Choices, IdentifierName, load_choices
from floquid.order import OrderScan
from floquid.order import scan as scan_orders
from floquid.pipeline import Settings, lifted, prepare

OF = "floquid scan"
STAGES = 8

HIGHEST = 10_000
"""The highest order that is looked at in a list: what lies beyond is a slip of the keyboard."""


def scan(
    *files: RecordFiles,
    record: RecordOptions | None = None,
    identifier: IdentifierName | None = None,
    orders: str | None = None,
    most: OptionalWhole = None,
    out: OutputFolder = None,
    format: Format = "text",  # noqa: A002
    settings: SettingsFile = None,
    debug: Debug = False,
) -> None:
    """Show how many modes there are: identify at many orders, see which poles stay, and look at mode indicators.

    Parameters
    ----------
    files
        Records of free responses, as for `floquid identify`. Several files are several hits on one system.
    record
        The clock of the records, their channels, and what is cut off.
    identifier
        The algorithm that finds the poles, as for `floquid identify`. When not given, that of --settings, or ERA, which
        finds each order afresh; ml and ami add poles to those they have, so that poles of noise stay too.
    orders
        The orders: 2..40 is each from 2 to 40, 2..40..2 every other one, 4,8,16 these three.
    most
        Instead of --orders: 2, 4, and so on up to this order. When neither is given, up to half of the periods, at most
        40.
    out
        A folder for scan.json, figures/stabilisation.png and figures/indicators.png.
    format
        text prints a table; json prints scan.json alone.
    settings
        A settings.toml written by `floquid identify`; options given here come first.
    debug
        Show the traceback of an error.
    """
    del debug
    check_files(files, OF)
    listed = _orders(orders, most)
    choices = (Choices() if settings is None else load_choices(settings)).with_given(
        **given(record, OF),
        identifier=identifier,
    )
    with (
        nullcontext() if out is None else result_folder(out, FILES) as folder,
        progress(STAGES + len(files) + (2 if out else 0)) as report,
    ):
        scanned = _scanned(files, choices, listed, "--most" if orders is None else "--orders", report)
        text = scan_text(scanned, choices)
        if folder is not None:
            _write(folder, scanned.found, text, report)
    if format == "json":
        sys.stdout.write(text)
        return
    print_scan(scanned, choices.identifier or "era", out)


def _scanned(
    files: tuple[Path, ...],
    choices: Choices,
    orders: tuple[int, ...] | None,
    option: str,
    report: Callable[[str], None],
) -> Scanned:
    """The records prepared as `floquid identify` does, their lifted responses, and the scan of the orders."""
    from threadpoolctl import threadpool_limits

    records, choices = read_records(files, choices, OF, report)
    chosen = choices.resolved()
    settings = Settings(**{name: getattr(chosen, name) for name in RECORDS})
    prepared = prepare(records, settings, report=report)
    responses = lifted(prepared, report=report)
    samples = int(responses.responses.lengths.max())
    if orders and orders[-1] >= samples:
        must, got = f"be less than the {samples} periods of the record", f"goes up to {orders[-1]}"
        raise input_error(option, OF, must, got, "Ask for lower orders, or record longer.")
    # Thousands of small matrices: threads inside BLAS would wait for each other.
    few = responses.responses.values.size < 2e7
    with threadpool_limits(limits=1 if few else None, user_api="blas"):
        found = scan_orders(responses.responses, chosen.identifier, orders, report=report)
    return Scanned(prepared=prepared, lifted=responses, found=found)


def _orders(orders: str | None, most: int | None) -> tuple[int, ...] | None:
    """The orders of «2..40», «2..40..2» or «4,8,16», or 2, 4, … `most`."""
    if orders is not None and most is not None:
        raise input_error("--most", OF, "not be given beside --orders", "both are given", "Give one of them.")
    if most is not None:
        if not 2 <= most <= HIGHEST:
            raise input_error("--most", OF, f"be 2 to {HIGHEST}", f"is {most}", "For example: --most 40")
        return tuple(range(2, most + 1, 2))
    if orders is None:
        return None
    listed: set[int] = set()
    for word in split(orders):
        ends = word.split("..")
        numbers = [int(end) for end in ends if end.isascii() and end.isdigit() and len(end) < 9]
        step = numbers[2] if len(numbers) == 3 else 1
        if len(numbers) != len(ends) or len(ends) > 3 or step < 1 or numbers[:2] != sorted(numbers[:2]):
            raise _no_orders(f"has {word!r}")
        listed.update(range(numbers[0], min(numbers[:2][-1], HIGHEST) + 1, step))
    if not listed or min(listed) < 1:
        raise _no_orders(f"is {orders!r}")
    return tuple(sorted(listed))


def _no_orders(got: str) -> Exception:
    must = "list positive orders"
    return input_error("--orders", OF, must, got, "For example: --orders 2..40, --orders 2..40..2 or --orders 4,8,16")


def _write(folder: ResultFolder, found: OrderScan, text: str, report: Callable[[str], None]) -> None:
    """Write the files into the folder, where they take their names together."""
    from floquid.plot import indicators, save_figure, stabilisation

    report("writing the scan")
    (folder.unfinished / "figures").mkdir()
    (folder.unfinished / "scan.json").write_text(text, encoding="utf-8")
    report("drawing the figures")
    save_figure(stabilisation(found), folder.unfinished / "figures" / "stabilisation.png")
    save_figure(indicators(found.indicators), folder.unfinished / "figures" / "indicators.png")
    folder.publish()
