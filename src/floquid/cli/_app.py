"""The subcommands put together, and what an error looks like to a person."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

from cyclopts import App, CycloptsError

from floquid.cli._demo import demo
from floquid.cli._identify import identify
from floquid.cli._info import info
from floquid.cli._simulate import simulate
from floquid.cli._terminal import terminal
from floquid.errors import FloquidError, InputError

DONE, FAILED, BAD_INPUT = 0, 1, 2

app = App(
    name="floquid",
    help="Identify linear time-periodic systems from measured responses.",
    version=version("floquid"),
    help_format="plaintext",
)
for command in (demo, info, identify, simulate):
    app.command(command)


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code.

    Parameters
    ----------
    arguments
        The words after `floquid`.

    Returns
    -------
    int
        0 done, 1 identification failed or was refused, 2 usage or bad input.
    """
    stderr = terminal(stderr=True)
    try:
        app(list(arguments), exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        stderr.print(f"floquid: {error}", soft_wrap=True)
        stderr.print("Try `floquid --help`, or `floquid COMMAND --help`.", soft_wrap=True)
        return BAD_INPUT
    except (FloquidError, OSError, MemoryError) as error:
        if "--debug" in arguments:
            raise
        stderr.print(f"floquid: {_words(error)}", soft_wrap=True)
        return BAD_INPUT if isinstance(error, (InputError, OSError)) else FAILED
    except KeyboardInterrupt:
        stderr.print("floquid: interrupted; nothing was changed after the last message.", soft_wrap=True)
        return 130
    return DONE


def _words(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return (
            "The record is too large for the memory of this machine: use fewer channels (`--channels`) or a part of it."
        )
    return str(error)
