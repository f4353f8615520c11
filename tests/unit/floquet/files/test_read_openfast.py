"""Linearisation files of OpenFAST: small ones written here, byte by byte, whose model is known in closed form.

The real ones (openfast_toolbox and WEIS, Apache-2.0) are read from their place, and not copied.
"""

import copy
import pickle
import re
import tarfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from floquid.errors import InputError
from floquid.floquet import OpenFastLinearisation, read_openfast
from floquid.floquet.files import LinSignals, read_lin
from floquid.floquet.files._lin_file import number

FOLDER = Path(__file__).resolve().parents[5] / "shared" / "data" / "openfast_lin"
REAL = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"there is no folder {FOLDER.name} of real files")

SPEED = 2.0
AZIMUTH_STATE = "ED Variable speed generator DOF (internal DOF index = DOF_GeAz), rad"
STATES = [
    (AZIMUTH_STATE, "F", 2),
    ("ED 1st flapwise bending-mode DOF of blade 2 (internal DOF index = DOF_BF(2,1)), m", "T", 2),
    ("ED First time derivative of Variable speed generator DOF (internal DOF index = DOF_GeAz), rad/s", "F", 2),
    ("AD x4 blade 2, node 2, -", "T", 1),
]
INPUTS = [("IfW Extended input: horizontal wind speed (steady/uniform wind), m/s", "F", 0), ("ED Yaw moment", "F", 0)]
OUTPUTS = [("ED Azimuth, (deg)", "F", 0), ("ED RootMyb2, (kN-m)", "T", 0), ("SrvD GenPwr, (kW)", "F", 0)]


def plain(value):
    return f"{value:25.16E}"


def double(value):
    """As a compiler writes double precision: 1.0D+00."""
    return plain(value).replace("E", "D")


def lost(value):
    """As Fortran writes an exponent of three digits where there is room for two: 1.0-101."""
    mantissa, exponent = f"{value:.16E}".split("E")
    return f"{mantissa}{int(exponent):+04d}"


def table(title, signals, values, version, fmt=plain):
    head = ["Row/Column", "Operating Point", "Rotating Frame?", "Derivative Order", "Description"]
    shown = [True, True, version >= 8.16, version >= 9, True]
    lines = [f"Order of {title}:"]
    for words in (head, ["-" * len(word) for word in head]):
        lines += ["   " + "   ".join(word for word, show in zip(words, shown, strict=True) if show)]
    for row, ((name, *flags), value) in enumerate(zip(signals, values, strict=True)):
        cells = [f"{row + 1:8d}", value if isinstance(value, str) else fmt(value), *map(str, flags), name]
        lines += ["   " + "   ".join(cell for cell, show in zip(cells, shown, strict=True) if show)]
    return [*lines, ""]


def block(name, matrix, fmt=plain):
    rows, columns = matrix.shape
    return [f"{name}: {rows} x {columns}", *(" " + " ".join(fmt(value) for value in row) for row in matrix), ""]


def lin_text(
    azimuth=0.0,
    *,
    A,
    B=None,
    C=None,
    D=None,
    x=None,
    rates=None,
    states=STATES,
    speed=SPEED,
    wind="14.0000",
    version=9,
    fmt=plain,
    title="A rotor",
    extra=(),
):
    """A file as the writers of that version (8.12, 8.16, or 9 for OpenFAST) lay it out."""
    inputs, outputs = (INPUTS if B is not None else []), (OUTPUTS if C is not None else [])
    counts = [("continuous states", len(states)), ("discrete states", 0), ("constraint states", 0)]
    counts += [("inputs", len(inputs)), ("outputs", len(outputs))]
    lines = ["", "Linearized model: Predictions were generated on 30-Mar-2022 at 17:22:37 using OpenFAST"]
    lines += [
        " linked with  NWTC Subroutine Library; ElastoDyn",
        "",
        f"Description from the FAST input file: {title}",
        "",
    ]
    if version < 8.16:
        lines += ["Linearized model at simulation time =   60.0000 s"]
    else:
        lines += ["Simulation information:", "   Simulation time:                   242.3200 s"]
        lines += [f"   Rotor Speed:                   {speed} rad/s", f"   Azimuth:                   {azimuth} rad"]
        lines += [f"   Wind Speed:                         {wind} m/s"] if version >= 9 else []
    lines += [f"   Number of {kind}: {count:8d}" for kind, count in counts]
    lines += ["   Jacobians included in this file?    No", ""]
    zeros = np.zeros(len(states))
    lines += table("continuous states", states, zeros if x is None else x, version, fmt)
    if rates is not False:
        rates = zeros if rates is None else rates
        derivatives = [(f"First time derivative of {name}/s", *rest) for name, *rest in states]
        lines += table("continuous state derivatives", derivatives, rates, version, fmt)
    lines += table("inputs", inputs, np.zeros(len(inputs)), version, fmt) if inputs else []
    # The direction cosines of an orientation: three numbers with commas.
    cosines = "1.000E+00, 0.000E+00, 0.000E+00"
    lines += table("outputs", outputs, [cosines, *np.zeros(len(outputs) - 1)], version, fmt) if outputs else []
    lines += ["", "Linearized state matrices:", ""]
    for name, matrix in {"A": A, "B": B, "C": C, "D": D}.items():
        lines += block(name, matrix, fmt) if matrix is not None else []
    return "\n".join([*lines, *extra]) + "\n"


def matrices(seed=0, n=4):
    rng = np.random.default_rng(seed)
    return {
        "A": rng.standard_normal((n, n)),
        "B": rng.standard_normal((n, 2)),
        "C": rng.standard_normal((3, n)),
        "D": rng.standard_normal((3, 2)),
    }


class Rotor:
    """A turbine with a known orbit x* = P(ψ) and known motion about it, N(ψ), at equal azimuth.

    States ψ, q, Ω, z with dψ/dt = Ω and dx/dt = P'(ψ) Ω + (Ω/Ω̄) N(ψ) (x - P(ψ)), x = (q, Ω, z): the deviation from
    the orbit obeys dξ/dψ = N(ψ) ξ/Ω̄, to the last term. Its linearisation follows by differentiation.
    """

    def __init__(self, swing=0.15, harmonics=1):
        """`swing` is the part by which the speed varies over a revolution."""
        rng = np.random.default_rng(3)
        self.mean = rng.standard_normal((3, 3)) - 2.0 * np.eye(3)
        self.waves = 0.5 * rng.standard_normal((2, harmonics, 3, 3))
        self.swing = swing
        self.input = rng.standard_normal((3, 2))

    def N(self, psi):
        k = np.arange(1, self.waves.shape[1] + 1) * psi
        return self.mean + np.tensordot(np.cos(k), self.waves[0], 1) + np.tensordot(np.sin(k), self.waves[1], 1)

    def orbit(self, psi):
        """P, P' and P'', where 1/Ω has the mean 1/SPEED exactly: Ω = SPEED/(1 + swing cos ψ)."""
        u = 1.0 + self.swing * np.cos(psi)
        du, ddu = -self.swing * np.sin(psi), -self.swing * np.cos(psi)
        omega = [SPEED / u, -SPEED * du / u**2, SPEED * (2.0 * du**2 / u**3 - ddu / u**2)]
        flap = [0.7 * np.sin(psi), 0.7 * np.cos(psi), -0.7 * np.sin(psi)]
        wake = [0.3 * np.cos(2 * psi), -0.6 * np.sin(2 * psi), -1.2 * np.cos(2 * psi)]
        return [np.array([flap[i], omega[i], wake[i]]) for i in range(3)]

    def text(self, psi, **keywords):
        P, dP, ddP = self.orbit(psi)
        omega = P[1]
        M = omega / SPEED * self.N(psi)
        A = np.zeros((4, 4))
        A[0, 2] = 1.0
        A[1:, 1:] = M + np.outer(dP, [0.0, 1.0, 0.0])
        A[1:, 0] = ddP * omega - M @ dP
        B = np.vstack([np.zeros(2), omega / SPEED * self.input])
        rates = np.array([omega, *(dP * omega)])
        options = {"A": A, "B": B, "C": np.ones((3, 4)), "D": np.ones((3, 2)), "x": [psi + 4.0, *P], "rates": rates}
        return lin_text(psi, speed=f"{omega:.12f}", **(options | keywords))


def write_turn(folder, text, azimuths):
    """One file an azimuth, `text(azimuth)`, in an order that is not that of the azimuths."""
    order = np.random.default_rng(1).permutation(len(azimuths))
    for number_, index in enumerate(order):
        (folder / f"turn.{number_ + 1}.lin").write_text(text(azimuths[index]), encoding="utf-8")
    return folder


def even(count, start=0.1):
    return start + 2.0 * np.pi * np.arange(count) / count


def exponents(model, n_steps=600):
    """The exponents by the exponential of A at the middle of each step, of the fit of all harmonics."""
    harmonics, coefficients = model.harmonics()
    psi = 2.0 * np.pi * (np.arange(n_steps) + 0.5) / n_steps
    A = np.einsum("ijk,ka->aij", coefficients, np.exp(1j * harmonics[:, None] * psi)).real
    transition = np.eye(A.shape[1])
    for factor in expm(A * (model.period / n_steps)):
        transition = factor @ transition
    multipliers = np.linalg.eigvals(transition)
    return np.log(multipliers[np.argsort(-np.abs(multipliers))] + 0j) / model.period


# One file


@pytest.mark.parametrize("version", [8.16, 9])
@pytest.mark.parametrize("fmt", [plain, double, lost])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_file_is_read_to_the_last_bit(tmp_path, version, fmt, end):
    said = matrices()
    said["A"][0] *= 1e-120
    x = np.array([4.7, -1.5, 2.0, 1e-110])
    path = tmp_path / "one.lin"
    text = lin_text(6.3, **said, x=x, rates=2 * x, version=version, fmt=fmt, title="Ωmega at 9 RPM: a test")
    path.write_bytes(text.replace("\n", end).encode())
    file = read_lin(path)
    digits = {"rtol": 1e-15, "atol": 0}
    for name, matrix in said.items():
        np.testing.assert_allclose(getattr(file, name), matrix, **digits)
    np.testing.assert_allclose(file.state_values, x, **digits)
    np.testing.assert_allclose(file.state_rates, 2 * x, **digits)
    assert (file.azimuth, file.rotor_speed, file.time) == (6.3, 2.0, 242.32)
    assert file.wind_speed == (14.0 if version >= 9 else None)
    assert file.description == "Ωmega at 9 RPM: a test"
    assert file.states.names[3] == "AD x4 blade 2, node 2"
    assert file.states.units == ("rad", "m", "rad/s", "-")
    assert file.states.rotating == (False, True, False, True)
    assert file.states.derivative_orders == ((2, 2, 2, 1) if version >= 9 else None)
    assert file.inputs.units == ("m/s", "")
    assert file.outputs.names == ("ED Azimuth", "ED RootMyb2", "SrvD GenPwr")
    assert file.outputs.units == ("deg", "kN-m", "kW")


def test_the_first_format_has_no_azimuth_and_is_read_and_refused(tmp_path):
    path = tmp_path / "old.lin"
    path.write_text(lin_text(**matrices(), version=8.12), encoding="utf-8")
    file = read_lin(path)
    assert file.azimuth is None
    assert file.rotor_speed is None
    assert file.states.rotating is None
    assert file.states.names[1].startswith("ED 1st flapwise")
    with pytest.raises(InputError, match=r"old\.lin does not state the azimuth.*\n.*8\.16"):
        read_openfast([path] * 3)


def test_what_later_releases_add_is_passed_over(tmp_path):
    said = matrices()
    text = lin_text(**said, extra=[*block("StateRotation", np.eye(3)), "ED M: a list of names", " 1.0 2.0", ""])
    jacobians = "\n".join(["Jacobian matrices:", "", *block("dUdu", np.eye(2)), *block("A", np.eye(3))])
    text = text.replace("\nLinearized state", f"{jacobians}\n\nLinearized state")
    text = text.replace("       4   " + plain(0.0), "       3   " + plain(0.0))  # rows of one number, as OpenFAST 4 has
    (tmp_path / "new.lin").write_text("\ufeff" + text, encoding="utf-8")
    np.testing.assert_array_equal(read_lin(tmp_path / "new.lin").A, said["A"])


def test_asterisks_are_no_numbers_where_none_is_needed(tmp_path):
    path = tmp_path / "wide.lin"
    path.write_text(lin_text(A=matrices()["A"], wind="********", x=["****", 1.0, 2.0, 3.0]), encoding="utf-8")
    file = read_lin(path)
    assert file.wind_speed is None
    assert np.isnan(file.state_values[0])
    assert file.B is None
    assert file.inputs.names == ()


@pytest.mark.parametrize(
    ("token", "value"),
    [("1.5D+01", 15.0), ("-1.0-101", -1e-101), ("+2.5+100", 2.5e100), (".5", 0.5), ("3", 3.0), ("1.E2", 100.0)],
)
def test_numbers_of_fortran(token, value):
    assert number(token) == value


@pytest.mark.parametrize("token", ["", "1_000", "0x10", "1.0.0", "12-3x", "T", "e5", "1e", "--1", "1,5"])
def test_what_is_no_number(token):
    assert number(token) is None


def break_line(text, start, new):
    lines = text.split("\n")
    index = next(i for i, line in enumerate(lines) if line.strip().startswith(start))
    lines[index] = new(lines[index]) if callable(new) else new
    return "\n".join(lines), index + 1


@pytest.mark.parametrize(
    ("start", "new", "message"),
    [
        ("Number of continuous states:", "", r"has no line «Number of continuous states:»"),
        (
            "Number of continuous states:",
            "   Number of continuous states: ****",
            "must end in the number of continuous",
        ),
        ("Number of continuous states:", "   Number of continuous states: 3", "must be blank, after the 3 rows"),
        ("Number of continuous states:", "   Number of continuous states: 987654321", "must be row 5 of 987654321"),
        ("Number of inputs:", "   Number of inputs: 0", r"announces B: 4 x 2, which must be 4 x 0"),
        ("Rotor Speed:", "   Rotor Speed: fast rad/s", "must state the rotor speed in rad/s, but states 'fast rad/s'"),
        ("Rotor Speed:", "   Rotor Speed: 12.1 rpm", "must state the rotor speed in rad/s"),
        ("Azimuth:", "   Azimuth: 12.1 deg", "must state the azimuth in rad"),
        ("Order of inputs:", "Order of imputs:", "announces 2 and has no table «Order of inputs»"),
        ("Row/Column", "   Row/Column  Description", "must be the head of a table"),
        ("2   ", lambda line: line.replace(" T ", " X "), "must say T or F"),
        ("2   ", lambda line: line.replace("2   ED", "two ED"), "must have an integer under «Derivative Order»"),
        ("2   ", lambda line: line.replace("E+00", "E*00"), "must begin with the number of the row and its operating"),
        ("2   ", "", "must be row 2 of 4 of «Order of continuous states», but is missing"),
        ("A:", "A: 5 x 4", r"announces A: 5 x 4, which must be 4 x 4, once"),
        ("A:", "A 4 x 4", "is neither blank nor the head of a matrix: 'A 4 x 4'"),
        ("B:", "A: 4 x 4", r"announces A: 4 x 4, which must be 4 x 4, once"),
        ("D:", "D: 3 x 2x", "is neither blank nor the head of a matrix"),
    ],
)
def test_a_fault_is_named_by_file_and_line(tmp_path, start, new, message):
    text, line = break_line(lin_text(**matrices()), start, new)
    path = tmp_path / "bad.lin"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        read_lin(path)
    assert "Argument `path` of `floquet.read_lin` must name linearisation files" in str(caught.value)
    assert "bad.lin" in str(caught.value)
    found = re.search(r"line (\d+) of", str(caught.value))
    assert found is None or line <= int(found[1]) <= text.count("\n") + 1
    assert found or "has no" in message


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("nan", r"has 'nan' in row 2, column 3 of C, which is no number"),
        ("********", r"has '\*+' in row 2, column 3 of C.*\n.*`OutFmt`"),
        ("1.0E+999", "row 2, column 3 of C"),
        ("1_0.0", "row 2, column 3 of C"),
        ("1.0 1.0", "has 5 numbers, where row 2 of C has 4"),
        ("", "has 3 numbers, where row 2 of C has 4"),
    ],
)
def test_a_bad_number_is_named_by_its_place(tmp_path, word, message):
    said = matrices()
    lines = lin_text(**said).split("\n")
    at = lines.index("C: 3 x 4") + 2
    words = lines[at].split()
    words[2] = word
    lines[at] = " ".join(words)
    (tmp_path / "bad.lin").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        read_lin(tmp_path / "bad.lin")
    assert f"line {at + 1} of" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"bad\.lin is empty"),
        (lin_text(**matrices()).encode("utf-16"), r"bad\.lin is not a text \(it holds NUL bytes\)"),
        (lin_text(**matrices(), title="a\0b").encode(), "holds NUL bytes"),
        (b"A: 1 x 1\n 1.0\n", r"bad\.lin has no line «Number of continuous states:»"),
        (b"%PDF-1.7 \xff\xfe", r"bad\.lin has no line «Number of continuous states:»"),
    ],
)
def test_what_is_no_linearisation_is_refused(tmp_path, content, message):
    (tmp_path / "bad.lin").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_lin(tmp_path / "bad.lin")


def test_a_file_cut_anywhere_is_refused_or_lacks_what_was_cut(tmp_path):
    said = matrices()
    text = lin_text(**said)
    path = tmp_path / "cut.lin"
    for size in [*range(1, len(text), 37), *range(len(text) - 30, len(text) - 2)]:
        path.write_text(text[:size], encoding="utf-8")
        try:
            file = read_lin(path)
        except InputError as error:
            assert "cut.lin" in str(error)  # noqa: PT017
            continue
        for name in "ABCD":
            assert getattr(file, name) is None or np.array_equal(getattr(file, name), said[name])
            assert (getattr(file, name) is None) == (size < text.index(f"\n{name}: "))


@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=8))
def test_flipped_bytes_never_raise_anything_else(tmp_path_factory, flips):
    content = bytearray(lin_text(**matrices()).encode())
    for place, byte in flips:
        content[place % len(content)] = byte
    path = tmp_path_factory.getbasetemp() / "flipped.lin"
    path.write_bytes(content)
    try:
        file = read_lin(path)
    except InputError:
        return
    assert all(getattr(file, name) is None or np.isfinite(getattr(file, name)).all() for name in "ABCD")


# One revolution


def test_the_azimuth_as_phase_leaves_the_motion_at_equal_azimuth(tmp_path):
    """The reduction is exact: N(ψ) of the rotor, in closed form, from files whose speed varies by up to 1 %."""
    rotor, azimuths = Rotor(swing=0.004), even(12, start=0.3) + 2.0 * np.pi * (np.arange(12) > 5)
    model = read_openfast(write_turn(tmp_path, rotor.text, azimuths))
    np.testing.assert_allclose(model.azimuths, even(12, start=0.3), rtol=1e-14)
    assert model.rotor_speed == pytest.approx(SPEED, rel=1e-12)
    assert model.period == pytest.approx(2.0 * np.pi / SPEED, rel=1e-12)
    np.testing.assert_allclose(model.times, model.azimuths / SPEED, rtol=1e-12)
    for index, psi in enumerate(model.azimuths):
        np.testing.assert_allclose(model.A[:, :, index], rotor.N(psi), atol=1e-11)
        np.testing.assert_allclose(model.B[:, :, index], rotor.input, atol=1e-11)
        np.testing.assert_allclose(model.operating_points[:, index], rotor.orbit(psi)[0], atol=1e-13)
    assert model.C.shape == (3, 3, 12)
    assert model.D.shape == (3, 2, 12)
    assert model.set_aside == (AZIMUTH_STATE.removesuffix(", rad"),)
    assert model.state_names == tuple(name.rpartition(", ")[0] for name, *_ in STATES[1:])
    assert model.states.rotating == (True, False, True)
    assert model.states.derivative_orders == (2, 2, 1)
    assert (len(model.inputs.names), len(model.outputs.names), model.n_blades) == (2, 3, 2)


def test_the_phase_takes_away_the_exponent_zero_and_no_other(tmp_path):
    """Kept, the azimuth brings the exponent zero of an autonomous system; struck out, the others are wrong."""
    rotor = Rotor(swing=0.0)
    folder = write_turn(tmp_path, rotor.text, even(16))
    kept, phase, dropped = (exponents(read_openfast(folder, azimuth=role)) for role in ("keep", "phase", "drop"))
    np.testing.assert_allclose(np.abs(kept).min(), 0.0, atol=1e-4)
    others = np.delete(kept, np.abs(kept).argmin())
    nearest = np.abs(phase[:, None] - others[None, :]).min(axis=1)
    assert nearest.max() < 1e-4
    assert np.abs(dropped[:, None] - others[None, :]).min(axis=1).max() > 0.05


def test_what_is_struck_out_and_what_is_kept(tmp_path):
    said = {psi: matrices(seed) for seed, psi in enumerate(even(5))}
    folder = write_turn(tmp_path, lambda psi: lin_text(psi, **said[psi]), even(5))
    dropped, kept = (read_openfast(folder, azimuth=role) for role in ("drop", "keep"))
    for index, one in enumerate(said.values()):
        np.testing.assert_array_equal(kept.A[:, :, index], one["A"])
        np.testing.assert_array_equal(dropped.A[:, :, index], one["A"][1:, 1:])
        np.testing.assert_array_equal(dropped.B[:, :, index], one["B"][1:])
        np.testing.assert_array_equal(dropped.C[:, :, index], one["C"][:, 1:])
        np.testing.assert_array_equal(dropped.D[:, :, index], one["D"])
    assert kept.set_aside == ()
    assert kept.state_names[0] == dropped.set_aside[0]


def test_without_an_azimuth_state_the_choices_are_one(tmp_path):
    A = matrices()["A"][1:, 1:]
    no_generator = [STATES[1], STATES[3], ("HD ExctnPtfmSg1", "F", 1)]
    folder = write_turn(tmp_path, lambda psi: lin_text(psi, A=A, states=no_generator, rates=False), even(3))
    for role in ("phase", "drop", "keep"):
        model = read_openfast(folder, azimuth=role)
        np.testing.assert_array_equal(model.A[:, :, 1], A)
        assert (model.B, model.set_aside, model.rotor_speed) == (None, (), SPEED)


def test_files_are_found_by_folder_pattern_and_name(tmp_path):
    write_turn(tmp_path, Rotor(0.0).text, even(6))
    one_module = tmp_path / "turn.1.ED.lin"
    one_module.write_text("not of the whole turbine", encoding="utf-8")
    (tmp_path / "turn.1.LIN.txt").touch()
    found = [
        read_openfast(tmp_path),
        read_openfast(str(tmp_path / "turn.*.lin"), n_azimuths=6),
        read_openfast([tmp_path / "turn.[1-3].lin", *(tmp_path / f"turn.{n}.lin" for n in (6, 5, 4))]),
    ]
    assert len({model.A.tobytes() for model in found}) == 1
    with pytest.raises(InputError, match=r"turn\.1\.ED\.lin has no line"):
        read_openfast([one_module])
    with pytest.raises(InputError, match=r"must name 7 files, but names 6"):
        read_openfast(tmp_path, n_azimuths=7)
    with pytest.raises(InputError, match=r"there is no such file in .*other\.\*"):
        read_openfast(tmp_path / "other.*")
    for wrong in (3, b"turn", [3], "", ["a\0b"], tmp_path / "none.lin"):
        with pytest.raises(InputError, match=r"`paths` of `floquet\.read_openfast`"):
            read_openfast(wrong)
    with pytest.raises(InputError, match=r'must be "phase", "drop" or "keep", but is True'):
        read_openfast(tmp_path, azimuth=True)


HEADER = {"speed": ("Rotor Speed:", "rad/s"), "azimuth": ("Azimuth:", "rad")}
LESS = {"C": None, "D": None}


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        (
            {"states": [*STATES[:3], ("AD x4 blade 2, node 3, -", "T", 1)]},
            r"has 'AD x4 blade 2, node 3, -' as number 4",
        ),
        ({"states": [*STATES[:3], ("AD x4 blade 2, node 2, m", "T", 1)]}, r"'AD x4 blade 2, node 2, m' as number 4"),
        (
            {"states": STATES[:3], "x": np.zeros(3), "A": np.eye(3), "rates": np.zeros(3), **LESS, "B": None},
            "has 3 states",
        ),
        (LESS, r"has 0 outputs where turn\.1\.lin has 3"),
        ({"D": None}, r"has no matrix D, unlike turn\.1\.lin"),
        ({"title": "Another rotor"}, "is of 'Another rotor', and turn.1.lin of 'A rotor'"),
        ({"speed": "2.0300"}, r"is at a rotor speed of 2\.03 rad/s, and turn\.1\.lin at 2"),
        ({"wind": "10.0000"}, r"is at a wind speed of 10 m/s, and turn\.1\.lin at 14"),
        ({"speed": "0.0000"}, r"is of a rotor at 0 rad/s.*\n.*eigenvalues"),
        ({"A": None, "B": None, **LESS}, "has no matrix A"),
        ({"rates": False}, r'does not state the rates of change.*\n.*`azimuth="drop"`'),
        ({"rates": [2.0, "*****", 0.0, 0.0]}, "does not state the rates of change"),
        ({"rates": [1.9, 0.0, 0.0, 0.0]}, "states a rotor speed of 2 rad/s and a generator at 1.9"),
        ({"azimuth": 0.1 + 4.0 * np.pi - 0.01}, r"turn\.1\.lin is at azimuth 0\.1 rad, which turn\.6\.lin is at too"),
    ],
)
def test_a_stranger_is_refused_by_name(tmp_path, keywords, message):
    rotor = Rotor(swing=0.0)
    for index, psi in enumerate(even(6)):
        text = rotor.text(psi)
        if index == 5:
            text = rotor.text(psi, **{key: value for key, value in keywords.items() if key not in HEADER})
            for key in keywords.keys() & HEADER.keys():
                text = break_line(text, HEADER[key][0], f"   {HEADER[key][0]} {keywords[key]} {HEADER[key][1]}")[0]
        (tmp_path / f"turn.{index + 1}.lin").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        read_openfast([tmp_path / f"turn.{n}.lin" for n in range(1, 7)])
    assert "turn.6.lin" in str(caught.value)


def test_too_few_and_too_odd_are_refused(tmp_path):
    folder = write_turn(tmp_path, Rotor(0.0).text, even(7))
    files = sorted(folder.iterdir())
    with pytest.raises(InputError, match=r"at least three files, but names 2\.\n.*eigenvalues"):
        read_openfast(files[:2])
    with pytest.raises(InputError, match=r"an even number of at least six, but has 7"):
        read_openfast(files).every_other()
    with pytest.raises(InputError, match=r"turn\.3\.lin is at azimuth .* which turn\.3\.lin is at too"):
        read_openfast([*files[:3], files[2]])
    end = folder / "end.lin"  # a whole revolution later, to a step of the simulation
    end.write_text(Rotor(0.0).text(even(7)[0] + 2.0 * np.pi - 0.004, title="A rotor"), encoding="utf-8")
    with pytest.raises(InputError, match=r"turn\.\d\.lin is at azimuth 0\.1 rad, which end\.lin is at too"):
        read_openfast([*files, end])
    for file in (*files, end):  # the same, with both ends on either side of azimuth zero
        text = file.read_text(encoding="utf-8")
        said = float(re.search(r"Azimuth: +(\S+)", text)[1])
        file.write_text(re.sub(r"Azimuth: +\S+", f"Azimuth: {said - 0.098:.6f}", text), encoding="utf-8")
    with pytest.raises(InputError, match=r"turn\.\d\.lin is at azimuth 0\.002 rad, which end\.lin is at too \(6\.28"):
        read_openfast([*files, end])


# The harmonics and the verdict


def model_of(azimuths, values, blades=2):
    """A model of A(ψ) = `values(ψ)`, with the names of that many blades."""
    A = np.stack([values(psi) for psi in azimuths], axis=-1)
    names = tuple(f"state {n} of blade {blades}" if blades else f"state {n}" for n in range(A.shape[0]))
    states = LinSignals(names=names, units=("m",) * len(names))
    points = np.zeros((len(names), len(azimuths)))
    return OpenFastLinearisation(azimuths=azimuths, rotor_speed=SPEED, A=A, states=states, operating_points=points)


@pytest.mark.parametrize("uneven", [0.0, 0.15])
@pytest.mark.parametrize("count", [7, 12])
def test_harmonics_are_those_of_the_matrix(uneven, count):
    rotor = Rotor(harmonics=3)
    azimuths = even(count) + uneven * np.random.default_rng(2).uniform(-0.5, 0.5, count)
    model = model_of(azimuths, rotor.N)
    harmonics, coefficients = model.harmonics()
    np.testing.assert_array_equal(harmonics, np.arange(-((count - 1) // 2), (count - 1) // 2 + 1))
    middle = len(harmonics) // 2
    np.testing.assert_allclose(coefficients[:, :, middle], rotor.mean, atol=1e-13)
    for k in (1, 2, 3):
        expected = 0.5 * (rotor.waves[0, k - 1] - 1j * rotor.waves[1, k - 1])
        np.testing.assert_allclose(coefficients[:, :, middle + k], expected, atol=1e-13)
    np.testing.assert_array_equal(coefficients[:, :, ::-1], coefficients.conj())
    verdict = model.resolution()
    assert verdict.equally_spaced == (uneven == 0.0)
    assert verdict.sizes[4:].max(initial=0.0) < 1e-14
    assert np.sum(verdict.sizes**2) == pytest.approx(1.0, abs=1e-12 if uneven == 0.0 else 0.2)


def test_fewer_harmonics_and_what_cannot_be_had():
    model = model_of(even(8), Rotor(harmonics=1).N)
    harmonics, coefficients = model.harmonics("A", 1)
    assert harmonics.tolist() == [-1, 0, 1]
    assert coefficients.shape == (3, 3, 3)
    with pytest.raises(InputError, match=r"at most 3, which 8 azimuths .* determine, but is 4"):
        model.harmonics("A", 4)
    with pytest.raises(InputError, match=r"be one that the files hold \(A\), but is 'C'"):
        model.harmonics("C")


def test_a_smooth_matrix_is_resolved_and_a_rough_one_is_not():
    smooth, rough = Rotor(harmonics=1).N, Rotor(harmonics=3).N
    assert model_of(even(12), smooth).resolution().resolved
    assert model_of(even(24), rough).resolution().resolved
    verdict = model_of(even(8), rough).resolution()
    assert not verdict.resolved
    assert "Harmonic 3 and what no harmonic fits are" in verdict.reasons[1]
    assert "do not die out" in verdict.reasons[1]


def test_the_residual_counts_where_the_harmonics_are_small():
    """A sixth harmonic at twelve azimuths is in none of the five that can be fitted."""
    verdict = model_of(even(12, start=0.0), lambda psi: -np.eye(2) * (2.0 + np.cos(6.0 * psi))).resolution()
    assert verdict.sizes[1:].max() < 1e-14
    assert verdict.tail == pytest.approx(np.sqrt(1.0 / 5.0), rel=1e-12)
    assert not verdict.resolved


def test_three_azimuths_of_three_blades_hide_what_happens_three_times_a_turn():
    def hidden(psi):
        return np.array([[0.0, 1.0], [-1.0 - 5.0 * np.cos(3.0 * psi), -0.1]])

    model = model_of(even(3, start=0.0), hidden, blades=3)
    verdict = model.resolution()
    assert verdict.tail < 1e-12  # it looks constant
    assert not verdict.resolved
    assert "falls onto the mean" in verdict.reasons[-1]
    assert "Use at least 7" in verdict.reasons[-1]
    unnamed = model_of(even(5), hidden, blades=0)
    assert unnamed.n_blades is None
    assert "none is named" in unnamed.resolution().reasons[-1]
    assert "falls onto" not in unnamed.resolution().reasons[-1]


def test_units_do_not_matter():
    rotor, scale = Rotor(harmonics=2), np.array([1.0, 2.0**20, 2.0**-15])
    one = model_of(even(9), rotor.N).resolution()
    other = model_of(even(9), lambda psi: rotor.N(psi) * scale[:, None] / scale).resolution()
    np.testing.assert_allclose(one.sizes, other.sizes, rtol=1e-9, atol=1e-15)
    assert one.tail == pytest.approx(other.tail, rel=1e-9)


def test_azimuths_of_half_a_turn_do_not_determine_harmonics():
    verdict = model_of(even(13) / 4.0, Rotor(harmonics=1).N).resolution()
    assert verdict.harmonics.size < 4
    assert not verdict.resolved
    assert "largest gap 276.9 degrees" in verdict.reasons[0]


def test_every_other_azimuth():
    rotor = Rotor(harmonics=2)
    model = model_of(even(12), rotor.N)
    half = model.every_other()
    np.testing.assert_array_equal(half.azimuths, model.azimuths[::2])
    np.testing.assert_array_equal(half.A, model.A[:, :, ::2])
    assert half.period == model.period
    np.testing.assert_allclose(exponents(half), exponents(model), atol=1e-12)


def test_a_model_is_frozen_and_survives_copies():
    model = model_of(even(5), Rotor().N)
    assert not model.A.flags.writeable
    for twin in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        np.testing.assert_array_equal(twin.A, model.A)
        assert twin.state_names == model.state_names


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"azimuths": even(5)[::-1]}, r"`azimuths` .* must be three or more that ascend in \[0, 2π\)"),
        ({"azimuths": even(5) + 6.0}, "must be three or more that ascend"),
        ({"azimuths": even(2)}, "but has 2 from 0.1 to 3.24"),
        ({"rotor_speed": 0.0}, "`rotor_speed` .* must be positive"),
        ({"A": np.zeros((3, 3, 4))}, r"`A` .* must have shape \(3, 3, 5\)"),
        ({"B": np.zeros((3, 1, 5))}, r"`B` .* must have shape \(3, 0, 5\)"),
        ({"A": np.full((3, 3, 5), np.nan)}, "must be finite"),
    ],
)
def test_a_wrong_model_is_refused(change, message):
    given_ = {
        "azimuths": even(5),
        "rotor_speed": SPEED,
        "A": np.zeros((3, 3, 5)),
        "states": LinSignals(names=("a", "b", "c"), units=("",) * 3),
        "operating_points": np.full((3, 5), np.nan),
    }
    OpenFastLinearisation(**given_)
    with pytest.raises(InputError, match=message):
        OpenFastLinearisation(**(given_ | change))


# Real files


@REAL
def test_three_azimuths_of_a_real_turbine():
    model = read_openfast(FOLDER)
    assert model.A.shape == (19, 19, 3)
    assert model.azimuths.tolist() == [0.0092, 1.9224, 4.0147]
    assert model.period == pytest.approx(6.6665, abs=2e-3)
    assert model.n_blades == 3
    assert model.B is None
    assert sum(model.states.rotating) == 18
    verdict = model.resolution()
    assert not verdict.resolved
    assert not verdict.equally_spaced
    assert "which 3 azimuths do not see" in verdict.reasons[-1]


@pytest.fixture(scope="module")
def floating(tmp_path_factory):
    """The folder of the twelve azimuths of a floating turbine."""
    folder = tmp_path_factory.mktemp("floating")
    with tarfile.open(FOLDER / "weis_12_azimuths.tar.xz") as archive:
        archive.extractall(folder, filter="data")
    return folder


@pytest.mark.slow
@REAL
def test_twelve_azimuths_of_a_real_turbine(floating):
    model = read_openfast(floating, n_azimuths=12)
    assert model.A.shape == (101, 101, 12)
    assert model.B.shape == (101, 100, 12)
    assert model.C.shape == (268, 101, 12)
    assert model.D.shape == (268, 100, 12)
    assert model.period == pytest.approx(8.0, abs=2e-3)
    assert np.array_equal(np.argsort(model.azimuths), np.arange(12))
    verdict = model.resolution()
    assert verdict.resolved, verdict.reasons
    assert not verdict.equally_spaced  # the time step does not divide the revolution
    assert verdict.sizes[1:].argmax() == 2  # three blades, seen from the tower
    assert not model.every_other().resolution().resolved


@pytest.mark.slow
@REAL
def test_the_azimuth_kept_brings_an_instability_that_is_not_there(floating):
    """The files' own column of the azimuth does not agree with their orbit: no model for exponents."""
    kept, phase = (exponents(read_openfast(floating, azimuth=role), n_steps=96) for role in ("keep", "phase"))
    assert kept.real.max() > 0.5
    assert phase.real.max() < 1e-9
