"""Text tables at the command line: one without a header, and one whose channels have rates of their own."""

from pathlib import Path

import numpy as np
import pytest
from tests.cli.test_commands import typed

from floquid.readers import read


@pytest.fixture
def bare(here):
    """A table parted by blanks, without a line of names."""
    record = read("good.npz")
    times = np.arange(record.n_samples) / 50.0
    np.savetxt("bare.txt", np.vstack([times, record.values[:2]]).T, fmt=["%.2f", "%.9f", "%.9f"])


@pytest.mark.usefixtures("bare")
def test_a_table_without_a_header():
    typed("info bare.txt", 2, "as `time [s],x [m],y [m]`, or pass `--no-header`.")
    text = typed("info bare.txt --no-header")
    assert "bare.txt: text table (.txt), 2 channels, 320 samples, 50 Hz" in text
    assert "floquid identify bare.txt --no-header" in text
    assert "2 channels, 320 samples at 50 Hz" in typed("convert bare.txt named.csv --no-header --channels 2,3")
    assert Path("named.csv").read_text().splitlines()[1] == "time [s],2 [-],3 [-]"
    typed("convert good.npz named.csv --no-header", 2, "`--header` must be False for a text table alone")


@pytest.mark.usefixtures("bare")
def test_the_settings_keep_that_there_is_no_header():
    typed("identify bare.txt --no-header --period 0.16 --order 4 --no-validate --no-constrained --out out")
    assert "header = false\n" in Path("out/settings.toml").read_text()
    typed("identify bare.txt --settings out/settings.toml --no-validate --out again")
    Path("out/settings.toml").write_text("header = 3\n")
    typed("identify bare.txt --settings out/settings.toml", 2, "must be true or false, but is 3")


@pytest.mark.usefixtures("here")
def test_channels_of_two_rates_are_told_and_one_is_proposed():
    """At 50 and 20 Hz, on the union of their times."""
    lines = ["time [s],x [m],y [m]"]
    for ticks in range(600):  # of 10 ms
        x, y = (f"{np.cos(0.01 * ticks + every):.6f}" if ticks % every == 0 else "" for every in (2, 5))
        lines += [f"{0.01 * ticks:.2f},{x},{y}"] if x or y else []
    Path("union.csv").write_text("\n".join(lines) + "\n")
    text = typed("info union.csv")
    assert "Note: `FILE` must have its channels sampled together" in text
    assert "x at 50 Hz; y at 20 Hz" in text
    assert "Next: floquid info union.csv --channels x\n" in text
    assert "50 Hz" in typed("info union.csv --channels x")
