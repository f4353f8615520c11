"""A search whose time is over is told to be."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.driven import ambient_of, mathieu, mathieu_and_lag, parted, record_of

from floquid import ConstantPeriod, IdentificationError, Record, identify
from floquid.findings import Severity
from floquid.innovations.search import _search
from floquid.inputs import Limits
from floquid.periodic import _fit_records
from floquid.pipeline.excited import _ambient, _identify
from floquid.systems import JeffcottRotor


@cache
def free():
    return JeffcottRotor().simulate(n_periods=40, samples_per_period=20, noise=0.01, seed=0), {}


@cache
def in_time():
    return identify(free()[0], validate=False)


def driven():
    values, inputs = record_of(mathieu(), 40, 16, 0.02, 0)
    clock = ConstantPeriod(period=mathieu().period)
    whole = np.concatenate([values, inputs])
    channels = [f"c{k}" for k in range(len(whole))]
    return Record(values=whole, sample_rate=16 / clock.period, clock=clock, channels=channels), {
        "inputs": channels[len(values) :]
    }


def ambient(system=None, seed=0):
    system = system or mathieu()
    values, clock = ambient_of(system, 150, 16, 0.02, seed, warm=40), ConstantPeriod(period=system.period)
    channels = [f"c{k}" for k in range(len(values))]
    record = Record(values=values, sample_rate=16 / clock.period, clock=clock, channels=channels)
    return record, {"excitation": "ambient", "validate": False}


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("made", "module", "late"),
    [
        (free, _fit_records, lambda point: replace(point, unfinished=True)),
        (driven, _identify, lambda found: (found[0], True)),
        (ambient, _ambient, lambda found: (found[0], True)),
    ],
    ids=["free", "inputs", "outputs alone"],
)
def test_a_search_whose_time_is_over_is_told_to_be(made, module, late, monkeypatch):
    record, options = made()
    options = {**options, "validate": False}
    ended = in_time() if made is free else identify(record, **options)
    assert not any("processor time" in text for text in ended.warnings)
    own = module.searched
    monkeypatch.setattr(module, "searched", lambda *given: late(own(*given)))
    assert any("processor time" in text for text in identify(record, **options).warnings)


@pytest.mark.first(2)
@pytest.mark.parametrize("options", [{}, {"identifier": "era-ml"}, {"identifier": "lscf", "harmonics": 2}], ids=str)
def test_free_responses_whose_search_for_poles_has_no_time_have_a_model_that_fails(options):
    record, _ = free()
    found = identify(record, seconds=1e-6, **options)
    late = [finding for finding in found.findings if finding.code == "poles_without_end"]
    assert [finding.severity for finding in late] == [Severity.FAILURE]
    assert found.failed
    assert not found.passed
    assert found.model.order >= 4
    ended = identify(record, **options, validate=False) if options else in_time()
    assert "poles_without_end" not in {finding.code for finding in ended.findings}


@pytest.mark.slow
def test_outputs_alone_without_time_have_the_modes_of_the_first_start_and_say_so(monkeypatch):
    record, options = ambient(mathieu_and_lag())
    starts, whole = [], _search._with

    class EndedError(Exception):
        """There is a second start."""

    def counted(*given):
        starts.append(whole(*given))
        if len(starts) > 1:
            raise EndedError
        return starts[-1]

    monkeypatch.setattr(_search, "_with", counted)
    monkeypatch.setattr(_search, "white", lambda *_: False)
    with pytest.raises(EndedError):
        identify(record, **options)
    starts.clear()
    monkeypatch.setattr(_search, "_with_one_more", None)
    found = identify(record, seconds=1e-6, **options)
    assert len(starts) == 1
    assert found.model.order > 0
    late = [finding for finding in found.findings if finding.code == "out_of_time"]
    assert [finding.severity for finding in late] == [Severity.WARNING]


def test_outputs_alone_without_a_mode_before_the_time_is_over_are_refused_for_it(monkeypatch):
    record, options = ambient()
    monkeypatch.setattr(_search, "_with", lambda *_: None)
    monkeypatch.setattr(_search, "_of_phases", None)
    with pytest.raises(IdentificationError, match="processor time"):
        identify(record, seconds=1e-6, **options)


@pytest.mark.parametrize(
    ("stage", "made", "fits"),
    [
        ("_with_one_more", mathieu, 0),
        pytest.param("_with_partners", parted, 0, marks=pytest.mark.slow),
        ("_to_the_end", mathieu, 1),
    ],
)
def test_a_stage_whose_time_is_over_fits_nothing_but_what_is_reported(stage, made, fits, monkeypatch):
    record, options = ambient(made(), seed=8)
    own, begun, counts = getattr(_search, stage), [], []

    class EndedError(Exception):
        """The stage is over, and so is the test."""

    def late(*given):
        before = len(begun)
        own(*(replace(one, until=0.0) if isinstance(one, Limits) else one for one in given))
        counts.append(len(begun) - before)
        raise EndedError

    for name in ("_with", "solve"):
        fit = getattr(_search, name)
        monkeypatch.setattr(_search, name, lambda *given, fit=fit, **more: begun.append(1) or fit(*given, **more))
    monkeypatch.setattr(_search, "chi2_limit", lambda *_: -1e9)
    monkeypatch.setattr(_search, "white", lambda *_: stage != "_with_one_more")
    monkeypatch.setattr(_search, stage, late)
    with pytest.raises(EndedError):
        identify(record, **options)
    assert counts == [fits]
