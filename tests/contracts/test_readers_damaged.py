"""Files that libraries read for us: cut short, empty, of another kind or of random bytes they end in one message."""

from pathlib import Path

import numpy as np
import pytest
from tests.foreign import save

from floquid import store
from floquid.core import ConstantPeriod, Record
from floquid.errors import InputError
from floquid.floquet import read_matrix
from floquid.readers import read

RESULT = Path(__file__).parents[1] / "store" / "files" / "result_v1.h5"
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


@pytest.mark.parametrize("call", [store.load, read_matrix])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.1, 0.5, 0.9, 0.999])
def test_of_a_result(call, share, tmp_path):
    data = RESULT.read_bytes()
    refused(tmp_path / "result.h5", data[: int(share * len(data))], call)
