"""The checks behind every constructor: what they let through, what they refuse, and in which words."""

from fractions import Fraction

import numpy as np
import pytest

from floquid._checks import describe, finite, frozen_array, input_error, integer, positive
from floquid.errors import FloquidError, InputError


def test_message_has_four_parts():
    error = input_error("rate", "Record", "be positive [Hz]", "is -1", "Swap the times.")
    assert str(error) == "Argument `rate` of `Record` must be positive [Hz], but is -1.\n  Swap the times."
    assert str(input_error("a", "f", "be b", "is c")) == "Argument `a` of `f` must be b, but is c."


def test_an_input_error_is_a_value_error():
    assert issubclass(InputError, ValueError)
    assert issubclass(InputError, FloquidError)


class TestFrozenArray:
    def test_writable_input_is_copied(self):
        mine = np.arange(3.0)
        held = frozen_array(mine, "a", "f", axes=("n",))
        mine[0] = 99.0
        assert held.tolist() == [0.0, 1.0, 2.0]
        assert mine.flags.writeable

    def test_read_only_input_is_taken_as_it_is(self):
        mine = np.arange(3.0)
        mine.flags.writeable = False
        assert frozen_array(mine, "a", "f", axes=("n",)) is mine

    @pytest.mark.parametrize("given", [[1, 2], np.array([1, 2], dtype="i2"), np.array([1, 2], dtype=">f8"), (True, 2)])
    def test_numbers_of_any_kind_become_the_dtype(self, given):
        held = frozen_array(given, "a", "f", axes=("n",))
        assert held.dtype == np.dtype(np.float64)
        assert held.tolist() == [1.0, 2.0]
        assert not held.flags.writeable

    def test_casting_leaves_the_input_writable(self):
        mine = np.arange(3)
        frozen_array(mine, "a", "f", axes=("n",))
        mine[0] = 5

    @pytest.mark.parametrize(
        "given",
        [
            ["a", "b"],
            [[1], [1, 2]],
            None,
            np.array([object()]),
            np.array(["2001-01-01"], dtype="M8[D]"),
            {"a": 1},
            [None],
        ],
    )
    def test_what_is_not_numbers_is_refused(self, given):
        with pytest.raises(
            InputError, match=r"^Argument `a` of `f` must be an array of numbers of shape \(n,\), but is "
        ):
            frozen_array(given, "a", "f", axes=("n",))

    @pytest.mark.parametrize("given", [np.zeros(2), np.zeros((2, 2)), np.zeros((3, 2, 1)), 0.0])
    def test_wrong_shape_is_refused(self, given):
        with pytest.raises(InputError, match=r"must have shape \(3, n\), but has shape \(.*\)\.\n  Turn it\.$"):
            frozen_array(given, "a", "f", axes=(3, "n"), remedy="Turn it.")

    def test_complex_is_not_cut_to_real(self):
        with pytest.raises(InputError, match=r"must be real, but is complex \(complex128\)\.\n  Pass its real part\."):
            frozen_array([1j], "a", "f", axes=("n",))

    @pytest.mark.parametrize("given", [[0.5, 1.0], [np.nan], [np.inf]])
    def test_integers_are_not_rounded(self, given):
        with pytest.raises(InputError, match=rf"must hold integers, but has {given[0]}"):
            frozen_array(given, "a", "f", axes=("n",), dtype=np.int64)
        assert frozen_array([1.0, -2.0], "a", "f", axes=("n",), dtype=np.int64).tolist() == [1, -2]

    @pytest.mark.parametrize("missing", [True, False])
    def test_a_mask_is_not_dropped(self, missing):
        masked = np.ma.masked_equal([1.0, 2.0], 2.0)
        with pytest.raises(InputError, match=r"must be a plain array, but is a masked one\.\n  Pass "):
            frozen_array(masked, "a", "f", axes=("n",), missing=missing)

    def test_missing_lets_nan_through_and_infinity_never(self):
        assert np.isnan(frozen_array([np.nan], "a", "f", axes=("n",), missing=True)).all()
        with pytest.raises(InputError, match=r"must be finite, but has 1 entries .* nan at index \(1,\)"):
            frozen_array([0.0, np.nan], "a", "f", axes=("n",))
        with pytest.raises(
            InputError, match=r"NaN alone marks a missing sample.* has 2 entries .* -inf at index \(0, 1\)"
        ):
            frozen_array([[np.nan, -np.inf], [np.inf, 0.0]], "a", "f", axes=("n", "m"), missing=True)


@pytest.mark.parametrize("given", [1, 1.5, np.float32(1.5), np.int8(1), np.array(1.5), Fraction(3, 2)])
def test_positive_and_finite_take_any_real_number(given):
    for check in (positive, finite):
        number = check(given, "a", "f")
        assert type(number) is float
        assert number == float(given)


@pytest.mark.parametrize(
    "given", ["1", None, True, np.nan, np.inf, 1j, [1.0], np.array([1.0]), np.bool_(True), 10**400]
)
def test_positive_and_finite_refuse_the_rest(given):
    for check in (positive, finite):
        with pytest.raises(
            InputError, match=r"^Argument `a` of `f` must be a finite number \[s\], but is .+\.\n  Go\.$"
        ):
            check(given, "a", "f", unit="s", remedy="Go.")


@pytest.mark.parametrize("given", [0, -1.0, -0.0])
def test_positive_refuses_zero_and_below(given):
    with pytest.raises(InputError, match=r"^Argument `a` of `f` must be positive \[Hz\], but is -?[01]\.$"):
        positive(given, "a", "f", unit="Hz")
    assert finite(given, "a", "f") == given


def test_integer():
    assert integer(np.int32(3), "a", "f", at_least=3) == 3
    for wrong in (2, 3.0, "3", True, None):
        with pytest.raises(InputError, match=r"must be an integer of at least 3, but is "):
            integer(wrong, "a", "f", at_least=3)


def test_a_long_value_is_described_shortly():
    assert describe(np.zeros((2, 3))) == "an array of float64 of shape (2, 3)"
    assert len(describe("x" * 500)) == 60
