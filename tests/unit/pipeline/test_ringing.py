"""Records that are longer than their modes ring: the same exponents and deviations as by all of their cycles."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import floquid as fq
from floquid.core import ConstantPeriod, Record
from floquid.pipeline.free import _starts

PHASES = 16
MODES = (-0.05 + 1.3j, -0.03 + 2.5j)


def decays(exponents=MODES, *, cycles=2000, hits=1, noise=0.3, seed=0, red=0.0, offset=0.0, gap=False, tail=1.0):
    """Hits on two channels of modes with five harmonics each, at a period of a second; `tail` scales late noise."""
    generator = np.random.default_rng(seed)
    times, turns = np.arange(PHASES * cycles) / PHASES, np.arange(-2, 3)
    shapes = generator.standard_normal((len(exponents), 2, 5, 2)) @ np.array([1.0, 1j]) * 0.5 ** np.abs(turns)
    lines = np.exp(2j * np.pi * np.outer(turns, times))
    records = []
    for hit in range(hits):
        parts = (np.exp(value * times) * (shape @ lines) for value, shape in zip(exponents, shapes, strict=True))
        white = generator.standard_normal((2, len(times)))
        for sample in range(1, len(times) if red else 1):
            white[:, sample] += red * white[:, sample - 1]
        white[:, len(times) // 2 :] *= tail
        values = (1.0 + 0.3 * hit) * 2.0 * sum(parts).real + noise * white + offset
        if gap:
            values[:, 400:405] = np.nan
        records.append(Record(values=values, sample_rate=PHASES, channels=["x", "y"], clock=ConstantPeriod(period=1.0)))
    return records


def by_all(monkeypatch, records, **options):
    """The analysis by all cycles."""
    with monkeypatch.context() as patched:
        patched.setattr(_starts, "SHORT", 10**9)
        return fq.identify(records, **options)


SYSTEMS = {
    "two modes": {},
    "loud": {"noise": 1e-5},
    "three modes": {"exponents": (-0.2 + 1.1j, -0.03 + 2.5j, -0.08 + 0.4j)},
    "several hits": {"hits": 2, "cycles": 1200},
    "red noise": {"red": 0.7, "cycles": 1200},
}


@cache
def of_first_cycles(name, seed):
    return fq.identify(decays(**{"seed": seed, **SYSTEMS[name]}))


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("name", SYSTEMS)
def test_cycles_in_which_nothing_rings_move_nothing(name, seed, monkeypatch):
    records = decays(**{"seed": seed, **SYSTEMS[name]})
    short, whole = of_first_cycles(name, seed), by_all(monkeypatch, records)
    assert short.cycles[0].n_cycles < whole.cycles[0].n_cycles
    assert short.answer == whole.answer
    gaps, std = short.model.exponents - whole.model.exponents, whole.model.exponent_std
    assert np.abs(gaps.real / std.real).max() < 0.03
    assert np.abs(gaps.imag / std.imag).max() < 0.03
    assert_allclose(short.model.exponent_std, std, rtol=1e-4)
    assert_allclose(short.noise, whole.noise, rtol=1e-6)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    "changes",
    [
        {"exponents": (0.002 + 1.3j, -0.03 + 2.5j)},
        {"exponents": (-0.005 + 1.3j, -0.03 + 2.5j)},
        {"offset": 2.0},
        {"gap": True},
    ],
    ids=["growing", "slow", "offset", "gap"],
)
def test_a_record_that_says_something_to_its_end_is_untouched(changes, monkeypatch):
    records = decays(cycles=900, **changes)
    short, whole = fq.identify(records, validate=False), by_all(monkeypatch, records, validate=False)
    assert short.fit.later is None
    assert_array_equal(short.model.exponents, whole.model.exponents)
    assert_array_equal(short.model.covariance, whole.model.covariance)


@pytest.mark.slow
def test_the_later_cycles_tell_the_noise():
    (record,) = decays(tail=3.0)
    analysis = fq.identify(record, validate=False)
    assert 2.0 < analysis.noise.min() / 0.3 < 2.5  # √5 of half 1 and half 3, and not 1


def test_modes_that_are_slower_than_the_first_ones_are_fitted_anew(monkeypatch):
    slow, kept = SimpleNamespace(multipliers=np.exp([-0.01])), []
    lifted = SimpleNamespace(
        responses=SimpleNamespace(lengths=np.array([5000]), values=np.ones((PHASES, 1, 5000))),
        n_channels=1,
        noise=np.array([[0.1]]),
        first=kept.append,
    )
    start = SimpleNamespace(whole=lifted, modal=SimpleNamespace(multipliers=np.exp([-0.05])), known=None)
    monkeypatch.setattr(_starts, "_first", lambda records, *_: records)
    monkeypatch.setattr(_starts, "replace", lambda fitted, **_: fitted)
    found = SimpleNamespace(model=slow, forced=None, findings=())
    assert _starts.fitted_ringing(start, (), lambda *_: found) is found
    assert kept == [pytest.approx(900, abs=2), pytest.approx(2400, abs=2)]  # rounding may ask for one cycle more


def test_the_summary_says_how_many_cycles_were_fitted(tmp_path):
    analysis = of_first_cycles("two modes", 0)
    assert "900 of 2000 periods" in analysis.summary()
    assert any("first 900 of 2000 periods" in words for words in analysis.synchronisation)
    fq.save(analysis, tmp_path / "result.h5")
    loaded = fq.load(tmp_path / "result.h5")
    assert_array_equal(loaded.fit.later, [1100])
    assert loaded.cycles[0].n_cycles == 900
