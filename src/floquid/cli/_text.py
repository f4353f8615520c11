"""Results as the text that the command line prints: tables and a verdict, for notebooks and `summary()`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from io import StringIO
from typing import Any

from rich.console import Console

from floquid.cli.commands.bootstrap import print_drawn
from floquid.cli.commands.compare import print_comparison, print_updated
from floquid.cli.commands.monitor import print_monitor
from floquid.cli.commands.scan import print_orders
from floquid.cli.commands.survey import print_survey
from floquid.cli.output.floquet import print_stability
from floquid.cli.output.printed import print_found
from floquid.cli.output.terminal import plain
from floquid.comparison import Comparison, Updated
from floquid.floquet import FloquetModes, stability
from floquid.monitoring import Monitor
from floquid.order import OrderScan
from floquid.pipeline import Analysis, Bootstrap
from floquid.surveys import Survey
from floquid.views import DampingUnit, SpeedUnit, check_damping_unit
from floquid.views import speed_unit as unit_of_speed

WIDTH = 100  # characters of a line of `summary()`


def text_of(
    result: Analysis | Bootstrap | OrderScan | FloquetModes | Survey | Comparison | Updated | Monitor,
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
    printed: dict[str, Callable[[Console, Any], object]] = {
        "analysis": partial(print_found, speed_unit=speed_unit, damping_unit=damping_unit),
        "bootstrap": print_drawn,
        "scan": print_orders,
        "modes": lambda console, modes: print_stability(console, modes, stability(modes)),
        "survey": print_survey,
        "comparison": print_comparison,
        "update": print_updated,
        "monitor": print_monitor,
    }
    printed[result.kind](console, result)
    return "\n".join(line.rstrip() for line in file.getvalue().strip("\n").splitlines())
