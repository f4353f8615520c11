"""The subcommands put together, and the way out of each: an exit code and at most one message."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from importlib.metadata import version

from cyclopts import App, CycloptsError

from floquid.cli._bootstrap import bootstrap
from floquid.cli._demo import demo, simulate
from floquid.cli._errors import (
    BAD_INPUT,
    DONE,
    FAILED,
    INTERRUPTED,
    NOT_MET,
    CriteriaNotMetError,
    explained,
    explained_usage,
)
from floquid.cli._floquet import floquet
from floquid.cli._identify import identify, report
from floquid.cli._records import convert, info
from floquid.cli._scan import scan
from floquid.cli._terminal import terminal
from floquid.cli._transfer import multisine, transfer

app = App(
    name="floquid",
    help="Identify linear time-periodic systems from measured responses.",
    usage="Usage: floquid COMMAND [OPTIONS]",
    version=version("floquid"),
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
)
app.command(demo, usage="Usage: floquid demo [SYSTEM] [OPTIONS]")
app.command(info, usage="Usage: floquid info FILE [OPTIONS]")
app.command(convert, usage="Usage: floquid convert FILE OUT [OPTIONS]")
app.command(identify, usage="Usage: floquid identify FILES... [OPTIONS]")
app.command(transfer, usage="Usage: floquid transfer FILES... --inputs NAMES [OPTIONS]")
app.command(multisine, usage="Usage: floquid multisine --period T --rate HZ [OPTIONS]")
app.command(scan, usage="Usage: floquid scan FILES... [OPTIONS]")
app.command(report, usage="Usage: floquid report RESULT [OPTIONS]")
app.command(bootstrap, usage="Usage: floquid bootstrap RESULT [OPTIONS]")
app.command(floquet, usage="Usage: floquid floquet FILES... [OPTIONS]")
app.command(simulate, usage="Usage: floquid simulate [SYSTEM] [OPTIONS]")


def run(arguments: Sequence[str]) -> int:
    """Run one command, the words after `floquid` in `arguments`, and return its exit code (see `floquid.cli`)."""
    debug = "--debug" in arguments
    try:
        # What numpy warns of is either refused where the numbers are checked or harmless: it is nothing for a person.
        with warnings.catch_warnings(record=not debug):
            app(list(arguments), exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except CycloptsError as error:
        return _end(explained_usage(error), BAD_INPUT)
    except BrokenPipeError:
        # Whoever read the output has had enough. What is left in the buffer goes nowhere, in silence.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        return _end("Interrupted before the end. A result is only ever written whole.", INTERRUPTED)
    except CriteriaNotMetError as error:
        return _end(str(error), NOT_MET)
    except Exception as error:  # noqa: BLE001  # the last place where a mistake of ours can be worded
        if debug:
            traceback.print_exc()
        return _end(*explained(error))
    return DONE


def _end(message: str, code: int) -> int:
    terminal(stderr=True).print(f"floquid: {message}", soft_wrap=True)
    return code
