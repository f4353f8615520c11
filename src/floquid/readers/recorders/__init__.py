"""Files of recorders and of acquisition systems."""

from floquid.readers.recorders._mdf import SAMPLES, load_comtrade, load_mdf
from floquid.readers.recorders._tdms import load_tdms
from floquid.readers.recorders._wav import load_wav

__all__ = ["SAMPLES", "load_comtrade", "load_mdf", "load_tdms", "load_wav"]
