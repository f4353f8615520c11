"""Files of formats that floquid only reads, as other programs write them."""

import struct

import numpy as np
from scipy.io import wavfile

from floquid.readers import write


def save_out(record, path):
    """Text output of OpenFAST, with all digits."""
    names = "\t".join(["Time", *(channel.name for channel in record.channels)])
    units = "\t".join(["(s)", *(f"({channel.unit})" for channel in record.channels)])
    rows = ["\t".join(map(repr, row)) for row in np.vstack([record.times, record.values]).T.tolist()]
    path.write_text("\n".join(["", "Predictions were made", "", "", "A turbine", "", names, units, *rows]) + "\n")


def save_outb(record, path):
    """Binary output of OpenFAST, not packed."""
    words = ["Time", *(c.name for c in record.channels), "(s)", *(f"({c.unit})" for c in record.channels)]
    head = struct.pack("<hiiddi", 3, record.n_channels, record.n_samples, record.start, 1.0 / record.sample_rate, 0)
    names = "".join(word[:10].ljust(10) for word in words).encode()
    path.write_bytes(head + names + record.values.T.astype("<f8").tobytes())


def save_tdms(record, path):
    """One group of waveforms."""
    import nptdms

    said = {"wf_increment": 1.0 / record.sample_rate, "wf_start_offset": record.start}
    signals = zip(record.channels, record.values, strict=True)
    with path.open("wb") as stream, nptdms.TdmsWriter(stream) as writer:
        writer.write_segment([nptdms.ChannelObject("g", channel.name, row, said) for channel, row in signals])


def save_wav(record, path):
    """Floating-point numbers."""
    wavfile.write(path, round(record.sample_rate), np.ascontiguousarray(record.values.T))


SAVE = {".out": save_out, ".outb": save_outb, ".tdms": save_tdms, ".wav": save_wav}


def save(record, path):
    """Write a record in any format."""
    SAVE.get(path.suffix, write)(record, path)
