"""Files that libraries read for us: cut short, empty, of another kind or of random bytes they end in one message."""

import numpy as np
import pytest
from tests.foreign import save

from floquid import store
from floquid.core import ConstantPeriod, Record
from floquid.errors import InputError
from floquid.floquet import read_matrix
from floquid.pipeline import identify
from floquid.readers import read
from floquid.systems import JeffcottRotor

NEEDS = {".tdms": "nptdms", ".parquet": "pyarrow"}
FORMATS = [".npz", ".mat", ".h5", ".wav", ".tdms", ".parquet"]


def whole(suffix, folder):
    pytest.importorskip(NEEDS.get(suffix, "numpy"))
    values = np.random.default_rng(0).standard_normal((2, 60))
    clock = ConstantPeriod(period=0.5)
    path = folder / f"run{suffix}"
    save(Record(values=values, sample_rate=12.5, channels=["x", "y"], clock=clock), path)
    return path


def refused(path, data, call=read):
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        call(path)
    assert str(path) in str(caught.value)
    assert "\n  " in str(caught.value), "it says what to do"


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("share", [0.01, 0.1, 0.3, 0.5, 0.9, 0.99])
def test_cut_short(suffix, share, tmp_path):
    path = whole(suffix, tmp_path)
    data = path.read_bytes()
    refused(path, data[: int(share * len(data))])


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize(
    "data",
    [b"", b"time,x\n0,1\n1,2\n" * 40, b"PK\3\4" + bytes(400), np.random.default_rng(1).bytes(4000), bytes(4000)],
    ids=["empty", "text", "archive", "random bytes", "zeros"],
)
def test_of_another_kind(suffix, data, tmp_path):
    refused(whole(suffix, tmp_path), data)


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
@pytest.mark.parametrize(
    "data", [b"", b"text\n" * 100, np.random.default_rng(1).bytes(4000)], ids=["", "text", "bytes"]
)
def test_of_a_matrix(suffix, data, tmp_path):
    refused(tmp_path / f"A{suffix}", data, read_matrix)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A result file's bytes."""
    path = tmp_path_factory.mktemp("result") / "result.h5"
    record = JeffcottRotor().simulate(n_periods=30, samples_per_period=8, noise=0.01)
    store.save(identify(record, order=4, validate=False), path)
    return path.read_bytes()


@pytest.mark.parametrize("call", [store.load, read_matrix])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.1, 0.5, 0.9, 0.999])
def test_of_a_result(call, share, result, tmp_path):
    refused(tmp_path / "result.h5", result[: int(share * len(result))], call)
