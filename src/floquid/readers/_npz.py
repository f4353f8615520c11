"""NumPy archives: `values` (channels, samples), `sample_rate` or `time`, `channels`, and what else is known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import describe
from floquid.core import Record, channels_named
from floquid.core._time_axis import TimeColumn
from floquid.errors import InputError
from floquid.readers._table import Source, Table, checked_orbit, make_channels, numbers_of, orbit_of, texts_of

_WORDS = ("units", "quantities", "locations", "directions")
_KEYS = ("values", "sample_rate", "time", "channels", *_WORDS, "start", "period", "origin", "orbit")
_KEYS_REMEDY = "Save it with np.savez(file, values=values, sample_rate=rate, channels=names, units=units)."


def load_npz(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a NumPy archive; nothing in it is ever unpickled.

    Raises
    ------
    InputError
        The file is not an archive, is damaged, lacks a key, or an array is not of its type and shape.
    """
    arrays, others = _arrays(source)
    missing = [key for key in ("values", "channels") if key not in arrays]
    if missing:
        holds = ", ".join([*arrays, *others]) or "nothing"
        raise source.error("hold `values` and `channels`", f"has no `{missing[0]}` (it holds {holds})", _KEYS_REMEDY)
    names = _texts(source, arrays, "channels")
    values = _values(source, arrays["values"], len(names))
    words = {key: _texts(source, arrays, key, len(names)) if key in arrays else None for key in _WORDS}
    quantities = words["quantities"]
    named = make_channels(
        source, names, words["units"], quantity=quantities, location=words["locations"], direction=words["directions"]
    )
    orbit = None
    if "orbit" in arrays:
        _require_numbers(source, arrays["orbit"], "orbit")
        orbit = checked_orbit(source, arrays["orbit"], len(names))
    if channels is not None:
        chosen = channels_named(named, channels, argument="channels", of=source.of)
        values, named = values[chosen], tuple(named[row] for row in chosen)
        orbit = None if orbit is None else orbit[chosen]
    notes = tuple(f"The file also holds `{key}`, which is not used." for key in others)
    time = None
    if "time" in arrays and ignore_time:
        notes += ("The times in the file were ignored.",)
    elif "time" in arrays:
        time = _time(source, arrays["time"], values.shape[1])
    numbers = {key: _scalar(source, arrays, key) for key in ("sample_rate", "start", "period", "origin")}
    return Table(values=values, channels=named, time=time, rate_note=None, orbit=orbit, notes=notes, **numbers)


def _arrays(source: Source) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """The arrays that we know, by key, and the names of the others."""
    with source.path.open("rb") as stream:
        try:
            archive: Any = np.load(stream, allow_pickle=False)
            others = [key for key in archive.files if key not in _KEYS]
        except Exception as error:  # noqa: BLE001  # damage raises anything: BadZipFile, AttributeError, ...
            got = f"is not one, or is damaged or cut short ({type(error).__name__})"
            raise source.error("be a NumPy archive", got, f"Copy it again. {_KEYS_REMEDY}") from None
        return {key: _array(source, archive, key) for key in _KEYS if key in archive}, others


def _array(source: Source, archive: Any, key: str) -> NDArray[Any]:
    try:
        return np.asarray(archive[key])
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001  # damage raises anything: zlib.error, struct.error, TokenError, ...
        if "Object arrays" in str(error):
            raise _objects(source, key) from None
        raise source.error(
            f"hold a readable array `{key}`",
            f"does not ({type(error).__name__}: {error})",
            "Copy or save the file again.",
        ) from None


def _objects(source: Source, key: str) -> InputError:
    return source.error(
        f"hold plain numbers or text in `{key}`",
        "holds Python objects there, which are never unpickled",
        f"Convert them first, as in np.asarray({key}, dtype=float) or dtype=str, and save it again.",
    )


def _values(source: Source, array: NDArray[Any], n_channels: int) -> NDArray[np.float64]:
    shaped = f"have `values` of shape (channels, samples) with {n_channels} channels, as in `channels`"
    _require_numbers(source, array, "values")
    if array.ndim != 2:
        remedy = "Save `values[None, :]` for one channel." if array.ndim == 1 else "Save one record a file."
        raise source.error(shaped, f"has shape {array.shape} there", remedy)
    if array.shape[0] != n_channels:
        swapped = array.shape[1] == n_channels
        remedy = "Time is the last axis: save `values.T`." if swapped else "Name every row of `values` in `channels`."
        raise source.error(shaped, f"has shape {array.shape} there", remedy)
    with np.errstate(over="ignore"):  # a long double too large becomes infinite, and is refused as such
        return array.astype(np.float64)


def _time(source: Source, array: NDArray[Any], n_samples: int) -> TimeColumn:
    _require_numbers(source, array, "time")
    if array.shape != (n_samples,):
        raise source.error(
            f"have `time` of shape (samples,) with {n_samples} samples, as in `values`",
            f"has shape {array.shape} there",
            "Save one time a sample [s].",
        )
    kept = array if array.dtype == np.float32 else array.astype(np.float64)
    return TimeColumn(values=kept, scale=1.0, label="time")


def _require_numbers(source: Source, array: NDArray[Any], key: str) -> None:
    if array.dtype.kind not in "biuf":
        what = {"c": "complex numbers", "U": "text", "S": "text", "M": "dates", "m": "time spans"}.get(array.dtype.kind)
        remedy = f"Save `{key}.real`." if array.dtype.kind == "c" else f"Save np.asarray({key}, dtype=float)."
        raise source.error(f"hold real numbers in `{key}`", f"has {what or 'records'} ({array.dtype}) there", remedy)


def _texts(source: Source, arrays: dict[str, NDArray[Any]], key: str, count: int | None = None) -> list[str]:
    array = np.atleast_1d(arrays[key])
    if array.dtype.kind not in "US" or array.ndim != 1 or not array.size or (count is not None and len(array) != count):
        words = f"one text a channel{'' if count is None else f' ({count})'} in `{key}`"
        raise source.error(
            f"hold {words}", f"has {describe(arrays[key])} there", f"Save np.array([...]) of names as `{key}`."
        )
    try:
        return [text.decode() if isinstance(text, bytes) else str(text) for text in array.tolist()]
    except UnicodeDecodeError:
        raise source.error(f"hold text in UTF-8 in `{key}`", "has other bytes there", "Save it from str.") from None


def _scalar(source: Source, arrays: dict[str, NDArray[Any]], key: str) -> float | None:
    if key not in arrays:
        return None
    array = arrays[key]
    must_be_positive = key in ("sample_rate", "period")
    number = float(array.reshape(())) if array.size == 1 and array.dtype.kind in "iuf" else np.nan
    if not np.isfinite(number) or (must_be_positive and number <= 0.0):
        got = f"{array.reshape(())[()]!s}" if array.size == 1 else describe(array)
        raise source.error(
            f"hold one finite{' positive' if must_be_positive else ''} number in `{key}`",
            f"has {got} there",
            "Mend it, or leave it out and pass `rate` (`--rate`) [Hz]."
            if key == "sample_rate"
            else "Mend it, or leave it out.",
        )
    return number


def save_npz(record: Record, path: Path) -> None:
    """Write `record` with every key that `load_npz` reads."""
    content: dict[str, Any] = {"values": record.values, **numbers_of(record), **orbit_of(record), **texts_of(record)}
    with path.open("wb") as stream:  # savez would add a suffix of its own to a name
        np.savez(stream, **content)
