"""`floquid convert`, typed: from each format to each, what is lost, and what is refused."""

import numpy as np
import pytest
from tests.cli.test_commands import typed

from floquid.core import PulseTimes, Record
from floquid.readers import FORMATS, read, write

EVERY_SUFFIX = [kind.suffix for kind in FORMATS if kind.save]


def test_one_record_through_all_formats_and_back(here):
    before = "good.npz"
    for suffix in EVERY_SUFFIX:
        after = f"next{suffix}"
        text = typed(["convert", before, after])
        assert text == f"Written to {after}: 4 channels, 320 samples at 1.273239545 Hz.\n"
        before = after
    first, last = read("good.npz"), read(before)
    np.testing.assert_array_equal(first.values, last.values)
    assert (first.sample_rate, first.channels) == (last.sample_rate, last.channels)


def test_the_options(here):
    typed(
        ["convert", "good.npz", "few.csv", "--channels", "Y,X", "--rate", "50", "--period", "0.16", "--origin", "0.02"]
    )
    found = read("few.csv")
    assert [c.name for c in found.channels] == ["Y", "X"]
    assert (found.sample_rate, found.clock.period, found.clock.origin) == (50.0, 0.16, 0.02)
    typed(["convert", "good.npz", "few.h5", "--frequency", "4"])
    assert read("few.h5").clock.period == 0.25


def test_what_is_lost_is_said(here):
    good = read("good.npz")
    write(Record(values=good.values, sample_rate=1.0, channels=good.channels, orbit=np.ones((4, 8))), "run.npz")
    assert "Not kept: the orbit.\n" in typed("convert run.npz run.uff")
    assert "Not kept" not in typed("convert run.npz run.csv")
    clock = PulseTimes(times=[0.0, 1.0, 2.0])
    from floquid.cli.commands.convert import differences

    tied = Record(values=good.values, sample_rate=1.0, channels=good.channels, clock=clock)
    assert differences(tied, good) == ["the rate of 1.0 Hz", "the clock"]


@pytest.mark.parametrize("out", ["good.npz", "out/../good.npz", "same.npz", "hard.npz"])
def test_the_file_itself_is_refused(out, here):
    (here / "same.npz").symlink_to("good.npz")
    (here / "hard.npz").hardlink_to("good.npz")
    before = (here / "good.npz").read_bytes()
    typed(["convert", "good.npz", out], 2, f"`OUT` must be another file, but {out} is the file that is read")
    assert (here / "good.npz").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            "convert none.csv run.npz",
            "`FILE` must be the path of a file that can be read, but there is no file none.csv",
        ),
        ("convert good.npz run.xyz", "`OUT` must end in one of .npz, .csv"),
        ("convert good.npz nowhere/run.csv", "`OUT` must be a path that can be written, but there is no folder"),
        ("convert good.npz out", "out is a folder"),
        ("convert good.npz good.npz", "`OUT` must be another file, but good.npz is the file that is read"),
        ("convert good.npz run.csv --channels X,Z", "`--channels` must name channels of the record, but has 'Z'"),
        ("convert good.npz run.csv --rate -1", "`--rate` must be positive [Hz]"),
        ("convert good.npz run.csv --period 1 --frequency 1", "--frequency"),
        ("convert good.npz", "OUT"),
    ],
)
def test_bad_input(words, message, here):
    typed(words, 2, message)
    assert not (here / "run.csv").exists()


def test_an_existing_file_outlives_a_record_that_cannot_be_written(here):
    write(Record(values=np.ones((1, 4)), sample_rate=1e6, channels=["x"], start=1e12), "late.npz")
    (here / "run.csv").write_text("before")
    typed("convert late.npz run.csv", 2, "have times that a table of numbers can tell apart")
    assert (here / "run.csv").read_text() == "before"


def test_the_help_names_every_format(here):
    text = " ".join(typed("convert --help").replace("│", " ").split())
    read_too = ", ".join(kind.suffix for kind in FORMATS)
    assert ", ".join(EVERY_SUFFIX) in text
    assert read_too in text
    for command, suffixes in (("info", read_too), ("identify", read_too), ("scan", read_too), ("simulate", ".csv")):
        assert suffixes in " ".join(typed(f"{command} --help").replace("│", " ").split())
