"""A periodic model as labelled arrays."""

import sys

import numpy as np
import pytest

from floquid import to_xarray
from floquid.core import Channel, PeriodicModel
from floquid.errors import InputError

NAMED = {
    "exponents": "1/s",
    "exponent_std": "1/s",
    "multipliers": "1",
    "multiplier_std": "1",
    "frequencies_hz": "Hz",
    "frequency_std_hz": "Hz",
    "damping_ratios": "1",
    "damping_ratio_std": "1",
}


def make_model(**changes):
    rng = np.random.default_rng(0)
    upper = rng.normal(size=(2, 3, 4)) + 1j * rng.normal(size=(2, 3, 4))
    upper = np.concatenate([upper, np.zeros((2, 3, 1))], axis=2)
    valid = {
        "exponents": [-0.1 + 2j, -0.1 - 2j],
        "coefficients": np.stack([upper, upper[..., ::-1].conj()]),
        "harmonics": [-3, -1, 0, 1, 3],
        "period": 0.7,
        "channels": [Channel(name="x", unit="mm", location="hub", direction="+X"), Channel(name="v", unit="m/s")],
        "covariance": np.diag([1.0, 4.0, 9.0, 16.0]),
        "coefficient_std": np.full((2, 2, 3, 5), 0.5 + 0.25j),
    }
    return PeriodicModel(**(valid | changes))


def test_every_number_is_where_its_labels_say():
    model = make_model()
    data = to_xarray(model)
    for name, unit in NAMED.items():
        assert data[name].dims == ("mode",)
        assert data[name].attrs["units"] == unit
        np.testing.assert_array_equal(data[name], getattr(model, name))
    assert data["coefficients"].dims == ("mode", "channel", "hit", "harmonic")
    assert data["coefficients"].sel(mode=2, channel="v", hit=3, harmonic=-1).item() == model.coefficients[1, 1, 2, 1]
    np.testing.assert_array_equal(data["coefficient_std"], model.coefficient_std)
    assert data["exponents"].dtype == data["coefficients"].dtype == np.complex128
    assert data["harmonic"].values.tolist() == [-3, -1, 0, 1, 3]
    assert data.attrs["period"] == 0.7
    assert data["unit"].sel(channel="v").item() == "m/s"
    assert data["direction"].sel(channel="x").item() == "+X"


def test_the_model_stays_as_it_is():
    model = make_model()
    data = to_xarray(model)
    data["exponents"][0] = data["coefficients"][0, 0, 0, 0] = 99.0
    assert model.exponents[0] == -0.1 + 2j
    assert model.coefficients[0, 0, 0, 0] != 99.0


def test_what_was_not_estimated_is_not_there():
    data = to_xarray(make_model(covariance=None, coefficient_std=None))
    assert set(data.data_vars) == {name for name in NAMED if "std" not in name} | {"coefficients"}


def test_a_library_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match=r'`to_xarray` .* xarray, .*\n  Install it: pip install "floquid'):
        to_xarray(make_model())
