"""A first period with values of its own: left out where modes that are gone after it bend the others, else kept."""

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.several_hits import Hits

from floquid import ConstantPeriod, Record, identify
from floquid.core import PeriodicModel
from floquid.errors import IdentificationError
from floquid.pipeline.free import _identify
from floquid.pipeline.free._find_poles import UnsettledError
from floquid.pipeline.free._identify import promised
from floquid.pipeline.free._starts import ensembles
from floquid.preparation import prepare

PERIOD, PHASES, OMEGA = 1.0, 24, 2.0 * np.pi
SLOW = complex(-0.08, 0.31 * OMEGA)
FAST = tuple(complex(-decay, turn * OMEGA) for decay, turn in ((15.0, 2.2), (13.0, 1.4), (14.0, 4.7), (16.0, 7.3)))
"""Gone within a period: noise hides what is left of them after it."""


def decays(*exponents: complex, seed: int = 0, noise: float = 0.002, periods: int = 60) -> list[Record]:
    """Two hits on five channels of modes with three harmonics each."""
    generator = np.random.default_rng(seed)
    times, harmonics = np.arange(PHASES * periods) * PERIOD / PHASES, np.arange(-1, 2)
    lines = np.exp(1j * OMEGA * np.outer(harmonics, times))
    shapes = generator.standard_normal((len(exponents), 5, 3, 2)) @ np.array([1.0, 1j])
    records = []
    for _ in range(2):
        values = np.zeros((5, len(times)))
        for exponent, shape in zip(exponents, shapes, strict=True):
            begin = complex(*generator.standard_normal(2))
            values += (begin * (shape @ lines) * np.exp(exponent * times)).real
        values += noise * np.abs(values).max() * generator.standard_normal(values.shape)
        clock = ConstantPeriod(period=PERIOD)
        records.append(Record(values=values, sample_rate=PHASES / PERIOD, clock=clock, channels=list("abcde")))
    return records


def pulls(model: PeriodicModel) -> NDArray[np.float64]:
    """The error of the nearest exponent over its deviation, its real and its imaginary part."""
    gaps = model.exponents - SLOW
    gaps = gaps.real + 1j * (gaps.imag - OMEGA * np.rint(gaps.imag / OMEGA))
    nearest = int(np.argmin(np.abs(gaps)))
    assert model.exponent_std is not None
    gap, std = gaps[nearest], model.exponent_std[nearest]
    return np.abs([gap.real / std.real, gap.imag / std.imag])


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", [0, 3, 4])
def test_modes_that_are_gone_after_a_period_do_not_bend_the_others(seed):
    analysis = identify(decays(SLOW, *FAST, seed=seed))
    assert analysis.passed, analysis.reasons
    assert analysis.model.order == 2
    assert pulls(analysis.model).max() < 4.0
    assert any("first period" in words for words in analysis.warnings)
    assert analysis.records[0].start == pytest.approx(PERIOD)


@pytest.mark.slow
def test_all_is_kept_where_that_is_asked_for():
    with pytest.raises(IdentificationError, match="does not repeat with the period given"):
        identify(decays(SLOW, *FAST), skip=0, validate=False)


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", range(6))
def test_a_first_period_like_the_others_promises_nothing(seed):
    records = decays(SLOW, seed=seed)
    analysis = identify(records, validate=False)
    assert promised(analysis.fit, prepare(records)) < 0.0
    assert analysis.records[0].start == 0.0


@pytest.mark.first(1)
@pytest.mark.parametrize("left", [(1.0, 0.5), (30.0, 15.0)], ids=["beside noise", "far above it"])
def test_a_residual_that_decays_on_promises_nothing(left, monkeypatch):
    """A share of the response itself: each period stands out against the next, and none would be the last."""
    records = decays(SLOW)
    fit, prepared = identify(records, validate=False).fit, prepare(records)
    noise = np.random.default_rng(1).standard_normal((2, 5, records[0].n_samples))
    sizes = np.exp(-0.08 * records[0].times) + (records[0].times < PERIOD) * 4.0

    def of(size):
        monkeypatch.setattr("floquid.pipeline.free._identify.unexplained", lambda *_: list(size * noise))
        return promised(fit, prepared)

    first, second = left
    assert of(sizes) > 0.0
    assert of(np.exp(-0.3 * records[0].times)) < 0.0
    assert of(1.0 + first * (records[0].times < PERIOD) + second * (np.abs(records[0].times - 1.5) < 0.5)) < 0.0


@pytest.mark.slow
def test_no_more_periods_are_left_out_once_the_time_is_over():
    analysis = identify(decays(SLOW, FAST[0], seed=3), trust_period=True, validate=False, seconds=1e-6)
    assert analysis.records[0].start == 0.0
    assert any("ended after 1e-06 s of processor time" in words for words in analysis.warnings)


@pytest.mark.parametrize(("error", "refused"), [(UnsettledError, False), (IdentificationError, True)])
def test_the_best_fit_is_given_as_one_that_fails_where_poles_do_not_tell_the_noise(monkeypatch, error, refused):
    """A good record was refused in words on clipped samples: modes that die within a period hid the noise."""

    def poles(*_):
        raise error("Identification ended without a result")

    monkeypatch.setattr(_identify, "explains", lambda *_: False)
    monkeypatch.setattr(_identify, "poles", poles)
    monkeypatch.setattr(_identify, "OPENINGS", (ensembles, poles))
    records = Hits.drawn([-0.25 + 1.0j, -0.5 + 2.1j], 8, 6, noise=0.03).records(0)
    if refused:
        with pytest.raises(IdentificationError, match="without a result"):
            identify(records)
        return
    found = identify(records)
    assert found.model.order == 4
    assert not found.passed
    assert any("noise cannot be told" in words for words in found.reasons)
