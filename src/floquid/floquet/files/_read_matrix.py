"""A(t) from a file."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid._checks import Rebuilt, describe, input_error, positive, wrong_value
from floquid.errors import InputError
from floquid.floquet.files._array_files import OF, Contents, contents, printable
from floquid.floquet.files._linearisation import OpenFastLinearisation
from floquid.floquet.files._read_openfast import read_openfast
from floquid.floquet.matrices import (
    AbstractPeriodicMatrix,
    HarmonicMatrix,
    Interpolation,
    PiecewiseMatrix,
    SampledMatrix,
    named,
)
from floquid.io import as_path, readable_file

_SAME = 1e-9  # of a period: by how much two statements of it, or an instant one period later, may differ
_TAIL = 1e-3  # of A: what the highest third of the harmonics of resolved samples may be, as with azimuths
_REPEATS = 1e-6  # of A: by how much the repeated end of samples may differ from their beginning
_LAYOUT = (
    "Save `A` (n, n, phases) at equal steps with `period` [s]; or with `times` (phases,) [s]; or with `edges` "
    "(phases,) [s], where constant pieces begin; or `coefficients` (n, n, harmonics) with `harmonics`. Beside them, "
    "`states`: names."
)


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MatrixFile(Rebuilt):
    """A(t) as a file has it.

    Made by `read_matrix`.

    Parameters
    ----------
    matrix
        A(t).
    states
        The names of the states (n,); x1, x2, ... where the file has none.
    source
        What A(t) was made from, in words.
    warnings
        What may be wrong with it, in sentences.
    linearisation
        What `read_openfast` gave, of `.lin` files.
    outputs, output_names
        C(t), constant or of the period of A(t), and the names of its rows, y1, y2, ... where the file has none; None
        and () of a file without it.
    """

    matrix: AbstractPeriodicMatrix
    states: tuple[str, ...]
    source: str
    warnings: tuple[str, ...] = ()
    linearisation: OpenFastLinearisation | None = None
    outputs: AbstractPeriodicMatrix | Floats | None = None
    output_names: tuple[str, ...] = ()


def read_matrix(
    paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    *,
    period: float | None = None,
    interpolation: Interpolation | None = None,
) -> MatrixFile:
    r"""A(t) from a file.

    .. math:: \dot x = A(t)\,x, \qquad A(t + T) = A(t)

    Files are read by name: `.npz`, `.mat` (version 5 to 7.3), `.h5`, `.hdf5` and `.json` with

    - `A` (n, n, phases) [1/s], real, and `period` [s]: samples at equal steps from t = 0, or at `times` (phases,) [s];
      a sample at the end that repeats the first is left out;
    - `A` (n, n, pieces) and `edges` (pieces,) [s], where each piece begins in which A(t) is constant;
    - `coefficients` (n, n, harmonics), complex, or `A` if it is so, and `harmonics`, m with -m, of
      :math:`e^{2\pi i m t/T}`; a complex number in JSON is [re, im];
    - beside them `states`, the names of the states; `C` (outputs, n), or (outputs, n, as many as A), and `outputs`, the
      names of its rows;

    `summary.json` and `result.h5` of `floquid identify` with an A(t); and `.lin` files of OpenFAST, or folders of them
    (see `read_openfast`): the harmonics that the azimuths determine are taken.

    Raises InputError where there is no such file; it is of another kind, damaged or cut short; it has not the names
    above (the message lists those that it has); an array is not of its shape, or is not finite; or the period is not
    known, or is another than the one given.

    `paths` is the file; of `.lin` files a folder, or several. `period` is T [s] where the file does not state it.
    `interpolation` is what A(t) is between samples: "fourier", "cubic" or "linear" (see `SampledMatrix`); "fourier" by
    default where they are at equal steps, else "cubic".
    """
    files = _paths(paths)
    if any(path.is_dir() or path.suffix.lower() == ".lin" or "*" in path.name for path in files):
        return _openfast(files, period, interpolation)
    if len(files) != 1:
        remedy = "Several files are read of OpenFAST's .lin alone: one for each azimuth."
        raise input_error("paths", OF, "name one file", f"names {len(files)}", remedy)
    found = contents(readable_file(files[0], of=OF, argument="paths"))
    return _made(found, period, interpolation)


def _paths(paths: object) -> list[Path]:
    given = [paths] if isinstance(paths, (str, os.PathLike)) else paths
    if not isinstance(given, Iterable) or isinstance(given, (bytes, bytearray)):
        raise wrong_value("paths", OF, "be a path, or several", paths)
    return [as_path(one, of=OF, argument="paths") for one in given]


def _openfast(files: list[Path], period: float | None, interpolation: Interpolation | None) -> MatrixFile:
    """The harmonics of a turbine that its azimuths determine."""
    if period is not None:
        remedy = "It is 2π over the mean speed of the rotor, which the files state."
        raise wrong_value("period", OF, "be left out for .lin files", period, remedy)
    model = read_openfast(files)
    words = f"OpenFAST, {model.azimuths.size} azimuths of one revolution at {model.rotor_speed:.6g} rad/s"
    if interpolation is None:
        harmonics, coefficients = model.harmonics()
        matrix: AbstractPeriodicMatrix = HarmonicMatrix(
            coefficients=coefficients, harmonics=harmonics, period=model.period
        )
        words += f", harmonics up to {int(harmonics[-1])}"
    else:
        matrix = SampledMatrix(values=model.A, period=model.period, times=model.times, interpolation=interpolation)
        words += f", {_BETWEEN[interpolation]} them"
    resolution = model.resolution()
    warnings = () if resolution.resolved else ("The azimuths do not resolve A(t).",)
    return MatrixFile(matrix=matrix, states=model.state_names, source=words, warnings=warnings, linearisation=model)


def _made(found: Contents, period: float | None, interpolation: Interpolation | None) -> MatrixFile:
    """A(t) of a file of arrays."""
    series = "coefficients" in found.arrays or ("A" in found.arrays and _numbers(found, "A").dtype.kind == "c")
    key = "coefficients" if "coefficients" in found.arrays else "A"
    needed = [key, "harmonics"] if series else [key]
    for name in needed:
        if name not in found.arrays:
            got = f"has no `{name}` (it holds {found.listing()})"
            raise found.error(f"hold `{name}`" + (" beside a complex A" if name == "harmonics" else ""), got, _LAYOUT)
    values = _stack(found, key, complex_numbers=series)
    length = _period(found, period)
    states = _names(found, "states", values.shape[0], "x")
    pieces = "edges" in found.arrays
    if interpolation is not None and (series or pieces):
        what = "harmonics" if series else "constant pieces"
        raise wrong_value("interpolation", OF, f"be left out for {what}", interpolation)
    try:
        matrix, words, warnings = _periodic(found, values, length, interpolation)
        outputs = _output_values(found, values.shape[1:], complex_numbers=series)
        if outputs is not None and outputs.ndim == 3:
            outputs = _periodic(found, outputs, length, interpolation)[0]
    except InputError as error:
        if OF in str(error):
            raise
        raise found.error("hold a periodic matrix", f"does not: {error}".removesuffix(".")) from None
    rows = () if outputs is None else _names(found, "outputs", outputs.shape[0], "y")
    return MatrixFile(matrix=matrix, states=states, source=words, warnings=warnings, outputs=outputs, output_names=rows)


def _periodic(
    found: Contents, values: NDArray[Any], period: float, interpolation: Interpolation | None
) -> tuple[AbstractPeriodicMatrix, str, tuple[str, ...]]:
    """The periodic matrix of harmonics, pieces or samples, with words on it and warnings."""
    if values.dtype.kind == "c":
        harmonics = _vector(found, "harmonics", values.shape[2])
        words = f"harmonics up to {int(harmonics[-1])}"
        return HarmonicMatrix(coefficients=values, harmonics=harmonics, period=period), words, ()
    if "edges" not in found.arrays:
        return _samples(found, values, period, interpolation)
    if "times" in found.arrays:
        raise found.error("hold `times` or `edges`", "has both", "Times are of samples, edges of pieces.")
    edges = _vector(found, "edges", values.shape[2])
    return PiecewiseMatrix(values=values, edges=edges, period=period), f"{len(edges)} constant pieces", ()


def _output_values(found: Contents, inner: tuple[int, int], *, complex_numbers: bool) -> NDArray[Any] | None:
    """C of a file, constant (outputs, n) or (outputs, n, phases) with the phases of A; None of one without it."""
    if "C" not in found.arrays:
        return None
    array = _numbers(found, "C")
    if complex_numbers and array.ndim == 4 and array.shape[3] == 2:  # JSON
        array = array[..., 0] + 1j * array[..., 1]
    if array.shape[1:] not in ((inner[0],), inner) or not array.size or not np.isfinite(array).all():
        shape = f"(outputs, {inner[0]}) or (outputs, {inner[0]}, {inner[1]})"
        raise found.error(f"hold finite numbers of shape {shape} in `C`", f"has shape {array.shape} there", _LAYOUT)
    if array.ndim == 2 and array.dtype.kind == "c":
        raise found.error("hold real numbers in a constant `C`", "has complex ones there", _LAYOUT)
    return array.astype(np.complex128 if complex_numbers and array.ndim == 3 else np.float64)


_BETWEEN = {
    "fourier": "the trigonometric polynomial through",
    "cubic": "the periodic cubic spline through",
    "linear": "straight lines between",
}


def _samples(
    found: Contents, values: Floats, period: float, interpolation: Interpolation | None
) -> tuple[SampledMatrix, str, tuple[str, ...]]:
    """The samples folded into one period, a repeated end left out; the words and the warnings."""
    count, times, dropped = values.shape[2], None, ""
    if "times" in found.arrays:
        times = _vector(found, "times", count)
        span = float(np.ptp(times))
        if span > period * (1.0 + _SAME):
            got = f"has some from {times.min():g} to {times.max():g}, and a period of {period:g} s"
            raise found.error("hold `times` of one period", got, "Cut A(t) to one period, or check the period.")
        if count > 1 and span >= period * (1.0 - _SAME):
            values, times = _without_end(found, values, times)
            dropped = ", the repeated end left out"
        folded = np.mod(times, period)
        folded[folded >= period * (1.0 - _SAME)] = 0.0
        order = np.argsort(folded, kind="stable")
        times, values = folded[order], values[:, :, order]
    matrix = SampledMatrix(values=values, period=period, times=times, interpolation=interpolation)
    count = values.shape[2]
    even = np.abs(np.diff(np.asarray(matrix.times), append=period + np.asarray(matrix.times)[0]) - period / count)
    steps = "equal" if even.max() <= 1e-6 * period else "unequal"
    many = f"{count} samples at {steps} steps{dropped}, {_BETWEEN[str(matrix.interpolation)]} them"
    words = "1 sample: a constant A" if count == 1 else many
    return matrix, words, _resolution(matrix)


def _without_end(found: Contents, values: Floats, times: Floats) -> tuple[Floats, Floats]:
    """The samples without the last, which must be the first once more."""
    first, last = int(times.argmin()), int(times.argmax())
    if np.abs(values[:, :, first] - values[:, :, last]).max() > _REPEATS * np.abs(values).max():
        got = f"has others at t = {times[last]:g} than at t = {times[first]:g}"
        remedy = "Is the period right, and half a revolution a period of all of A(t)?"
        raise found.error("hold the same values one period later", got, remedy)
    return np.delete(values, last, axis=2), np.delete(times, last)


def _resolution(matrix: SampledMatrix) -> tuple[str, ...]:
    """A warning for samples whose harmonics do not die out."""
    values = np.asarray(matrix.values)
    if matrix.interpolation != "fourier" or values.shape[2] < 2:
        return ()
    size = np.abs(values).max(axis=2)
    lines = np.abs(np.fft.rfft(values, axis=2)) / values.shape[2]
    count = lines.shape[2] - 1
    tail = 2.0 * lines[:, :, int(2 * count / 3) + 1 :].sum(axis=2)
    share = float(np.divide(tail, size, out=np.zeros_like(tail), where=size > 1e-9 * size.max()).max())
    if share <= _TAIL:
        return ()
    words = (
        f"The highest third of the harmonics that {values.shape[2]} samples tell is {share:.2g} of A(t): they may not "
        "resolve it. Give more samples or, where A(t) jumps, `edges`."
    )
    return (words,)


def _stack(found: Contents, key: str, *, complex_numbers: bool) -> NDArray[Any]:
    """The matrices (n, n, phases), finite."""
    last = "harmonics" if complex_numbers else "phases"
    shape = f"(n, n, {last})"
    array = _numbers(found, key)
    if complex_numbers and array.ndim == 4 and array.shape[3] == 2:  # JSON
        array = array[..., 0] + 1j * array[..., 1]
    if found.result:
        array = np.moveaxis(array, 0, -1) if array.ndim == 3 else array
    if array.ndim != 3 or array.shape[0] != array.shape[1] or not array.size:
        remedy = _LAYOUT
        if array.ndim == 2:
            remedy = "A constant matrix needs no Floquet analysis: take its eigenvalues. Or are other instants missing?"
        elif array.ndim == 3 and array.shape[1] == array.shape[2]:
            turned = f"`np.moveaxis({key}, 0, -1)`, in MATLAB `permute({key}, [2 3 1])`"
            remedy = f"The axis of {last} is the last: save {turned}."
        raise found.error(f"hold `{key}` of shape {shape}", f"has shape {array.shape} there", remedy)
    bad = ~np.isfinite(array)
    if bad.any():
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        must, remedy = f"hold finite numbers in `{key}`", "Leave out those instants and give `times`, or mend it."
        raise found.error(must, f"has {int(bad.sum())} numbers there that are not, the first at index {where}", remedy)
    return array.astype(np.complex128 if complex_numbers else np.float64)


def _numbers(found: Contents, key: str) -> NDArray[Any]:
    try:
        array = np.asarray(found.arrays[key])
    except ValueError:
        array = np.asarray(None)
    if array.dtype.kind not in "iufc":
        what = "text" if array.dtype.kind in "US" else "something else"
        raise found.error(f"hold an array of numbers in `{key}`", f"has {what} there", _LAYOUT)
    return array


def _vector(found: Contents, key: str, count: int) -> Floats:
    """A list of as many real numbers, in whatever direction."""
    array = _numbers(found, key)
    if array.dtype.kind == "c" or array.size != count or max(array.shape, default=1) != count:
        got = f"has {array.dtype} of shape {array.shape} there"
        raise found.error(f"hold {count} real numbers in `{key}`, one for each matrix", got, _LAYOUT)
    if not np.isfinite(array).all():
        raise found.error(f"hold finite numbers in `{key}`", "has others there")
    return np.array(array.ravel(), dtype=np.float64)


def _period(found: Contents, given: float | None) -> float:
    """The period, of the file or given [s]."""
    stated = None
    if "period" in found.arrays:
        array = _numbers(found, "period")
        if array.size != 1 or array.dtype.kind == "c" or not 0.0 < float(array.ravel()[0]) < np.inf:
            raise found.error("hold one positive number [s] in `period`", f"has {describe(array)} there", "Mend it.")
        stated = float(array.ravel()[0])
    if given is None and stated is None:
        got = f"is not, and {found.path} states none (it holds {found.listing()})"
        raise input_error("period", OF, "be given", got, "In seconds, as in `period=0.02`: 2π/ω.")
    if given is None:
        assert stated is not None
        return stated
    length = positive(given, "period", OF, unit="s")
    if stated is not None and abs(stated - length) > _SAME * stated:
        raise input_error("period", OF, f"be left out or be that of {found.path}, {stated:.9g} s", f"is {length:.9g} s")
    return length


def _names(found: Contents, key: str, count: int, letter: str) -> tuple[str, ...]:
    """The names of states or outputs, of the file or x1, x2, ... with their `letter`."""
    if key not in found.arrays:
        return named(None, count, letter, key, OF)
    raw = np.asarray(found.arrays[key], dtype=object).ravel().tolist()
    texts = [_text(one) for one in raw]
    if len(texts) != count or not all(texts) or len(set(texts)) != count:
        got = f"has {len(texts)} there" if len(texts) != count else "has others, or one twice"
        raise found.error(f"hold {count} distinct names in `{key}`", got, f"Save one text for each of `{key}`.")
    return tuple(texts)


def _text(value: Any) -> str:
    """A text, out of the array that MATLAB keeps it in; "" for anything else."""
    while isinstance(value, np.ndarray) and value.size == 1:
        value = value.ravel()[0]
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    return printable(value.rstrip()) if isinstance(value, str) else ""
