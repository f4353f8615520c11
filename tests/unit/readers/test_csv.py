"""Text tables in the shapes that other programs write."""

import numpy as np
import pytest

from floquid.errors import InputError
from floquid.readers import describe_file, read

NAN = np.nan


def table(tmp_path, data, **options):
    path = tmp_path / "run.csv"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return read(path, **options)


@pytest.mark.parametrize(
    "text",
    [
        "time [s],x [m],y [V]\n0,1.5,2\n0.1,-2.5,\n0.2,3e1,nan\n",
        "\ufefftime [s],x [m],y [V]\n0,1.5,2\n0.1,-2.5,\n0.2,3e1,nan\n",
        "time [s],x [m],y [V]\r\n0,1.5,2\r\n0.1,-2.5,\r\n0.2,3e1,NaN\r\n\r\n\r\n",
        "time [s];x [m];y [V]\n0;1.5;2\n0.1;-2.5;\n0.2;3e1;nan",
        "time [s];x [m];y [V]\n0;1,5;2\n0,1;-2,5;\n0,2;3e1;nan\n",
        "time [s]\tx [m]\ty [V]\n0\t1.5\t2\n0.1\t-2.5\t\n0.2\t3e1\tnan\n",
        "# made by hand\n\ntime [s], x [m], y [V]\n0, 1.5, 2\n# half-way\n0.1, -2.5,  \n0.2, 3e1, nan\n,,\n,,\n",
        '"time [s]","x [m]","y [V]"\n"0","1.5","2"\n"0.1","-2.5",""\n"0.2","3e1","nan"\n',
        "time [s],x [m],y [V],\n0,1.5,2,\n0.1,-2.5,,\n0.2,3e1,nan,\n",
        "t,x (m),y (V)\n0,1.5,2\n0.1,-2.5,\n0.2,3e1,nan\n",
        "Time (ms),x [m],y [V]\n0,1.5,2\n100,-2.5,\n200,3e1,nan\n",
        "ms,x [m],y [V]\n0,1.5,2\n100,-2.5,\n200,3e1,nan\n",
        "time_us,x [m],y [V]\n0,1.5,2\n100000,-2.5,\n200000,3e1,nan\n",
        "clock [s],x [m],y [V]\n0,1.5,2\n0.1,-2.5,\n0.2,3e1,nan\n",
        "time,x,y\ns,m,V\n0,1.5,2\n0.1,-2.5,\n0.2,3e1,nan\n",
        "Analyser 3000\nRate, 10 Hz\nChannels,2\n\ntime [s],x [m],y [V]\n0,1.5,2\n0.1,-2.5,\n0.2,3e1,nan\n",
        "Run;7\nBy;me\n\nTime;x;y\ns;m;V\n0;1,5;2\n0,1;-2,5;\n0,2;3e1;nan\n",
        "Weights:\t1\t2\ntime [s]\tx [m]\ty [V]\n0\t1.5\t2\n0.1\t-2.5\t\n0.2\t3e1\tnan\n",
        "x [m],Time,y [V]\n1.5,0,2\n-2.5,0.1,\n3e1,0.2,nan\n",
    ],
)
def test_dialects(tmp_path, text):
    record = table(tmp_path, text)
    np.testing.assert_array_equal(record.values, [[1.5, -2.5, 30.0], [2.0, NAN, NAN]])
    assert [(c.name, c.unit, c.quantity) for c in record.channels] == [("x", "m", "displacement"), ("y", "V", "other")]
    assert record.sample_rate == 10.0
    assert record.start == 0.0
    assert record.clock is None


def test_what_is_above_the_header_and_a_time_without_a_unit_are_told(tmp_path):
    steps = table(tmp_path, "Analyser 3000\nRate,10\n\ntime,x\n0,1\n1,2\n2,3\n").provenance.steps
    assert "What is above the header, down to line 2, was read past." in steps
    told = "`time` has no unit: its times are taken for seconds (others would be `time [ms]`)."
    assert told in steps
    assert told in describe_file(tmp_path / "run.csv").notes
    for head in ("time [s]", "time_ms", "ms"):
        assert "no unit" not in str(table(tmp_path, f"{head},x\n0,1\n1,2\n2,3\n").provenance.steps)


def test_a_remark_in_parentheses_is_part_of_the_name(tmp_path):
    record = table(tmp_path, "time,tip x (fixed frame),a (m/s^2),b [raw (V)]\n0,1,2,3\n1,2,3,4\n")
    assert [(c.name, c.unit) for c in record.channels] == [
        ("tip x (fixed frame)", "-"),
        ("a", "m/s^2"),
        ("b", "raw (V)"),
    ]


def test_minutes_and_names_that_only_begin_like_a_time(tmp_path):
    record = table(tmp_path, "time [min],torque,t [m],tip\n0,1,2,3\n0.5,2,3,4\n1,2,3,4\n")
    assert record.sample_rate == 1.0 / 30.0
    assert [c.name for c in record.channels] == ["torque", "t", "tip"]


def test_without_times_the_rate_is_given(tmp_path):
    record = table(tmp_path, "x,y\n1,2\n3,4\n5,6\n", rate=50.0)
    assert (record.sample_rate, record.start, record.n_samples) == (50.0, 0.0, 3)
    found = describe_file(tmp_path / "run.csv")
    assert found.sample_rate is found.duration is found.start is None
    assert any("pass `rate=`" in note for note in found.notes)


def test_a_rate_that_is_given_makes_the_times_of_no_account(tmp_path):
    record = table(tmp_path, "time,x\n12:00:01,1\n12:00:01,2\n12:00:02,3\n", rate=4.0)
    np.testing.assert_array_equal(record.values, [[1.0, 2.0, 3.0]])
    assert "The time column `time` was ignored." in record.provenance.steps


def test_a_blank_line_is_not_skipped_where_it_may_be_a_sample(tmp_path):
    with pytest.raises(InputError, match=r"blank line.*line 3"):
        table(tmp_path, "x\n1\n\n3\n", rate=4.0)
    assert table(tmp_path, "time,x\n0,1\n\n1,3\n").n_samples == 2


def test_a_column_of_text_does_not_matter_when_others_are_chosen(tmp_path):
    record = table(tmp_path, "time,x,remark\n0,1,start\n1,2,\n2,3,end\n", channels=["x"])
    np.testing.assert_array_equal(record.values, [[1.0, 2.0, 3.0]])


def test_gaps_become_missing_samples(tmp_path):
    rows = [f"{k / 256:.6f},{k}\n" for k in range(300) if k not in (10, 11, 200)]
    record = table(tmp_path, "time,x\n" + "".join(rows))
    assert (record.sample_rate, record.n_samples) == (256.0, 300)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(record.values[0])), [10, 11, 200])
    assert any("2 gaps" in step and "3 samples marked missing" in step for step in record.provenance.steps)
    assert describe_file(tmp_path / "run.csv").channels[0].n_missing == 3


def test_a_header_edited_after_writing_is_believed(tmp_path):
    from floquid.core import Record
    from floquid.readers import write

    path = tmp_path / "run.csv"
    write(Record(values=np.eye(2, 5), sample_rate=3.0, channels=["x", "y"]), path)
    path.write_text(path.read_text().replace(",y [-]", ",z [N]"))
    assert [(c.name, c.quantity) for c in read(path).channels] == [("x", "displacement"), ("z", "force")]


def test_a_record_whose_times_a_table_cannot_tell_apart_is_not_written(tmp_path):
    from floquid.core import Record
    from floquid.readers import write

    late = Record(values=np.eye(2, 5), sample_rate=1e6, channels=["x", "y"], start=1e12)
    with pytest.raises(InputError, match=r"Write it as \.npz"):
        write(late, tmp_path / "run.csv")
    assert not list(tmp_path.iterdir())
    write(late, tmp_path / "run.npz")
    assert read(tmp_path / "run.npz").start == 1e12


def test_an_unusable_time_axis_is_described(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time,x\n0,1\n1,2\n0.5,3\n")
    found = describe_file(path)
    assert found.sample_rate is None
    assert found.n_samples == 3
    assert any("goes back in `time`" in note for note in found.notes)


def union(fast=50, slow=20, seconds=10):
    """Two channels of a logger on the union of their times, in hundredths of a second."""
    ticks = range(100 * seconds)
    cells = [(k, "1.5" if k % (100 // fast) == 0 else "", "-2" if k % (100 // slow) == 0 else "") for k in ticks]
    return "time [s],x,z,y\n" + "".join(f"{k / 100:.2f},{x},{x},{y}\n" for k, x, y in cells if x or y)


def test_channels_of_two_rates_on_the_union_of_their_times_are_told_apart(tmp_path):
    with pytest.raises(InputError, match=r"own in `time \[s\]`: x, z at 50 Hz; y at 20 Hz.\n.*`channels=`.*x,z"):
        table(tmp_path, union())
    fast, slow = table(tmp_path, union(), channels=["x", "z"]), table(tmp_path, union(), channels=["y"])
    assert (fast.sample_rate, fast.n_samples, slow.sample_rate, slow.n_samples) == (50.0, 500, 20.0, 200)
    assert not np.isnan(fast.values).any()
    assert (
        "200 of 600 rows hold the channels asked for: the others are at times between theirs." in slow.provenance.steps
    )
    assert describe_file(tmp_path / "run.csv").sample_rate is None


def test_every_other_sample_of_a_channel_may_be_missing(tmp_path):
    record = table(tmp_path, union(50, 25))
    assert record.sample_rate == 50.0
    assert np.isnan(record.values[2]).sum() == 250
