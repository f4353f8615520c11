"""Files that other libraries write, over a hundred of over twenty kinds: read as those libraries read them."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import pytest
import scipy.io
from scipy.io import wavfile
from tests.unit.readers.test_h5 import gtsdf
from tests.unit.readers.test_mat import V73
from tests.unit.readers.test_openfast import as_published
from tests.unit.readers.test_recorders import comtrade, hawc2

from floquid.readers import read


class Content(NamedTuple):
    """What a file holds: values (channels, samples)."""

    names: list[str]
    units: list[str]
    rate: float
    values: np.ndarray


RECORDS = [
    Content(["x"], ["m"], 50.0, np.random.default_rng(0).standard_normal((1, 40))),
    Content(["acc 1", "acc 2"], ["m/s^2", "m/s^2"], 51200.0, np.random.default_rng(1).standard_normal((2, 300))),
    Content(["F", "x", "y"], ["N", "mm", "mm"], 12.5, 1e3 * np.random.default_rng(2).standard_normal((3, 77))),
    Content(list("abcdefgh"), ["V"] * 8, 44100.0, 1e-4 * np.random.default_rng(3).standard_normal((8, 1000))),
    Content(["tach", "tip"], ["V", "g"], 400.0, np.random.default_rng(4).standard_normal((2, 64))),
]  # fmt: skip
Kind = Callable[[Path, Content], tuple[Path, Content, dict]]
"""Writes what a record holds below a folder: the file, what its own library reads of it, and options of `read`."""

KINDS: dict[str, Kind] = {}


def kind(function: Kind) -> Kind:
    KINDS[function.__name__] = function
    return function


def times(r):
    return np.arange(r.values.shape[1]) / r.rate


def by_path(r):
    """Names of rows of a matrix in a file that has no others."""
    return [f"data[{row}]" for row in range(len(r.values))]


def bare(r, values):
    return Content(by_path(r) if len(values) > 1 else ["data"], ["-"] * len(values), r.rate, values)


def archive(folder, r, save):
    path = folder / "run.npz"
    save(path, values=r.values, sample_rate=r.rate, channels=r.names, units=r.units)
    with np.load(path) as f:
        return path, Content(f["channels"].tolist(), f["units"].tolist(), float(f["sample_rate"]), f["values"]), {}


@kind
def numpy_savez(folder, r):
    return archive(folder, r, np.savez)


@kind
def numpy_savez_compressed(folder, r):
    return archive(folder, r, np.savez_compressed)


@kind
def numpy_save(folder, r):
    path = folder / "run.npy"
    np.save(path, r.values.astype("f4"))
    return path, bare(r, np.load(path).astype(float)), {"rate": r.rate}


@kind
def numpy_save_of_records(folder, r):
    path = folder / "run.npy"
    np.save(path, np.rec.fromarrays([times(r), *r.values], names=["time", *r.names]))
    back = np.load(path)
    names = [name for name in back.dtype.names if name != "time"]
    return path, Content(names, ["-"] * len(names), r.rate, np.array([back[name] for name in names])), {}


def matlab(folder, r, **options):
    path = folder / "run.mat"
    texts = {key: np.array(words, object) for key, words in (("channels", r.names), ("units", r.units))}
    scipy.io.savemat(path, {"values": r.values, "sample_rate": r.rate, **texts}, **options)
    back = scipy.io.loadmat(path, simplify_cells=True)
    texts = [np.atleast_1d(back[key]).tolist() for key in ("channels", "units")]
    return path, Content(*texts, back["sample_rate"], np.atleast_2d(back["values"])), {}


@kind
def matlab_5(folder, r):
    return matlab(folder, r)


@kind
def matlab_5_packed(folder, r):
    return matlab(folder, r, do_compression=True)


@kind
def matlab_4(folder, r):
    path = folder / "run.mat"
    scipy.io.savemat(path, {"data": r.values, "fs": r.rate}, format="4")
    back = scipy.io.loadmat(path)
    return path, bare(r, back["data"])._replace(rate=float(back["fs"].item())), {"channels": ["data"]}


@kind
def matlab_struct_array(folder, r):
    path = folder / "run.mat"
    y = np.array([tuple(row) for row in zip(r.names, r.values, r.units, strict=True)], dtype="O,O,O")
    y.dtype.names = ("Name", "Data", "Unit")
    scipy.io.savemat(path, {"run": {"Y": y[None, :], "time": times(r), "n": 1.0}})
    back = np.atleast_1d(scipy.io.loadmat(path, squeeze_me=True)["run"]["Y"].item())
    found = Content(*([str(v) for v in back[key]] for key in ("Name", "Unit")), r.rate, np.array(list(back["Data"])))
    return path, found, {"channels": ["run/Y"] if len(back) > 1 else [found.names[0]]}


@kind
def matlab_73(folder, r):
    with V73(folder) as file:
        file.numbers("values", r.values)
        file.numbers("sample_rate", r.rate)
        file.cells("channels", *r.names)
        file.cells("units", *r.units)
    with h5py.File(file.path) as back:
        return file.path, Content(r.names, r.units, back["sample_rate"][0, 0], back["values"][()].T), {}


@kind
def hdf5(folder, r):
    path = folder / "run.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("run")
        group.attrs["SampleRate"] = r.rate
        for name, unit, row in zip(r.names, r.units, r.values, strict=True):
            group.create_dataset(name, data=row, compression="gzip").attrs["unit"] = unit
    with h5py.File(path) as file:
        rate, paths = file["run"].attrs["SampleRate"], [f"run/{name}" for name in r.names]
        found = Content(paths, [file[p].attrs["unit"] for p in paths], rate, np.array([file[p][()] for p in paths]))
    return path, found, {"channels": paths}


@kind
def hdf5_of_hawc2(folder, r):
    span = np.ptp(r.values, axis=1)
    raw = np.rint((r.values.T - r.values.min(axis=1)) / span * 60000).astype("u2")
    content = {"gains": span / 60000, "offsets": r.values.min(axis=1)}
    path = gtsdf(folder, (raw, content, {"time_step": 1 / r.rate}), names=r.names, units=r.units)
    with h5py.File(path) as back:
        block = back["block0000"]
        values = (block["data"][()] * block["gains"][()] + block["offsets"][()]).T
        rate = 1 / block.attrs["time_step"]
    return path, Content(r.names, r.units, rate, values), {}


@kind
def hdf5_packed_as_netcdf_does(folder, r):
    path, scale = folder / "run.h5", np.abs(r.values).max() / 30000
    with h5py.File(path, "w") as file:
        file["time"] = times(r)
        file["data"] = np.rint(r.values / scale).astype("i2")
        file["data"].attrs["scale_factor"] = scale
    with h5py.File(path) as file:
        found = bare(r, file["data"][()] * file["data"].attrs["scale_factor"])
    return path, found, {"channels": ["data"]}


def universal(folder, r, **options):
    pyuff = pytest.importorskip("pyuff")
    path = folder / "run.uff"
    for name, unit, row in zip(r.names, r.units, r.values, strict=True):
        sets = pyuff.prepare_58(
            func_type=1, rsp_node=0, rsp_dir=0, ref_node=0, ref_dir=0, data=row, x=times(r), id1=name,
            abscissa_spacing=1, abscissa_spec_data_type=17, ordinate_spec_data_type=1, orddenom_spec_data_type=0,
            ord_data_type=4, ordinate_axis_units_lab=unit, **options,
        )  # fmt: skip
        pyuff.UFF(str(path)).write_sets(sets, "add")
    back = pyuff.UFF(str(path)).read_sets()
    back = back if isinstance(back, list) else [back]
    rates = [float(f"{1 / s['abscissa_inc']:.5g}") for s in back]
    found = Content(
        [s["id1"] for s in back],
        [s["ordinate_axis_units_lab"] for s in back],
        rates[0],
        np.array([s["data"] for s in back]),
    )
    return path, found, {}


@kind
def universal_text(folder, r):
    return universal(folder, r, binary=0)


@kind
def universal_binary(folder, r):
    return universal(folder, r, binary=1)


@kind
def parquet_of_pandas(folder, r):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    path = folder / "run.parquet"
    labels = [f"{name} [{unit}]" for name, unit in zip(r.names, r.units, strict=True)]
    pandas.DataFrame(np.vstack([times(r), r.values]).T, columns=["time [s]", *labels]).to_parquet(path)
    back = pandas.read_parquet(path)
    return path, Content(r.names, r.units, r.rate, back[labels].to_numpy().T), {}


@kind
def parquet_with_dates(folder, r):
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = folder / "run.parquet"
    stamps = np.datetime64("2026-03-01", "ns") + np.rint(times(r) * 1e9).astype("m8[ns]")
    parquet.write_table(pa.table([stamps, *r.values], names=["when", *r.names]), path, compression="zstd")
    back = parquet.read_table(path)
    return path, Content(r.names, ["-"] * len(r.names), r.rate, np.array([back[n].to_numpy() for n in r.names])), {}


def labview(folder, r, waveform):
    nptdms = pytest.importorskip("nptdms")
    path = folder / "run.tdms"
    said = {"wf_increment": 1 / r.rate, "wf_start_offset": 0.0} if waveform else {}
    made = [
        nptdms.ChannelObject("g", name, row, said | {"unit_string": unit})
        for name, unit, row in zip(r.names, r.units, r.values, strict=True)
    ]
    if not waveform:
        stamps = np.datetime64("2026-03-01", "us") + np.rint(times(r) * 1e6).astype("m8[us]")
        made.append(nptdms.ChannelObject("g", "Timestamp", stamps, {}))
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(made)
    back = nptdms.TdmsFile.read(path)["g"].channels()[: len(r.names)]
    units = [channel.properties["unit_string"] for channel in back]
    return path, Content([c.name for c in back], units, r.rate, np.array([c[:] for c in back])), {}


@kind
def tdms(folder, r):
    return labview(folder, r, waveform=True)


@kind
def tdms_with_time_stamps(folder, r):
    return labview(folder, r, waveform=False)


def sound(folder, r, dtype, full):
    path = folder / "run.wav"
    peak = np.abs(r.values).max()
    wavfile.write(path, int(r.rate), (r.values.T / peak * (0.9 * full)).astype(dtype))
    rate, back = wavfile.read(path)
    values = np.atleast_2d(back.T.astype(float) / full)
    return (
        path,
        Content([f"ch{k}" for k in range(1, len(values) + 1)], ["FS" if full > 1 else "-"] * len(values), rate, values),
        {},
    )


@kind
def wav_of_16_bits(folder, r):
    return sound(folder, r, "i2", 2.0**15)


@kind
def wav_of_32_bits(folder, r):
    return sound(folder, r, "i4", 2.0**31)


@kind
def wav_of_fractions(folder, r):
    return sound(folder, r, "f4", 1)


def vehicle(folder, r, version):
    asammdf = pytest.importorskip("asammdf")
    path = folder / ("run.mf4" if version >= "4" else "run.mdf")
    with asammdf.MDF(version=version) as file:
        signals = zip(r.names, r.units, r.values, strict=True)
        file.append([asammdf.Signal(row, times(r), name=name, unit=unit) for name, unit, row in signals])
        file.save(path)
    with asammdf.MDF(path) as file:
        back = [file.get(name) for name in r.names]
    return (
        path,
        Content([s.name for s in back], [s.unit for s in back], r.rate, np.array([s.samples for s in back])),
        {},
    )


@kind
def mdf_3(folder, r):
    return vehicle(folder, r, "3.30")


@kind
def mdf_4(folder, r):
    return vehicle(folder, r, "4.10")


def relay(folder, r, form, **options):
    library = pytest.importorskip("comtrade")
    del r  # the record of those tests
    path = comtrade(folder, form, names=("IA", "UB"), **options)
    back = library.Comtrade(use_double_precision=True).load(str(path))
    units = [channel.uu for channel in back.cfg.analog_channels]
    return path, Content(back.analog_channel_ids, units, back.cfg.sample_rates[0][0], np.array(back.analog)), {}


@kind
def comtrade_text(folder, r):
    return relay(folder, r, "ASCII", rates=((r.rate, 60),))


@kind
def comtrade_binary(folder, r):
    return relay(folder, r, "BINARY", rates=((r.rate, 60),))


@kind
def comtrade_fractions_in_one_file(folder, r):
    return relay(folder, r, "FLOAT32", rates=((r.rate, 60),), cff=True)


@kind
def openfast_text(folder, r):
    pandas = pytest.importorskip("pandas")
    path = folder / "run.out"
    names = [name.replace(" ", "") for name in r.names]
    head = f"A run\n\nTime {' '.join(names)}\n(s) {' '.join(f'({unit})' for unit in r.units)}"
    np.savetxt(path, np.vstack([times(r), r.values]).T, header=head, comments="", fmt="%.15e")
    back = pandas.read_csv(path, sep=r"\s+", skiprows=[0, 1, 3])
    return path, Content(list(back.columns[1:]), r.units, r.rate, back.to_numpy()[:, 1:].T), {}


@kind
def openfast_binary(folder, r):
    path = folder / "run.outb"
    words = [word.encode().ljust(10) for word in ("Time", *r.names, "(s)", *(f"({unit})" for unit in r.units))]
    head = np.array([2], "<i2").tobytes() + np.array(r.values.shape, "<i4").tobytes()
    scale = 30000 / np.abs(r.values).max(axis=1)
    head += np.array([0.0, np.float32(1 / r.rate)], "<f8").tobytes()
    head += np.concatenate([scale, 0 * scale]).astype("<f4").tobytes() + bytes(4) + b"".join(words)
    path.write_bytes(head + np.rint(r.values.T * scale).astype("<i2").tobytes())
    names, units, _, table = as_published(path.read_bytes())
    return path, Content(names[1:], [unit.strip("()") for unit in units[1:]], r.rate, table[:, 1:].T), {}


@kind
def hawc2_binary(folder, r):
    del r  # the record of those tests
    path, table = hawc2(folder)
    return path, Content(["bea1 angle", "bea1 angle_2"], ["rad", "-"], 50.0, table[1:]), {}


@kind
def csv_of_pandas(folder, r):
    pandas = pytest.importorskip("pandas")
    path = folder / "run.csv"
    labels = [f"{name} [{unit}]" for name, unit in zip(r.names, r.units, strict=True)]
    pandas.DataFrame(np.vstack([times(r), r.values]).T, columns=["time [s]", *labels]).to_csv(path, index=False)
    return path, Content(r.names, r.units, r.rate, pandas.read_csv(path)[labels].to_numpy().T), {}


def test_there_are_files_enough():
    assert len(KINDS) >= 20
    assert len(KINDS) * len(RECORDS) >= 100


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # of pyuff, where it writes bytes
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("record", RECORDS, ids=lambda record: f"{len(record.names)} of {record.rate:g} Hz")
def test_read_as_by_its_own_library(name, record, tmp_path, capsys):
    path, expected, options = KINDS[name](tmp_path, record)
    found = read(path, **options)
    assert [channel.name for channel in found.channels] == expected.names
    assert [channel.unit for channel in found.channels] == expected.units
    assert found.sample_rate == pytest.approx(expected.rate, rel=1e-12)
    assert found.values.shape == expected.values.shape
    scale = np.abs(expected.values).max()
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-12, atol=1e-12 * scale)
