"""`result.h5` of records whose excitation goes on: every field comes back, deviations and transfer functions too."""

from dataclasses import fields, replace

import h5py
import numpy as np
import pytest
from tests.driven import ambient_of, flapping, mathieu, record_of
from tests.unit.store.test_store import differences

import floquid
from floquid import load, save
from floquid.core import Channel, Record
from floquid.errors import InputError

PHASES = 20


def record(values, inputs, period, first):
    channels = [first, *(f"y{k}" for k in range(1, len(values))), *(f"u{k}" for k in range(len(inputs)))]
    whole = np.vstack([values, inputs])
    return Record(values=whole, sample_rate=PHASES / period, channels=channels, start=0.3, point={"unit": 7.0})


@pytest.fixture(scope="module")
def driven():
    """Two records, a direct term, a pair; and two real negative multipliers."""
    system, blade = mathieu(direct=0.2), flapping()
    first = Channel(name="y µ", unit="mm", location="disc")
    both = [
        record(*record_of(system, periods, PHASES, 0.02, seed), system.period, first)
        for periods, seed in ((30, 1), (25, 2))
    ]
    one = record(*record_of(blade, 30, PHASES, 0.01, 3), blade.period, "flap")
    return (
        floquid.identify(both, period=system.period, inputs=["u0"], states=["y µ"], system_times=7),
        floquid.identify(one, period=blade.period, inputs=["u0"], validate=False),
    )


@pytest.fixture(scope="module")
def ambient():
    system = mathieu()
    values = ambient_of(system, 150, PHASES, 0.02, 1)
    return floquid.identify(
        record(values, np.zeros((0, values.shape[1])), system.period, "y"),
        period=system.period,
        states=["y"],
        system_times=7,
        excitation="ambient",
    )


def again(analysis, folder):
    save(analysis, folder / "result.h5")
    return load(folder / "result.h5")


def test_every_field_of_a_driven_analysis_comes_back(driven, tmp_path):
    for found in driven:
        back = again(found, tmp_path)
        assert back.point == found.point == {"unit": 7.0, "speed_rpm": 60.0 / found.model.period}
        assert list(differences(found, back)) == []
        assert np.array_equal(found.transfer([0.1, 0.2]).std, back.transfer([0.1, 0.2]).std)
    assert driven[0].fit.at.direct != ()
    assert driven[0].state.inputs_std.shape == (7, 2, 1)
    assert driven[1].fit.at.modes[0].real
    assert driven[0].model.inputs.channels[0].name == "u0"


def test_every_field_of_an_ambient_analysis_comes_back(ambient, tmp_path):
    back = again(ambient, tmp_path)
    assert back.state.system_std.shape == (7, 2, 2)
    assert list(differences(ambient, back)) == []
    assert np.array_equal(ambient.fit.parameters, back.fit.parameters)


def test_the_comparison_sees_every_field(driven, ambient):
    for found, other in ((driven[0], driven[1]), (ambient, driven[0])):
        assert list(differences(found, other)) != []
    own = driven[0].model
    changed = replace(driven[0], model=replace(own, inputs=replace(own.inputs, initial=2.0 * own.inputs.initial)))
    assert list(differences(driven[0], changed)) == ["analysis.model.inputs.initial"]


def test_the_same_analysis_gives_the_same_bytes(driven, tmp_path):
    save(driven[0], tmp_path / "one.h5")
    save(load(tmp_path / "one.h5"), tmp_path / "two.h5")
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


def test_the_page_of_the_room_names_each_dataset(driven, ambient, tmp_path):
    names = []
    for found in (driven[0], ambient):
        save(found, tmp_path / "r.h5")
        with h5py.File(tmp_path / "r.h5") as file:
            assert "driven" in file
            file.visit(names.append)
    words = {word.strip(",;():") for word in floquid.store.__doc__.replace("/", " ").split()}
    inside = {part for name in names for part in name.split("/")}
    unnumbered = {name for name in inside if not name.startswith(("mode", "hit"))}
    assert unnumbered - words - {field.name for field in fields(floquid.Settings)} == set()


@pytest.mark.parametrize("name", ["driven/modes/mode1", "driven/direct", "model/inputs/direct", "driven"])
def test_a_damaged_file_is_refused_in_words(driven, tmp_path, name):
    save(driven[0], tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        del file[name]
    with pytest.raises(InputError, match="damaged or not whole"):
        load(tmp_path / "r.h5")


def test_a_kind_of_the_future_is_refused(driven, tmp_path):
    save(driven[0], tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        file.attrs["kind"] = "telepathic"
    with pytest.raises(InputError, match="telepathic"):
        load(tmp_path / "r.h5")


def test_files_from_before_there_were_points_and_places_are_read(driven, tmp_path):
    save(driven[0], tmp_path / "result.h5")
    with h5py.File(tmp_path / "result.h5", "a") as file:
        names = []
        file.visit(names.append)
        for name in sorted(names, reverse=True):
            if name.split("/")[-1] in ("point", "place"):
                del file[name]
    back = load(tmp_path / "result.h5")
    assert back.point == back.records[0].point == {}
    assert back.model.channels == driven[0].model.channels
