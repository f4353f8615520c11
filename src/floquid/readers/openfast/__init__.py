"""Time series that OpenFAST writes: text (.out) and binary (.outb)."""

from floquid.readers.openfast._common import rate_of_step
from floquid.readers.openfast._out import load_out, save_out
from floquid.readers.openfast._outb import load_outb, save_outb

__all__ = ["load_out", "load_outb", "rate_of_step", "save_out", "save_outb"]
