"""What `floquid scan` says: a table for a person, `scan.json` for a program."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from floquid.cli._settings import Choices
from floquid.cli._terminal import counted, print_title, print_whitening, terminal
from floquid.lifting import Lifted
from floquid.lti import ModalModel, Outcome
from floquid.order import OrderScan, Stability
from floquid.pipeline import Prepared

FILES = ("scan.json", "figures/stabilisation.png", "figures/indicators.png")

LEGEND = (
    "stable: poles that agree with one of the order before in frequency, damping and shape; left: share of the sum of "
    "squares that the poles do not explain; misfit: the same over what white noise of the size found would "
    "leave, 1 for a right model; ΔAIC, ΔBIC: two criteria that weigh misfit against the number of parameters, above "
    "their lowest value (*). "
    "True poles stay stable from some order on, and there the misfit comes to rest near 1."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scanned:
    """What a scan gives: the records as used, their lifted responses, and the models over the orders."""

    prepared: Prepared
    lifted: Lifted
    found: OrderScan


def print_scan(scanned: Scanned, identifier: str, out: Path | None) -> None:
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
    for sentence in scanned.prepared.findings:
        console.print(f"  {sentence}")
    for fault in scanned.prepared.faults:
        console.print(f"Warning: {fault}", style="yellow")
    print_whitening(console, lifted)
    print_title(console, f"Orders by {identifier.upper()}, conjugate poles counted one by one")
    console.print(_table(found))
    console.print(LEGEND, style="dim")
    seen = found.indicators
    last = f"{counted(seen.n_above, 'singular value')} of the responses above white noise"
    console.print(f"{last}: at least so many poles, if the noise is white.")
    if out is None:
        console.print("Add --out DIR for the stabilisation diagram, the mode indicators and scan.json.", style="dim")
    else:
        console.print(f"Written to {out}/: {', '.join(FILES)}", soft_wrap=True)


def _table(found: OrderScan) -> Table:
    """An order a row."""
    table = Table(box=None)
    for name in ("order", "stable", "left [%]", "misfit", "ΔAIC", "ΔBIC"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("note")
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


def _above_least(values: NDArray[np.float64]) -> list[str]:
    """Each value above the least, which has a star."""
    above = values - values.min()
    return [f"{value:.4g}" if value else "0 *" for value in above]


def scan_text(scanned: Scanned, choices: Choices) -> str:
    """`scan.json` as text."""
    lifted, found = scanned.lifted, scanned.found
    criteria, seen, tolerances = found.criteria, found.indicators, found.tolerances
    content = {
        "format": "floquid-scan/1",
        "period": lifted.period,
        "n_cycles": [int(length) for length in lifted.responses.lengths],
        "n_phases": lifted.n_phases,
        "noise_whitening": None if lifted.whitening is None else lifted.whitening.tolist(),
        "channels": [channel.name for channel in lifted.channels],
        "synchronisation": list(scanned.prepared.findings),
        "warnings": list(scanned.prepared.faults),
        "identifier": choices.identifier or "era",
        "tolerances": {name: getattr(tolerances, name) for name in ("frequency", "damping", "decay", "shape")},
        "orders": [
            {
                "order": order,
                "reached": model.outcome is Outcome.SUCCESS,
                "outcome": model.outcome.name,
                "n_stable": int(found.n_stable[number]),
                "cost": _number(criteria.cost[number]),
                "left": _number(criteria.left[number]),
                "misfit": _number(criteria.misfit[number]),
                "aic": _number(criteria.aic[number]),
                "bic": _number(criteria.bic[number]),
                "poles": _poles(model, found.stable[number]),
            }
            for number, (order, model) in enumerate(zip(found.orders, found.models, strict=True))
        ],
        "indicators": {
            "singular_values": [_number(value) for value in seen.singular_values[: 2 * max(found.orders)]],
            "noise_edge": seen.noise_edge,
            "n_above": seen.n_above,
            "delays": seen.delays,
        },
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _poles(model: ModalModel, levels: NDArray[np.int64]) -> list[dict[str, Any]]:
    """Every pole of a model: its multiplier, principal pole [1/s], folded frequency [Hz] and stability."""
    return [
        {
            "multiplier": [float(mu.real), float(mu.imag)],
            "pole": [_number(pole.real), _number(pole.imag)],
            "frequency_hz": float(abs(np.angle(mu)) / (2.0 * np.pi * model.dt)),
            "stability": Stability(int(level)).name.lower(),
        }
        for mu, pole, level in zip(model.multipliers, model.poles, levels, strict=True)
    ]


def _number(value: float) -> float | None:
    """A number, or null for what JSON cannot hold."""
    return float(value) if np.isfinite(value) else None
