"""Time series that OpenFAST writes: text (.out) and binary (.outb)."""

from floquid.readers.openfast._out import load_out
from floquid.readers.openfast._outb import load_outb

__all__ = ["load_out", "load_outb"]
