"""A search whose time is over is told to be."""

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import mathieu, record_of

from floquid import ConstantPeriod, Record, identify
from floquid.periodic import _fit_records
from floquid.pipeline.excited import _identify
from floquid.systems import JeffcottRotor


def free():
    return JeffcottRotor().simulate(n_periods=40, samples_per_period=20, noise=0.01, seed=0), {}


def driven():
    values, inputs = record_of(mathieu(), 40, 16, 0.02, 0)
    clock = ConstantPeriod(period=mathieu().period)
    whole = np.concatenate([values, inputs])
    channels = [f"c{k}" for k in range(len(whole))]
    return Record(values=whole, sample_rate=16 / clock.period, clock=clock, channels=channels), {
        "inputs": channels[len(values) :]
    }


@pytest.mark.parametrize(
    ("made", "module", "late"),
    [
        (free, _fit_records, lambda point: replace(point, unfinished=True)),
        (driven, _identify, lambda found: (found[0], True)),
    ],
    ids=["free", "inputs"],
)
def test_a_search_whose_time_is_over_is_told_to_be(made, module, late, monkeypatch):
    record, options = made()
    assert not any("processor time" in text for text in identify(record, **options).warnings)
    own = module.searched
    monkeypatch.setattr(module, "searched", lambda *given: late(own(*given)))
    assert any("processor time" in text for text in identify(record, **options).warnings)
