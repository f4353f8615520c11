"""Universal files of other programs and of ours: rates behind six digits, names, units, and every kind of damage.

pyuff, which shares no code with the reader, writes and reads the files beside it.
"""

import re
import warnings

import numpy as np
import pytest
import pyuff

from floquid.core import Channel, ConstantPeriod, Record
from floquid.errors import InputError
from floquid.readers import describe_file, read, write
from floquid.tables import nominal_rate_of_step, printed

VALUES = np.random.default_rng(5).standard_normal(30)
FOUR_PARTS = r"Argument `\w+` of `read` must .+, but .+\.\n  \S.+\."


def function(values=VALUES, **changes):
    """The bytes of one dataset 58 as a careful program writes it, but for `changes`."""
    o = {
        "ids": ["NONE"] * 5, "function": 1, "entity": "NONE", "node": 12, "direction": 1, "reference": (0, 0),
        "data_type": 4, "points": len(values), "even": 1, "start": " 0.00000e+00", "step": " 1.00000e-03",
        "abscissa": (17, "Time", "s"), "ordinate": (12, "Acceleration", "m/s^2"), "binary": True, "order": 1,
        "format": 2, "bytes": None, "body": None, "times": None, "closing": b"    -1\n",
    } | changes  # fmt: skip
    if o["body"] is None:
        o["body"] = body(values, o)
    size = len(o["body"]) if o["bytes"] is None else o["bytes"]
    kind = f"{58:6d}b{o['order']:6d}{o['format']:6d}{11:12d}{size:12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    ref = o["reference"]
    lines = [
        "    -1",
        kind if o["binary"] else f"{58:6d}",
        *o["ids"],
        f"{o['function']:5d}{0:10d}{0:5d}{0:10d}" + point(o["entity"], o["node"], o["direction"]) + point("NONE", *ref),
        f"{o['data_type']:10d}{o['points']:10d}{o['even']:10d}{o['start']:>13s}{o['step']:>13s}{0.0:13.5e}",
        *(f"{k:10d}{0:5d}{0:5d}{0:5d} {label:20s} {unit:20s}" for k, label, unit in (o["abscissa"], o["ordinate"])),
        *[f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}"] * 2,
    ]
    return "\n".join(lines).encode() + b"\n" + o["body"] + o["closing"]


def point(entity, node, direction):
    return f" {entity:10s}{node:10d}{direction:4d}"


def body(values, o):
    size = 8 if o["data_type"] in (4, 6) else 4
    if o["binary"]:
        order = "<" if o["order"] == 1 else ">"
        if o["times"] is None:
            return np.asarray(values, f"{order}f{size}").tobytes()
        pairs = np.empty(len(values), dtype=[("x", f"{order}f4"), ("y", f"{order}f{size}")])
        pairs["x"], pairs["y"] = o["times"], values
        return pairs.tobytes()
    width, a_line = ("%20.12E", 4) if size == 8 else ("%13.5E", 6)
    numbers = [width % value for value in values]
    if o["times"] is not None:
        numbers, a_line = [f"{time:13.5E}{number}" for time, number in zip(o["times"], numbers, strict=True)], 2
    return "".join("".join(numbers[k : k + a_line]) + "\n" for k in range(0, len(numbers), a_line)).encode()


def text_set(number, *lines):
    return "\n".join(["    -1", f"{number:6d}", *lines, "    -1", ""]).encode()


def saved(tmp_path, *datasets, name="run.uff"):
    path = tmp_path / name
    path.write_bytes(b"".join(datasets))
    return path


def notes(record):
    return " ".join(record.provenance.steps)


# The step printed to six digits.


@pytest.mark.parametrize(
    ("rate", "n", "drift"),
    [(51200, 600 * 51200, "78.6"), (44100, 26_460_000, "43.1"), (4096, 245_760, "0.377"), (48000, 1_000_000, "1.6")],
)
def test_a_nominal_rate_is_found_behind_its_step(rate, n, drift):
    from floquid.readers.uff._channels import _rate_of

    found, words = _rate_of(printed(f"{1 / rate:13.5e}"), n)
    assert found == rate
    assert f"would drift by {drift} samples over the record" in words
    assert float(drift) == pytest.approx(abs(float(f"{1 / rate:.5e}") * rate - 1) * n, rel=1e-2)


@pytest.mark.parametrize(
    "rate",
    [
        51200,
        25600,
        2048,
        4096,
        81920,
        10240,
        102400,
        44100,
        48000,
        64000,
        1e4,
        2500,
        1000 / 3,
        6250,
        100,
        0.5,
        1e6,
        2001,
        3e5,
    ],
)
@pytest.mark.parametrize("form", ["{:.5e}", "{:.5E}", "{:.6e}", "{:.11e}", "{!r}", "single"])
def test_round_rates_are_exact_with_any_number_of_digits(rate, form):
    text = f"{float(np.float32(1 / rate)):.9e}" if form == "single" else form.format(1 / rate)
    found = nominal_rate_of_step(printed(text))
    if form == "{!r}" and len(text) < 10:  # 0.001: three digits at most, which may be a rounded number of any kind
        assert found in (None, rate)
    else:
        assert found == rate


@pytest.mark.parametrize("rate", [7600 / 3, 12346.789, 1234.567, 5001, 6400.03136, 1652.9, 2048.5, 51205.0])
def test_other_rates_are_left_as_printed(rate):
    step = printed(f"{1 / rate:13.5e}")
    assert nominal_rate_of_step(step) is None


def test_a_step_of_eleven_microseconds_and_a_rate_beside_it_print_alike():
    step = printed(f"{1 / 12345.678:13.5e}")  # 8.10000e-05, as is that of 12345.679 Hz
    assert step.text == "8.10000e-05"
    assert nominal_rate_of_step(step) == 1 / step.value  # nothing is changed: no whole number of hertz is made of it


@pytest.mark.parametrize("text", ["0.000020", "2.0e-5", "1.95e-05", "0.02", "1.E-04", "2D-5"])
def test_few_digits_are_no_evidence(text):
    assert nominal_rate_of_step(printed(text)) is None


def test_the_rate_and_what_is_said_of_it(tmp_path):
    record = read(saved(tmp_path, function(step="1.95313e-05")))
    assert record.sample_rate == 51200.0
    assert (
        "Sampling rate 51200 Hz: nominal; the header's 1.95313e-05 s is rounded to 6 digits, and agrees. "
        "`rate=` overrides it."
    ) in record.provenance.steps
    record = read(saved(tmp_path, function(np.zeros(200_000), step="3.94737e-04")))
    assert record.sample_rate == 1 / 3.94737e-4
    assert "known to 6 digits only. The true one may drift by up to 0.253 samples" in notes(record)
    assert "No round rate is clearly meant; `rate=` overrides it." in notes(record)
    record = read(saved(tmp_path, function(step="1.95313e-05")), rate=51199.0)
    assert record.sample_rate == 51199.0
    assert "Sampling rate 51199 Hz: as given; the file states 51200 Hz." in record.provenance.steps


def test_a_start_of_few_digits_is_said(tmp_path):
    record = read(saved(tmp_path, function(start=" 1.23457e+02")))
    assert record.start == 123.457
    assert "The start 1.23457e+02 s is known to 6 digits only, or 0.5 samples: so is the phase at it." in notes(record)
    assert "The start" not in notes(read(saved(tmp_path, function(start="-2.50000e-01"))))


def test_milliseconds(tmp_path):
    record = read(saved(tmp_path, function(step="1.95313e-02", start="-1.0e+00", abscissa=(17, "Time", "ms"))))
    assert (record.sample_rate, record.start) == (51200.0, -0.001)


# What pyuff writes, and what it reads.


def written_by_pyuff(path, values, capsys, *, step, uneven=None, **changes):
    x = np.arange(values.shape[1]) * step if uneven is None else uneven
    for k, row in enumerate(values):
        dataset = pyuff.prepare_58(
            func_type=1, rsp_node=k + 1, rsp_dir=3, ref_node=0, ref_dir=0, data=row, x=x, id1=f"hit of {k}",
            abscissa_spacing=int(uneven is None), abscissa_spec_data_type=17,
            ordinate_spec_data_type=8, orddenom_spec_data_type=0, **changes,
        )  # fmt: skip
        single = dataset["ord_data_type"] == 2
        pyuff.UFF(str(path)).write_sets(dataset, "add", force_double=not single)
    capsys.readouterr()


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # of pyuff, where it writes bytes
@pytest.mark.parametrize(("binary", "data_type"), [(0, 4), (0, 2), (1, 4)])
@pytest.mark.parametrize("is_even", [True, False])
def test_what_pyuff_writes_is_read(tmp_path, capsys, binary, data_type, is_even):
    path, values = tmp_path / "run.unv", np.random.default_rng(2).standard_normal((3, 41))
    uneven = None if is_even else np.delete(np.arange(42) / 1000, 20)
    written_by_pyuff(path, values, capsys, step=1e-3, uneven=uneven, binary=binary, ord_data_type=data_type)
    record = read(path)
    assert capsys.readouterr() == ("", "")
    assert record.sample_rate == 1000.0
    assert [channel.name for channel in record.channels] == ["1:+Z", "2:+Z", "3:+Z"]
    found = record.values if is_even else np.delete(record.values, 20, axis=1)
    assert record.n_samples == 41 if is_even else 42
    tolerance = 0.0 if binary else 1e-11 if data_type == 4 else 1e-5
    np.testing.assert_allclose(found, values, rtol=tolerance, atol=0)
    if not is_even:
        assert np.isnan(record.values[:, 20]).all()
        assert "The time column has 1 gap" in notes(record)


def test_what_is_written_is_read_by_pyuff(tmp_path):
    values = np.random.default_rng(3).standard_normal((2, 50))
    values[0, 3] = np.nan
    channels = [Channel(name="x", unit="m"), Channel(name="y of " + "a long name " * 12, unit="V", quantity="pulse")]
    record = Record(
        values=values, sample_rate=7600 / 3, channels=channels, start=-0.25, clock=ConstantPeriod(period=3 / 190)
    )
    write(record, tmp_path / "run.uff")
    found = pyuff.UFF(str(tmp_path / "run.uff")).read_sets()
    assert len(found) == 2
    for dataset, row in zip(found, values, strict=True):
        np.testing.assert_array_equal(dataset["data"], row)
        assert (dataset["func_type"], dataset["ord_data_type"], dataset["num_pts"]) == (1, 4, 50)
        assert dataset["abscissa_inc"] == 3.947368e-4
        assert dataset["abscissa_min"] == -0.25
    assert found[0]["id1"] == "x"
    assert found[0]["ordinate_axis_units_lab"] == "m"
    assert found[1]["ordinate_spec_data_type"] == 0
    assert found[0]["id2"] == "floquid rate=2533.3333333333335 Hz start=-0.25 s"
    assert read(tmp_path / "run.uff").channels == tuple(channels)


def test_written_again_by_pyuff_the_exact_rate_and_the_names_stay(tmp_path, capsys):
    channels = [Channel(name="tip, x", unit="µm"), Channel(name="y", unit="V", quantity="pulse", location="shaft")]
    record = Record(values=np.ones((2, 9)), sample_rate=7600 / 3, channels=channels, clock=ConstantPeriod(period=0.1))
    write(record, tmp_path / "ours.uff")
    sets = pyuff.UFF(str(tmp_path / "ours.uff")).read_sets()
    for dataset in sets:
        dataset["binary"] = 0
    pyuff.UFF(str(tmp_path / "theirs.uff")).write_sets(sets, "overwrite")
    capsys.readouterr()
    found = read(tmp_path / "theirs.uff")
    assert found.sample_rate == 7600 / 3
    assert found.clock == record.clock
    assert [c.name for c in found.channels] == ["tip, x", "y"]
    assert [c.unit for c in found.channels] == ["µm", "V"]


# Bytes and text.


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("data_type", [2, 4])
@pytest.mark.parametrize("closing", [b"    -1\n", b"\n    -1\n", b"\r\n    -1\r\n", b"    -1"])
def test_binary_blocks(tmp_path, order, data_type, closing):
    path = saved(tmp_path, function(order=order, data_type=data_type, closing=closing))
    found = read(path).values[0]
    np.testing.assert_array_equal(found, VALUES if data_type == 4 else VALUES.astype(np.float32))
    assert ("single precision" in notes(read(path))) == (data_type == 2)


def test_a_closing_mark_among_the_numbers_closes_nothing(tmp_path):
    data = bytearray(VALUES.tobytes())
    data[100:116] = b"\n    -1\n    -1\n "
    values = np.frombuffer(bytes(data))
    path = saved(tmp_path, function(values), function(VALUES, node=13))
    np.testing.assert_array_equal(read(path).values, [values, VALUES])
    assert pyuff.UFF(str(path)).get_n_sets() != 2  # which is why the count of bytes is gone by


def test_a_count_of_bytes_that_was_left_at_zero(tmp_path):
    np.testing.assert_array_equal(read(saved(tmp_path, function(bytes=0))).values[0], VALUES)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("data_type", [2, 4])
def test_uneven_abscissas_with_a_lost_sample(tmp_path, binary, data_type):
    times = np.delete(np.arange(31) / 1024, 7)
    record = read(saved(tmp_path, function(even=0, step="0.0", times=times, data_type=data_type, binary=binary)))
    assert record.sample_rate == 1024.0
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(record.values[0])), [7])
    np.testing.assert_allclose(np.delete(record.values[0], 7), VALUES, rtol=1e-5)
    record = read(tmp_path / "run.uff", rate=1000.0)
    assert (record.sample_rate, record.n_samples, record.start) == (1000.0, 30, 0.0)
    assert "The times in the file were ignored." in record.provenance.steps


@pytest.mark.parametrize(
    "text",
    [
        b"  1.00000D+00 -2.50000D+00  3.00000D+00\n          NaN\n",
        b"  1.00000E+00 -2.50000E+00  3.00000E+00          NaN",
        b"1 -2.5 3 nan\n",
        b"1.0\r\n-2.5\r\n3\r\nnan\r\n",
        b" 1.00000e+00 -2.5000e+00\n 3.00000e+00          nan\n",
        b" 1.00000e+000-2.50000e+000 3.00000e+000          nan\n",
        b"1.000000e+000-2.50000e+0003.000000e+000          nan\n",
    ],
)
def test_text_of_any_kind(tmp_path, text):
    data = function(VALUES[:4], binary=False, data_type=2, body=text, closing=b"\n    -1\n")
    np.testing.assert_array_equal(read(saved(tmp_path, data)).values[0], [1.0, -2.5, 3.0, np.nan])


@pytest.mark.parametrize("binary", [True, False])
def test_line_ends_of_windows(tmp_path, binary):
    data = function(binary=False).replace(b"\n", b"\r\n")
    if binary:
        head, mark = function(body=b"@@", bytes=VALUES.nbytes).split(b"@@")
        data = head.replace(b"\n", b"\r\n") + VALUES.tobytes() + mark.replace(b"\n", b"\r\n")
    path = saved(tmp_path, b"\xef\xbb\xbf", data, b"\r\n\r\n\x1a")
    np.testing.assert_allclose(read(path).values[0], VALUES, rtol=1e-11)
    assert read(path).channels[0].unit == "m/s^2"


# Names, units, and what is set aside.


def test_names_quantities_and_units(tmp_path):
    path = saved(
        tmp_path,
        function(node=12, direction=1, ordinate=(8, "", "m")),
        function(node=12, direction=-2, ordinate=(11, "", "mm/s")),
        function(node=3, direction=4, ordinate=(8, "", "deg")),
        function(node=4, direction=3, ordinate=(12, "", "G")),
        function(node=5, direction=3, ordinate=(13, "", "NONE")),
        function(node=6, direction=3, ordinate=(12, "", "V")),
        function(node=7, direction=3, ordinate=(12, "", "m")),
        function(node=0, direction=0, entity="TACHO", ordinate=(1, "", "V")),
        function(node=0, direction=0, ids=["µ-strain of the blade", *["NONE"] * 4], ordinate=(3, "", "µε")),
    )
    record = read(path)
    assert [(c.name, c.quantity, c.unit, c.location, c.direction) for c in record.channels] == [
        ("12:+X", "displacement", "m", "12", "+X"),
        ("12:-Y", "velocity", "mm/s", "12", "-Y"),
        ("3:+RX", "displacement", "deg", "3", "+RX"),
        ("4:+Z", "acceleration", "g", "4", "+Z"),
        ("5:+Z", "force", "-", "5", "+Z"),
        ("6:+Z", "acceleration", "V", "6", "+Z"),
        ("7:+Z", "other", "m", "7", "+Z"),
        ("TACHO", "pulse", "V", "TACHO", ""),
        ("µ-strain of the blade", "strain", "µε", "", ""),
    ]
    assert "'7:+Z' says acceleration and 'm', which contradict each other" in notes(record)
    assert read(path, channels=["TACHO", "12:-Y"]).n_channels == 2


def test_labels_in_the_code_page_of_windows(tmp_path):
    data = function(ordinate=(8, "Weg", "µm")).decode("latin-1").replace("Âµ", "µ").encode("latin-1")
    assert b"\xb5m" in data
    assert read(saved(tmp_path, data)).channels[0].unit == "µm"


def test_names_are_as_long_as_it_takes(tmp_path):
    same = {"ids": ["left", *["NONE"] * 4], "entity": "BLADE"}
    assert [c.name for c in read(saved(tmp_path, function(**same), function(node=2, **same))).channels] == [
        "12:+X",
        "2:+X",
    ]
    path = saved(tmp_path, function(entity="BLADE"), function(entity="HUB"))
    assert [c.name for c in read(path).channels] == ["BLADE 12:+X", "HUB 12:+X"]
    path = saved(tmp_path, function(ids=["left"] * 5), function(ids=["right"] * 5))
    assert [c.name for c in read(path).channels] == ["left", "right"]
    path = saved(tmp_path, function(ids=["left"] * 5), function(node=2, ids=["right"] * 5))
    assert [c.name for c in read(path, channels=["right", "12:+X"]).channels] == ["2:+X", "12:+X"]


def test_without_any_name_they_are_counted(tmp_path):
    path = saved(tmp_path, function(node=0, direction=0), function(node=0, direction=0))
    assert [c.name for c in read(path).channels] == ["function 1", "function 2"]


def test_what_else_the_file_holds_is_said(tmp_path):
    path = saved(
        tmp_path,
        text_set(151, "a model", "NONE"),
        text_set(164, f"{5:10d}{'mm (milli newton)':20s}{2:10d}", "1.0D+03 1.0D+03 1.0D+00", "2.7D+02"),
        text_set(15, "1 0 0 0 0.0 0.0 0.0"),
        text_set(15, "2 0 0 0 0.0 0.0 0.0"),
        function(np.zeros(8), function=4, data_type=5, points=4, bytes=64),
        function(
            ids=["rap", "run 7", "01-Oct-25 10:00:00", "NONE", "NONE"], ordinate=(8, "", "NONE"), reference=(9, 3)
        ),
        text_set(99999, "whatever"),
    )
    record = read(path)
    assert record.channels == (Channel(name="12:+X", unit="mm", location="12", direction="+X"),)
    for words in [
        "The file also holds 1 dataset of type 151 (header), not used.",
        "The file also holds 2 datasets of type 15 (nodes), not used.",
        "The file also holds 1 dataset of type 99999, not used.",
        "The file also holds 1 function of type 4 (frequency response), not used.",
        "Dataset 164 states the unit system 5: it names the units that the functions do not.",
        "ID lines of '12:+X': rap | run 7 | 01-Oct-25 10:00:00",
        "Reference of the functions: 9:+Z.",
    ]:
        assert words in record.provenance.steps
        assert words in describe_file(path).notes


def test_channels_that_go_together_can_be_chosen(tmp_path):
    path = saved(
        tmp_path,
        function(),
        function(VALUES[:20], node=13),
        function(node=14),
        function(node=15, step="2.00000e-03"),
    )
    words = "'12:+X' with 30 points of 0.001 from 0.0 s and '13:+X' with 20 points of 0.001 from 0.0 s"
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        read(path)
    assert "`channels=`: 12:+X, 14:+X | 13:+X | 15:+X." in str(caught.value)
    assert read(path, channels=["14:+X", "12:+X"]).values.shape == (2, 30)
    assert read(path, channels=["13:+X"]).n_samples == 20


# Bad files.


OURS = ["x", "floquid rate=1000.0 Hz start=0.0 s", "NONE", "NONE", "NONE"]
GOOD = function()
BAD = {
    "an archive": (b"PK\x03\x04" + bytes(200), "be a universal file", "PK", "Name it by its format"),
    "text": (b"time [s],x [m]\n0,1\n1,2\n", "first line is `    -1`", "begins with 'time [s],x [m]", "Name it"),
    "blank": (b"\n \n\n", "nothing but blank lines", "Export"),
    "random bytes": (np.random.default_rng(0).bytes(5000), "be a universal file", "begins with", "Name it"),
    "UTF-16": (function(binary=False).decode().encode("utf-16"), "be a universal file", "Name it"),
    "an opening alone": (b"    -1\n", "state the type", "has nothing", "Copy"),
    "no type": (b"    -1\nhello\n    -1\n", "state the type", "'hello'", "Copy"),
    "type and rubbish": (GOOD.replace(b"    58b", b"    58x"), "state the type", "58x", "Copy"),
    "cut in its header": (GOOD[:300], "ends inside the header", "Copy"),
    "cut in its numbers": (GOOD[:-50], "hold its binary datasets whole", "declares 240 bytes", "are left", "Copy"),
    "cut in its mark": (GOOD[:-4], "closed by `    -1`", "does not end there", "Copy"),
    "cut text": (function(binary=False)[:-30], "close each dataset", "cut short", "Copy"),
    "another set cut": (GOOD + text_set(15, "1 2 3")[:-8], "close each dataset", "of type 15", "Copy"),
    "text after it": (GOOD + b"the end\n", "between two lines", "'the end'", "Copy"),
    "bytes after it": (GOOD + bytes(3), "between two lines", "Copy"),
    "no function": (
        text_set(15, "1") + function(function=4) + text_set(15, "2"),
        "hold time responses", "2 datasets of type 15 (nodes), 1 function of type 4 (frequency response)", "Export",
    ),
    "complex": (function(data_type=6, points=15), "real numbers", "complex ordinates in '12:+X'", "`channels=`"),
    "an unknown type": (function(data_type=3), "headers of dataset 58", "line 7", "Mend"),
    "byte order 3": (
        GOOD.replace(b"b     1", b"b     3"), "say the byte order", "'3     2", "Copy",
    ),
    "byte order, wrong": (GOOD.replace(b"b     1", b"b     2"), "declares 2 for '12:+X'", "Set the first number"),
    "byte order, wrong, single": (
        function(data_type=2).replace(b"b     1", b"b     2"), "declares 2 for '12:+X'", "Set the first number",
    ),
    "VAX floats": (function(format=1), "IEEE 754", "DEC VMS (1)", "Export"),
    "too many points": (function(points=31), "the points that it declares", "31", "240 bytes", "248", "line 7"),
    "too few points": (function(points=29), "the points that it declares", "29", "240 bytes", "line 7"),
    "a great many points": (function(points=10**10 - 1), "the points that it declares", "9999999999", "line 7"),
    "a great many of text": (function(points=10**10 - 1, binary=False), "cannot hold as many", "line 7"),
    "a great many bytes": (function(bytes=10**11, points=10**9), "declares 100000000000 bytes", "are left", "Copy"),
    "one point less of text": (function(binary=False, points=31), "declares 31 for '12:+X' and holds 30", "line 7"),
    "negative points": (function(points=-5), "headers of dataset 58", "line 7", "Mend"),
    "no points": (function(np.empty(0)), "holds none", "Export"),
    "one point": (function(np.ones(1)), "at least two samples", "Export"),
    "text for a number": (
        function(binary=False).replace(b"E-01", b"Q-01", 1), "hold numbers", "of '12:+X', in line 1 under", "Mend",
    ),
    "text for a count": (GOOD.replace(b"        30", b"     thirt"), "line 7", "Mend"),
    "an underscore": (GOOD.replace(b"        30", b"       3_0"), "line 7", "Mend"),
    "zero step": (function(step="0.00000e+00"), "positive step", "0.00000e+00", "`rate=`"),
    "negative step": (function(step="-1.0000e-03"), "positive step", "-1.0000e-03 s for '12:+X'", "`rate=`"),
    "tiny step": (function(step="1.0000e-320"), "positive step", "1.0000e-320", "`rate=`"),
    "infinite step": (function(step="inf"), "line 7", "Mend"),
    "step beyond floats": (function(step="1.00000e+999"), "line 7", "Mend"),
    "NaN for the start": (function(start="nan"), "line 7", "Mend"),
    "a direction of 7": (function(direction=7), "line 6", "Mend"),
    "control letters": (function(ids=["a\x07b", *["NONE"] * 4]), "line 1", "Mend"),
    "infinite": (function(np.r_[np.inf, VALUES]), "hold finite samples", "'12:+X', sample 0", "NaN"),
    "float overflow": (
        function(VALUES[:4], binary=False, body=b"1.0E+999 1 1 1\n"), "hold finite samples", "'12:+X'", "NaN",
    ),
    "frequencies": (function(abscissa=(18, "Frequency", "Hz")), "times in seconds", "type 18 in 'Hz'", "Export"),
    "unknown unit of time": (function(abscissa=(17, "", "rev")), "times in seconds", "'rev'", "`rate=`"),
    "two of one name": (GOOD + GOOD, "apart", "'12:+X' twice, at bytes 7 and", "one run a file"),
    "steps that differ": (GOOD + function(node=1, step="2.0e-3"), "of one step", "'12:+X'", "'1:+X'", "`channels=`"),
    "starts that differ": (GOOD + function(node=1, start="1.0"), "of one step", "'12:+X'", "'1:+X'", "`channels=`"),
    "times that differ": (
        function(even=0, times=np.arange(30.0)) + function(even=0, times=np.arange(30.0) + 1, node=1),
        "the same times", "'1:+X' than for '12:+X'", "`channels=`",
    ),
    "times going back": (function(even=0, times=-np.arange(30.0)), "goes back in `abscissa`", "Sort"),
    "our rate against the step": (
        function(ids=OURS, step="2.00000e-03"), "ID line 2 that agrees", "1000 Hz", "2.00000e-03 s", "`rate=`",
    ),
    "our start against it": (function(ids=OURS, start="1.0e+00"), "ID line 2 that agrees", "1.0e+00 s", "`rate=`"),
    "our rate, garbled": (function(ids=[OURS[0], "floquid rate=1e3x Hz start=0.0 s", *OURS[2:]]), "ID lines 2", "Mend"),
    "our rate, negative": (function(ids=[OURS[0], "floquid rate=-1 Hz start=0.0 s", *OURS[2:]]), "ID lines 2", "Mend"),
    "our origin, far": (
        function(ids=[*OURS[:3], "floquid period=1e-9 s origin=1e300 s", "NONE"]), "ID lines 2 and 4", "Mend",
    ),
    "our periods, differing": (
        function(ids=[*OURS[:3], "floquid period=1.0 s origin=0.0 s", "NONE"]) + function(ids=["y", *OURS[1:]]),
        "'x' with", "a period of 1.0 s", "'y' with", "no period", "`channels=`",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in BAD.values()], ids=BAD)
def test_bad_file(data, words, tmp_path, capsys):
    path = saved(tmp_path, data)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError) as caught:
            read(path)
    message = str(caught.value)
    assert str(path) in message
    assert re.fullmatch(FOUR_PARTS, message, re.DOTALL), message
    place = 0
    for word in words:
        assert word in message[place:], f"{word!r} is not in {message!r}"
        place = message.index(word, place)
    assert capsys.readouterr() == ("", "")


def test_the_table_starts_from_good_files(tmp_path):
    for data in (GOOD, function(binary=False), function(ids=OURS)):
        assert read(saved(tmp_path, data)).n_samples == 30


@pytest.mark.parametrize("step", ["0.00000e+00", "-1.0000e-03", "2.00000e-03"])
def test_a_rate_given_makes_a_bad_step_good(tmp_path, step):
    record = read(saved(tmp_path, function(step=step, ids=OURS)), rate=500.0)
    assert (record.sample_rate, record.n_samples) == (500.0, 30)


@pytest.mark.slow
def test_a_truncated_header_is_refused_at_every_byte(tmp_path):
    whole = function() + function(VALUES, node=13, binary=False)
    first = len(function())
    for cut in [*range(1, 700), *range(first + 5, first + 700), *range(len(whole) - 60, len(whole) - 1)]:
        with pytest.raises(InputError, match=r"run\.uff"):
            read(saved(tmp_path, whole[:cut]))


def test_words_of_ours_that_were_changed_are_passed_over(tmp_path):
    words = 'floquid {"quantity": "displacement", "unit": "m"}'
    path = saved(tmp_path, function(ids=[*OURS[:4], words], ordinate=(11, "Velocity", "m/s")))
    assert read(path).channels[0].quantity == "velocity"
    assert "its axis was changed since: the line is passed over." in notes(read(path))
    path = saved(tmp_path, function(ids=[*OURS[:4], words[:30]]))
    assert read(path).channels[0].name == "x"
    assert "ID line 5 of 'x' is not as floquid wrote it, and is passed over." in notes(read(path))
