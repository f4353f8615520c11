"""The linearisation files of one revolution as one periodic model, with the azimuth as its phase."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error, integer, wrong_value
from floquid.floquet.files._lin_file import LinFile, LinSignals, read_lin
from floquid.floquet.files._linearisation import OpenFastLinearisation, mean_over_revolution
from floquid.io import as_path

AzimuthRole: TypeAlias = Literal["phase", "drop", "keep"]
"""The treatment of the rotor azimuth, a rigid-body state; see `read_openfast`."""

_OF = "floquet.read_openfast"
_MUST = "name the linearisation files of one model over one revolution"
_SAME = 0.01  # by how much the rotor and wind speeds of the files may differ
_APART = 0.1  # of the mean spacing: azimuths nearer than this are one azimuth twice
_MODULE = re.compile(
    r".*\.\d+\.(?:ED|BD\d*|AD\d*|ADsk|SrvD|IfW|HD|SD|SED|SEA|SeaSt|MAP|MD|FEAM|ExtPtfm|Orca|Ice[FD]\d*)\.lin",
    re.IGNORECASE,
)
_AZIMUTH = re.compile(r"^(?!.*time derivative).*\bDOF_GeAz\b", re.IGNORECASE)


def read_openfast(
    paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    *,
    azimuth: AzimuthRole = "phase",
    n_azimuths: int | None = None,
) -> OpenFastLinearisation:
    r"""A turbine linearised by OpenFAST at azimuths of one revolution, as a periodic model.

    .. math:: A(\psi) = \frac{\bar\Omega}{\dot\psi^*}\left(A_{xx} - \frac{\dot x^*}{\dot\psi^*}\,a_{\psi x}\right)

    The azimuth ψ of the generator is itself a state of the files, a rigid-body one, and it is the phase of the
    periodic model. `azimuth="phase"` takes it as the independent variable, which is exact: with x the other states,
    dx/dψ = f(x, ψ)/ψ̇, linearised about the orbit (x*, ψ*), has the matrix above, where A_xx is the files' matrix
    without the row and column of ψ, and a_ψx the row of ψ without its own column (a one under the generator's speed).
    The rank-one term is there because a faster rotor comes sooner to each azimuth: it is as large as the orbit's own
    motion, and nothing where x* is constant. The factor in front, of mean one, makes the time t = ψ/Ω̄. So the
    exponents are those of the turbine except for the one zero that belongs to a shift along the orbit. B is treated as
    A, row by row; C loses a column; D stays.

    Nothing else is left out: the speed of the generator, the torsion of the drivetrain and every state of first order
    stay, in the order of the files. Where the files have no azimuth state (the rotor turns at a given speed), nothing
    is set aside and the three choices are the same.

    Of the files there are A(ψ), and B, C, D where all hold them, with the azimuths folded to [0, 2π) and ascending.
    Raises InputError where a file cannot be read (see the message: file and line); there are fewer than three, or not
    `n_azimuths`; a file has other states, inputs, outputs or another title than the first, or speeds that differ by
    more than a hundredth; two are at the same azimuth; the rotor stands still; or `azimuth` is "phase" and a file does
    not state the rates of change of its operating point.

    Parameters
    ----------
    paths
        A folder: all its `.lin` files except those of single modules (`Main.1.ED.lin`); a pattern with
        `*`; a file; or several of these. In any order.
    azimuth
        "phase" as above. "drop" only strikes out the row and column of ψ, as is usual after a multi-blade transform.
        "keep" leaves the state in the matrices: a real model then has an exponent zero, but the column of ψ as
        OpenFAST writes it need not agree with the orbit, and may bring an instability that is not there.
    n_azimuths
        How many files there must be; not asked where not given.

    Notes
    -----
    The files must be of one periodic orbit (`CalcSteady`), and are worth the digits that they have: give `OutFmt` ten
    or more. States of BeamDyn with `RotStates` are, in the releases to which OpenFAST's issue 3394 applies, written
    in a frame that does not turn though flagged as rotating; no reader can tell, and such exponents are wrong.

    Jonkman and Jonkman 2016, «FAST modularization framework for wind turbine simulation: full-system linearization»,
    for the files; Hale, «Ordinary Differential Equations», ch. VI.1-2, for coordinates transverse to an orbit.
    """
    if azimuth not in ("phase", "drop", "keep"):
        raise wrong_value("azimuth", _OF, 'be "phase", "drop" or "keep"', azimuth)
    files = [read_lin(path, of=_OF, argument="paths") for path in _paths(paths)]
    if n_azimuths is not None and len(files) != integer(n_azimuths, "n_azimuths", _OF, at_least=3):
        raise input_error("paths", _OF, f"name {n_azimuths} files", f"names {len(files)}", "Is a file missing?")
    if len(files) < 3:
        remedy = "A model that does not vary with the azimuth needs no Floquet analysis: take the eigenvalues of A."
        raise input_error("paths", _OF, "name at least three files", f"names {len(files)}", remedy)
    for file in files:
        _check(file)
        _check_like(files[0], file)
    files = sorted(files, key=_folded)
    _refuse_twice(files)
    return _assembled(files, azimuth)


def _paths(paths: object) -> list[Path]:
    """The files that are named, one by one, by folders or by patterns."""
    given = [paths] if isinstance(paths, (str, os.PathLike)) else paths
    if not isinstance(given, Iterable) or isinstance(given, (bytes, bytearray)):
        raise wrong_value("paths", _OF, "be a path, or several", paths)
    found: list[Path] = []
    for one in given:
        path = as_path(one, of=_OF, argument="paths")
        if path.is_dir():
            inside = sorted(path.iterdir())
        elif any(letter in path.name for letter in "*?[") and not path.exists():
            inside = sorted(path.parent.glob(path.name))
        else:
            found.append(path)
            continue
        inside = [file for file in inside if file.suffix.lower() == ".lin" and not _MODULE.fullmatch(file.name)]
        if not inside:
            raise input_error("paths", _OF, _MUST, f"there is no such file in {path}", "Check the folder.")
        found += inside
    return found


def _refused(file: LinFile, got: str, remedy: str) -> Exception:
    return input_error("paths", _OF, _MUST, f"{file.path} {got}", remedy)


def _check(file: LinFile) -> None:
    """Refuse a file that does not state what a periodic model needs."""
    if file.A is None:
        raise _refused(file, "has no matrix A", "Is the file whole, and are there states?")
    if file.azimuth is None or file.rotor_speed is None:
        what = "azimuth" if file.azimuth is None else "rotor speed"
        raise _refused(file, f"does not state the {what}", "Use files of FAST 8.16 or later.")
    if file.rotor_speed <= 0.0:
        got = f"is of a rotor at {file.rotor_speed:g} rad/s"
        raise _refused(file, got, "A rotor that stands still needs no Floquet analysis: take the eigenvalues of A.")


def _check_like(first: LinFile, file: LinFile) -> None:
    """Refuse a file that is of another model, or of another operating point, than the first."""
    for kind in ("states", "inputs", "outputs"):
        one, other = (_labels(getattr(which, kind)) for which in (first, file))
        if one != other:
            short = min(len(one), len(other))
            at = next((i for i in range(short) if one[i] != other[i]), None)
            difference = (
                f"has {len(other)} {kind} where {first.path.name} has {len(one)}"
                if at is None
                else f"has {other[at]!r} as number {at + 1} of its {kind} where {first.path.name} has {one[at]!r}"
            )
            raise _refused(file, difference, "Name the files of one model, and of the whole turbine.")
    for matrix in "BCD":
        if (getattr(first, matrix) is None) != (getattr(file, matrix) is None):
            has = "has no" if getattr(file, matrix) is None else "has a"
            raise _refused(file, f"{has} matrix {matrix}, unlike {first.path.name}", "Is a file cut short?")
    if first.description != file.description:
        got = f"is of {file.description[:80]!r}, and {first.path.name} of {first.description[:80]!r}"
        raise _refused(file, got, "Name the files of one model.")
    for what, unit in (("rotor_speed", "rad/s"), ("wind_speed", "m/s")):
        one, other = getattr(first, what), getattr(file, what)
        if one is not None and other is not None and abs(one - other) > _SAME * max(abs(one), abs(other)):
            words = what.replace("_", " ")
            got = f"is at a {words} of {other:g} {unit}, and {first.path.name} at {one:g}"
            raise _refused(file, got, "Name the files of one operating point.")


def _labels(signals: LinSignals) -> list[str]:
    return [f"{name}, {unit}" if unit else name for name, unit in zip(signals.names, signals.units, strict=True)]


def _folded(file: LinFile) -> float:
    """The azimuth in [0, 2π)."""
    assert file.azimuth is not None
    angle = file.azimuth % (2.0 * np.pi)
    return angle if angle < 2.0 * np.pi else 0.0


def _refuse_twice(files: list[LinFile]) -> None:
    angles = np.array([_folded(file) for file in files])
    gaps = np.diff(angles, append=angles[0] + 2.0 * np.pi)
    nearest = int(gaps.argmin())
    if gaps[nearest] < _APART * 2.0 * np.pi / len(files):
        one, other = files[nearest], files[(nearest + 1) % len(files)]
        got = f"is at azimuth {other.azimuth:g} rad, which {one.path.name} is at too ({one.azimuth:g} rad)"
        raise _refused(other, got, "Leave one of them out: they would count twice.")


def _assembled(files: list[LinFile], azimuth: AzimuthRole) -> OpenFastLinearisation:
    """The model of files that are known to belong together, in the order of their azimuths."""
    held = [name for name in "ABCD" if getattr(files[0], name) is not None]
    stacks = {name: np.stack([getattr(file, name) for file in files], axis=-1) for name in held}
    states, points, aside = files[0].states, np.stack([file.state_values for file in files], axis=-1), ()
    angles = np.array([_folded(file) for file in files])
    speed = float(np.mean([file.rotor_speed for file in files if file.rotor_speed is not None]))
    winds = [file.wind_speed for file in files if file.wind_speed is not None]
    found = [index for index, name in enumerate(states.names) if _AZIMUTH.search(name)]
    if len(found) > 1:
        raise _refused(files[0], "has more than one azimuth of a generator", "Linearise one turbine at a time.")
    if found and azimuth != "keep":
        index = found[0]
        if azimuth == "phase":
            rates = _rates(files, index)
            speed = 1.0 / mean_over_revolution(angles, 1.0 / rates[index])
            for name in {"A", "B"} & stacks.keys():
                turning = rates[index]  # deviations at equal azimuth, and time counted at the mean speed
                rows = stacks[name] - (rates / turning)[:, None, :] * stacks[name][index]
                stacks[name] = rows * (speed / turning)
        for name, axis in (("A", 0), ("A", 1), ("B", 0), ("C", 1)):
            if name in stacks:
                stacks[name] = np.delete(stacks[name], index, axis=axis)
        aside, states, points = (states.names[index],), states.without(index), np.delete(points, index, axis=0)
    if not states.names:
        raise _refused(files[0], "has no state but the azimuth", "Linearise with other degrees of freedom, too.")
    return OpenFastLinearisation(
        azimuths=angles,
        rotor_speed=speed,
        **stacks,
        states=states,
        inputs=files[0].inputs,
        outputs=files[0].outputs,
        operating_points=points,
        set_aside=aside,
        description=files[0].description,
        wind_speed=float(np.mean(winds)) if len(winds) == len(files) else None,
    )


def _rates(files: list[LinFile], index: int) -> Floats:
    """The rates of change of the states along the orbit (n, azimuths); that of the azimuth is at `index`."""
    for file in files:
        if file.state_rates is None or not np.isfinite(file.state_rates).all():
            got = "does not state the rates of change of its operating point"
            raise _refused(file, got, 'They are needed where the azimuth is the phase. Or pass `azimuth="drop"`.')
        turning, stated = float(file.state_rates[index]), file.rotor_speed or 0.0
        if abs(turning - stated) > _SAME * stated:
            got = f"states a rotor speed of {stated:g} rad/s and a generator at {turning:g}"
            raise _refused(file, got, 'Use files of an undisturbed orbit, or pass `azimuth="drop"`.')
    return np.stack([file.state_rates for file in files if file.state_rates is not None], axis=-1)
