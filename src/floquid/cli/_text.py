"""A result as the text of the terminal, for `summary()`."""

from __future__ import annotations

from io import StringIO

from floquid.cli._bootstrap import print_drawn
from floquid.cli._driven import print_excited
from floquid.cli._floquet_output import print_stability
from floquid.cli._scan import print_orders
from floquid.cli._terminal import plain, print_found, print_warnings
from floquid.floquet import FloquetModes, stability
from floquid.order import OrderScan
from floquid.pipeline import Analysis, Bootstrap, ExcitedAnalysis

WIDTH = 100


def text_of(result: Analysis | ExcitedAnalysis | Bootstrap | OrderScan | FloquetModes) -> str:
    """The tables and the verdict of a result that the command line prints, without colours, and with Python's names."""
    file = StringIO()
    console = plain(file, WIDTH)
    match result:
        case Analysis():
            print_found(console, result)
            print_warnings(console, result.warnings)
        case ExcitedAnalysis():
            print_excited(console, result)
        case Bootstrap():
            print_drawn(console, result)
        case OrderScan():
            print_orders(console, result)
        case FloquetModes():
            print_stability(console, result, stability(result))
    return "\n".join(line.rstrip() for line in file.getvalue().strip("\n").splitlines())
