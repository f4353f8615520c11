"""The command line: `commands` has a file for each, a thin call of one public function.

`arguments` has what they are given, `output` what they write. Their modules are not private: this is a program.

Exit codes: 0 done, 1 identification failed or was refused, 2 usage or bad input, 3 validation criteria not met under
`--enforce`, 130 interrupted. What goes wrong is one message on stderr; no traceback without `--debug`.

A command imports what it needs when it is run: `--version` and `--help` wait for no numerics.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

__all__ = ["main", "run"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line with `arguments`, by default those of the process, and leave with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:  # a terminal that cannot show λ, or a file name that is no text, ends nothing
            reconfigure(errors="backslashreplace")
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: Sequence[str]) -> int:
    """Run one command, the words after `floquid` in `arguments`, and return its exit code (see `floquid.cli`)."""
    from floquid.cli._app import run

    return run(arguments)


def text_of(result: Any, **units: Any) -> str:
    """The tables and the verdict of a `result` that the command line prints, in `units`; see `_text.text_of`."""
    from floquid.cli._text import text_of

    return text_of(result, **units)
