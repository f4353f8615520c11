"""`floquid scan`: which poles stay when the order changes, and what can be seen before any model."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from floquid._arrays import Floats, Integers
from floquid._checks import counted, input_error
from floquid.cli.arguments.options import RECORDS, Choices, FreeOptions, choices_of, given
from floquid.cli.arguments.records import check_files, read_records
from floquid.cli.arguments.shared import Format, OutputFolder, RecordFiles, SettingsFile, is_saved, split
from floquid.cli.output.folder import ResultFolder, identified_in, maybe_folder, refuse_beside_result
from floquid.cli.output.printed import print_whitening
from floquid.cli.output.terminal import (
    json_text,
    new_table,
    print_files,
    print_title,
    print_warnings,
    progress,
    terminal,
)
from floquid.findings import Finding, as_mapping, texts
from floquid.lifting import Lifted
from floquid.lti import ModalModel, Outcome
from floquid.order import OrderScan, Stability
from floquid.order import scan as scan_orders
from floquid.pipeline import Analysis, IdentifierName, Settings, blas_threads, lifted, prepare

OF = "floquid scan"
STAGES = 8

HIGHEST = 10_000  # the highest order that is looked at in a list: what lies beyond is a slip of the keyboard

FILES = ("scan.json", "figures/stabilisation.png", "figures/indicators.png")

LEGEND = (
    "stable: poles that agree with the order before in frequency, damping and shape. left: share of the sum of squares "
    "that the poles do not explain. misfit: the same over that of white noise of this size; 1 for a right model. ΔAIC, "
    "ΔBIC: misfit weighed against the number of parameters, above the least value (*). True poles stay stable from "
    "some order on, where the misfit rests near 1."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scanned:
    """Result of a scan: what was done to the records, their lifted responses, and the models over the orders.

    `analysis` is the saved one that the responses are of, if they are.
    """

    done: tuple[Finding, ...]
    faults: tuple[Finding, ...]
    lifted: Lifted
    found: OrderScan
    analysis: Analysis | None


def scan(
    *files: RecordFiles,
    record: FreeOptions | None = None,
    identifier: IdentifierName | None = None,
    orders: str | None = None,
    out: OutputFolder = None,
    format: Format = "text",  # noqa: A002
    settings: SettingsFile = None,
) -> None:
    """Show how many modes there are: identify at many orders, see which poles stay, and look at mode indicators.

    Parameters
    ----------
    files
        Records of free responses, as for `floquid identify`. Several files are several hits on one system. Or the
        result.h5 or the folder of an identification, whose lifted responses are taken.
    record
        The clock of the records, their channels, and what is cut off.
    identifier
        The algorithm that finds the poles, as for `floquid identify`. When not given, that of --settings, or ERA, which
        finds each order afresh; ml and ami add poles to those they have, so that poles of noise stay too.
    orders
        The orders: 2..40 is each from 2 to 40, 2..40..2 every other one, 4,8,16 these three. When not given, every
        other one up to half of the periods, at most 48.
    out
        A folder for scan.json, figures/stabilisation.png and figures/indicators.png. Of a saved result frequencies are
        unfolded.
    format
        text prints a table; json prints scan.json alone.
    """
    listed, said = _orders(orders), given(record, OF)
    choices = choices_of(settings).with_given(**said, identifier=identifier)
    if is_saved(files):
        refuse_beside_result(said, OF)
    else:
        check_files(files, OF)
    if choices.settings.inputs or choices.settings.excitation != "none":
        name = "inputs" if choices.settings.inputs else "excitation"
        value = ",".join(choices.settings.inputs) or choices.settings.excitation
        remedy = f"`floquid identify --{name} {value}` finds how many modes there are, and says why."
        raise input_error(f"--{name}", OF, "be left out: a scan is of free responses", f"is {value}", remedy)
    stages = STAGES + len(files) + (2 if out else 0)
    with maybe_folder(out, FILES) as folder, progress(stages) as report:
        scanned = _scanned(files, choices, listed, report)
        text = _scan_text(scanned, choices)
        if folder is not None:
            _write(folder, scanned, text, report)
    if format == "json":
        sys.stdout.write(text)
        return
    _print_scan(scanned, choices.identifier or "era", out)


def _scanned(
    files: tuple[Path, ...],
    choices: Choices,
    orders: tuple[int, ...] | None,
    report: Callable[[str], None],
) -> Scanned:
    """The records prepared as `floquid identify` does, their lifted responses, and the scan of the orders."""
    done, faults, analysis = (), (), None
    if is_saved(files):
        chosen, analysis = choices.resolved(), identified_in(files[0], OF)
        responses, done = analysis.lifted, analysis.findings
    else:
        records, choices = read_records(files, choices, OF, report)
        chosen = choices.resolved()
        prepared = prepare(records, Settings(**{name: getattr(chosen, name) for name in RECORDS}), report=report)
        responses, done, faults = lifted(prepared, report=report), prepared.findings, prepared.faults
    samples = int(responses.responses.lengths.max())
    if orders and orders[-1] >= samples:
        must, got = f"be less than the {samples} periods of the record", f"goes up to {orders[-1]}"
        raise input_error("--orders", OF, must, got, "Ask for lower orders, or record longer.")
    with blas_threads([responses.responses]):
        found = scan_orders(responses.responses, chosen.identifier, orders, report=report)
    return Scanned(done=done, faults=faults, lifted=responses, found=found, analysis=analysis)


def _orders(orders: str | None) -> tuple[int, ...] | None:
    """The orders of «2..40», «2..40..2» or «4,8,16»."""
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


def _write(folder: ResultFolder, scanned: Scanned, text: str, report: Callable[[str], None]) -> None:
    """Write the files into the folder, where they take their names together."""
    from floquid.plot import indicators, save_figure, stabilisation

    report("writing the scan")
    (folder.unfinished / "figures").mkdir()
    folder.write("scan.json", text)
    report("drawing the figures")
    # Only the modes of an identification say on which branch a pole is.
    figure = stabilisation(scanned.found, analysis=scanned.analysis)
    save_figure(figure, folder.unfinished / "figures" / "stabilisation.png")
    save_figure(indicators(scanned.found.indicators), folder.unfinished / "figures" / "indicators.png")
    folder.publish()


def _print_scan(scanned: Scanned, identifier: str, out: Path | None) -> None:
    """The record, the table of orders, and where the figures are."""
    console, lifted, found = terminal(), scanned.lifted, scanned.found
    cycles = ", ".join(str(length) for length in lifted.responses.lengths)
    console.print(
        f"{counted(lifted.n_hits, 'record')}, {counted(lifted.n_channels, 'channel')}; period {lifted.period:.8g} s: "
        f"{counted(lifted.n_phases, 'sample')} a period, {cycles} periods"
        f"{'' if lifted.whitening is None else ' after a filter that takes one'}."
    )
    for step in lifted.provenance.steps:
        console.print(f"  {step}", style="dim")
    for finding in scanned.done:
        console.print(f"  {finding}")
    print_warnings(console, scanned.faults)
    print_whitening(console, lifted.whitening, lifted.channels)
    print_orders(console, found, f"Orders by {identifier.upper()}")
    print_files(out, FILES, "for the stabilisation diagram, the mode indicators and scan.json")


def print_orders(console: Console, found: OrderScan, title: str = "Orders") -> None:
    """Print the table of orders, and the least number of poles."""
    print_title(console, f"{title}, conjugate poles counted one by one")
    console.print(_table(found))
    console.print(LEGEND, style="dim")
    seen = found.indicators
    last = f"{counted(seen.n_above, 'singular value')} of the responses above white noise"
    console.print(f"{last}: the least number of poles, if the noise is white.")


def _table(found: OrderScan) -> Table:
    """An order a row."""
    table = new_table([], ["order", "stable", "left [%]", "misfit", "ΔAIC", "ΔBIC"], ["note"])
    criteria = found.criteria
    aic, bic = _above_least(criteria.aic), _above_least(criteria.bic)
    for number, (order, model) in enumerate(zip(found.orders, found.models, strict=True)):
        reached = model.outcome is Outcome.SUCCESS
        table.add_row(
            str(order),
            str(found.n_stable[number]) if reached else "-",
            f"{100 * criteria.left[number]:.4g}",
            f"{criteria.misfit[number]:.5g}",
            aic[number],
            bic[number],
            "" if reached else f"not reached: {counted(model.order, 'pole')}",
        )
    return table


def _above_least(values: Floats) -> list[str]:
    """Each value above the least, which has a star."""
    above = values - values.min()
    return [f"{value:.4g}" if value else "0 *" for value in above]


def _scan_text(scanned: Scanned, choices: Choices) -> str:
    """`scan.json` as text."""
    lifted, found = scanned.lifted, scanned.found
    criteria, seen, tolerances = found.criteria, found.indicators, found.tolerances
    content = {
        "format": "floquid-scan/1",
        "period": lifted.period,
        "n_cycles": lifted.responses.lengths,
        "n_phases": lifted.n_phases,
        "noise_whitening": lifted.whitening,
        "channels": [channel.name for channel in lifted.channels],
        "synchronisation": texts(scanned.done),
        "findings": [as_mapping(own) for own in scanned.done],
        "warnings": texts(scanned.faults),
        "identifier": choices.identifier or "era",
        "tolerances": {name: getattr(tolerances, name) for name in ("frequency", "damping", "decay", "shape")},
        "orders": [
            {
                "order": order,
                "reached": model.outcome is Outcome.SUCCESS,
                "outcome": model.outcome.name,
                "n_stable": found.n_stable[number],
                **{name: getattr(criteria, name)[number] for name in ("cost", "left", "misfit", "aic", "bic")},
                "poles": _poles(model, found.stable[number]),
            }
            for number, (order, model) in enumerate(zip(found.orders, found.models, strict=True))
        ],
        "indicators": {
            "singular_values": seen.singular_values[: 2 * max(found.orders)],
            "noise_edge": seen.noise_edge,
            "n_above": seen.n_above,
            "delays": seen.delays,
        },
    }
    return json_text(content)


def _poles(model: ModalModel, levels: Integers) -> list[dict[str, Any]]:
    """Every pole of a model: its multiplier, principal pole [1/s], folded frequency [Hz] and stability."""
    return [
        {
            "multiplier": mu,
            "pole": pole,
            "frequency_hz": abs(np.angle(mu)) / (2.0 * np.pi * model.dt),
            "stability": Stability(int(level)).name.lower(),
        }
        for mu, pole, level in zip(model.multipliers, model.poles, levels, strict=True)
    ]
