"""A(t) from files: every format gives the matrix that was written, and what cannot be is one message that names it."""

import json
import struct
from dataclasses import replace

import h5py
import numpy as np
import pytest
import scipy.io
from tests.unit.floquet.files.test_read_openfast import REAL, Rotor, even, write_turn

import floquid
from floquid import floquet
from floquid.errors import InputError
from floquid.floquet import read_matrix
from floquid.systems import JeffcottRotor
from floquid.testing import assert_exponents_close

PERIOD = 1.7
NAMES = ["x", "y", "dx/dt"]
TIMES = np.arange(16) * PERIOD / 16
SERIES = floquet.HarmonicMatrix.from_cosines(
    np.array([[-1.0, 2.0, 0.0], [0.5, -3.0, 1.0], [0.0, 0.3, -0.5]]),
    0.3 * np.arange(9.0).reshape(3, 3, 1) - 1.0,
    np.eye(3)[:, :, None],
    period=PERIOD,
)
A = np.moveaxis(SERIES.at(TIMES), 0, -1)


def cells(texts):
    array = np.empty(len(texts), dtype=object)
    array[:] = texts
    return array


def npz(path, **arrays):
    np.savez(path, **arrays)


def mat(path, *, packed=False, **arrays):
    arrays = {key: cells(value) if key == "states" else value for key, value in arrays.items()}
    scipy.io.savemat(path, arrays, do_compression=packed)


def mat_packed(path, **arrays):
    mat(path, packed=True, **arrays)


def mat_with_rows(path, **arrays):
    """The names as a character matrix, which fills them up with blanks."""
    scipy.io.savemat(path, {key: np.array(value) if key == "states" else value for key, value in arrays.items()})


def mat_73(path, **arrays):
    """As MATLAB 7.3 keeps them: turned round, texts as codes, cells as references."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for key, value in arrays.items():
            if key == "states":
                references = file.create_dataset(key, (len(value), 1), dtype=h5py.ref_dtype)
                references.attrs["MATLAB_class"] = np.bytes_("cell")
                for place, text in enumerate(value):
                    cell = file.create_dataset(f"#refs#/{place}", data=np.frombuffer(text.encode("utf-16-le"), "<u2"))
                    cell.attrs["MATLAB_class"] = np.bytes_("char")
                    references[place, 0] = cell.ref
                continue
            array = np.atleast_2d(value).T
            if np.iscomplexobj(array):
                kept = np.empty(array.shape, dtype=[("real", "f8"), ("imag", "f8")])
                kept["real"], kept["imag"] = array.real, array.imag
                array = kept
            file.create_dataset(key, data=array).attrs["MATLAB_class"] = np.bytes_("double")


def h5(path, **arrays):
    with h5py.File(path, "w") as file:
        for key, value in arrays.items():
            file[key] = value


def as_json(path, **arrays):
    content = {}
    for key, value in arrays.items():
        array = np.asarray(value)
        pairs = np.stack([array.real, array.imag], axis=-1) if np.iscomplexobj(array) else array
        content[key] = pairs.tolist()
    path.write_text(json.dumps(content), encoding="utf-8")


FORMATS = {
    "npz": (npz, "a.npz"),
    "mat": (mat, "a.mat"),
    "packed mat": (mat_packed, "a.mat"),
    "mat of rows": (mat_with_rows, "a.mat"),
    "mat 7.3": (mat_73, "a.mat"),
    "h5": (h5, "a.h5"),
    "hdf5": (h5, "a.HDF5"),
    "json": (as_json, "a.json"),
}


@pytest.fixture(params=FORMATS)
def written(request, tmp_path):
    """A function: write the arrays in one format, and read them."""
    write, name = FORMATS[request.param]

    def written(*, options=None, **arrays):
        write(tmp_path / name, **arrays)
        return read_matrix(tmp_path / name, **(options or {}))

    return written


def test_samples(written):
    found = written(A=A, period=PERIOD, states=NAMES)
    assert isinstance(found.matrix, floquet.SampledMatrix)
    assert found.matrix.interpolation == "fourier"
    assert found.matrix.period == PERIOD
    assert np.array_equal(found.matrix.values, A)
    assert found.states == tuple(NAMES)
    assert found.warnings == ()
    assert found.source == "16 samples at equal steps, the trigonometric polynomial through them"


def test_samples_at_given_times(written):
    """At unequal steps, out of order and one period late."""
    times = PERIOD * np.sort(np.random.default_rng(0).uniform(size=40))
    values = np.moveaxis(SERIES.at(times), 0, -1)
    order = np.random.default_rng(1).permutation(40)
    arrays = {"A": values[:, :, order], "times": times[order] + 0.3 * PERIOD, "states": NAMES}
    moved = floquet.SampledMatrix(values=values, period=PERIOD, times=times).at(TIMES - 0.3 * PERIOD)
    found = written(**arrays, options={"period": PERIOD})
    assert found.matrix.at(TIMES) == pytest.approx(moved, abs=1e-2)
    assert found.source == "40 samples at unequal steps, the periodic cubic spline through them"
    straight = written(**arrays, options={"period": PERIOD, "interpolation": "linear"}).matrix
    assert straight.interpolation == "linear"
    assert np.abs(straight.at(TIMES) - found.matrix.at(TIMES)).max() > 1e-4


def test_a_repeated_end_is_left_out(written):
    closed = np.concatenate([A, A[:, :, :1]], axis=2)
    found = written(A=closed, times=np.append(TIMES, PERIOD), period=PERIOD)
    assert np.array_equal(found.matrix.values, A)
    assert "16 samples at equal steps, the repeated end left out" in found.source
    assert found.states == ("x1", "x2", "x3")


def test_pieces(written):
    found = written(A=A[:, :, :3], edges=[0.0, 0.4, 1.0], period=PERIOD)
    assert isinstance(found.matrix, floquet.PiecewiseMatrix)
    assert found.matrix.at([0.1, 0.5, 1.6]) == pytest.approx(np.moveaxis(A[:, :, :3], 2, 0), abs=0)
    assert found.source == "3 constant pieces"


@pytest.mark.parametrize("key", ["coefficients", "A"])
def test_harmonics(written, request, key):
    if key == "A" and "json" in request.node.name:
        pytest.skip("JSON has no complex numbers to tell harmonics from samples by")
    found = written(**{key: SERIES.coefficients}, harmonics=SERIES.harmonics, period=PERIOD)
    assert isinstance(found.matrix, floquet.HarmonicMatrix)
    assert np.array_equal(found.matrix.coefficients, SERIES.coefficients)
    assert found.source == "harmonics up to 1"


def test_samples_that_do_not_resolve_are_said(tmp_path):
    jumps = np.where(TIMES < 0.5, 1.0, -1.0) * np.eye(2)[:, :, None]
    npz(tmp_path / "a.npz", A=jumps, period=PERIOD)
    (warning,) = read_matrix(tmp_path / "a.npz").warnings
    assert "may not resolve it" in warning
    few = np.moveaxis(SERIES.at(TIMES[::8]), 0, -1)
    npz(tmp_path / "a.npz", A=few, period=PERIOD)
    assert read_matrix(tmp_path / "a.npz").warnings


def big_endian(path, name, array):
    """A MATLAB file of a machine of the other byte order."""

    def element(kind, data):
        return struct.pack(">II", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    def variable(name, array):
        parts = [
            element(6, struct.pack(">II", 6, 0)),
            element(5, struct.pack(f">{array.ndim}i", *array.shape)),
            element(1, name.encode()),
            element(9, array.astype(">f8").tobytes(order="F")),
        ]
        return element(14, b"".join(parts))

    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(">H", 0x0100) + b"MI"
    path.write_bytes(head + variable(name, array) + variable("period", np.array([[PERIOD]])))


def test_the_other_byte_order(tmp_path):
    big_endian(tmp_path / "a.mat", "A", A)
    found = read_matrix(tmp_path / "a.mat")
    assert np.array_equal(found.matrix.values, A)
    assert found.matrix.period == PERIOD


# Results of floquid.


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("result")
    record = JeffcottRotor(damping=0.02).simulate(n_periods=60, samples_per_period=16, noise=1e-5, seed=1)
    analysis = floquid.identify(record, channels=["X", "Y"], states=["X", "Y"], validate=False)
    floquid.save(analysis, folder / "result.h5")
    (folder / "summary.json").write_text(json.dumps(floquid.exports.summary(analysis)), encoding="utf-8")
    bare = replace(analysis, state=None)
    floquid.save(bare, folder / "bare.h5")
    (folder / "bare.json").write_text(json.dumps(floquid.exports.summary(bare)), encoding="utf-8")
    return folder, analysis


@pytest.mark.parametrize("name", ["result.h5", "summary.json"])
def test_the_exponents_of_an_identified_system_come_back(result, name):
    folder, analysis = result
    found = read_matrix(folder / name)
    assert found.states == ("X", "Y", "d/dt X", "d/dt Y")
    assert found.source == "50 samples at equal steps, the trigonometric polynomial through them"
    assert found.matrix.at(analysis.state.times) == pytest.approx(analysis.state.system)
    exponents = floquet.exponents(found.matrix)
    assert_exponents_close(exponents, analysis.model.exponents, analysis.model.period, atol=1e-9)


@pytest.mark.parametrize("name", ["bare.h5", "bare.json"])
def test_a_result_without_a_system_is_told(result, name):
    with pytest.raises(
        InputError, match=r"must hold A\(t\), but .* without one\.\n  Run `floquid identify` with --states"
    ):
        read_matrix(result[0] / name)


# OpenFAST.


@pytest.mark.parametrize("how", ["folder", "files", "pattern"])
def test_a_turn_of_a_rotor(tmp_path, how):
    rotor = Rotor(swing=0.004)
    folder = write_turn(tmp_path, rotor.text, even(12, start=0.0))
    given = {"folder": folder, "files": sorted(folder.glob("*.lin")), "pattern": folder / "turn.*.lin"}[how]
    found = read_matrix(given)
    assert isinstance(found.matrix, floquet.HarmonicMatrix)
    model = found.linearisation
    assert found.states == model.state_names
    assert len(found.states) == 3
    assert found.matrix.at(model.times) == pytest.approx(np.moveaxis(model.A, 2, 0), abs=1e-9)
    truth = floquet.exponents(lambda t: rotor.N(2.0 * t), np.pi)
    assert_exponents_close(floquet.exponents(found.matrix), truth, np.pi, atol=1e-8)
    assert found.warnings == ()


def test_between_azimuths_as_asked(tmp_path):
    folder = write_turn(tmp_path, Rotor(swing=0.004).text, even(12, start=0.0))
    found = read_matrix(folder, interpolation="cubic")
    assert isinstance(found.matrix, floquet.SampledMatrix)
    assert "12 azimuths" in found.source
    assert found.source.endswith("the periodic cubic spline through them")
    with pytest.raises(InputError, match=r"`period` of `floquet\.read_matrix` must be left out for \.lin files"):
        read_matrix(folder, period=3.0)


def test_too_few_azimuths_are_told(tmp_path):
    folder = write_turn(tmp_path, Rotor(swing=0.004, harmonics=3).text, even(4))
    assert read_matrix(folder).warnings == ("The azimuths do not resolve A(t).",)


@REAL
def test_a_real_turbine():
    from tests.unit.floquet.files.test_read_openfast import FOLDER

    found = read_matrix(sorted(FOLDER.glob("Main.*.lin")))
    assert len(found.states) == 19
    assert found.matrix.shape == (19, 19)
    assert found.warnings


# What cannot be.


BAD = A.copy()
BAD[1, 2, 5] = np.nan
TEXT = np.full(A.shape, "1.0")


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"B": A, "rate": 3.0}, r"must hold `A`, but .* has no `A` \(it holds `B`, `rate`\)\.\n  Save `A` \(n, n, ph"),
        ({"A": A}, r"`period` .* must be given, but is not, and .* states none \(it holds `A`\)"),
        ({"A": A, "period": 0.0}, "one positive number"),
        ({"A": A, "period": [1.0, 2.0]}, "one positive number"),
        ({"A": A[0], "period": PERIOD}, r"has shape \(3, 16\) there\.\n  A constant matrix needs no Floquet"),
        ({"A": np.moveaxis(A, 2, 0), "period": PERIOD}, r"\(16, 3, 3\) there\.\n  The axis of phases is the last"),
        ({"A": A[:2], "period": PERIOD}, r"must hold `A` of shape \(n, n, phases\), but .* has shape \(2, 3, 16\)"),
        ({"A": BAD, "period": PERIOD}, r"finite numbers in `A`, but .* has 1 numbers there .* index \(1, 2, 5\)"),
        ({"A": A, "period": PERIOD, "times": TIMES[1:]}, "must hold 16 real numbers in `times`"),
        ({"A": A, "period": PERIOD, "times": np.append(TIMES[1:], np.nan)}, "finite numbers in `times`"),
        ({"A": A, "period": PERIOD, "times": 2.0 * TIMES}, "must hold `times` of one period"),
        ({"A": A, "period": PERIOD, "times": np.append(TIMES[:-1], PERIOD)}, "the same values one period later"),
        ({"A": A, "period": PERIOD, "times": np.full(16, 0.3)}, r"periodic matrix, but .* does not: .*`times`"),
        ({"A": A, "period": PERIOD, "edges": TIMES, "times": TIMES}, "must hold `times` or `edges`"),
        ({"A": A, "period": PERIOD, "edges": TIMES[::-1]}, "does not: Argument `edges` of `PiecewiseMatrix`"),
        ({"A": A, "period": PERIOD, "states": ["x", "y"]}, "must hold 3 distinct names in `states`, but .* has 2"),
        ({"A": A, "period": PERIOD, "states": ["x", "y", "x"]}, "one twice"),
        ({"coefficients": A + 0j, "period": PERIOD}, "must hold `harmonics` beside a complex A"),
        ({"coefficients": A + 1j, "harmonics": np.arange(16), "period": PERIOD}, "does not: Argument `harmonics`"),
    ],
)
@pytest.mark.parametrize("kind", ["npz", "mat", "h5", "json"])
def test_what_is_not_a_periodic_matrix_is_told(tmp_path, kind, arrays, message):
    write, name = FORMATS[kind]
    if kind == "mat":
        arrays = {key: np.asarray(value) if key != "states" else value for key, value in arrays.items()}
    write(tmp_path / name, **arrays)
    with pytest.raises(InputError, match=message) as caught:
        read_matrix(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


@pytest.mark.parametrize("kind", ["npz", "h5", "json"])
def test_text_is_no_matrix(tmp_path, kind):
    write, name = FORMATS[kind]
    write(tmp_path / name, A=TEXT.astype("S") if kind == "h5" else TEXT, period=PERIOD)
    with pytest.raises(
        InputError, match=r"must hold an array of numbers in `A`, but .* has (text|something else) there"
    ):
        read_matrix(tmp_path / name)


def test_a_period_beside_that_of_the_file(tmp_path):
    npz(tmp_path / "a.npz", A=A, period=PERIOD)
    assert read_matrix(tmp_path / "a.npz", period=PERIOD * (1.0 + 1e-12)).matrix.period == PERIOD * (1.0 + 1e-12)
    with pytest.raises(InputError, match=r"must be left out or be that of .*a\.npz, 1\.7 s, but is 3\.4 s"):
        read_matrix(tmp_path / "a.npz", period=2.0 * PERIOD)
    npz(tmp_path / "a.npz", A=A, period=PERIOD, edges=TIMES)
    with pytest.raises(InputError, match=r"`interpolation` .* must be left out for constant pieces"):
        read_matrix(tmp_path / "a.npz", interpolation="linear")


def test_nothing_is_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("it was unpickled",))

    np.savez(tmp_path / "a.npz", A=np.array([Trap()], dtype=object), period=PERIOD)
    with pytest.raises(InputError, match="is not one, or is damaged or cut short"):
        read_matrix(tmp_path / "a.npz")


def test_names_and_kinds_of_files(tmp_path):
    with pytest.raises(InputError, match=r"there is no file .*none\.npz"):
        read_matrix(tmp_path / "none.npz")
    (tmp_path / "a.txt").write_text("1 2 3")
    with pytest.raises(InputError, match=r"must end in \.npz, \.mat, \.h5, \.hdf5, \.json or \.lin, but is .*a\.txt"):
        read_matrix(tmp_path / "a.txt")
    for name in ("a.npz", "a.mat", "a.h5", "a.json"):
        (tmp_path / name).write_bytes(b"no such thing" * 20)
        with pytest.raises(InputError, match=rf"must be a whole .* file|archive, but .*{name} is none"):
            read_matrix(tmp_path / name)
    npz(tmp_path / "b.npz", A=A, period=PERIOD)
    with pytest.raises(InputError, match="must name one file, but names 2"):
        read_matrix([tmp_path / "b.npz", tmp_path / "b.npz"])
    with pytest.raises(InputError, match="must name one file, but names 0"):
        read_matrix([])
    with pytest.raises(InputError, match="be a path, or several"):
        read_matrix(3)


def test_what_is_elsewhere_is_not_read(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["A"] = A
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["A"] = h5py.ExternalLink("other.h5", "/A")
        file["period"] = PERIOD
    with pytest.raises(InputError, match="`A` in it is a link, which is not followed"):
        read_matrix(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("A", shape=A.shape, dtype="f8", chunks=A.shape)
        file["period"] = PERIOD
    with pytest.raises(InputError, match=r"parts of `A` were never written"):
        read_matrix(tmp_path / "a.h5")


@pytest.mark.parametrize("kind", ["npz", "mat", "packed mat", "mat 7.3", "h5", "json"])
def test_a_file_cut_short_is_a_message(tmp_path, kind):
    write, name = FORMATS[kind]
    write(tmp_path / name, A=A, period=PERIOD, states=NAMES)
    whole = (tmp_path / name).read_bytes()
    for share in (0.01, 0.1, 0.5, 0.9, 0.99):
        (tmp_path / name).write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError, match=rf"must be .*{name} is"):
            read_matrix(tmp_path / name)


@pytest.mark.first(1)
@pytest.mark.parametrize("kind", ["npz", "mat", "packed mat", "json"])
def test_damage_is_a_message_or_does_no_harm(tmp_path, kind):
    """scipy's own reader ends the process on some of these."""
    write, name = FORMATS[kind]
    write(tmp_path / name, A=A, period=PERIOD, states=NAMES)
    whole = (tmp_path / name).read_bytes()
    rng = np.random.default_rng(0)
    refused = []
    for trial in range(200):
        data = bytearray(whole)
        if trial % 4 == 0:
            data = data[: rng.integers(1, len(data))]
        for place in rng.integers(0, len(data), 2):
            data[place] = rng.integers(0, 256)
        (tmp_path / name).write_bytes(data)
        try:
            found = read_matrix(tmp_path / name)
        except InputError as error:
            refused.append(str(error))
        else:
            assert np.isfinite(found.matrix.at(0.3)).all()
    assert len(refused) > 50
    assert all(str(tmp_path / name) in message for message in refused)


def test_rows_of_unequal_length_in_a_file_are_refused(tmp_path):
    path = tmp_path / "ragged.json"
    path.write_text('{"A": [[[1, 2], [1]]], "period": 1}', encoding="utf-8")
    with pytest.raises(InputError, match="must hold an array of numbers in `A`"):
        read_matrix(path)


def test_samples_with_the_end_repeated_are_refused_in_a_file_too(tmp_path):
    path = tmp_path / "repeated.npz"
    angle = np.linspace(0.0, 2.0 * np.pi, 33)
    a = np.array([[0.0 * angle, 1.0 + 0.0 * angle], [-2.0 - np.cos(angle), -0.1 + 0.0 * angle]])
    np.savez(path, A=a, period=1.0)
    with pytest.raises(InputError, match="ends with its first sample again"):
        read_matrix(path)
