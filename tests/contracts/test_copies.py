"""What is pickled or copied comes back equal, of the same type and read-only: every public type, every intermediate."""

import copy
import functools
import importlib
import inspect
import pickle
import pkgutil
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import get_origin

import numpy as np
import pytest
from tests.driven import ambient_of, mathieu, record_of

import floquid
from floquid import InputError, _arrays, floquet, identify, monitor, read_shapes, survey, systems
from floquid._checks import Rebuilt
from floquid.comparison import Parameter, compare, update
from floquid.core import AzimuthSignal, Channel, ConstantPeriod, PulseTimes, Record, TachometerSignal
from floquid.fleets import Fleet
from floquid.large import LargeResult
from floquid.lti import MaximumLikelihood
from floquid.pipeline import Settings, bootstrap
from floquid.views import families, synchronisation

INNER = {"ModeParameters", "Table", "TimeAxis", "TimeColumn"}
"""Types with arrays that are shown for those who start a fit of their own, and are made in its inmost loop."""

WAYS = {
    "pickle": lambda one: pickle.loads(pickle.dumps(one)),
    "oldest pickle": lambda one: pickle.loads(pickle.dumps(one, protocol=2)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}


def record(periods=60, noise=0.01, seed=1):
    rotor = systems.JeffcottRotor(damping=0.02)
    return rotor.simulate(n_periods=periods, samples_per_period=12, noise=noise, seed=seed)


def with_tachometer():
    """A pulse a period in a channel of its own, an imbalance, and a rate that is no whole number a period."""
    whole = record(seed=2)
    times = np.arange(whole.n_samples) / whole.sample_rate
    # Edges of two samples: the angle is measured.
    pulses = 5.0 * np.clip(0.5 + 5.0 * (0.2 - np.abs((times / (2.0 * np.pi) + 0.46) % 1.0 - 0.5)), 0.0, 1.0)
    imbalance = 0.3 * np.abs(whole.values).max() * np.cos(times)
    return Record(
        values=np.vstack([whole.values + imbalance, pulses]),
        sample_rate=whole.sample_rate,
        channels=[*whole.channels, "tach"],
    )


def coloured():
    """Noise that remembers itself from sample to sample."""
    clean = record(periods=200, noise=0.0)
    noise = 0.02 * np.abs(clean.values).max() * np.random.default_rng(3).standard_normal(clean.values.shape)
    for sample in range(1, noise.shape[1]):
        noise[:, sample] += 0.8 * noise[:, sample - 1]
    return replace(clean, values=clean.values + noise)


@functools.cache
def analysis(name):
    if name == "lifted":
        return identify(record(), states=["X", "Y"])
    if name == "structure":
        return identify(record(), states=["X", "Y"], structure="auto", identifier=MaximumLikelihood())
    if name == "tachometer":
        return identify(with_tachometer(), tach="tach")
    if name == "coloured":
        return identify(coloured(), validate=False)
    return identify(record(noise=1e-3), order=2)


ANALYSES = {
    "lifted": ("state", "validation", "choice", "periodicity"),
    "structure": ("state", "refinement", "validation"),
    "tachometer": ("fit", "shafts", "records", "validation"),
    "coloured": ("lifted", "choice"),
    "failing": ("validation",),
}
"""Analyses by name, and what each must have for this to be a test of that."""


def of_the_oracle():
    """A known A(t), what is computed of it, and the systems that come with the package."""
    rotor = systems.JeffcottRotor(damping=0.02)
    sampled = floquet.SampledMatrix(values=np.diag([-0.1, -0.2])[:, :, None].repeat(8, axis=2), period=2.0)
    return {"rotor": rotor, "sampled": sampled, "modes": floquet.modes(sampled)}


def with_inputs():
    """A response to a force that goes on."""
    values, inputs = record_of(mathieu(), 30, 12, 0.02, 0)
    channels = ["y", Channel(name="F", unit="N")]
    driven = Record(values=np.concatenate([values, inputs]), sample_rate=12.0 / np.pi, channels=channels)
    return identify(driven, period=np.pi, inputs=["F"])


def at_load(found, load):
    return replace(found, model=replace(found.model, point={"load": load}))


def turning(values):
    """A rotor whose exponents do not depend on a mass."""
    return systems.JeffcottRotor(damping=values["damping"])


@functools.cache
def others():
    found = analysis("lifted")
    return {
        "settings": Settings(period=1.0, channels=("X",), identifier=MaximumLikelihood()),
        "azimuth": AzimuthSignal(channel="azimuth"),
        "tachometer signal": TachometerSignal(channel="tach"),
        "pulses": PulseTimes(times=np.arange(5.0)),
        "clock": ConstantPeriod(period=2.0, origin=0.5),
        "an orbit": replace(record(), orbit=np.ones((4, 12))),
        "bootstrap": bootstrap(replace(found, state=None), draws=20, workers=1),
        "synchronisation": synchronisation(found),
        "families": tuple(families(found)),
        "readings": read_shapes(found, pairs=["X:Y"], blades={"flap": ["X", "Y"]}, participation="X"),
        "survey": survey([at_load(found, load) for load in (1.0, 2.0, 3.0)], over="load"),
        "fleet": Fleet(
            out=Path("modes.parquet"), n_records=3, n_before=1, n_identified=2, n_passed=2, n_modes=5, lost=(("c", ""),)
        ),
        "large": LargeResult(
            path=Path("result.h5"),
            period=1.0,
            exponents=np.array([-0.1 + 1.0j]),
            exponent_std=np.array([0.01 + 0.01j]),
            covariance=1e-4 * np.eye(2),
            real=np.array([False]),
            noise=np.ones(2),
            channels=(Channel(name="x"), Channel(name="y")),
            phase=0.25,
            residue_spread=np.eye(2, dtype=complex),
            residue_slope=np.eye(2, dtype=complex),
            n_phases=8,
            n_cycles=300,
            sweeps=3,
            last_step=0.01,
        ),
        "comparison": compare(found, systems.JeffcottRotor(damping=0.02)),
        "parameter": Parameter(value=1.0, prior_std=0.1),
        "update": update(turning, found, {"damping": 0.02, "mass": 1.0}),
        "monitor": monitor([at_load(found, load) for load in (1.0, 2.0, 3.0)], baseline=slice(0, 2), over="load"),
        "driven": with_inputs(),
        "ambient": identify(
            Record(values=ambient_of(mathieu(), 50, 12, 0.02, 0), sample_rate=12.0 / np.pi, channels=["y"]),
            period=np.pi,
            excitation="ambient",
        ),
        **of_the_oracle(),
    }


def assert_same(one, other, path):
    """Equal to the last bit, of equal types, the arrays of the other read-only."""
    assert type(one) is type(other), path
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype, path
        assert np.array_equal(one, other, equal_nan=one.dtype.kind in "fc"), path
        assert not other.flags.writeable, path
        with pytest.raises(ValueError, match="read-only"):
            other[...] = 0
    elif is_dataclass(one):
        for field in fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name), f"{path}.{field.name}")
    elif isinstance(one, (tuple, list)):
        assert len(one) == len(other), path
        for number, (mine, yours) in enumerate(zip(one, other, strict=True)):
            assert_same(mine, yours, f"{path}[{number}]")
    elif isinstance(one, Mapping):
        assert list(one) == list(other), path
        for name in one:
            assert_same(one[name], other[name], f"{path}[{name}]")
    elif type(one).__eq__ is not object.__eq__:
        assert one == other or one != one, path


def parts(one):
    """Every object of this package that one holds, itself among them."""
    if is_dataclass(one) and type(one).__module__.startswith("floquid"):
        yield one
        for field in fields(one):
            yield from parts(getattr(one, field.name))
    elif isinstance(one, (tuple, list)):
        for part in one:
            yield from parts(part)
    elif isinstance(one, Mapping):
        yield from parts(tuple(one.values()))


EVERY_WAY = pytest.mark.parametrize("way", list(WAYS.values()), ids=list(WAYS))


@pytest.mark.parametrize("name", ["survey", "comparison", "update", "monitor"])
def test_what_is_found_of_several_records_comes_back_from_a_file(name, tmp_path):
    found = others()[name]
    floquid.save(found, tmp_path / "kept.h5")
    kept = floquid.load(tmp_path / "kept.h5")
    assert_same(found, kept, name)
    if name == "update":
        with pytest.raises(InputError, match="have a page, but holds parameters"):
            floquid.report(kept, tmp_path / "page.html")


@EVERY_WAY
@pytest.mark.parametrize("name", list(ANALYSES))
def test_an_analysis_comes_back(name, way):
    found = analysis(name)
    for part in ANALYSES[name]:
        assert getattr(found, part), part
    assert_same(found, way(found), name)


def test_the_analyses_are_of_the_kinds_that_there_are():
    assert len(analysis("tachometer").fit.forced.harmonics)
    assert analysis("failing").failed
    assert analysis("coloured").lifted.whitening is not None


@EVERY_WAY
def test_everything_else_comes_back(way):
    for name, one in others().items():
        assert_same(one, way(one), name)


def test_each_part_comes_back_alone():
    """An object of each type that is reached, without what holds it."""
    seen = {type(part): part for name in ANALYSES for part in parts(analysis(name))}
    seen |= {type(part): part for one in others().values() for part in parts(one)}
    for kind, one in seen.items():
        for name, way in WAYS.items():
            assert_same(one, way(one), f"{kind.__name__} by {name}")
    public = {getattr(floquid, name) for name in floquid.__all__}
    missed = {kind.__name__ for kind in public if inspect.isclass(kind) and is_dataclass(kind)} - {
        kind.__name__ for kind in seen
    }
    assert not missed


def test_a_copy_shares_nothing_that_could_be_written():
    """What a pickle holds is made for the copy alone, and is not copied once more."""
    values = np.arange(6.0).reshape(2, 3)
    values.flags.writeable = False
    one = Record(values=values, sample_rate=1.0, channels=["X", "Y"])
    assert one.values is values
    assert copy.copy(one).values is values
    deep = copy.deepcopy(one)
    assert not np.shares_memory(deep.values, values)
    assert deep.values.base is None


def test_every_public_type_with_arrays_is_rebuilt():
    rooms = [importlib.import_module(found.name) for found in pkgutil.iter_modules(floquid.__path__, "floquid.")]
    shown = [getattr(room, name) for room in rooms for name in getattr(room, "__all__", ())]
    kinds = {kind for kind in shown if inspect.isclass(kind) and is_dataclass(kind)}
    arrays = ("NDArray", *(name for name, kind in vars(_arrays).items() if get_origin(kind) is np.ndarray))
    assert len(arrays) > 5
    with_arrays = {kind for kind in kinds if any(name in str(f.type) for f in fields(kind) for name in arrays)}
    assert len(with_arrays) > 30
    assert {kind.__name__ for kind in with_arrays if not issubclass(kind, Rebuilt)} == INNER
