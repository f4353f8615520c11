"""Words on the order, and on the end of an identification, that hang on the numbers."""

import pytest

from floquid.findings import failure, note, warning
from floquid.lti import Outcome


@pytest.mark.parametrize(
    ("real", "just", "mode", "end"),
    [
        (None, False, "the mode folded to 0.2500 of ω", "noise explains."),
        (-0.9, True, "the real multiplier -0.9", "noise explains: only just more."),
    ],
)
def test_the_mode_that_would_be_missed_least_is_named_by_its_multiplier(real, just, mode, end):
    assert str(note("modes_needed", needed=True, modes=3, real=real, share=0.25, rise=1.234, just=just)) == (
        f"Each of the 3 modes is needed. Without the weakest, {mode}, the misfit rises by 1.23 times what {end}"
    )


@pytest.mark.parametrize(
    ("share", "doubtful", "end"),
    [
        (0.2, False, "candidate stays below the limit (0.20 of it)."),
        (0.8, True, "(0.80 of it). Noise alone rarely comes so close."),
        (1.5, True, "exceeds the limit (1.50 of it): a mode is missing."),
    ],
)
def test_a_further_mode_is_judged_by_its_share(share, doubtful, end):
    assert str(note("further_mode", share=share, doubtful=doubtful)).endswith(end)


@pytest.mark.parametrize(
    ("near", "end"), [(False, "4.57 standard deviations apart."), (True, "apart: they may be one mode, or three.")]
)
def test_the_nearest_modes_may_be_one(near, end):
    assert str(note("nearest_modes", gap=4.567, near=near)).endswith(end)


@pytest.mark.parametrize(
    ("code", "one", "two"),
    [
        ("modes_or_drift", "One mode changes by less", "2 modes change by less"),
        ("shared_multipliers", "One multiplier belongs to", "2 multipliers belong to"),
    ],
)
def test_one_and_several_are_counted(code, one, two):
    more = {"hits": 3} if code == "shared_multipliers" else {}
    assert str(note(code, number=1, **more)).startswith(one)
    assert str(note(code, number=2, **more)).startswith(two)


@pytest.mark.parametrize(
    ("taps", "independent", "words"),
    [
        (0, 1.0, "The residual is white noise (1.2 standard deviations from it)."),
        (3, 0.5, "white after a filter of 3 taps (1.2 standard deviations from it); its responses are"),
        (0, 0.5, "its responses are worth 50% of their number."),
    ],
)
def test_white_noise_says_what_made_it_so_and_what_it_is_worth(taps, independent, words):
    assert words in str(note("white", colour=1.23, taps=taps, independent=independent))


@pytest.mark.parametrize("outcome", Outcome)
def test_each_end_of_an_identification_is_a_sentence_and_a_part_of_one(outcome):
    said = failure(outcome.value)
    assert said.clause == str(said)[0].lower() + str(said)[1:-1]


def test_what_is_weakly_determined_is_counted():
    assert str(warning("hardly_determined", number=2, real=None, share=0.125)) == (
        "2 of the modes are weakly determined, the mode folded to 0.1250 of ω most: each may stand for several."
    )
