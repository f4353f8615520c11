"""Bad input, as a person meets it: one clear message on stderr, the documented exit code, an earlier result untouched.

Each row of `CASES` is a name, how its input is made in the current folder, the words typed, the exit code, and what
the message must say. `good.npz` is there; identify and demo write to `out`, which holds an earlier result, and simulate
to a file in it, unless the words say otherwise.
"""

import os
import pickle
import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
from tests.cli.conftest import EARLIER, after_stages, contents, hdf5, save_npz, simulated

from floquid.cli import run

PERIOD = repr(2.0 * np.pi)
GOOD = f"identify good.npz --period {PERIOD}"
THIS = f"identify this.npz --period {PERIOD}"
VALUES = simulated().values
NOISE = np.random.default_rng(0).standard_normal(VALUES.shape)


def nothing():
    """`good.npz` is all that is needed."""


def npz(values=None, name="this.npz", **changes):
    return lambda: save_npz(name, values, **changes)


def file(content, name="this.npz"):
    return lambda: Path(name).write_bytes(content.encode() if isinstance(content, str) else content)


def folder(name):
    return lambda: Path(name).mkdir(parents=True)


def changed(value, channel=1, sample=100):
    values = VALUES.copy()
    values[channel, sample] = value
    return values


def with_row(row):
    values = VALUES.copy()
    values[1] = row
    return values


def csv(values=VALUES, head="time [s],X,Y,X_tt,Y_tt", **words):
    rate = simulated().sample_rate
    rows = [",".join(map(repr, [n / rate, *column])) for n, column in enumerate(values.T.tolist())]
    text = "\n".join([head, *rows]) + "\n"
    for old, new in words.items():
        text = text.replace(old, new)
    return file(text, "this.csv")


class Payload:
    """What would leave a file behind if it were unpickled."""

    def __reduce__(self):
        return (Path.touch, (Path("executed"),))


def objects(*things):
    array = np.empty(len(things), dtype=object)
    array[:] = things
    return array


def text_in_a_number_column():
    csv()()
    path = Path("this.csv")
    lines = path.read_text().splitlines()
    cells = lines[6].split(",")
    lines[6] = ",".join([*cells[:2], "broken", *cells[3:]])
    path.write_text("\n".join(lines))


def unwritable_folder():
    Path("locked").mkdir()
    Path("locked").chmod(0o555)


def other_hit(**changes):
    return npz(changes.pop("values", VALUES[:, ::-1]), **changes)


def toml(text):
    return file(text, "this.toml")


def cut_short():
    data = Path("good.npz").read_bytes()
    Path("this.npz").write_bytes(data[: len(data) // 2])


WITH_TOML = f"{GOOD} --settings this.toml"
TWO = f"identify good.npz this.npz --period {PERIOD}"

FILES = [
    ("missing file", nothing, THIS, 2, r"`FILE` must .*there is no file this\.npz"),
    ("second file missing", nothing, TWO, 2, r"there is no file this\.npz"),
    ("empty npz", file(""), THIS, 2, r"this\.npz is empty"),
    ("empty csv", file("", "this.csv"), f"identify this.csv --period {PERIOD}", 2, r"this\.csv is empty"),
    ("csv without rows", file("t [s],x\n", "this.csv"), "identify this.csv --period 1", 2, r"a header and no rows"),
    ("csv without header", csv(head="1,2,3,4,5"), "identify this.csv --period 1", 2, r"begins with numbers"),
    ("text in a number column", text_in_a_number_column, f"identify this.csv --period {PERIOD}", 2,
     r"'broken' in line 7, column 'Y'"),
    ("folder as file", folder("this.npz"), THIS, 2, r"this\.npz is a folder"),
    ("unknown suffix", file("abc", "this.xyz"), "identify this.xyz --period 1", 2, r"end in one of \.npz, \.csv"),
    ("no suffix", file("abc", "this"), "identify this --period 1", 2, r"has no suffix"),
    ("not an archive", file("hello"), THIS, 2, r"must be a whole NumPy archive"),
    ("archive cut short", cut_short, THIS, 2, r"damaged or cut short"),
    ("archive of other things", lambda: np.savez("this.npz", a=1), THIS, 2, r"no `values` and none is named"),
    ("no rate in the file", npz(sample_rate=None), THIS, 2, r"must say its sampling rate.*\n.*--rate"),
    ("empty word for a file", nothing, f"identify '' --period {PERIOD}", 2, r"empty word"),
    ("no file", nothing, "identify --period 1", 2, r"at least one record.*\n.*floquid identify run\.npz"),
    ("info of a missing file", nothing, "info this.npz", 2, r"there is no file this\.npz"),
    ("info of an empty file", file(""), "info this.npz", 2, r"this\.npz is empty"),
    ("info of objects", npz(objects(Payload())), "info this.npz", 2, r"never unpickled"),
    ("info of infinities", npz(changed(np.inf)), "info this.npz", 2, r"finite samples"),
    ("info of two files", nothing, "info good.npz other.npz", 2, r"Too many words: other\.npz"),
    ("info of nothing", nothing, "info", 2, r"FILE requires an argument"),
]  # fmt: skip

SAMPLES = [
    ("NaN only", npz(VALUES * np.nan), THIS, 2, r"channel 'X' of record 1 has none\.\n.*--channels"),
    ("NaN in one channel only", npz(with_row(np.nan)), THIS, 2, r"channel 'Y' of record 1 has none\.\n.*--channels"),
    ("infinity", npz(changed(-np.inf)), THIS, 2, r"finite samples .*channel 'Y', sample 100"),
    ("infinity in csv", csv(changed(np.inf)), f"identify this.csv --period {PERIOD}", 2, r"line 102, column 'Y'"),
    ("one sample", npz(VALUES[:, :1]), THIS, 2, r"at least two samples, but this\.npz holds 1"),
    ("one sample in csv", csv(VALUES[:, :1]), f"identify this.csv --period {PERIOD}", 2, r"at least two samples"),
    ("no sample", npz(VALUES[:, :0]), THIS, 2, r"must hold samples"),
    ("one channel as a vector", npz(VALUES[0], channels=["X"]), THIS, 2, r"Save `values\[None, :\]`"),
    ("axes swapped", npz(VALUES.T), THIS, 2, r"Time is the last axis: save `values\.T`"),
    ("complex samples", npz(VALUES + 1j), THIS, 2, r"real numbers"),
    ("text samples", npz(VALUES.astype(str)), THIS, 2, r"real numbers"),
    ("object array", npz(objects(1.0, "a")), THIS, 2, r"never unpickled"),
    ("pickle in values", npz(objects(Payload())), THIS, 2, r"never unpickled"),
    ("pickle in units", npz(units=objects(Payload())), THIS, 2, r"`units`.*\n?.*never unpickled"),
    ("pickle named npz", file(pickle.dumps(Payload())), THIS, 2, r"must be a whole NumPy archive"),
    ("two channels of one name", npz(channels=["X", "X", "Y", "Z"]), THIS, 2, r"'X' twice"),
    ("constant channel", npz(with_row(3.0)), THIS, 2, r"channel 'Y' of record 1 is constant \(3\)\.\n.*--channels"),
    ("channel of zeros", npz(with_row(0.0)), THIS, 2, r"channel 'Y' of record 1 is constant \(0\)"),
    ("all zeros", npz(0.0 * VALUES), THIS, 2, r"channel 'X' of record 1 is constant \(0\)"),
    ("channel twice", npz(with_row(VALUES[0])), THIS, 2, r"channel 'Y' is a copy of channel 'X'"),
    ("pure noise", npz(NOISE), THIS, 1, r"no mode rises above the noise"),
    ("huge values", npz(1e300 * VALUES), THIS, 2, r"channel 'X' of record 1 reaches \d(\.\d+)?e\+(300|299)"),
    ("large values", npz(1e80 * VALUES), THIS, 2, r"reaches \d(\.\d+)?e\+(80|79)"),
    ("tiny values", npz(1e-300 * VALUES), THIS, 2, r"reaches \d(\.\d+)?e-30[01]"),
    ("denormal values", npz(1e-320 * VALUES), THIS, 2, r"reaches \d(\.\d+)?e-32[01]"),
    ("huge noise", npz(1e200 * NOISE), THIS, 2, r"reaches \d\.\d+e\+200"),
    ("one period", npz(VALUES[:, :8]), THIS, 1, r"holds 1 whole period: fewer than 4"),
    ("three periods", npz(VALUES[:, :24]), THIS, 1, r"holds 3 whole periods: fewer than 4"),
    ("fewer periods than modes", npz(VALUES[:, :32]), THIS, 1, r"no mode rises|too short"),
]  # fmt: skip

HITS = [
    ("other channels", other_hit(channels=list("abcd")), TWO, 2, r"the same channels.* a \[-\].*\n.*--channels"),
    ("other number of channels", other_hit(values=VALUES[:3], channels=list("XYZ")), TWO, 2, r"the same channels"),
    ("other order of channels", other_hit(channels=["Y", "X", "X_tt", "Y_tt"]), TWO, 2, r"the same channels"),
    ("other units", other_hit(units=["mm"] * 4), TWO, 2, r"the same units"),
    ("one file twice", nothing, "identify good.npz ./good.npz --period 1", 2, r"each record once"),
    ("one record twice", npz(), TWO, 2, r"channel 'X' of record 2 is a copy of channel 'X' of record 1"),
]  # fmt: skip

TIMES = [
    ("no period", nothing, "identify good.npz", 2, r"--period` must be given.*good\.npz does not.*\n.*--frequency"),
    ("period and frequency", nothing, f"{GOOD} --frequency 1", 2, r"`--frequency` must not be given beside --period"),
    ("text period", nothing, "identify good.npz --period fast", 2, r'--period: unable to convert "fast"'),
    ("negative period", nothing, "identify good.npz --period -1", 2, r"period must be positive \[s\], but is -1"),
    ("zero period", nothing, "identify good.npz --period 0", 2, r"period must be positive \[s\]"),
    ("nan period", nothing, "identify good.npz --period nan", 2, r"period must be a finite number"),
    ("infinite period", nothing, "identify good.npz --period inf", 2, r"period must be a finite number"),
    ("huge period", nothing, "identify good.npz --period 1e300", 2, r"shorter than the record \(251\.\d+ s\)"),
    ("period longer than the record", nothing, "identify good.npz --period 252", 2, r"shorter than the record"),
    ("tiny period", nothing, "identify good.npz --period 1e-300", 2, r"two sampling intervals or more \(1\.57"),
    ("zero frequency", nothing, "identify good.npz --frequency 0", 2, r"--frequency` must be positive \[Hz\]"),
    ("negative frequency", nothing, "identify good.npz --frequency=-1", 2, r"--frequency` must be positive"),
    ("infinite frequency", nothing, "identify good.npz --frequency inf", 2, r"--frequency` must be a finite number"),
    ("frequency without a period", nothing, "identify good.npz --frequency 5e-324", 2, r"period must be a finite"),
    ("period not whole", nothing, f"identify good.npz --period {2.02 * np.pi}", 1,
     r"does not repeat with the period given: its own is 6\.2[5-9]\d+ ± \S+ s, not 6\.346.*\n.*--estimate-period"),
    ("negative rate", nothing, f"{GOOD} --rate -1", 2, r"`--rate` must be positive \[Hz\], but is -1"),
    ("negative rate in the file", npz(sample_rate=-5.0), THIS, 2, r"positive number in `sample_rate`.*-5"),
    ("zero rate", nothing, f"{GOOD} --rate 0", 2, r"`--rate` must be positive"),
    ("nan rate", nothing, f"{GOOD} --rate nan", 2, r"`--rate` must be a finite number"),
    ("huge rate", nothing, f"{GOOD} --rate 1e300", 2, r"shorter than the record"),
    ("tiny rate", nothing, f"{GOOD} --rate 1e-300", 2, r"two sampling intervals or more"),
    ("nan origin", nothing, f"{GOOD} --origin nan", 2, r"`--origin` must be a finite number"),
    ("huge origin", nothing, f"{GOOD} --origin 1e300", 2, r"near enough to zero"),
]  # fmt: skip

OPTIONS = [
    ("unknown channel", nothing, f"{GOOD} --channels X,Q", 2, r"`--channels` .*'Q'\.\n.*X, Y, X_tt, Y_tt"),
    ("channel chosen twice", nothing, f"{GOOD} --channels X,X", 2, r"`--channels` .*'X' twice"),
    ("no input at all", nothing, f"{GOOD} --inputs ''", 2, r"`--inputs` must name a channel, but is ''"),
    ("a sum of what is no channel", nothing, f"{GOOD} --states X,0.5*Q+Y", 2, r"`--states` .*'0\.5\*Q\+Y'"),
    ("a sum without a sign", nothing, f"{GOOD} --states X,0.5*XY", 2, r"`--states` must .* sums .*'0\.5\*XY'"),
    ("no weights in a file", file("", "E.csv"), f"{GOOD} --states E.csv", 2, r"a table of weights"),
    ("a weight short", file("X,Y\n1\n", "E.csv"), f"{GOOD} --states E.csv", 2, r"for each channel in every row"),
    ("weights in bytes", file("X,Y\n1,\x00\n", "E.csv"), f"{GOOD} --states E.csv", 2, r"a table of weights"),
    ("no channel at all", nothing, f"{GOOD} --channels ''", 2, r"`--channels` must name a channel, but is ''"),
    ("no state at all", nothing, f"{GOOD} --states ''", 2, r"`--states` must name a channel, but is ''"),
    ("unknown state", nothing, f"{GOOD} --states X,Q", 2, r"`--states` .*'Q'\.\n.*X, Y, X_tt, Y_tt"),
    ("state that is not among the channels", nothing, f"{GOOD} --channels X,Y --states X,X_tt", 2, r"'X_tt'"),
    ("order 0", nothing, f"{GOOD} --order 0", 2, r"`--order` must be an integer of at least 1"),
    ("order 2.5", nothing, f"{GOOD} --order 2.5", 2, r'--order: "2\.5" is not a whole number'),
    ("order of text", nothing, f"{GOOD} --order four", 2, r'--order: "four" is not a whole number'),
    ("odd order of pairs", nothing, f"{GOOD} --order 3", 1, r"order 3 cannot be reached.* pair"),
    ("order that the data do not hold", npz(VALUES[:, :80]), f"{THIS} --order 8", 1, r"order 8 cannot be reached"),
    ("order of as many as periods", nothing, f"{GOOD} --order 40", 2, r"less than the 40 periods"),
    ("negative harmonics", nothing, f"{GOOD} --harmonics -1", 2, r"`--harmonics` must be .* at least 0"),
    ("too many harmonics", nothing, f"{GOOD} --harmonics 4", 2, r"less than half the 8 samples a period, but is 4"),
    ("unknown option", nothing, f"{GOOD} --perod 1", 2, r"Unknown option: --perod\. Did you mean --period\?"),
    ("option without its value", nothing, "identify good.npz --period", 2, r"--period requires an argument"),
    ("option twice", nothing, f"{GOOD} --period 1", 2, r"--period specified multiple times"),
    ("unknown format", nothing, f"{GOOD} --format xml", 2, r'Choose from: "text", "json"'),
    ("unknown command", nothing, "identfy good.npz", 2, r'Did you mean "identify"\?'),
]  # fmt: skip

SETTINGS = [
    ("unknown setting", toml("perod = 1.0\n"), WITH_TOML, 2, r"this\.toml has `perod`.*\n.*period, channels"),
    ("setting of a wrong type", toml("order = 'four'\n"), WITH_TOML, 2, r"Setting `order` in this\.toml .*'four'"),
    ("channels as a number", toml("channels = 3\n"), WITH_TOML, 2, r"Setting `channels` in this\.toml .*is 3"),
    ("channels as a text", toml("channels = 'X'\n"), WITH_TOML, 2, r"list of channel names"),
    ("period as a text", toml("period = '1'\n"), WITH_TOML, 2, r"Setting `period` in this\.toml .*finite number"),
    ("period as a truth value", toml("period = true\n"), WITH_TOML, 2, r"finite number \[s\], but is True"),
    ("negative rate in settings", toml("rate = -1.0\n"), WITH_TOML, 2, r"Setting `rate` in this\.toml .*positive"),
    ("impossible probability", toml("mode_false_alarm = 2.0\n"), WITH_TOML, 2, r"lie between 0 and 1"),
    ("bad TOML", toml("period = = 3\n"), WITH_TOML, 2, r"file in TOML.*line 1, column 10"),
    ("binary as TOML", toml(b"\xff\xfe\x00"), WITH_TOML, 2, r"file in TOML"),
    ("empty settings", toml(""), WITH_TOML, 2, r"this\.toml is empty"),
    ("missing settings", nothing, WITH_TOML, 2, r"`--settings` must .*no file this\.toml"),
    ("folder as settings", folder("this.toml"), WITH_TOML, 2, r"this\.toml is a folder"),
]  # fmt: skip


def foreign():
    """A folder with a file of the name of a result that another program wrote."""
    folder("this")()
    Path("this/result.h5").write_bytes(hdf5("weather"))


PLACES = [
    ("result below a file", nothing, f"{GOOD} --out good.npz/out", 2, r"`--out` must be a folder.*good\.npz/out"),
    ("result in a file", nothing, f"{GOOD} --out good.npz", 2, r"good\.npz is a file"),
    ("result in an empty word", nothing, f"{GOOD} --out ''", 2, r"--out: an empty word"),
    ("figures are a file", lambda: (folder("this")(), Path("this/figures").touch()), f"{GOOD} --out this", 2,
     r"this/figures is a file"),
    ("result.h5 is a folder", folder("this/result.h5"), f"{GOOD} --out this", 2, r"this/result\.h5 is a folder"),
    ("result.h5 of another program", foreign, f"{GOOD} --out this", 2, r"this/result\.h5 is no result of floquid"),
    ("simulate to a missing folder", nothing, "simulate --periods 4 --out no/this.npz", 2, r"there is no folder .*no"),
    ("simulate below a file", nothing, "simulate --periods 4 --out good.npz/this.npz", 2, r"no folder .*good\.npz"),
    ("simulate to a folder", folder("this.npz"), "simulate --periods 4 --out this.npz", 2, r"is a folder"),
    ("simulate to an unknown suffix", nothing, "simulate --periods 4 --out this.xyz", 2, r"end in one of"),
    ("demo below a file", nothing, "demo --periods 4 --out good.npz/this", 2, r"`--out` must be a folder"),
]  # fmt: skip

SIMULATIONS = [
    ("simulate no system", nothing, "simulate saturn", 2, r"example system, but is 'saturn'\.\n.*jeffcott"),
    ("simulate no period", nothing, "simulate --periods 0", 2, r"`--periods` must be .* at least 1"),
    ("simulate half a period", nothing, "simulate --periods 0.5", 2, r"not a whole number"),
    ("simulate one sample", nothing, "simulate --periods 1 --samples-per-period 1", 2, r"at least two samples"),
    ("simulate no sample", nothing, "simulate --samples-per-period 0", 2, r"`--samples-per-period` must be"),
    ("simulate for ever", nothing, "simulate --periods 1000000000000000000", 2, r"at most 1e\+10 samples"),
    ("simulate negative noise", nothing, "simulate --noise -1", 2, r"`--noise` must not be negative"),
    ("simulate nan noise", nothing, "simulate --noise nan", 2, r"`--noise` must be a finite number"),
    ("simulate huge noise", nothing, "simulate --periods 4 --noise 1e305", 2, r"`--noise` must leave the response"),
    ("simulate negative seed", nothing, "simulate --seed -1", 2, r"`--seed` must be .* at least 0"),
    ("simulate no direction", nothing, "simulate --impulse-deg inf", 2, r"`--impulse-deg` must be .*\[deg\]"),
    ("demo of no system", nothing, "demo saturn", 2, r"example system, but is 'saturn'"),
    ("demo of a short record", nothing, "demo --periods 2", 1, r"holds 2 whole periods"),
    ("demo of noise", nothing, "demo --periods 20 --noise 50", 1, r"no mode rises above the noise"),
]  # fmt: skip

CASES = [*FILES, *SAMPLES, *HITS, *TIMES, *OPTIONS, *SETTINGS, *PLACES, *SIMULATIONS]


def arguments(words):
    """The words as a shell splits them, with a place for the result where none is named."""
    listed = shlex.split(words)
    if "--out" in listed or listed[0] not in ("identify", "demo", "simulate"):
        return listed
    return [*listed, "--out", "out/record.npz" if listed[0] == "simulate" else "out"]


def assert_one_message(stdout, stderr, pattern):
    assert stdout == ""
    stderr = after_stages(stderr)
    assert stderr.startswith("floquid: ")
    assert re.findall(r"^\S.*", stderr, flags=re.MULTILINE) == [stderr.splitlines()[0]], "one message, indented after"
    for word in ("Traceback", "Unexpected", "Argument `", "Error:", "RuntimeWarning"):
        assert word not in stderr
    assert re.search(pattern, stderr), stderr


@pytest.mark.parametrize(("make", "words", "code", "pattern"), [case[1:] for case in CASES], ids=[c[0] for c in CASES])
def test_one_message_and_nothing_else(here, capsys, make, words, code, pattern):
    make()
    before = sorted(path.relative_to(here) for path in here.rglob("*"))
    assert run(arguments(words)) == code
    assert_one_message(*capsys.readouterr(), pattern)
    assert contents(here / "out") == EARLIER
    assert sorted(path.relative_to(here) for path in here.rglob("*")) == before, "nothing is left behind"


def test_the_names_of_the_cases_are_distinct():
    assert len({case[0] for case in CASES}) == len(CASES)


def test_the_payload_works_when_unpickled(here):
    """Test of the tests above: what they put into files would leave a trace."""
    npz(objects(Payload()))()
    with np.load("this.npz", allow_pickle=True) as archive:
        archive["values"]
    assert Path("executed").exists()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(here, capsys):
    unwritable_folder()
    assert run([*shlex.split(GOOD), "--out", "locked"]) == 2
    assert_one_message(*capsys.readouterr(), r"`--out` must be a folder .*locked is not: Permission denied")


def test_a_new_folder_is_not_left_behind_empty(here, capsys):
    npz(NOISE)()
    assert run([*shlex.split(THIS), "--out", "new/and/deeper"]) == 1
    assert_one_message(*capsys.readouterr(), "no mode")
    assert not Path("new").exists()


def test_debug_shows_the_traceback_and_keeps_the_exit_code(here, capsys):
    assert run([*shlex.split(THIS), "--debug"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "Traceback" in printed.err
    assert printed.err.splitlines()[-2].startswith("floquid: `FILE` must")


def test_a_mistake_of_ours_is_owned_up_to(here, capsys, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr("floquid.preparation._options.read", broken)
    assert run([*shlex.split(GOOD), "--out", "out"]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert after_stages(printed.err).startswith("floquid: Unexpected ZeroDivisionError: by nothing\n")
    assert "mistake in floquid" in printed.err
    assert "--debug" in printed.err
    assert contents(here / "out") == EARLIER


@pytest.mark.first(4)
@pytest.mark.parametrize(
    ("error", "code", "pattern"),
    [
        (MemoryError(), 1, "more memory than there is"),
        (np.linalg.LinAlgError("SVD did not converge"), 1, r"cannot be worked with \(SVD did not converge\)"),
        (OSError(28, "No space left on device"), 2, "No space left on device"),
        (KeyboardInterrupt(), 130, "Interrupted before the end"),
    ],
)
@pytest.mark.parametrize(
    "stage", ["commands.identify.identify_records", "output.folder.save", "output.folder.ResultFolder.publish"]
)
def test_the_machine_gives_out(here, capsys, monkeypatch, stage, error, code, pattern):
    def broken(*_, **__):
        raise error

    monkeypatch.setattr(f"floquid.cli.{stage}", broken)
    assert run([*shlex.split(GOOD), "--out", "out"]) == code
    assert_one_message(*capsys.readouterr(), pattern)
    assert contents(here / "out") == EARLIER


def test_figures_that_fail_leave_the_result_without_any(here, capsys, monkeypatch):
    def broken(*_, **__):
        raise MemoryError

    monkeypatch.setattr("floquid.plot.save_figures", broken)
    assert run([*shlex.split(GOOD), "--out", "out", "--figures"]) == 1
    out, err = capsys.readouterr()
    assert "Modes: order" in out
    assert "memory" in err
    assert {"result.h5", "summary.json", "settings.toml"} <= set(contents(here / "out"))
    assert not [name for name in contents(here / "out") if name.startswith((".floquid", "figures", "report"))]


# In processes of their own: the installed command, its streams and its exit codes.


def command():
    found = shutil.which("floquid", path=str(Path(sys.executable).parent))
    assert found, "the package is installed together with its command"
    return found


def test_the_entry_point_leaves_with_the_exit_code(here, capsys, monkeypatch):
    """Another process is what `test_the_installed_command_keeps_its_streams_apart` runs."""
    (point,) = entry_points(group="console_scripts", name="floquid")
    monkeypatch.setattr(sys, "argv", ["floquid", *arguments(THIS)])
    with pytest.raises(SystemExit) as ended:
        point.load()()
    assert ended.value.code == 2
    assert_one_message(*capsys.readouterr(), "no file")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "code", "pattern"),
    [
        (THIS, 2, "no file"),
        ("identify noise.npz --period 6.283185307179586", 1, "no mode"),
        (f"{GOOD} --perod 1", 2, "Did you mean"),
        (f"{GOOD} --out good.npz/out", 2, "--out"),
        ("info huge\udcff.npz", 2, "no file"),
    ],
)
def test_the_installed_command(here, words, code, pattern):
    npz(NOISE, name="noise.npz")()
    ended = subprocess.run([command(), *arguments(words)], capture_output=True, check=False)
    assert ended.returncode == code
    assert_one_message(ended.stdout.decode(), ended.stderr.decode(), pattern)
    assert contents(here / "out") == EARLIER


@pytest.mark.kill
def test_ctrl_c(here):
    """A signal in the middle of the work, to a process of its own."""
    script = (
        "import os, signal, time, floquid.cli.commands.identify as command\n"
        "from floquid.cli import main\n"
        "command.identify_records = lambda *_, **__: (os.kill(os.getpid(), signal.SIGINT), time.sleep(60))\n"
        f"main({[*shlex.split(GOOD), '--out', 'out']!r})\n"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert ended.returncode == 130
    assert_one_message(ended.stdout, ended.stderr, "Interrupted")
    assert contents(here / "out") == EARLIER


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_output_that_cannot_be_written(here):
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [command(), "info", "good.npz"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert ended.returncode == 2
    assert_one_message("", ended.stderr, "No space left")


@pytest.mark.slow
def test_a_reader_that_has_had_enough(here):
    script = f"{shlex.quote(command())} info good.npz | true; exit ${{PIPESTATUS[0]}}"
    ended = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert ended.stderr == ""
