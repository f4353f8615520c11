"""Constructors called with arguments that they do not have say what to write, and are unchanged otherwise."""

import copy
import pickle
from dataclasses import replace
from inspect import signature

import numpy as np
import pytest

from floquid._checks import answers_slips
from floquid.core import AzimuthSignal, Channel, ConstantPeriod, PulseTimes, Record, TachometerSignal
from floquid.errors import InputError

Y, FS = np.zeros((2, 10)), 5.0
TIMES = np.arange(10) / FS + 3.0
WHOLE = {"values": Y, "sample_rate": FS, "channels": ["x", "y"]}


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: Record(Y, FS), 'no positional ones: write `Record(values=y, sample_rate=fs, channels=["x", "y"])`'),
        (lambda: Record(values=Y, dt=0.2), "no argument `dt`: write `sample_rate=1/dt`, as in `Record(values=y, "),
        (lambda: Record(values=Y, time=TIMES), "`sample_rate=1 / (time[1] - time[0]), start=time[0]`"),
        (lambda: Record(values=Y, t=TIMES), "`sample_rate=1 / (t[1] - t[0]), start=t[0]`"),
        (lambda: Record(values=Y, fs=FS), "`sample_rate=fs`"),
        (lambda: Record(values=Y, samplerate=FS), "`sample_rate=samplerate`"),
        (lambda: Record(values=Y, sample_rate=FS, names=["x", "y"]), "`channels=names`"),
        (lambda: Record(**WHOLE, period=6.28), "`clock=ConstantPeriod(period=T)`"),
        (lambda: Record(**WHOLE, colour="red"), "Record has no argument `colour`: write `Record("),
        (lambda: Record(values=Y, sample_rate=FS), "Record needs `channels`: write `Record("),
        (lambda: ConstantPeriod(6.28), "no positional ones: write `ConstantPeriod(period=6.28)`"),
        (lambda: ConstantPeriod(T=6.28), "`period=T`"),
        (lambda: ConstantPeriod(rpm=600), "`period=60/rpm`"),
        (lambda: TachometerSignal("tach"), '`TachometerSignal(channel="tach", pulses_per_revolution=1)`'),
        (AzimuthSignal, "AzimuthSignal needs `channel`"),
        (lambda: PulseTimes(times=TIMES, ppr=2), "`pulses_per_revolution=ppr`"),
        (
            lambda: Channel("x"),
            'no positional ones: write `Channel(name="x", unit="m")`',
        ),
    ],
)
def test_a_slip_is_answered_with_what_to_write(call, says):
    with pytest.raises(TypeError) as error:
        call()
    assert says in str(error.value)


def test_what_is_written_is_right():
    written = Record(values=Y, sample_rate=1 / (TIMES[1] - TIMES[0]), start=TIMES[0], channels=["x", "y"])
    np.testing.assert_allclose(written.times, TIMES)
    assert ConstantPeriod(period=60 / 600).fundamental == pytest.approx(600 * 2 * np.pi / 60)


def test_everything_else_is_as_it_was():
    record, clock = Record(**WHOLE), ConstantPeriod(period=2.0)
    assert list(signature(Record).parameters)[:3] == ["values", "sample_rate", "channels"]
    assert {one.kind.name for one in signature(ConstantPeriod).parameters.values()} == {"KEYWORD_ONLY"}
    for way in (copy.copy, copy.deepcopy, replace, lambda one: pickle.loads(pickle.dumps(one))):
        assert way(clock) == clock
        assert np.array_equal(way(record).values, Y)
    with pytest.raises(InputError, match="`sample_rate` of `Record` must be positive"):
        Record(**WHOLE | {"sample_rate": -1.0})


def test_a_type_error_from_inside_is_not_taken_for_a_slip():
    @answers_slips("Broken(one=1)", {})
    class Broken:
        def __init__(self, *, one):
            raise TypeError("a mistake inside")

    with pytest.raises(TypeError, match="a mistake inside"):
        Broken(one=1)
    with pytest.raises(TypeError, match="Broken needs `one`"):
        Broken()
