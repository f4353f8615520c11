"""Spectra of modulated outputs, and operational modal analysis of them."""

import numpy as np
import pytest
from tests.driven import ambient_of, mathieu

from floquid import ConstantPeriod, IdentificationError, InputError, Record, identify, plot
from floquid.innovations import h_oma, harmonic_spectra
from floquid.inputs import samples_of
from floquid.lti import LSCF
from floquid.testing import pair_exponents

SYSTEM, PHASES = mathieu(), 15  # odd: lags of whole periods are odd, too


def samples(values, starts=(0.0,), period=SYSTEM.period, phases=PHASES):
    none = [np.zeros((0, own.shape[1])) for own in values]
    return samples_of(values, none, starts, step=period / phases, fundamental=2.0 * np.pi / period)


@pytest.fixture(scope="module")
def values():
    return ambient_of(SYSTEM, 3000, PHASES, 0.02, 0)


def test_noise_whose_size_turns_has_the_spectra_of_its_equation():
    """y = s (1 + a sin ωt) e: S_mm = s² h (1 + a²/2), S_{m+1,m} = -i a s² h, S_{m+2,m} = -a² s² h/4, by hand."""
    size, a, start = 3.0, 0.8, 0.4
    step = SYSTEM.period / PHASES
    times = start + step * np.arange(2**15)
    white = np.random.default_rng(0).standard_normal((1, len(times)))
    found = harmonic_spectra(samples([size * (1.0 + a * np.sin(2.0 * times)) * white], [start]), harmonics=1, periods=8)
    assert found.values.shape == (PHASES * 4, 3, 3)
    mean = found.values[4:].mean(axis=0) / (size**2 * step)
    one, two = -1j * a, -0.25 * a**2
    expected = np.array([[0.0, one.conjugate(), two], [one, 0.0, one.conjugate()], [two, one, 0.0]])
    assert np.abs(mean - expected - (1.0 + 0.5 * a**2) * np.eye(3)).max() < 0.06
    assert found.frequencies_hz[1] == pytest.approx(1.0 / (8.0 * SYSTEM.period))
    assert np.allclose(found.values, found.values.conj().swapaxes(1, 2))
    assert found.singular_values.shape == found.values.shape[:2]


@pytest.mark.parametrize("identifier", [None, LSCF()])
def test_both_forms_find_the_exponents_of_two_records_that_start_anywhere(values, identifier):
    """The bound of 3000 periods is 0.004 for either part: the method is not efficient, four of it.

    Both see the same noise, and differ less than by the 0.018 that the window of the segments is worth.
    """
    cut, late = 20011, 20016
    both = samples([values[:, :cut], values[:, late + 5 :]], [0.0, 5 * SYSTEM.period / PHASES])
    models = [h_oma(both, 2, form=form, lags=7, identifier=identifier) for form in ("frequency", "time")]
    for model, (truth, within) in zip(models, ((SYSTEM.exponents(), 0.016), (models[0].poles, 0.006)), strict=True):
        off = pair_exponents(model.poles, truth, SYSTEM.period).differences
        assert max(np.abs(off.real).max(), np.abs(off.imag).max()) < within
        assert model.covariance is None


def test_what_cannot_be_is_refused(values):
    own = samples([values])
    record = Record(values=values, sample_rate=PHASES / SYSTEM.period, channels=["y"])
    for what, words in ((h_oma, (2,)), (harmonic_spectra, ())):
        with pytest.raises(InputError, match=rf"samples of a result, but are .*\n.*`{what.__name__}\(identify"):
            what(record, *words)
    with pytest.raises(InputError, match="form"):
        h_oma(own, 2, form="both")
    with pytest.raises(InputError, match="be at most 750"):
        h_oma(own, 2, lags=751)
    with pytest.raises(InputError, match="be at most 3000"):
        harmonic_spectra(own, periods=3001)
    with pytest.raises(InputError, match="harmonics"):
        harmonic_spectra(own, harmonics=-1)
    with pytest.raises(IdentificationError, match=r"14\.5 samples"):
        h_oma(samples([values], phases=14.5), 2)
    turning = np.cumsum(1.0 + 0.01 * np.sin(np.arange(values.shape[1]) / 100.0)) * SYSTEM.period / PHASES
    with pytest.raises(IdentificationError, match="speed is not constant"):
        h_oma(samples([values], [turning]), 2)


def test_the_picture_marks_the_lines_of_the_model_where_the_spectra_peak(values):
    record = Record(
        values=values[:, : 250 * PHASES],
        sample_rate=PHASES / SYSTEM.period,
        channels=["x"],
        clock=ConstantPeriod(period=SYSTEM.period),
    )
    analysis = identify(record, validate=False, excitation="ambient")
    assert "harmonic_spectra" in dir(analysis.plot)
    (axes,) = analysis.plot.harmonic_spectra(periods=20).axes
    marks = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 2]
    frequency, size = axes.lines[0].get_data()
    true = (SYSTEM.exponents().imag.max() + 2.0 * np.array([0, 1, -1])) / (2.0 * np.pi)
    assert all(np.abs(np.array(marks) - abs(line)).min() < 0.01 for line in true)
    for mark in marks[:1] + [abs(line) for line in true]:
        assert size[np.abs(frequency - mark) < 0.01].max() > 5.0 * size[np.abs(frequency - mark) < 0.08].min()
    assert axes.get_xlabel() == "frequency [Hz]"
    assert axes.get_ylabel().endswith("[1/Hz]")
    with pytest.raises(InputError, match="be an Analysis"):
        plot.harmonic_spectra(record)
