"""Whole files, small, to begin from: what floquid writes, what other programs write, and the bad files of the tests."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
from tests.contracts.test_readers_bad_input import CSV, NPZ
from tests.unit import test_readers_mat as mat
from tests.unit import test_readers_uff as uff
from tests.unit.test_openfast import Rotor, even, lin_text
from tests.unit.test_openfast import matrices as lin_matrices

from floquid.core import Channel, ConstantPeriod, Record
from floquid.readers import write

RESULT = Path(__file__).parents[1] / "store" / "files" / "result_v1.h5"

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
        own = [_written(lambda path, one=one: write(one, path), Path(folder), suffix) for one in small_records()]
        return own + [_written(make, Path(folder), suffix) for make in _OTHERS.get(suffix, ())] + _bad(suffix)


def _written(make: Callable[[Path], object], folder: Path, suffix: str) -> bytes:
    path = folder / f"run{suffix}"
    path.unlink(missing_ok=True)
    make(path)
    return path.read_bytes()


def _bad(suffix: str) -> list[bytes]:
    tables = {".csv": CSV, ".npz": NPZ}
    return [row[0] for row in tables.get(suffix, {}).values() if row[0]]


def _plain_mat(path: Path) -> None:
    run = {"a": np.arange(20.0), "b": np.arange(20), "time": np.arange(20) / 10, "s": {"c": "text", "z": 1 + 2j}}
    names = np.array(["x", "ÿ"], dtype=object)
    content = {"values": _VALUES, "sample_rate": 12.5, "channels": names, "run": run, "data": _VALUES.T}
    scipy.io.savemat(path, content, do_compression=False)


def _paths_mat(path: Path) -> None:
    run = {"a": np.arange(20.0), "b": np.arange(20), "time": np.arange(20) / 10}
    content = {
        "run": run,
        "data": _VALUES.T.astype("f4"),
        "time": np.arange(30) / 10,
        "c": np.array([["a", 1]], object),
    }
    scipy.io.savemat(path, content, do_compression=False)


def _other_order(path: Path) -> None:
    variables = [mat.doubles(_VALUES, "values", ">"), mat.doubles([[12.5]], "sample_rate", ">")]
    names = mat.array(mat.CELL, (1, 2), "channels", mat.text("x", order=">"), mat.text("y", order=">"), order=">")
    path.write_bytes(mat.raw(path.parent, *variables, names, order=">").read_bytes())


def _version_73(path: Path) -> None:
    path.write_bytes(mat.v73(path.parent).read_bytes())


def _plain_h5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["values"], file["sample_rate"], file["channels"] = _VALUES, 100.0, ["x", "y"]
        file["values"].attrs["unit"] = "m"


def _paths_h5(path: Path) -> None:
    with h5py.File(path, "w", libver="latest") as file:
        file["run/a"], file["run/b"], file["run/time"] = np.arange(20.0), np.arange(20), np.arange(20) / 10
        file["run/a"].attrs["units"] = "mm"
        file.create_dataset("data", data=_VALUES.T, chunks=(7, 2), compression="gzip", shuffle=True)
        file["loop"], file["soft"] = file["/"], h5py.SoftLink("/run/a")


def _lzf_h5(path: Path) -> None:
    with h5py.File(path, "w", libver="earliest") as file:
        file.create_dataset("data", data=_VALUES.T.astype("f4"), chunks=(8, 2), compression="lzf", fletcher32=True)
        file.create_dataset("run/a", data=np.arange(20.0), maxshape=(None,))
        file["run/b"] = np.arange(20).astype(">i2")


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
    ".mat": (_plain_mat, _paths_mat, _other_order, _version_73),
    ".h5": (_plain_h5, _paths_h5, _lzf_h5),
    ".uff": (_uff_sets, _uff_uneven),
    ".csv": (
        lambda path: path.write_text("time;x [mm];y\n0,0;1,5;2\n0,1;;3\n0,2;2,5;4\n", encoding="utf-8"),
        lambda path: path.write_text('"t [ms]"\t"x"\n0\t1\n1\t2\n2\t3\n', encoding="utf-8"),
        lambda path: path.write_bytes(b"\xef\xbb\xbftime,x\r\n0,1\r\n1,nan\r\n2,3\r\n"),
    ),
}


def results() -> list[bytes]:
    """A result of every kind, and the same unpacked, so that a changed byte is seen by no checksum."""
    return [RESULT.read_bytes(), unpacked(RESULT.read_bytes())]


def unpacked(data: bytes) -> bytes:
    """The same HDF5 file without compression and checksums."""
    stream = io.BytesIO()
    with h5py.File(io.BytesIO(data)) as old, h5py.File(stream, "w", libver="earliest") as new:
        new.attrs.update(old.attrs)

        def copied(name: str, thing: Any) -> None:
            if isinstance(thing, h5py.Group):
                new.require_group(name)
            elif thing.shape is None:
                new.create_dataset(name, data=h5py.Empty(thing.dtype))
            else:
                new.create_dataset(name, data=thing[()], dtype=thing.dtype)

        old.visititems(copied)
    return stream.getvalue()


def matrices() -> list[bytes]:
    """A(t) in every format that it is read from."""
    A = np.round(np.random.default_rng(1).standard_normal((2, 2, 5)), 2)
    names = ["x", "v"]
    sampled: dict[str, Any] = {"A": A, "period": 1.7, "states": names}
    timed = sampled | {"times": np.arange(5) / 3}
    pieces = {"A": A, "period": 1.7, "edges": np.arange(5) / 3}
    series = {"coefficients": A[..., :3] + 0j, "harmonics": [-1, 0, 1], "period": 1.7}
    found: list[bytes] = []
    for content in (sampled, timed, pieces, series):
        stream = io.BytesIO()
        np.savez(stream, **content)
        found.append(stream.getvalue())
        stream = io.BytesIO()
        cells = {key: np.array(value, dtype=object) if key == "states" else value for key, value in content.items()}
        scipy.io.savemat(stream, cells, do_compression=content is timed)
        found.append(stream.getvalue())
        stream = io.BytesIO()
        with h5py.File(stream, "w") as file:
            for key, value in content.items():
                file[key] = value
        found.append(stream.getvalue())
        pairs = {
            key: np.stack([value.real, value.imag], -1) if np.iscomplexobj(value) else value
            for key, value in content.items()
        }
        found.append(json.dumps({key: np.asarray(value).tolist() for key, value in pairs.items()}).encode())
    system = {"values": np.moveaxis(A, -1, 0).tolist(), "times": [0.0, 0.1, 0.2, 0.3, 0.4], "states": names}
    found.append(json.dumps({"format": "floquid-summary", "system": system, "period": 0.5}).encode())
    return [*found, unpacked(RESULT.read_bytes())]


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
