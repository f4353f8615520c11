"""The modes of a saved result in the format of another program: what `floquid convert` does with a result."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from floquid._checks import input_error
from floquid.cli._folder import result_file
from floquid.cli._progress import progress
from floquid.cli._terminal import counted, terminal
from floquid.exports import MODE_FORMATS, export_modes
from floquid.store import load
from floquid.views import upper_modes

OF = "floquid convert"


def convert_modes(result: Path, out: Path, options: Mapping[str, object]) -> None:
    """Write the modes of a result, a file or the folder that it is in; `options` are those of records.

    Raises
    ------
    InputError
        An option was given, the suffix of `out` is unknown, or a file cannot be read or written.
    """
    given = [name for name, value in options.items() if value is not None]
    if given:
        got, remedy = f"{result} is a result of `floquid identify`", "Leave the option out: modes have all of it."
        raise input_error(f"--{given[0]}", OF, "come with a record", got, remedy)
    if out.suffix.lower() not in MODE_FORMATS:
        remedy = f"Use one of {', '.join(MODE_FORMATS)}."
        raise input_error("OUT", OF, "have a suffix that modes can be written to", f"is {out}", remedy)
    with progress(2) as report:
        report("reading the result")
        analysis = load(result_file(result))
        report(f"writing {out.name}")
        export_modes(analysis, out)
    model = analysis.model
    words = (counted(len(upper_modes(model)), "mode"), counted(len(model.harmonics), "harmonic"))
    terminal().print(f"Written to {out}: {words[0]}, of {words[1]}.", soft_wrap=True)
