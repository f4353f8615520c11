"""The subcommands put together, the way out of each (an exit code and at most one message), and results as text."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from importlib.metadata import version
from io import StringIO

from cyclopts import App, CycloptsError

from floquid.cli._bootstrap import bootstrap, print_drawn
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
from floquid.cli._floquet_output import print_stability
from floquid.cli._identify import identify, report
from floquid.cli._info import info
from floquid.cli._monitor import monitor, print_monitor
from floquid.cli._multisine import multisine
from floquid.cli._records import convert
from floquid.cli._scan import print_orders, scan
from floquid.cli._shapes import shapes
from floquid.cli._survey import print_survey, survey
from floquid.cli._terminal import plain, print_found, terminal
from floquid.cli._transfer import transfer
from floquid.floquet import FloquetModes, stability
from floquid.monitoring import Monitor
from floquid.order import OrderScan
from floquid.pipeline import Analysis, Bootstrap
from floquid.surveys import Survey
from floquid.views import DampingUnit, SpeedUnit, check_damping_unit
from floquid.views import speed_unit as unit_of_speed

WIDTH = 100  # characters of a line of `summary()`

app = App(
    name="floquid",
    help="Identify linear time-periodic systems from measured responses.",
    usage="Usage: floquid COMMAND [OPTIONS]",
    version=version("floquid"),
    help_format="plaintext",
    help_epilogue="Every command takes --debug: it shows the traceback of an error.",
    suppress_keyboard_interrupt=False,
)
app.command(demo, usage="Usage: floquid demo [SYSTEM] [OPTIONS]")
app.command(info, usage="Usage: floquid info FILE [OPTIONS]")
app.command(convert, usage="Usage: floquid convert FILE OUT [OPTIONS]")
app.command(identify, usage="Usage: floquid identify FILES... [OPTIONS]")
app.command(survey, usage="Usage: floquid survey FILES... [OPTIONS]")
app.command(monitor, usage="Usage: floquid monitor FILES... --baseline FIRST:END [OPTIONS]")
app.command(transfer, usage="Usage: floquid transfer FILES... --inputs NAMES [OPTIONS]")
app.command(multisine, usage="Usage: floquid multisine --period T --rate HZ [OPTIONS]")
app.command(scan, usage="Usage: floquid scan FILES... [OPTIONS]")
app.command(report, usage="Usage: floquid report RESULT [OPTIONS]")
app.command(shapes, usage="Usage: floquid shapes RESULT [OPTIONS]")
app.command(bootstrap, usage="Usage: floquid bootstrap RESULT [OPTIONS]")
app.command(floquet, usage="Usage: floquid floquet FILES... [OPTIONS]")
app.command(simulate, usage="Usage: floquid simulate [SYSTEM] [OPTIONS]")


def run(arguments: Sequence[str]) -> int:
    """Run one command, the words after `floquid` in `arguments`, and return its exit code (see `floquid.cli`)."""
    words = [word for word in arguments if word != "--debug"]
    debug = len(words) < len(arguments)
    try:
        # What numpy warns of is either refused where the numbers are checked or harmless: it is nothing for a person.
        with warnings.catch_warnings(record=not debug):
            app(words, exit_on_error=False, print_error=False, result_action="return_value")
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


def text_of(
    result: Analysis | Bootstrap | OrderScan | FloquetModes | Survey | Monitor,
    *,
    speed_unit: SpeedUnit = "hz",
    damping_unit: DampingUnit = "percent",
) -> str:
    """The tables and the verdict of a `result` that the command line prints, without colours, with Python's names.

    The speed of a shaft is in `speed_unit`, damping in `damping_unit`. Raises InputError where one is none.
    """
    unit_of_speed(speed_unit, "summary")
    check_damping_unit(damping_unit, "summary")
    file = StringIO()
    console = plain(file, WIDTH)
    match result:
        case Analysis():
            print_found(console, result, speed_unit=speed_unit, damping_unit=damping_unit)
        case Bootstrap():
            print_drawn(console, result)
        case OrderScan():
            print_orders(console, result)
        case FloquetModes():
            print_stability(console, result, stability(result))
        case Survey():
            print_survey(console, result)
        case Monitor():
            print_monitor(console, result)
    return "\n".join(line.rstrip() for line in file.getvalue().strip("\n").splitlines())
