"""Tables of transfer functions: what is read again is what was written. scikit-rf 2.2 reads them alike."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat

from floquid import Channel, InputError
from floquid.exports import export_transfer, import_transfer, transfer_rows
from floquid.inputs import TransferFunctions

PORTS = {1: "s1p", 2: "s2p", 3: "s3p", 5: "s5p"}


def functions(outputs, inputs, harmonics=(0,), units=("A", "V")):
    generator = np.random.default_rng(0)
    shape = (len(harmonics), outputs, inputs, 4)
    values, std = (generator.standard_normal(shape) + 1j * generator.standard_normal(shape) for _ in range(2))
    return TransferFunctions(
        frequencies_hz=[3.0, 1.0, 2.0, 4.0], harmonics=harmonics, values=values, std=np.abs(std.real) + 1j,
        outputs=tuple(Channel(name=f"i{k}", unit=units[0]) for k in range(outputs)),
        inputs=tuple(Channel(name=f"u{k}", unit=units[1]) for k in range(inputs)),
    )  # fmt: skip


def touchstone(text, ports):
    """The kind of parameter, frequencies and matrices (frequencies, ports, ports) of a Touchstone file of version 1."""
    lines = [line for line in text.splitlines() if not line.startswith("!")]
    assert lines[0].split()[0::5] == ["#", "1"]
    numbers = np.array(" ".join(lines[1:]).split(), float).reshape(-1, 1 + 2 * ports**2)
    matrices = (numbers[:, 1::2] + 1j * numbers[:, 2::2]).reshape(-1, ports, ports)
    return lines[0].split()[2], numbers[:, 0], matrices.transpose(0, 2, 1) if ports == 2 else matrices


@pytest.mark.parametrize("ports", PORTS)
def test_touchstone_of_a_square_harmonic(ports, tmp_path):
    found, file = functions(ports, ports), tmp_path / f"g.{PORTS[ports]}"
    export_transfer(found, file)
    text = file.read_text("ascii")
    kind, hertz, matrices = touchstone(text, ports)
    assert kind == "Y"
    assert list(hertz) == [1.0, 2.0, 3.0, 4.0]
    assert np.allclose(matrices, np.moveaxis(found.values[0], 2, 0)[[1, 2, 0, 3]], rtol=1e-11)
    assert f"! port {ports}: from u{ports - 1} [V] to i{ports - 1} [A]" in text
    assert all(len(line.split()) <= 9 for line in text.splitlines() if line[0] not in "!#")
    export_transfer(functions(ports, ports, units=("µm", "N")), file)
    text = file.read_text("ascii")
    assert touchstone(text, ports)[0] == "Z"
    assert "[um]" in text


def test_mat_has_all_of_it(tmp_path):
    found = functions(2, 3, (-1, 0, 2), ("m/s²", "N"))
    export_transfer(found, tmp_path / "g.mat")
    read = loadmat(tmp_path / "g.mat", simplify_cells=True)
    assert np.array_equal(read["values"], found.values)
    assert np.array_equal(read["std"], found.std)
    assert np.array_equal(read["harmonics"], [-1, 0, 2])
    assert list(read["inputs"]) == ["u0", "u1", "u2"]
    assert list(read["output_units"]) == ["m/s^2"] * 2
    assert read["step"].size == 0


def test_csv_names_path_harmonic_and_unit(tmp_path):
    found = functions(1, 2, (-1, 0))
    export_transfer(found, tmp_path / "g.csv")
    head, *rows = (tmp_path / "g.csv").read_text().splitlines()
    assert head.startswith(
        '"frequency [Hz]","G(-1) u0 to i0 real [A/V]","G(-1) u0 to i0 imag [A/V]","G(-1) u0 to i0 real'
    )
    assert np.allclose(float(rows[2].split(",")[1]), found.values[0, 0, 0, 2].real)


@pytest.mark.parametrize(
    ("found", "name", "words"),
    [
        (functions(2, 1), "g.s2p", "from 1 inputs to 2 outputs"),
        (functions(2, 2), "g.s3p", "3 outputs and inputs"),
        (functions(2, 2, (0, 1)), "g.s2p", "`harmonics=0`"),
        (functions(1, 1), "g.xls", "known suffix"),
        (None, "g.csv", "TransferFunctions"),
    ],
)
def test_what_has_no_such_form_is_refused(found, name, words, tmp_path):
    with pytest.raises(InputError, match=words):
        export_transfer(found, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["csv", "mat"])
@pytest.mark.parametrize("units", [("m", "N"), ("m/s", "N"), ("-", "V"), ("m", "-"), ("V", "m/s")])
@pytest.mark.parametrize(("step", "known"), [(None, True), (0.125 / 3.0, True), (None, False)])
def test_a_table_is_read_as_it_was_written(suffix, units, step, known, tmp_path):
    found = replace(functions(2, 1, (-1, 0, 2), units), step=step)
    values = found.values.copy()
    values[:, 0, 0, 1] = np.nan
    found = replace(found, values=values, std=found.std if known else None)
    export_transfer(found, tmp_path / f"g.{suffix}")
    back = import_transfer(tmp_path / f"g.{suffix}")
    assert back.step == found.step
    assert (back.outputs, back.inputs) == (found.outputs, found.inputs) or units == ("m/s", "-")
    assert back.harmonics.tolist() == [-1, 0, 2]
    for name in ("frequencies_hz", "values", "std"):
        one, other = getattr(found, name), getattr(back, name)
        assert (one is None) == (other is None)
        assert one is None or np.allclose(one, other, rtol=1e-8, equal_nan=True)


def test_a_table_of_something_else_is_refused(tmp_path):
    (tmp_path / "g.csv").write_text("t,x\n0,1\n")
    (tmp_path / "g.mat").write_bytes(b"no such file of MATLAB, but long enough to look at" * 9)
    (tmp_path / "g.s1p").write_text("# Hz Z RI R 1\n1 2 3\n")
    head = "frequency [Hz],G(+0) F to x real [m/N],G(+0) F to x imag [m/N]\n"
    (tmp_path / "head.csv").write_text(head)
    (tmp_path / "short.csv").write_text(head + "1,2\n")
    short = [(name, "lines of 3 numbers") for name in ("head.csv", "short.csv")]
    for name, words in (
        *short,
        ("g.csv", "names no path"),
        ("g.mat", "as `export_transfer` writes"),
        ("g.s1p", "end in"),
    ):
        with pytest.raises(InputError, match=words):
            import_transfer(tmp_path / name)


def test_what_is_missing_is_no_number_at_all():
    """The imaginary part of what was not measured was 0, and so was its deviation."""
    values = np.full((1, 1, 1, 2), np.nan, complex)
    values.imag, std = 0.0, values.copy()
    values[..., 0], std[..., 0] = 1.0 + 2.0j, 0.1 + 0.1j
    found = replace(functions(1, 1), frequencies_hz=[1.0, 2.0], values=values, std=std)
    assert transfer_rows(found).splitlines()[1:] == ["1,1,2,0.1,0.1", "2,nan,nan,nan,nan"]


def test_mat_has_a_struct_for_each_path(tmp_path):
    found = functions(2, 3, (-1, 0), ("µm", "N"))
    export_transfer(found, tmp_path / "g.mat")
    paths = loadmat(tmp_path / "g.mat", simplify_cells=True)["paths"]
    assert [(own["input"], own["output"]) for own in paths] == [(f"u{j}", f"i{k}") for k in range(2) for j in range(3)]
    assert {own["unit"] for own in paths} == {"um/N"}
    np.testing.assert_array_equal(paths[4]["values"], found.values[:, 1, 1])
    np.testing.assert_array_equal(paths[4]["std"], found.std[:, 1, 1])
    export_transfer(replace(found, std=None), tmp_path / "g.mat")
    assert loadmat(tmp_path / "g.mat", simplify_cells=True)["paths"][0]["std"].size == 0
