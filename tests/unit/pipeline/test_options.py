"""Each option counts for every kind of record, or is refused with the reason why it cannot."""

import inspect
from dataclasses import fields, replace
from typing import get_type_hints

import numpy as np
import pytest
from tests.driven import ambient_of, mathieu, record_of

from floquid import ConstantPeriod, Record, Settings, identify
from floquid.findings import Severity
from floquid.preparation._options import Options

SYSTEM, PHASES = mathieu(), 20
KINDS = {"inputs": {"inputs": ["F"]}, "ambient": {"excitation": "ambient"}}


def of(kind, periods=80):
    """A record of a kind, at a constant period."""
    if kind == "inputs":
        values, inputs = record_of(SYSTEM, periods, PHASES, 0.02, 0)
        rows, names = np.concatenate([values, inputs]), ["x", "F"]
    else:
        rows, names = ambient_of(SYSTEM, 3 * periods, PHASES, 0.02, 0), ["x"]
    rate = PHASES / SYSTEM.period
    return Record(values=rows, sample_rate=rate, channels=names, clock=ConstantPeriod(period=SYSTEM.period))


def test_keywords_signature_and_settings_are_the_same():
    named = [field.name for field in fields(Settings)]
    assert set(get_type_hints(Options)) == set(named)
    found = inspect.signature(identify).parameters
    assert list(found)[3:] == named
    assert [found[name].default for name in named] == [field.default for field in fields(Settings)]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_first_periods_are_left_out_and_the_orbit_is_taken_off(kind):
    record = of(kind, 40)
    found = identify(record, **KINDS[kind], skip=10.0, validate=False)
    assert found.records[0].n_samples == record.n_samples - 10 * PHASES
    assert "skipped" in {own.code for own in found.findings}
    orbit = np.zeros((record.n_channels, PHASES))
    orbit[0] = 3.0 + np.cos(2.0 * np.pi * np.arange(PHASES) / PHASES)
    values = record.values + np.tile(orbit, record.n_samples // PHASES)
    beside = identify(replace(record, values=values, orbit=orbit), **KINDS[kind], validate=False)
    plain = identify(record, **KINDS[kind], validate=False)
    assert beside.model.exponents == pytest.approx(plain.model.exponents, rel=1e-6)
    assert "orbit_subtracted" in {own.code for own in beside.findings}


def test_a_period_that_is_trusted_is_a_warning():
    record = of("inputs", 40)
    wrong = record.with_clock(ConstantPeriod(period=1.0005 * SYSTEM.period))
    found = identify(wrong, inputs=["F"], validate=False)
    told = {own.code: own.severity for own in found.findings if own.code == "wrong_period"}
    assert set(told.values()) == {Severity.FAILURE}
    trusted = identify(wrong, inputs=["F"], validate=False, trust_period=True)
    assert {own.code: own.severity for own in trusted.findings if own.code in told} == dict.fromkeys(
        told, Severity.WARNING
    )
