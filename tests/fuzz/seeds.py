"""Whole files, small, to begin from: what floquid writes, what other programs write, and the bad files of the tests."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tests.contracts.test_readers_bad_input import CSV
from tests.foreign import save
from tests.unit.floquet.files.test_read_openfast import Rotor, even, lin_text
from tests.unit.floquet.files.test_read_openfast import matrices as lin_matrices
from tests.unit.readers import test_uff as uff

from floquid.core import Channel, ConstantPeriod, Record

_GENERATOR = np.random.default_rng(0)
_VALUES = np.round(_GENERATOR.standard_normal((2, 30)), 3)


def small_records() -> list[Record]:
    """Records that between them have all that a record may have."""
    gaps = _VALUES.copy()
    gaps[1, 4] = np.nan
    channels = [Channel(name="x", unit="mm", location="disc", direction="+x"), Channel(name="tacho", unit="V")]
    clock = ConstantPeriod(period=0.12, origin=0.01)
    return [
        Record(values=_VALUES, sample_rate=100.0, channels=["x", "y"]),
        Record(values=gaps, sample_rate=2533.3333, channels=channels, clock=clock, start=-0.25),
        Record(values=_VALUES[:1], sample_rate=10.0, channels=["x"], orbit=np.ones((1, 4))),
    ]


def records(suffix: str) -> list[bytes]:
    """Files of records of one format."""
    with tempfile.TemporaryDirectory() as folder:
        own = [_written(lambda path, one=one: save(one, path), Path(folder), suffix) for one in small_records()]
        return own + [_written(make, Path(folder), suffix) for make in _OTHERS.get(suffix, ())] + _bad(suffix)


def _written(make: Callable[[Path], object], folder: Path, suffix: str) -> bytes:
    path = folder / f"run{suffix}"
    path.unlink(missing_ok=True)
    make(path)
    return path.read_bytes()


def _bad(suffix: str) -> list[bytes]:
    tables = {".csv": CSV}
    return [row[0] for row in tables.get(suffix, {}).values() if row[0]]


def _uff_sets(path: Path) -> None:
    path.write_bytes(
        uff.text_set(151, *["title"] * 7)
        + uff.function(binary=False)
        + uff.function(binary=False, data_type=2, even=0, times=np.arange(30) / 100)
        + uff.function(order=2, direction=2)
    )


def _uff_uneven(path: Path) -> None:
    path.write_bytes(uff.function(even=0, times=np.arange(30) / 100, data_type=2))


_OTHERS: dict[str, tuple[Callable[[Path], object], ...]] = {
    ".uff": (_uff_sets, _uff_uneven),
    ".csv": (
        lambda path: path.write_text("time;x [mm];y\n0,0;1,5;2\n0,1;;3\n0,2;2,5;4\n", encoding="utf-8"),
        lambda path: path.write_text('"t [ms]"\t"x"\n0\t1\n1\t2\n2\t3\n', encoding="utf-8"),
        lambda path: path.write_text("X,x,Start,Increment,\nSequence,Volt,0,2e-2\n0,1.5,\n1,2.5,\n2,3,\n"),
        lambda path: path.write_text("# fs = 50\n# time x [mm]\n0.00  1.5\n0.02  1.7\n0.04  1.1\n0.05  \n"),
        lambda path: path.write_text("when;x\n2024-05-01 12:00:00,02;1,5\n2024-05-01 12:00:00,04+02:00;1\n"),
        lambda path: path.write_text("LabVIEW\t\nDelta_X\t0.02\t0.02\nX_Value\tx\tComment\n\t1\n\t2\n", "utf-16"),
        lambda path: path.write_bytes(b"\xef\xbb\xbftime,x\r\n0,1\r\n1,nan\r\n2,3\r\n"),
    ),
}


def matrices() -> list[bytes]:
    """A(t) in JSON, in every layout that it is read from."""
    A = np.round(np.random.default_rng(1).standard_normal((2, 2, 5)), 2)
    names = ["x", "v"]
    sampled: dict[str, Any] = {"A": A.tolist(), "period": 1.7, "states": names}
    times = (np.arange(5) / 3).tolist()
    series = np.stack([A[..., :3], 0.0 * A[..., :3]], -1).tolist()
    system = {"values": np.moveaxis(A, -1, 0).tolist(), "times": [0.0, 0.1, 0.2, 0.3, 0.4], "states": names}
    contents = (
        sampled,
        sampled | {"times": times},
        {"A": A.tolist(), "period": 1.7, "edges": times},
        {"coefficients": series, "harmonics": [-1, 0, 1], "period": 1.7},
        {"format": "floquid-summary", "system": system, "period": 0.5},
    )
    return [json.dumps(content).encode() for content in contents]


def lin() -> list[bytes]:
    """Linearisations of a rotor at four azimuths, and of other versions."""
    turn = [Rotor().text(psi).encode() for psi in even(4)]
    return [*turn, lin_text(0.1, **lin_matrices(), version=8.16, rates=False).encode()]


def settings() -> list[bytes]:
    """Settings files with every choice that there is."""
    return [
        b'period = 0.02\nchannels = ["x", "y"]\norder = 4\nharmonics = 3\nrate = 100.0\nidentifier = "ami-ml"\n',
        b'states = ["x", "y"]\nstructure = "auto"\nform = "second-order"\nsystem_times = 40\norigin = 0.5\n',
        b'tach = "t"\npulses_per_revolution = 2\nforced = true\nskip = 1\nestimate_period = true\n',
        b"mode_false_alarm = 1e-6\nharmonic_false_alarm = 1e-3\nnoise_floor = 1e-9\noutput_error = true\n",
    ]
