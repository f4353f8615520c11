"""The subcommands put together, and the way out of each: an exit code and at most one message."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Sequence

from cyclopts import App

from floquid._version import __version__

# The module of each command, the words after it, and the first line of its help: `--help` imports none to list them.
COMMANDS = {
    "demo": ("demo", "[SYSTEM]", "Simulate the experiment of Allen's paper, identify it, and compare with the truth."),
    "info": (
        "info",
        "FILE",
        (
            "Show what is in a record file: channels, units, rate, candidates for clock, hits and inputs, what to type "
            "next."
        ),
    ),
    "convert": (
        "convert",
        "FILE OUT",
        "Write a record in another format, and say what that format could not hold; or the modes of a result.",
    ),
    "identify": (
        "identify",
        "FILES...",
        "Identify the Floquet exponents, the periodic mode shapes and A(t) from measured responses.",
    ),
    "survey": (
        "survey",
        "FILES...",
        "Follow modes over a speed, or another operating point, and find where they turn unstable.",
    ),
    "compare": (
        "compare",
        "A B",
        "Compare two sets of modes, mode by mode: differences with deviations, what is missing, and χ² of all.",
    ),
    "monitor": (
        "monitor",
        "FILES... --baseline FIRST:END",
        "Compare records of one machine with a baseline of it: alarms, when it changed, how periodic it is.",
    ),
    "fleet": (
        "fleet",
        "FILES...",
        "Identify many records, each for itself, into one Parquet table with a row a mode.",
    ),
    "transfer": (
        "transfer",
        "FILES... --inputs NAMES",
        "Harmonic transfer functions from measured inputs to the other channels, with their deviations.",
    ),
    "multisine": (
        "multisine",
        "--period T --rate HZ",
        "Write inputs for measuring harmonic transfer functions: random lines whose sidebands do not meet.",
    ),
    "scan": (
        "scan",
        "FILES...",
        "Show how many modes there are: identify at many orders, see which poles stay, and look at mode indicators.",
    ),
    "report": (
        "identify",
        "RESULT",
        "Write the report of a saved result: one HTML page that opens in any browser, without a network.",
    ),
    "shapes": (
        "shapes",
        "RESULT",
        (
            "Read the shapes of a saved result: whirl of modes, their names by patterns over blades, shares of their "
            "lines."
        ),
    ),
    "bootstrap": (
        "bootstrap",
        "RESULT",
        "Check the standard deviations of a result: draw records from its model, fit each anew, and see the spread.",
    ),
    "floquet": (
        "floquet",
        "FILES...",
        "Floquet exponents, periodic mode shapes and stability of a system whose A(t) is known.",
    ),
    "simulate": ("demo", "[SYSTEM]", "Write the free response of an example system to a file."),
}


def app_of(words: Sequence[str] = ()) -> App:
    """The command line; a command that is named in `words` has its whole help, the others their first line."""
    app = App(
        name="floquid",
        help="Identify linear time-periodic systems from measured responses.",
        usage="Usage: floquid COMMAND [OPTIONS]",
        version=__version__,
        version_format="plaintext",  # or a renderer of markdown would be imported for it
        help_format="markdown",
        help_epilogue="Every command takes --debug: it shows the traceback of an error.",
        suppress_keyboard_interrupt=False,
    )
    for name, (module, places, line) in COMMANDS.items():
        usage, place = f"Usage: floquid {name} {places} [OPTIONS]", f"floquid.cli.commands.{module}:{name}"
        app.command(place, name=name, usage=usage, help=None if name in words else line)
    return app


def run(arguments: Sequence[str]) -> int:
    """Run one command, the words after `floquid` in `arguments`, and return its exit code (see `floquid.cli`)."""
    words = [word for word in arguments if word != "--debug"]
    debug = len(words) < len(arguments)
    try:
        # What numpy warns of is either refused where the numbers are checked or harmless: it is nothing for a person.
        with warnings.catch_warnings(record=not debug):
            app_of(words)(words, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read the output has had enough. What is left in the buffer goes nowhere, in silence.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  # the last place to word a mistake of ours
        from floquid.cli._errors import explained
        from floquid.cli.output.terminal import terminal

        if debug and not isinstance(error, KeyboardInterrupt):
            traceback.print_exc()
        message, code = explained(error)
        terminal(stderr=True).print(f"floquid: {message}", soft_wrap=True)
        return code
    return 0
