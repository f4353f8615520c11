"""A file of variables with our names: `values` (channels, samples), `channels`, `sample_rate` or `time`, ...

NumPy archives, MATLAB files and HDF5 have them; what is refused is told in the file's dialect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floquid._arrays import Floats
from floquid._checks import describe
from floquid.core import channels_named
from floquid.io import Source
from floquid.readers.variables._variables import REMEDIES, VariableFile, numbers, printable, require_numbers
from floquid.tables import SECONDS, Table, TimeColumn, make_channels

_WORDS = ("units", "quantities", "locations", "directions")
KEYS = ("values", "sample_rate", "time", "channels", *_WORDS, "start", "period", "origin", "orbit")
"""The names that are ours."""


def table_by_name(source: Source, file: VariableFile, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a file that holds `values` and `channels`."""
    held = file.variables
    names = _texts(source, file, "channels")
    values = _values(source, file, len(names))
    words = {key: _texts(source, file, key, len(names)) if key in held else None for key in _WORDS}
    units = words["units"] or ([held["values"].unit] * len(names) if held["values"].unit else None)
    named = make_channels(
        source, names, units, quantity=words["quantities"], location=words["locations"], direction=words["directions"]
    )
    orbit = None
    if "orbit" in held:
        orbit = _orbit(source, numbers(source, file, "orbit"), len(names))
    if channels is not None:
        chosen = channels_named(named, channels, argument="channels", of=source.of)
        values, named = values[chosen], tuple(named[row] for row in chosen)
        orbit = None if orbit is None else orbit[chosen]
    others = [path for path in held if path not in KEYS]
    notes = tuple(f"The file also holds `{printable(path)}`, which is not used." for path in others[:20])
    if len(others) > 20:
        notes += (f"It holds {len(others) - 20} more that are not used.",)
    time = None
    if "time" in held and ignore_time:
        notes += ("The times in the file were ignored.",)
    elif "time" in held:
        time = time_column(source, file, "time", values.shape[1])
    return Table(
        values=values,
        channels=named,
        time=time,
        orbit=orbit,
        notes=notes,
        sample_rate=scalar(source, file, "sample_rate"),
        start=scalar(source, file, "start"),
        period=scalar(source, file, "period"),
        origin=scalar(source, file, "origin"),
    )


def time_column(source: Source, file: VariableFile, path: str, n_samples: int) -> TimeColumn:
    """The times at `path`, a row or a column of them."""
    array = numbers(source, file, path)
    if array.size == max(array.shape, default=0):
        array = array.reshape(-1)
    if array.shape != (n_samples,):
        must = f"have `time` of shape (samples,) with {n_samples} samples, as in `values`"
        raise source.error(must, f"has shape {array.shape} there", "Save one time a sample [s].")
    unit = file.variables[path].unit
    scale = SECONDS.get(unit) if unit not in ("", "-") else 1.0
    if scale is None:
        must = "have its times in one of s, ms, us, ns, min, h"
        got = f"has `{printable(path)}` in {unit!r}"
        raise source.error(must, got, "Save the times as numbers in seconds, or pass `rate=` [Hz] to ignore them.")
    kept = array if array.dtype == np.float32 else array.astype(np.float64)
    return TimeColumn(values=kept, scale=scale, label=printable(path))


def scalar(source: Source, file: VariableFile, path: str) -> float | None:
    """The number at `path` [Hz] if it is a `sample_rate`, else [s]; None if there is none."""
    variable = file.variables.get(path)
    if variable is None:
        return None
    unit = "Hz" if variable.name == "sample_rate" else "s"
    if variable.unit not in ("", "-", unit):
        remedy = f"Save it in {unit}{', or pass `rate=` [Hz]' if unit == 'Hz' else ''}."
        raise source.error(f"have `{printable(path)}` in {unit}", f"has it in {variable.unit!r}", remedy)
    array = numbers(source, file, path)
    must_be_positive = variable.name in ("sample_rate", "period")
    number = float(array.reshape(())) if array.size == 1 and array.dtype.kind in "iuf" else np.nan
    if not np.isfinite(number) or (must_be_positive and number <= 0.0):
        got = f"{array.reshape(())[()]!s}" if array.size == 1 else describe(array)
        must = f"hold one finite{' positive' if must_be_positive else ''} number in `{variable.name}`"
        remedy = "Mend it, or leave it out and pass `rate=` [Hz]." if unit == "Hz" else "Mend it, or leave it out."
        raise source.error(must, f"has {got} there", remedy)
    return number


def _orbit(source: Source, array: Floats, n_channels: int) -> Floats:
    if array.ndim != 2 or array.shape[0] != n_channels or not array.shape[1] or not np.isfinite(array).all():
        must = f"have `orbit` of shape (channels, phases) with {n_channels} channels, all finite"
        got = f"has shape {array.shape} there" + ("" if np.isfinite(array).all() else ", not all of it finite")
        raise source.error(must, got, "Save one period of the orbit a channel, or leave it out.")
    return np.asarray(array, np.float64)


def _values(source: Source, file: VariableFile, n_channels: int) -> Floats:
    require_numbers(source, file.variables["values"])
    shape = file.variables["values"].shape
    if len(shape) != 2 or shape[0] != n_channels:
        if len(shape) == 1 or (n_channels == 1 and shape[1:] == (1,)):
            remedy = file.dialect.row
        elif len(shape) == 2 and shape[1] == n_channels:
            remedy = file.dialect.turn
        else:
            remedy = "Save one record a file." if len(shape) != 2 else "Name every row of `values` in `channels`."
        must = f"have `values` of shape (channels, samples) with {n_channels} channels, as in `channels`"
        raise source.error(must, f"has shape {shape} there", remedy)
    with np.errstate(over="ignore"):  # a long double too large becomes infinite, and is refused as such
        return file.numbers("values").astype(np.float64, order="C")


_NOT_HELD = ("a MATLAB object", "a link", "data of another file", "Python objects")
"""Kinds whose content a file does not give away: text cannot be made of it here."""


def _texts(source: Source, file: VariableFile, key: str, count: int | None = None) -> list[str]:
    variable = file.variables[key]
    texts = file.texts(key) if variable.kind in ("text", "a cell array") else None
    if not texts or (count is not None and len(texts) != count):
        what = (
            variable.words + (", numbers" if variable.kind == "numbers" else "") if texts is None else describe(texts)
        )
        must = f"hold one text a channel{'' if count is None else f' ({count})'} in `{key}`"
        got = f"has {variable.kind if variable.kind in _NOT_HELD else what} there"
        raise source.error(must, got, REMEDIES[variable.kind] if variable.kind in _NOT_HELD else file.dialect.texts)
    return texts
