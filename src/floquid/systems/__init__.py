"""Example systems whose exponents, responses and state matrices are known."""

from floquid.systems._jeffcott import JeffcottRotor
from floquid.systems._run import Run

SYSTEMS: dict[str, type[JeffcottRotor]] = {"jeffcott": JeffcottRotor}
"""The example systems by the names that the command line uses."""

__all__ = ["SYSTEMS", "JeffcottRotor", "Run"]
