"""Modes written for other programs: what is in the files, read back by pyuff, scipy, csv, json, and GNU Octave."""

import csv
import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import pyuff
from scipy.io import loadmat

from floquid.core import Channel, PeriodicModel
from floquid.errors import InputError
from floquid.exports import MODE_FORMATS, export_modes, modes_frame, summary
from floquid.exports._formats import degrees_of_freedom
from floquid.pipeline import identify
from floquid.systems import JeffcottRotor
from floquid.views import decrement, mode_table, with_error

CHANNELS = (
    Channel(name="a", unit="mm", location="blade 3", direction="-Y"),
    Channel(name="b", unit="mm", location="blade 3", direction="+x"),
    Channel(name="c", unit="µm/s", quantity="velocity", location="blade 3", direction="+X"),
    Channel(name="d", unit="mm"),
    Channel(name="e", unit="rad", location="12", direction="RZ"),
    Channel(name="f", unit="mm", location="blade 3", direction="-Y"),
    Channel(name="=HYPERLINK(1)", quantity="other", unit="V"),
)


def make_model(channels=CHANNELS, n_hits=2, **changes):
    """Two pairs and a real mode, each with harmonics of its own."""
    rng = np.random.default_rng(0)
    size = (3, len(channels), n_hits, 4)
    shapes = rng.normal(size=size) + 1j * rng.normal(size=size)
    shapes[0, ..., 0] = shapes[1, ..., 3] = shapes[2, ..., [0, 3]] = 0.0
    shapes[2] = shapes[2].real
    both = [shapes[0], shapes[0][..., ::-1].conj(), shapes[1], shapes[1][..., ::-1].conj(), shapes[2]]
    harmonics = [-2, -1, 1, 2]
    exponents = [-0.1 + 2j, -0.1 - 2j, 0.02 + 3j, 0.02 - 3j, -1e-101 + 0j]
    valid = {
        "exponents": exponents,
        "coefficients": both,
        "harmonics": harmonics,
        "period": 0.7,
        "channels": channels,
        "covariance": np.diag(np.arange(10.0)) * 1e-6,
        "coefficient_std": np.full((5, len(channels), n_hits, 4), 0.25 + 0.5j),
    }
    return PeriodicModel(**(valid | changes))


@pytest.fixture(scope="module")
def analysis():
    rotor = JeffcottRotor(damping=0.02)
    records = [
        rotor.simulate(n_periods=30, samples_per_period=8, noise=0.01, seed=s, impulse_deg=40 * s) for s in (1, 2)
    ]
    return identify(records, states=["X", "Y"], validate=False)


def written(result, path, **options):
    export_modes(result, path, **options)
    return path


# Universal files


SHOWN = CHANNELS[:4] + CHANNELS[5:]
"""Those without a rotation: pyuff reads no more than three complex numbers a node."""


def datasets(path):
    sets = pyuff.UFF(str(path)).read_sets()
    return sets[0], sets[1], sets[2:]


def test_the_modes_as_a_table():
    model = make_model()
    found = modes_frame(model)
    assert found.index.tolist() == [1, 2, 3]
    upper = list(model.upper_modes)
    assert found["exponent imag [rad/s]"].tolist() == model.exponents.imag[upper].tolist()
    assert found["frequency std [Hz]"].tolist() == model.frequency_std_hz[upper].tolist()
    bare = modes_frame(replace(model, covariance=None))
    assert bare["exponent real std [1/s]"].isna().all()


def test_a_universal_file_has_a_header_nodes_and_a_shape_for_each_mode_and_harmonic(tmp_path):
    model = make_model(SHOWN)
    header, nodes, shapes = datasets(written(model, tmp_path / "modes.uff"))
    assert (header["type"], nodes["type"], {shape["type"] for shape in shapes}) == (151, 15, {55})
    assert header["program"].startswith("floquid ")
    kept = [(mode, k) for mode in (0, 2, 4) for k in range(4) if model.coefficients[mode, ..., k].any()]
    groups = 3  # mm, µm/s, V
    assert len(shapes) == len(kept) * 2 * groups
    assert sorted({shape["mode_n"] for shape in shapes}) == list(range(1, len(kept) + 1))
    for shape in shapes:
        mode, k = kept[shape["mode_n"] - 1]
        rate = model.exponents[mode] + 1j * model.harmonics[k] * model.fundamental
        assert shape["eig"] == pytest.approx(rate, rel=1e-5)
        assert shape["modal_b"] == -shape["eig"]
        assert shape["modal_a"] == 1.0
        assert (shape["model_type"], shape["analysis_type"], shape["data_type"]) == (1, 3, 5)


def test_every_coefficient_is_at_its_node_and_along_its_direction(tmp_path):
    model = make_model(CHANNELS[:4])
    _, nodes, shapes = datasets(written(model, tmp_path / "modes.unv"))
    assert nodes["node_nums"] == [1.0, 3.0]
    expected = {8: {(3, "r2", -1.0): 0, (3, "r1", 1.0): 1, (1, "r1", 1.0): 3}, 11: {(3, "r1", 1.0): 2}}
    kept = [(mode, k) for mode in (0, 2, 4) for k in range(4) if model.coefficients[mode, ..., k].any()]
    seen = 0
    for shape in shapes:
        mode, k = kept[shape["mode_n"] - 1]
        own = expected[shape["spec_data_type"]]
        total = sum(np.abs(shape[component]).sum() for component in ("r1", "r2", "r3"))
        for (node, component, sign), row in own.items():
            at = shape["node_nums"].tolist().index(node)
            coefficient = sign * model.coefficients[mode, row, shape["load_case"] - 1, k]
            assert shape[component][at] == pytest.approx(coefficient, rel=1e-5)
            total -= abs(shape[component][at])
            seen += 1
        assert total == pytest.approx(0.0, abs=1e-9)
    assert seen == len(kept) * 2 * 4


def test_the_id_lines_say_what_it_is_and_have_the_numbers_in_full(tmp_path):
    model = make_model(SHOWN)
    _, _, shapes = datasets(written(model, tmp_path / "modes.uff"))
    first = shapes[0]
    assert first["id1"] == "Mode 1, harmonic -1, hit 1: displacement [mm]"
    assert complex(first["id2"].removeprefix("floquid exponent=").removesuffix(" 1/s")) == model.exponents[0]
    assert first["id4"] == "floquid mode=1 harmonic=-1 hit=1 period=0.7 s"
    assert complex(first["id5"].removeprefix("floquid exponent_std=").removesuffix(" 1/s")) == model.exponent_std[0]
    text = (tmp_path / "modes.uff").read_text(encoding="utf-8")
    assert max(map(len, text.splitlines())) <= 80
    assert "Mode 1, harmonic -1, hit 1: velocity [µm/s]" in text


def test_rotations_have_six_values_a_node(tmp_path):
    """pyuff does not read six complex ones: the lines are looked at."""
    model = make_model(CHANNELS[4:5], n_hits=1)
    lines = written(model, tmp_path / "modes.uff").read_text(encoding="utf-8").splitlines()
    first = lines.index("    55")
    assert lines[first + 6].split() == ["1", "3", "3", "8", "5", "6"]
    assert lines[first + 9].split() == ["12"]
    numbers = [float(line[k : k + 13]) for line in lines[first + 10 : first + 12] for k in range(0, 78, 13)]
    value = model.coefficients[0, 0, 0, 1]
    assert numbers == pytest.approx([0.0] * 10 + [value.real, value.imag], rel=1e-5)


def test_nodes_by_location():
    found = [(dof.node, dof.component, dof.sign) for dof in degrees_of_freedom(CHANNELS)]
    # Channel f is where a is: a node of its own, as have those without a location or a direction.
    assert found == [(3, 1, -1), (3, 0, 1), (3, 0, 1), (1, 0, 1), (12, 5, 1), (2, 1, -1), (4, 0, 1)]
    rows = ("blade 3", "hub 3", "hub", "blade 7")
    same = degrees_of_freedom([Channel(name=word, location=word, direction="X") for word in rows])
    assert [dof.node for dof in same] == [3, 1, 2, 7]


def test_coordinates_of_nodes(tmp_path):
    path = written(
        make_model(SHOWN), tmp_path / "modes.uff", coordinates={"blade 3": [1.0, -2.0, 1e-3], "d": (4, 5, 6)}
    )
    _, nodes, _ = datasets(path)
    where = dict(zip(nodes["node_nums"], zip(nodes["x"], nodes["y"], nodes["z"], strict=True), strict=True))
    assert where[3.0] == (1.0, -2.0, 0.001)
    assert where[1.0] == (4.0, 5.0, 6.0)
    assert where[4.0] == (0.0, 0.0, 0.0)


def test_lines_between_nodes_are_drawn_where_there_are_coordinates(tmp_path):
    where = {"blade 3": [1.0, 0.0, 0.0], "d": (0.0, 0.0, 0.0), "=HYPERLINK(1)": (0.0, 1.0, 0.0)}
    model = make_model(SHOWN)
    sets = pyuff.UFF(str(written(model, tmp_path / "modes.uff", coordinates=where))).read_sets()
    (lines,) = [own for own in sets if own["type"] == 82]
    assert lines["nodes"].tolist() == [3, 1, 4]
    chosen = [["d", "blade 3"], ["d", "=HYPERLINK(1)"]]
    sets = pyuff.UFF(str(written(model, tmp_path / "two.uff", coordinates=where, lines=chosen))).read_sets()
    assert [own["nodes"].tolist() for own in sets if own["type"] == 82] == [[1, 3], [1, 4]]
    with pytest.raises(InputError, match="`lines` of `export_modes` must be of locations of channels, but has 'hub'"):
        export_modes(model, tmp_path / "bad.uff", coordinates=where, lines=[["d", "hub"]])
    with pytest.raises(InputError, match="`lines` of `export_modes` must come with coordinates"):
        export_modes(model, tmp_path / "bad.uff", lines=chosen)


# MATLAB


def test_modes_are_a_struct_array_with_the_names_of_channels(tmp_path):
    names = ("tip x", "tip-x", "2nd", "ΔT [K]", "a" * 70)
    model = make_model([Channel(name=name) for name in names])
    found = loadmat(written(model, tmp_path / "modes.mat"), simplify_cells=True)["modes"]
    assert len(found) == len(model.upper_modes)
    for own, mode in zip(found, model.upper_modes, strict=True):
        assert own["frequency_hz"] == model.frequencies_hz[mode]
        assert own["damping_ratio_std"] == model.damping_ratio_std[mode]
        assert own["exponent"] == model.exponents[mode]
        assert bool(own["is_real"]) == bool(model.real[mode])
        assert list(own["shape"]) == ["tip_x", "tip_x_2", "x2nd", "T_K", "a" * 56]
        for row, values in enumerate(own["shape"].values()):
            np.testing.assert_array_equal(values, model.coefficients[mode, row])


def test_a_matlab_file_has_every_number_to_its_last_bit(analysis, tmp_path):
    found = loadmat(written(analysis, tmp_path / "modes.mat"))
    model = analysis.model
    for name, expected in {
        "exponents": model.exponents[:, None],
        "exponents_std": model.exponent_std[:, None],
        "multipliers": model.multipliers[:, None],
        "coefficients": model.coefficients,
        "coefficients_std": model.coefficient_std,
        "harmonics": model.harmonics[:, None],
        "covariance": model.covariance,
        "period": [[model.period]],
        "frequencies_hz": model.frequencies_hz[:, None],
        "damping_ratios_std": model.damping_ratio_std[:, None],
        "times": analysis.state.times[:, None],
        "A": analysis.state.system.transpose(1, 2, 0),
        "Phi": analysis.state.transition.transpose(1, 2, 0),
    }.items():
        np.testing.assert_array_equal(found[name], expected)
    assert [str(cell[0][0]) for cell in found["channels"]] == [c.name for c in model.channels]
    assert [str(cell[0][0]) for cell in found["states"]] == list(analysis.state.states)


def test_what_was_not_estimated_is_an_empty_matrix(tmp_path):
    bare = replace(make_model(), covariance=None, coefficient_std=None)
    found = loadmat(written(bare, tmp_path / "modes.mat"))
    assert found["exponents_std"].shape == found["coefficients_std"].shape == (0, 0)
    assert "A" not in found


@pytest.mark.skipif(shutil.which("octave") is None, reason="GNU Octave is not installed")
def test_octave_reads_the_same_numbers(analysis, tmp_path):
    model = replace(analysis.model, channels=[Channel(name=n, unit="µm") for n in ("a", "b", "c", "d")])
    written(replace(analysis, model=model), tmp_path / "modes.mat")
    script = (
        "m = load('modes.mat'); printf('%.17g %.17g\\n', [real(m.exponents), imag(m.exponents)]');"
        "printf('%d ', size(m.coefficients), size(m.A)); printf('\\n%.17g\\n', m.A(2,1,3));"
        "printf('%s %s\\n', m.channels{1}, m.units{1});"
    )
    run = subprocess.run(
        ["octave", "--no-gui", "--quiet", "--norc", "--eval", script],
        cwd=tmp_path, capture_output=True, text=True, check=True, encoding="utf-8",
    )  # fmt: skip
    lines = run.stdout.splitlines()
    numbers = [complex(*map(float, line.split())) for line in lines[:4]]
    np.testing.assert_array_equal(numbers, model.exponents)
    shape = (*model.coefficients.shape, 4, 4, len(analysis.state.times))
    assert [int(word) for word in lines[4].split()] == list(shape)
    assert float(lines[5]) == analysis.state.system[2, 1, 0]
    assert lines[6] == "a um"


# Tables


def test_a_table_for_latex_and_markdown_has_what_the_terminal_prints(analysis, tmp_path):
    shown = mode_table(analysis)
    latex = written(analysis, tmp_path / "modes.tex").read_text("utf-8").splitlines()
    body = latex[latex.index(r"\midrule") + 1 : latex.index(r"\bottomrule")]
    assert latex[latex.index(r"\toprule") + 1].startswith(r"mode & f [Hz] & $\zeta$ [\%] & Re $\lambda$ [1/s]")
    assert len(body) == len(shown.rows)
    assert body[0].startswith(f"$1$ & ${shown.rows[0][0]}$ & ${shown.rows[0][1]}$ & ${shown.rows[0][2]}$ & $\\pm ")
    markdown = written(analysis, tmp_path / "modes.md").read_text("utf-8").splitlines()
    assert markdown[0].startswith(r"| mode | f [Hz] | ζ [%] | Re λ [1/s] | Im λ [rad/s] | \|μ\| |")
    assert markdown[2] == "| 1 | " + " | ".join(shown.rows[0]) + " |"


def test_damping_is_the_logarithmic_decrement_where_asked_for(analysis, tmp_path):
    model, mode = analysis.model, analysis.model.upper_modes[0]
    value, slope = decrement(model.damping_ratios[mode])
    assert value == pytest.approx(-2 * np.pi * model.exponents[mode].real / abs(model.exponents[mode].imag), rel=1e-12)
    assert (decrement(0.1 + 1e-7)[0] - decrement(0.1 - 1e-7)[0]) / 2e-7 == pytest.approx(decrement(0.1)[1], rel=1e-6)
    table = mode_table(analysis, damping_unit="decrement")
    assert table["δ"][0] == with_error(value, slope * model.damping_ratio_std[mode])
    assert table["ζ [%]"] == ()
    text = written(analysis, tmp_path / "modes.tex", damping_unit="decrement").read_text("utf-8")
    assert r"$\delta$" in text
    assert "δ" in analysis.summary(damping_unit="decrement")
    for call in (
        lambda: export_modes(analysis, tmp_path / "x.md", damping_unit="%"),
        lambda: analysis.summary(damping_unit=1),
    ):
        with pytest.raises(InputError, match='must be "percent" or "decrement"'):
            call()


def test_a_model_alone_has_a_table_too(tmp_path):
    text = written(make_model(), tmp_path / "modes.md").read_text("utf-8")
    assert len(text.splitlines()) == 2 + 3 + 2


def table(path):
    with path.open(encoding="utf-8-sig", newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_table_has_a_row_for_each_coefficient(tmp_path):
    model = make_model()
    rows = table(written(model, tmp_path / "modes.csv"))
    kept = (model.coefficients != 0).any(axis=(1, 2))
    assert len(rows) == kept.sum() * len(CHANNELS) * 2
    # The last one would be a formula.
    names = {"'=HYPERLINK(1)": 6} | {channel.name: k for k, channel in enumerate(CHANNELS[:-1])}
    for row in rows:
        mode, hit, channel = int(row["mode"]) - 1, int(row["hit"]) - 1, names[row["channel"]]
        place = model.harmonics.tolist().index(int(row["harmonic"]))
        value = complex(float(row["coefficient real"]), float(row["coefficient imag"]))
        assert value == model.coefficients[mode, channel, hit, place]
        assert complex(float(row["exponent real [1/s]"]), float(row["exponent imag [rad/s]"])) == model.exponents[mode]
        assert (row["coefficient real std"], row["coefficient imag std"]) == ("0.25", "0.5")
        frequency = (model.exponents[mode].imag + model.harmonics[place] * model.fundamental) / (2 * np.pi)
        assert float(row["harmonic frequency [Hz]"]) == pytest.approx(frequency)
        assert row["unit"] == CHANNELS[channel].unit


def test_cells_of_what_was_not_estimated_are_empty(tmp_path):
    row = table(written(replace(make_model(), covariance=None, coefficient_std=None), tmp_path / "modes.csv"))[0]
    empty = [name for name, cell in row.items() if not cell]
    assert len(empty) == 6
    assert all("std" in name for name in empty)


def test_a_spreadsheet_is_told_of_letters_beyond_ascii_only_where_there_are_some(tmp_path):
    assert written(make_model(), tmp_path / "modes.csv").read_bytes().startswith(b"\xef\xbb\xbfmode,")
    assert written(make_model(CHANNELS[:2]), tmp_path / "modes.csv").read_bytes().startswith(b"mode,")


def test_json_of_an_analysis_is_its_summary(analysis, tmp_path):
    assert json.loads(written(analysis, tmp_path / "modes.json").read_text("utf-8")) == summary(analysis)


def test_json_of_a_model_has_its_modes(analysis, tmp_path):
    found = json.loads(written(analysis.model, tmp_path / "modes.json").read_text("utf-8"))
    assert (found["format"], found["period"]) == ("floquid-modes/1", analysis.model.period)
    assert [mode["exponent"] for mode in found["modes"]] == [[e.real, e.imag] for e in analysis.model.exponents]
    assert [channel["name"] for channel in found["channels"]] == [c.name for c in analysis.model.channels]


# All of them


@pytest.mark.parametrize("suffix", MODE_FORMATS)
def test_a_file_is_replaced_whole_or_not_at_all(suffix, tmp_path, monkeypatch):
    path = tmp_path / f"modes{suffix.upper()}"
    path.write_bytes(b"earlier")
    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.write_bytes", full_disk)
        with pytest.raises(InputError, match="cannot be"):
            export_modes(make_model(), path)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"earlier"
    export_modes(make_model(), path)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() != b"earlier"


def full_disk(*_):
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize("suffix", [".mat", ".csv", ".json"])
def test_the_same_model_gives_the_same_bytes(suffix, tmp_path, monkeypatch):
    one = written(make_model(), tmp_path / f"modes{suffix}").read_bytes()
    monkeypatch.setattr("time.asctime", lambda *_: "another day")
    assert written(make_model(), tmp_path / f"modes{suffix}").read_bytes() == one


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        ((make_model(), "modes.txt"), {}, r"`path` .* must end in a known suffix, .*\n  Use one of .uff, .unv, .mat"),
        ((make_model(), "modes"), {}, "`path` .* must end in a known suffix"),
        (("model", "modes.csv"), {}, "`result` .* must be an Analysis or a PeriodicModel"),
        ((make_model(), "modes.csv"), {"coordinates": {}}, "`coordinates` .* come with a universal file"),
        (
            (make_model(), "modes.uff"),
            {"coordinates": {"hub": [0, 0, 0]}},
            "be of locations of channels, but has 'hub'",
        ),
        ((make_model(), "modes.uff"), {"coordinates": {"d": [0, 0]}}, r"`coordinates` .* have shape \(3,\)"),
        ((make_model(), "none/modes.uff"), {}, "there is no folder"),
    ],
    ids=["suffix", "no suffix", "result", "no place", "unknown place", "two numbers", "folder"],
)
def test_what_cannot_be_is_refused(arguments, options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        export_modes(*arguments, **options)
    assert list(tmp_path.iterdir()) == []


def test_of_conjugates_one_is_in_a_universal_file(analysis, tmp_path):
    _, _, shapes = datasets(written(analysis, tmp_path / "modes.uff"))
    found = {shape["id2"] for shape in shapes}
    assert len(found) == len(analysis.model.upper_modes) == analysis.model.order // 2
