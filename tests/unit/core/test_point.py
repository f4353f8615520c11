"""The operating point: kept by whatever is made of a record, and had from the clock where no record states it."""

import copy
import pickle

import numpy as np
import pytest

import floquid as fq
from floquid.core import common_point

POINT = {"speed_rpm": 742.0, "temperature": 21.3}


@pytest.fixture
def record():
    values = np.random.default_rng(0).standard_normal((2, 50))
    return fq.Record(values=values, sample_rate=10.0, channels=["x", "y"], point=POINT)


def test_what_is_derived_of_a_record_keeps_its_point(record):
    clock = fq.ConstantPeriod(period=1.0)
    for made in (record.select(["y"]), record.with_clock(clock), pickle.loads(pickle.dumps(record)), copy.copy(record)):
        assert made.point == POINT
    assert record.with_point({"speed_rpm": 750.0}).point == {"speed_rpm": 750.0, "temperature": 21.3}
    with pytest.raises(TypeError):
        record.point["speed_rpm"] = 1.0


@pytest.mark.parametrize("point", [{"speed": np.nan}, {"speed": "fast"}, {"a/b": 1.0}, {"": 1.0}, [1.0]])
def test_a_point_is_finite_numbers_by_name(record, point):
    with pytest.raises(fq.InputError, match="point"):
        record.with_point(point)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat", ".csv"])
def test_files_hold_the_point(record, tmp_path, suffix):
    fq.write(record, tmp_path / f"r{suffix}")
    assert fq.read(tmp_path / f"r{suffix}").point == POINT


def test_objects_hold_the_point(record):
    assert fq.from_pandas(fq.to_pandas(record)).point == POINT
    assert fq.from_xarray(fq.to_xarray(record)).point == POINT
    assert fq.from_sep005(fq.to_sep005(record)).point == POINT


def test_numbers_beside_named_variables_are_the_point(tmp_path):
    """A rate, a step and a scale are none, nor is what is no number or not finite."""
    beside = {"fs": 100.0, "rpm": 700.0, "n_blades": 3, "gain": 1.0, "lost": np.nan, "who": "me"}
    np.savez(tmp_path / "r.npz", acc=np.ones(100), **beside)
    assert fq.read(tmp_path / "r.npz", channels=["acc"]).point == {"rpm": 700.0, "n_blades": 3.0}


def test_records_identified_together_have_the_mean_of_what_all_state():
    assert common_point([{"a": 1.0, "b": 2.0}, {"a": 3.0}]) == {"a": 2.0}
    assert common_point([]) == {}
