"""Tables of other programs → transfer functions: CSV and MATLAB, as `export_transfer` writes them."""

from __future__ import annotations

import csv
import re
from os import PathLike
from pathlib import Path

import numpy as np

from floquid._checks import input_error
from floquid.core import Channel
from floquid.inputs import TransferFunctions
from floquid.io import GUARD, DamagedError, readable_file

OF = "import_transfer"
HEAD = re.compile(r"G\(([+-]?\d+)\) (.+?) to (.+?) (real|imag)( std)? \[(.*)\]")
SAMPLED = re.compile(r"frequency \[Hz\](?: of samples every (\S+) s)?")


def import_transfer(path: str | PathLike[str]) -> TransferFunctions:
    """The transfer functions in a table that `export_transfer` wrote, or another program in its form.

    `.csv` and `.mat`. Of a table of comma-separated values the head of each column counts, not its place: the first is
    `frequency [Hz]`, with `of samples every 0.05 s` behind it where G is of samples, the others are like
    `G(+1) F to x real [m/N]`, `imag`, `real std` and `imag std`. Deviations may be missing.

    `path` is the table. Raises InputError where the file cannot be read or holds something else.
    """
    file = readable_file(path, of=OF)
    kinds = {".csv": lambda: _table(file), ".mat": lambda: GUARD.call(file, _variables, file)}
    if file.suffix.lower() not in kinds:
        raise input_error("path", OF, "end in .csv or .mat", f"is {file}", "Write it with `export_transfer`.")
    try:
        return kinds[file.suffix.lower()]()
    except (DamagedError, KeyError, ValueError, TypeError, NotImplementedError, csv.Error) as error:
        got = f"{file} is not: {(str(error) or type(error).__name__).splitlines()[0]}"
        raise input_error("path", OF, "be a table as `export_transfer` writes it", got, "See its page.") from None


def _table(file: Path) -> TransferFunctions:
    with file.open(encoding="utf-8-sig", newline="") as stream:
        rows = [row for row in csv.reader(stream) if row]
    first, heads = SAMPLED.fullmatch(rows[0][0].strip()), [HEAD.fullmatch(head.strip()) for head in rows[0][1:]]
    if first is None or not heads or not all(heads):
        wrong = [head for head, own in zip(rows[0], [first, *heads], strict=True) if own is None]
        raise ValueError(f"its column {wrong[0]!r} names no path" if wrong else "it has no columns")
    if len(rows) < 2 or any(len(row) != len(rows[0]) for row in rows):
        raise ValueError(f"it needs lines of {len(rows[0])} numbers below its head")
    numbers = np.array(rows[1:], float)
    parts = {own.groups()[:5]: column for own, column in zip(heads, numbers[:, 1:].T, strict=True) if own}
    units = {own.groups()[1:3]: own[6] for own in heads if own}
    harmonics = sorted({int(harmonic) for harmonic, *_ in parts})
    inputs, outputs = (list(dict.fromkeys(key[place] for key in units)) for place in (0, 1))
    values, std = (np.full((len(harmonics), len(outputs), len(inputs), len(numbers)), np.nan, complex) for _ in "gs")
    for kind, found in ((None, values), (" std", std)):
        for (harmonic, source, output, part, own), column in parts.items():
            if own == kind and part == "real":
                place = harmonics.index(int(harmonic)), outputs.index(output), inputs.index(source)
                found[place] = column + 1j * parts[harmonic, source, output, "imag", own]
    both = {path: _units(unit) for path, unit in units.items()}
    return TransferFunctions(
        frequencies_hz=numbers[:, 0],
        harmonics=np.array(harmonics),
        values=values,
        std=std if any(key[4] for key in parts) else None,
        outputs=tuple(Channel(name=name, unit=both[inputs[0], name][0]) for name in outputs),
        inputs=tuple(Channel(name=name, unit=both[name, outputs[0]][1]) for name in inputs),
        step=float(first[1]) if first[1] else None,
    )


def _units(text: str) -> tuple[str, str]:
    """The units of output and input of that of a path; "-" is none."""
    if "/" not in text:
        return text, "-"
    above, below = text[:-1].rsplit("/(", 1) if text.endswith(")") and "/(" in text else text.rsplit("/", 1)
    return ("-" if above == "1" else above), below


def _variables(file: Path) -> TransferFunctions:
    from scipy.io import loadmat

    found = loadmat(file)
    std, step = found["std"], np.ravel(found["step"])
    outputs, inputs = (
        tuple(
            Channel(name=str(np.ravel(name)[0]), unit=str(np.ravel(unit)[0]))
            for name, unit in zip(np.ravel(found[f"{side}s"]), np.ravel(found[f"{side}_units"]), strict=True)
        )
        for side in ("output", "input")
    )
    hertz, harmonics = np.ravel(found["frequencies_hz"]), np.ravel(found["harmonics"])
    # MATLAB leaves out the last axes of length 1.
    shape = (len(harmonics), len(outputs), len(inputs), len(hertz))
    return TransferFunctions(
        frequencies_hz=hertz,
        harmonics=harmonics.astype(np.int64),
        values=found["values"].reshape(shape),
        std=std.reshape(shape) if std.size else None,
        outputs=outputs,
        inputs=inputs,
        step=float(step[0]) if len(step) else None,
    )
