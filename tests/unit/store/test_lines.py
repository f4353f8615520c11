"""`result.h5` of transfer functions: every field comes back, and with them deviations at any frequency."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from tests.driven import lag, mathieu, shaken
from tests.unit.store.test_store import differences
from tests.unit.transfer.test_fit import of_equations

import floquid
from floquid import InputError, fit_transfer, load, measure_transfer, save
from floquid.inputs import Limits


@pytest.fixture(scope="module")
def measured():
    _, record, names = shaken(lag(), 20, 32, 4, 0.01, 0)
    return measure_transfer(record, inputs=names, harmonics=[-1, 0, 1])


@pytest.fixture(scope="module")
def fits(measured):
    """Of samples, a real multiplier with what rings at the begin; and of continuous time, a pair with a direct term."""
    told = replace(measured, findings=(*measured.findings, floquid.findings.warning("measured_transient", ratio=2.0)))
    given = of_equations(mathieu(direct=0.4), np.linspace(0.05, 0.8, 16), harmonics=np.arange(-1, 2))
    return fit_transfer(told, hold="first", limits=Limits(modes=1)), fit_transfer(
        given, period=np.pi, limits=Limits(modes=1)
    )


def test_every_field_comes_back(measured, fits, tmp_path):
    file = tmp_path / "g.h5"
    for found in (measured, *fits):
        save(found, file)
        assert list(differences(found, load(file))) == []
    assert fits[0].modal.modes[0].real
    assert len(fits[0].begins) == 1
    assert len(fits[1].modal.direct) > 0
    for found in fits:
        save(found, file)
        back = load(file)
        for sampled in {False, found.measured.step is not None}:
            one, other = (own.transfer([0.1, 0.2], [0, 1], sampled=sampled) for own in (found, back))
            assert np.array_equal(one.values, other.values)
            assert np.array_equal(one.std, other.std)


def test_the_page_of_the_room_names_each_dataset(measured, fits, tmp_path):
    names = []
    for found in (measured, *fits):
        save(found, tmp_path / "g.h5")
        with h5py.File(tmp_path / "g.h5") as file:
            file.visit(names.append)
    words = {word.strip(",;():") for word in floquid.store.__doc__.replace("/", " ").split()}
    inside = {part for name in names for part in name.split("/") if not part.startswith("mode")}
    assert inside - words == set()


def test_damage_is_refused_in_words(fits, tmp_path):
    save(fits[0], tmp_path / "g.h5")
    with h5py.File(tmp_path / "g.h5", "r+") as file:
        del file["fit/modes/mode1/shape"]
    with pytest.raises(InputError, match="damaged or not whole"):
        load(tmp_path / "g.h5")
