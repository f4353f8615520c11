"""A finding: its sentence, its clause, its way into a file and back; options as the command has them."""

import pickle

import pytest

from floquid.errors import InputError
from floquid.findings import Severity, as_mapping, from_mapping, note, texts, warning
from floquid.preparation import for_command


def test_a_finding_says_where_it_is():
    found = note("more_gaps", where="record 2", number=3)
    assert str(found) == "Record 2: There are 3 more stretches of missing samples."
    assert found.clause == "there are 3 more stretches of missing samples"


def test_a_code_without_words_is_refused():
    with pytest.raises(InputError, match="`code` of `Finding` must be one of the table of words, but is 'unheard'"):
        note("unheard")


def test_sentences_of_one_severity():
    both = (note("skipped", periods=2.0), warning("growing", number=1, order=4))
    assert texts(both, Severity.NOTE) == ("The first 2 periods were left out.",)
    assert texts(both) == tuple(map(str, both))


def test_a_finding_comes_back():
    found = warning("product", frequency=1.5, of=(0.5, 1.0))
    assert from_mapping(as_mapping(found)) == found
    assert not from_mapping(as_mapping(found)).words
    assert pickle.loads(pickle.dumps(found)) == found


@pytest.mark.parametrize(
    "other", [{"code": "of_a_later_floquid"}, {"numbers": {"number": 3}}, {"text": "Words of an earlier floquid."}]
)
def test_what_another_floquid_said_stays_as_it_was(other):
    content = as_mapping(warning("growing", number=1, order=4)) | other
    found = from_mapping(content)
    assert str(found) == content["text"]
    assert found.code == content["code"]
    assert as_mapping(found) == content


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("leave them out (`skip=`)", "leave them out (`--skip`)"),
        ('pass `form="delayed"`', "pass `--form delayed`"),
        ("`period=3.25`", "`--period 3.25`"),
        ("`trust_period=True`", "`--trust-period`"),
        ('`method="repeats"`', "`--method repeats`"),
        ("name that number (`repeat`) of a record (`read`)", "name that number (`--repeat`) of a record (`read`)"),
        ("`constrained=False`", "`--no-constrained`"),
        ("`periods_per_revolution=2`", "`--periods-per-rev 2`"),
        ("the variable `rate` and `unknown=`", "the variable `rate` and `unknown=`"),
        ("`read(path, period=...)`", "`read(path, period=...)`"),
    ],
)
def test_options_as_the_command_has_them(text, shown):
    assert for_command(text) == shown
