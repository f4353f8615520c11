"""Words on a shaft and its records that hang on the numbers."""

import pytest

from floquid.findings import failure, note, warning


@pytest.mark.parametrize(
    ("absent", "words"),
    [
        ((58,), "from line 58 of 60."),
        ((57, 58), "from lines 57, 58 of 60."),
        (tuple(range(50, 58)), "from lines 50, 51, 52, 53, 54, 55 and 2 more of 60."),
    ],
)
def test_lines_that_never_gave_a_pulse_are_named_up_to_six(absent, words):
    assert words in str(note("absent_lines", absent=absent, lines=60))


@pytest.mark.parametrize(("more", "end"), [(0, "bridges them."), (2, "bridges them; there are 2 more such gaps.")])
def test_the_widest_gap_is_named_and_the_others_are_counted(more, end):
    assert str(warning("angle_bridged", first=1.0, last=3.5, revolutions=25.0, more=more)) == (
        f"The angle was not measured between 1 and 3.5 s, 25 revolutions: a smooth curve {end}"
    )


@pytest.mark.parametrize(
    ("before", "after", "by"),
    [
        (2.0, 0.0, "by 2 revolutions before it:"),
        (0.0, 3.0, "by 3 revolutions after it:"),
        (2.0, 3.0, "by 2 revolutions before it and 3 revolutions after it:"),
    ],
)
def test_each_end_beyond_the_evidence_is_named(before, after, by):
    assert by in str(note("beyond_angle", before=before, after=after))


def test_a_fault_is_a_sentence_and_a_part_of_one():
    both = warning("clipped", channel="z", unit="-", levels=(-1.0, 1.0), samples=12, share=0.12)
    assert str(both) == "Channel 'z' is clipped at -1 and 1: 12 samples, 12 %."
    assert both.clause == "channel 'z' is clipped at -1 and 1: 12 samples, 12 %"
    assert failure("wraps_round", channel="z", bits=16, jumps=1).clause.endswith("its whole range, once")
    alone = note("missing_samples", channels=("z",), first=1.0, last=2.0, samples=5, of=1)
    assert str(alone) == "Channel 'z' misses 5 samples from 1 to 2 s."


def test_findings_that_shafts_share_are_told_once():
    each = [note("speed_constant", hz=hz) for hz in (10.0, 10.0, 12.0)]
    assert list(dict.fromkeys(each)) == [each[0], each[2]]
