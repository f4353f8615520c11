"""What goes into a modal identification and what comes out: read-only, checked, refused in four parts."""

import dataclasses
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from floquid.errors import InputError
from floquid.findings import failure
from floquid.lti import ModalModel, Outcome, TimeResponses

FOUR_PARTS = r"^Argument `{argument}` of `{of}` must .+, but .+\.(\n  \S.+\.)?$"


def responses(**changes):
    valid = {"values": np.arange(24.0).reshape(2, 3, 4), "dt": 0.5, "noise": np.full((2, 3), 0.1), "lengths": [4, 3, 2]}
    return TimeResponses(**(valid | changes))


def modal(**changes):
    valid = {
        "multipliers": np.array([0.9 * np.exp(1j), 0.9 * np.exp(-1j), -0.5]),
        "residues": np.ones((3, 2, 2), complex),
        "dt": 0.5,
        "covariance": np.eye(6),
        "residue_spread": np.ones((2, 3, 3), complex),
        "residue_slope": np.ones((2, 3, 3), complex),
        "residual_std": np.ones((2, 2)),
        "stats": {"cost": 1.0},
    }
    return ModalModel(**(valid | changes))


ARRAYS = [(responses, name) for name in ("values", "noise", "lengths")] + [
    (modal, name)
    for name in ("multipliers", "residues", "covariance", "residue_spread", "residue_slope", "residual_std")
]
EVERY_ARRAY = pytest.mark.parametrize(("make", "name"), ARRAYS, ids=[f"{m.__name__}-{n}" for m, n in ARRAYS])


@EVERY_ARRAY
def test_a_writable_array_is_copied_and_held_read_only(make, name):
    mine = np.array(getattr(make(), name))
    made = make(**{name: mine})
    held = getattr(made, name)
    assert not held.flags.writeable
    assert not np.shares_memory(held, mine)
    assert mine.flags.writeable


@EVERY_ARRAY
def test_a_read_only_array_is_taken_as_it_is(make, name):
    mine = np.array(getattr(make(), name))
    mine.flags.writeable = False
    assert getattr(make(**{name: mine}), name) is mine


@EVERY_ARRAY
def test_a_wrong_number_of_axes_or_a_text_is_refused(make, name):
    for wrong in (np.zeros((1,) * 5), "text"):
        with pytest.raises(InputError, match=FOUR_PARTS.format(argument=name, of=r"\w+")):
            make(**{name: wrong})


@pytest.mark.parametrize("make", [responses, modal])
def test_fields_are_frozen_and_given_by_name(make):
    made = make()
    for field in dataclasses.fields(made):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(made, field.name, None)
    with pytest.raises(TypeError):
        type(made)(np.zeros((1, 1, 1)), 0.5)


@pytest.mark.parametrize(
    ("make", "argument", "wrong", "words"),
    [
        (responses, "values", np.full((2, 3, 4), np.nan), "be finite"),
        (responses, "values", np.zeros((2, 0, 4)), "hold at least one output, input and sample"),
        (responses, "noise", np.full((3, 2), 0.1), "have shape (2, 3)"),
        (responses, "noise", np.zeros((2, 3)), "be positive"),
        (responses, "noise", np.full((2, 3), np.inf), "be finite"),
        (responses, "lengths", [4, 4], "have shape (3,)"),
        (responses, "lengths", [4, 0, 4], "lie in 1 to 4"),
        (responses, "lengths", [4, 5, 4], "lie in 1 to 4"),
        (responses, "lengths", [4, 2.5, 4], "hold integers"),
        (responses, "dt", 0.0, "be positive"),
        (responses, "dt", np.nan, "be a finite number"),
        (modal, "residues", np.ones((2, 2, 2), complex), "have shape (3, outputs, inputs)"),
        (modal, "covariance", np.eye(3), "have shape (6, 6)"),
        (modal, "residue_spread", np.ones((2, 2, 2), complex), "have shape (inputs, 3, 3)"),
        (modal, "multipliers", [np.inf, 1.0, 1.0], "be finite"),
        (modal, "dt", -1.0, "be positive"),
    ],
)
def test_what_is_not_possible_is_refused(make, argument, wrong, words):
    with pytest.raises(InputError) as error:
        make(**{argument: wrong})
    of = type(make()).__name__
    assert re.match(FOUR_PARTS.format(argument=argument, of=of), str(error.value), re.DOTALL)
    assert words in str(error.value)


def test_what_is_not_given():
    plain = TimeResponses(values=np.ones((2, 3, 4)), dt=1.0)
    assert_array_equal(plain.noise, np.ones((2, 3)))
    assert_array_equal(plain.lengths, [4, 4, 4])
    assert (plain.n_outputs, plain.n_inputs) == (2, 3)
    bare = ModalModel(multipliers=[0.5], residues=np.ones((1, 1, 1)), dt=1.0)
    assert bare.covariance is bare.residue_spread is bare.residue_slope is bare.residual_std is None
    assert bare.outcome is Outcome.SUCCESS


def test_poles_are_principal_logarithms():
    """A negative real multiplier is on the upper edge of the strip, π/dt."""
    found = modal()
    assert found.order == 3
    assert_allclose(found.poles, np.array([np.log(0.9) + 1j, np.log(0.9) - 1j, np.log(0.5) + np.pi * 1j]) / 0.5)


def test_stats_cannot_be_changed():
    mine = {"cost": 1.0}
    found = modal(stats=mine)
    mine["cost"] = 2.0
    assert found.stats["cost"] == 1.0
    with pytest.raises(TypeError):
        found.stats["cost"] = 3.0


@pytest.mark.parametrize("outcome", list(Outcome), ids=lambda outcome: outcome.name)
def test_an_outcome_is_a_sentence_with_a_remedy(outcome):
    said = str(failure(outcome.value))
    assert len(said.split()) > 3
    assert said.endswith(".")
    if outcome is not Outcome.SUCCESS:
        assert re.search(r"\b([Uu]se|[Rr]ecord|ask) ", said)
