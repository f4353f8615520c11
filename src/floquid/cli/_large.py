"""`floquid identify --memory`: a record larger than memory, read in blocks."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from floquid._bar import bar
from floquid._checks import input_error
from floquid.cli._errors import CriteriaNotMetError
from floquid.cli._terminal import json_text, print_files, terminal
from floquid.errors import IdentificationError
from floquid.large import LargeResult, identify_large
from floquid.preparation import for_command
from floquid.readers import read
from floquid.search import SECONDS

TAKEN = ("period", "rate", "origin", "channels", "order", "mode_false_alarm", "seconds")
RESULT = "result.h5"


def identify_in_blocks(
    files: Sequence[Path],
    given: Mapping[str, Any],
    memory: str,
    out: Path | None,
    format_: str,
    of: str,
    *,
    enforce: bool,
) -> None:
    """Identify one record within a memory, write the result into a folder, and print it.

    As `identify` ends in an error where a model fails, so does this, and with `enforce` where it does not pass.
    """
    if len(files) != 1:
        raise input_error("FILES", of, "be one file with --memory", f"are {len(files)}", "Give one.")
    if out is None:
        raise input_error(
            "--memory", of, "come with --out", "no folder was named", "Residues stay there: add `--out DIR`."
        )
    others = [name for name in given if name not in TAKEN]
    if others:
        must, got = "stand alone with --memory", "is given with it"
        taken = ", ".join(f"--{name}".replace("_", "-") for name in TAKEN)
        remedy = f"It takes {taken}. Others need a record in memory."
        raise input_error(f"--{others[0].replace('_', '-')}", of, must, got, remedy)
    if (out / "summary.json").exists():
        got = f"{out} holds the result of a record in memory"
        raise input_error("--out", of, "be a folder of its own with --memory", got, "Name another folder.")
    said = [given.get(name) for name in ("period", "rate", "channels")]
    record = read(files[0], lazy=True, period=said[0], rate=said[1], channels=said[2], origin=given.get("origin", 0.0))
    out.mkdir(parents=True, exist_ok=True)
    with bar(True) as report:
        found = identify_large(
            record,
            out / RESULT,
            memory=memory,
            order=given.get("order"),
            false_alarm=given.get("mode_false_alarm", 1e-9),
            seconds=given.get("seconds", SECONDS),
            report=report,
        )
    if format_ == "json":
        sys.stdout.write(json_text(_summary(found)))
        sys.stdout.flush()
    else:
        terminal().print(for_command(found.summary()), soft_wrap=True, highlight=False)
        print_files(out, (RESULT,), "to keep the result")
        text = "`fq.load` reads it in Python; `floquid compare`, `survey` and `shapes` take it, too."
        terminal().print(text, style="dim")
    if found.failed:
        raise IdentificationError(found.reasons[0])
    if enforce and not found.passed:
        raise CriteriaNotMetError("\n  ".join(["The model does not pass its checks.", *found.reasons]))


def _summary(found: LargeResult) -> dict[str, Any]:
    """The result as `summary.json` has that of a record in memory, as far as there is one."""
    modes = [
        {
            "exponent": [value.real, value.imag],
            "exponent_std": [std.real, std.imag],
            "multiplier": [multiplier.real, multiplier.imag],
            "kind": "pair" if not real else "real" if multiplier.real > 0 else "negative",
        }
        for value, std, multiplier, real in zip(
            found.exponents, found.exponent_std, found.multipliers, found.real, strict=True
        )
    ]
    channels, periods = found.part
    checked = {"passed": found.passed, "reasons": found.reasons, "channels": channels, "periods": periods}
    size = {"period": found.period, "n_cycles": found.n_cycles, "n_phases": found.n_phases, "sweeps": found.sweeps}
    return {"format": "floquid-large/1", **size, "modes": modes, "system": None, "validation": checked}
