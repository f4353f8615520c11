"""Text tables and workbooks as other programs export them: 50 Hz, x = 1, 2, 3, 4 and y = -1, -2, -3, -4."""

import numpy as np
import pytest

from floquid.errors import InputError
from floquid.readers import describe_file, read

X, Y = [1.0, 2.0, 3.0, 4.0], [-1.0, -2.0, -3.0, -4.0]


def rows(form, sep="\n", end="\n"):
    """Four rows: {k} is the row, {t} its time [s], {ms} that in milliseconds."""
    lines = [form.format(k=k, t=f"{0.02 * k:.2f}", ms=20 * k, x=f"{k + 1}.0", y=f"-{k + 1}.0") for k in range(4)]
    return sep.join(lines) + end


EXPORTS = {  # name: the suffix, the text, the names, the units
    "blanks": (".txt", "time x y\n" + rows("{t}  {x}  {y}"), "xy", "--"),
    "blanks, units apart": (".txt", " Time (s)  Tip x (mm)  Tip y (mm)\n" + rows("  {t} {x} {y}"), None, ["mm"] * 2),
    "blanks, names of two words": (".txt", "Time [s]    Tip x    Tip y\n" + rows("  {t}   {x}  {y}"), None, "--"),
    "blanks, units below": (".asc", "time x y\n(s) (mm) (mm)\n" + rows("{t} {x} {y}"), "xy", ["mm"] * 2),
    "tabs": (".tsv", "time [s]\tx [m]\ty [m]\n" + rows("{t}\t{x}\t{y}"), "xy", "mm"),
    "tabs and blanks": (".dat", "time [s]\tx [m]\ty [m]\n" + rows("{t} \t {x} \t {y}"), "xy", "mm"),
    "np.savetxt": (".csv", "# time [s],x [m],y [m]\n" + rows("{t},{x},{y}"), "xy", "mm"),
    "np.savetxt with blanks": (".dat", "# run 7\n# time x y\n" + rows("{t} {x} {y}"), "xy", "--"),
    "np.savetxt, commas over blanks": (".txt", "# time, x, y\n" + rows("{t} {x} {y}"), "xy", "--"),
    "np.savetxt, blanks over commas": (".csv", "# time x y\n" + rows("{t},{x},{y}"), "xy", "--"),
    "commas over blanks": (".dat", "time [s], x [m], y [m]\n" + rows("{t}  {x}  {y}"), "xy", "mm"),
    "MATLAB's comments": (".dat", "% time x y\n% s m m\n" + rows("{t} {x} {y}"), "xy", "mm"),
    "PicoScope": (".csv", "Time,x,y\n(ms),(mV),(mV)\n\n" + rows("{ms},{x},{y}"), "xy", ["mV"] * 2),
    "Rigol": (
        ".csv", "X,x,y,Start,Increment,\nSequence,Volt,Volt,-6.0e-03,2.0e-02\n" + rows("{k},{x},{y},"), "xy", "VV",
    ),
    "Rigol, newer": (".csv", "x,y,t0 =-2.5e-03, tInc = 2.0e-02,\n" + rows("{x},{y},,,"), "xy", "--"),
    "Keysight": (".csv", "x-axis,x,y\nsecond,Volt,Volt\n" + rows("{t},{x},{y}"), "xy", "VV"),
    "LabVIEW": (
        ".lvm",
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
        "Channels\t2\nSamples\t4\t4\nDate\t2024/05/01\nX0\t0.0\t0.0\nDelta_X\t0.02\t0.02\n***End_of_Header***\t\t\n"
        "X_Value\tx\ty\tComment\n" + rows("{t}\t{x}\t{y}"), "xy", "--",
    ),
    "LabVIEW without times": (
        ".lvm",
        "LabVIEW Measurement\t\nX_Columns\tNo\n***End_of_Header***\t\n\t\nChannels\t2\nDelta_X\t0.02\t0.02\n"
        "***End_of_Header***\t\t\nX_Value\tx\ty\tComment\n" + rows("\t{x}\t{y}"), "xy", "--",
    ),
    "LabVIEW with units": (
        ".lvm",
        "LabVIEW Measurement\t\n***End_of_Header***\t\n\t\nChannels\t2\nY_Unit_Label\tVolts\tN\nDelta_X\t0.02\t0.02\n"
        "***End_of_Header***\t\t\nX_Value\tx\ty\tComment\n" + rows("{t}\t{x}\t{y}"), "xy", "VN",
    ),
    "semicolons": (".csv", "Zeit [s];x [m];y [m]\n" + rows("{t};{x};{y}").replace(".", ","), "xy", "mm"),
    "tabs and commas": (".txt", "Zeit [s]\tx [m]\ty [m]\n" + rows("{t}\t{x}\t{y}").replace(".", ","), "xy", "mm"),
    "a rate above": (".csv", "Sampling rate:,50,Hz\nOperator,me\nx [m],y [m]\n" + rows("{x},{y}"), "xy", "mm"),
    "a rate in a comment": (".csv", "# fs = 0.05 kHz\nx [m],y [m]\n" + rows("{x},{y}"), "xy", "mm"),
    "a count called #": (".csv", "#,time [s],x [m],y [m]\n" + rows("{k},{t},{x},{y}"), "xy", "mm"),
    "a long comment": (".csv", "# a\n" * 300 + "time [s],x [m],y [m]\n" + rows("{t},{x},{y}"), "xy", "mm"),
    "Excel's first line": (".csv", "sep=;\ntime [s];x [m];y [m]\n" + rows("{t};{x};{y}"), "xy", "mm"),
    "Time(S)": (".csv", "Time(S),x,y\n" + rows("{t},{x},{y}"), "xy", "--"),
    "counts": (".csv", "nr,time [s],x,y\n" + rows("{k},{t},{x},{y}"), "xy", "--"),
    "an index without a name": (".csv", ",time [s],x,y\n" + rows("{k},{t},{x},{y}"), "xy", "--"),
    "times without a name": (".csv", ",x,y\n" + rows("{t},{x},{y}"), "xy", "--"),
    "milliseconds since 1970": (".csv", "timestamp,x,y\n" + rows("17145648000{ms:02d},{x},{y}"), "xy", "--"),
    "dates": (".csv", "Timestamp,x,y\n" + rows("2024-05-01 23:59:59.{ms:03d},{x},{y}"), "xy", "--"),
    "dates with a zone": (".csv", "when,x,y\n" + rows("2024-05-01T12:00:00.{ms:03d}+02:00,{x},{y}"), "xy", "--"),
    "dates in UTC": (".csv", "when,x,y\n" + rows("2024/05/01 12:00:00.{ms:03d}Z,{x},{y}"), "xy", "--"),
    "dates with commas": (".csv", "when,x,y\n" + rows("2024-05-01 12:00:00,{ms:03d},{x},{y}"), "xy", "--"),
    "dates with commas, semicolons": (
        ".csv", "when;x;y\n" + rows("2024-05-01 12:00:00,{ms:03d};{k},5;-{k},5"), "xy", "--",
    ),
    "dates and blanks": (".txt", "Timestamp x y\n" + rows("2024-05-01 12:00:00.{ms:03d} {x} {y}"), "xy", "--"),
    "dates and times apart": (".csv", "Date;Time;x;y\n" + rows("2024-05-01;12:00:00,{ms:03d};{x};{y}"), "xy", "--"),
    "dates beside times": (".csv", "date,time [s],x,y\n" + rows("2024-05-01,{t},{x},{y}"), "xy", "--"),
    "an end without a line's": (".csv", "time,x,y\n" + rows("{t},{x},{y}", end=""), "xy", "--"),
    "cut short": (".csv", "time,x,y\n" + rows("{t},{x},{y}") + "0.08,5", "xy", "--"),
}  # fmt: skip


def assert_read(path, names, units, **options):
    record = read(path, **options)
    assert record.sample_rate == 50.0
    shift = 0.5 if "semicolons" in path.stem and "dates" in path.stem else 0.0
    np.testing.assert_array_equal(record.values, [np.subtract(X, shift), np.add(Y, shift)])
    assert [channel.name for channel in record.channels] == list(names or ("Tip x", "Tip y"))
    assert [channel.unit for channel in record.channels] == list(units)
    return record


@pytest.mark.parametrize(("suffix", "text", "names", "units"), EXPORTS.values(), ids=EXPORTS)
def test_exports_of_other_programs(suffix, text, names, units, tmp_path, request):
    path = tmp_path / f"{request.node.callspec.id}{suffix}"
    path.write_text(text)
    assert_read(path, names, units)
    assert describe_file(path).sample_rate == 50.0


def test_what_was_read_in_another_way_is_said(tmp_path):
    said = {
        "counts": "`nr` counts the rows and is no channel; name it with `channels=` to read it all the same.",
        "an index without a name": "Column 1 counts the rows: it is no channel.",
        "times without a name": "Column 1 increases: it is taken for the time.",
        "Rigol": "Sampling rate 50 Hz: by `Increment` in line 1.",
        "LabVIEW without times": "Sampling rate 50 Hz: by `Delta_X` in line 6.",
        "a rate in a comment": "Sampling rate 50 Hz: by `fs` in line 1.",
        "dates": "The times are dates: they count from the first, 2024-05-01 23:59:59.000.",
        "dates beside times": "`date` holds dates and is no channel.",
        "cut short": "Line 6 has no line end and may be cut short: the file was read up to there.",
    }
    for name, words in said.items():
        suffix, text, *_ = EXPORTS[name]
        path = tmp_path / f"run{suffix}"
        path.write_text(text)
        assert words in read(path).provenance.steps, name


def test_of_several_rates_that_are_stated_none_is_taken(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("Sample rate A,50\nSample rate,100\nfs = 20\nx [m],y [m]\n" + rows("{x},{y}"))
    with pytest.raises(InputError, match="neither a rate nor a column of times"):
        read(path)


def test_a_counter_that_is_named_is_read(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(EXPORTS["counts"][1])
    assert read(path, channels=["nr", "x"]).channels[0].name == "nr"
    path.write_text("time,x,y\n0,1,5\n1,2,6\n2,3,7\n")  # by their names they are none
    assert [channel.name for channel in read(path).channels] == ["x", "y"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_letters_of_every_encoding(tmp_path, encoding):
    path = tmp_path / "run.csv"
    path.write_bytes(("Zeit [µs];Weg x [µm];Größe [°]\r\n" + rows("{ms}000;{x};{y}", "\r\n")).encode(encoding))
    record = read(path)
    assert [channel.name for channel in record.channels] == ["Weg x", "Größe"]
    assert (record.channels[0].quantity, record.sample_rate) == ("displacement", 50.0)
    assert ("it was read as Windows-1252" in str(record.provenance.steps)) == (encoding == "cp1252")


def test_a_table_without_a_header(tmp_path):
    path = tmp_path / "run.txt"
    path.write_text(rows("{t} {x} {y}"))
    with pytest.raises(InputError, match=r"begins with numbers \(line 1\)\.\n.*`header=False`"):
        read(path)
    record = read(path, header=False)
    assert [channel.name for channel in record.channels] == ["2", "3"]
    assert record.sample_rate == describe_file(path, header=False).sample_rate == 50.0
    assert "Column 1 increases: it is taken for the time." in record.provenance.steps
    assert read(path, header=False, channels=["3"]).sample_rate == 50.0
    path.write_text(rows("{y} {x} {t}"))
    assert [channel.name for channel in read(path, header=False, rate=50.0).channels] == ["1", "2", "3"]
    path.write_text("Run 7, by hand\n" + rows("{y};{x}"))
    assert [channel.name for channel in read(path, header=False, rate=50.0).channels] == ["1", "2"]
    (tmp_path / "run.wav").write_bytes(b"RIFF")
    with pytest.raises(InputError, match=r"be False for a text table alone, but .*run\.wav is a WAV file"):
        read(tmp_path / "run.wav", header=False)


def test_a_text_column_is_left_out_where_others_are_named(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time [s],x,remark,y\n" + rows("{t},{x},halt {k},{y}"))
    np.testing.assert_array_equal(read(path, channels=["x", "y"]).values, [X, Y])
    with pytest.raises(InputError, match=r"'halt 0' in line 2, column 'remark'"):
        read(path)


def test_a_long_table_with_holes_is_read_in_blocks(tmp_path):
    path, n = tmp_path / "run.csv", 40000
    path.write_text("time [s],x,y\n" + "".join(f"{k / 50:.2f},{'' if k % 3 else k},{k}\n" for k in range(n)))
    record = read(path, channels=["y", "x"])
    np.testing.assert_array_equal(record.values[0], np.arange(n))
    np.testing.assert_array_equal(record.values[1], np.where(np.arange(n) % 3, np.nan, np.arange(n)))
    path.write_text("time [s];x\n" + "".join(f"{k};{k // 20000},{k % 7}\n" for k in range(n)) + f"{n};1.5\n")
    with pytest.raises(InputError, match="one decimal mark in all its numbers"):
        read(path)
