"""Output files of simulators of wind turbines."""

from floquid.readers.simulators._hawc2 import load_sel
from floquid.readers.simulators._openfast import load_out, load_outb

__all__ = ["load_out", "load_outb", "load_sel"]
