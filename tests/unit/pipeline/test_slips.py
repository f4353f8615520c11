"""`identify` and `Settings` called as they are not say what to write."""

from dataclasses import fields

import numpy as np
import pytest

from floquid import Record, Settings, identify
from floquid.errors import InputError
from floquid.preparation._settings import SLIPS

Y = np.zeros((2, 10))
RECORD = Record(values=Y, sample_rate=5.0, channels=["x", "y"])
WRITE = 'identify(Record(values=y, sample_rate=fs, channels=["x", "y"]), period=T)'


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: identify(Y, 5.0), f"Write `{WRITE}`"),
        (
            lambda: identify(Y),
            f"of shape (2, 10).\n  Read files with `read`; of arrays write `{WRITE}`",
        ),
        (lambda: identify("run.csv", period=1.0), "is 'run.csv'.\n  Read files with `read`"),
        (lambda: identify(RECORD, 6.28), "`settings` of `identify` must be Settings, or options by name, but is 6.28"),
        (lambda: identify(RECORD, T=6.28), "`identify` has no option `T`."),
        (lambda: identify(RECORD, T=6.28), "Did you mean `period=T`?"),
        (lambda: identify(RECORD, n_modes=2), "`identify` has no option `n_modes`. Did you mean `order=2*n_modes`?"),
        (lambda: identify(RECORD, perid=6.28), "Did you mean `period`?"),
        (lambda: identify(RECORD, colour="red"), "Its options are: period, channels, inputs"),
    ],
)
def test_a_slip_is_answered_with_what_to_write(call, says):
    with pytest.raises(InputError) as error:
        call()
    assert says in str(error.value)


def test_settings_answer_the_same():
    with pytest.raises(TypeError, match=r"no positional ones: write `Settings\(period=6.28"):
        Settings(6.28)
    with pytest.raises(TypeError, match="has no argument `rpm`: write `period=60/rpm`"):
        Settings(rpm=600)


def test_what_is_to_be_written_are_fields():
    names = {field.name for field in fields(Settings)}
    assert not names & SLIPS.keys()
    assert {words.partition("=")[0] for words in SLIPS.values()} <= names
