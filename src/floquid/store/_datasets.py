"""Datasets and groups of a result file, written and read by the table of `_layout`; identifiers as text."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import fields
from enum import Enum
from functools import cache
from numbers import Number
from typing import Any, cast

import numpy as np

from floquid import lti
from floquid._arrays import Integers
from floquid._checks import input_error, optional_fields
from floquid.core import Channel, channel_of
from floquid.errors import InputError
from floquid.findings import Finding, as_mapping, from_mapping
from floquid.io import DamagedError
from floquid.lti import AbstractIdentifier
from floquid.shapes import ShapeOptions
from floquid.store._layout import ABSENT, FLAGS, LAYOUT, TEXTS

KNOWN: dict[str, type[AbstractIdentifier]] = {
    kind.__name__: kind for kind in (lti.AMI, lti.ERA, lti.LSCF, lti.MaximumLikelihood, lti.PolyLSCF)
}


def to_text(identifier: AbstractIdentifier) -> str:
    """The identifier as JSON: `{"name": …, "options": {…}}`, another identifier among its options the same way."""
    kind = type(identifier)
    if KNOWN.get(kind.__name__) is not kind:
        must, got = f"be found by an identifier of floquid ({', '.join(KNOWN)})", f"was found by {kind.__qualname__}"
        remedy = "Save it with replace(analysis, settings=replace(analysis.settings, identifier=None))."
        raise input_error("analysis", "save", must, got, remedy)
    return json.dumps(_plain(identifier))


def _plain(identifier: AbstractIdentifier) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for field in fields(cast("Any", identifier)):
        value = getattr(identifier, field.name)
        options[field.name] = _plain(value) if isinstance(value, AbstractIdentifier) else value
    return {"name": type(identifier).__name__, "options": options}


def from_text(text: str) -> AbstractIdentifier:
    """The identifier that `to_text` wrote."""
    try:
        return _built(json.loads(text))
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise InputError(f"the identifier {text!r:.80} cannot be read ({error})") from None


def _built(content: dict[str, Any]) -> AbstractIdentifier:
    kind = KNOWN[content["name"]]
    options = {name: _option(value) for name, value in content["options"].items()}
    return kind(**options)


def _option(value: Any) -> Any:
    if isinstance(value, dict):
        return _built(value)
    return tuple(value) if isinstance(value, list) else value


_DTYPES = {"b": np.int64, "i": np.int64, "u": np.int64, "f": np.float64, "c": np.complex128}


def put_object(group: Any, thing: Any) -> None:
    """Write the fields of `thing` that the layout of its type has."""
    for name, place in LAYOUT[type(thing)].items():
        value = getattr(thing, name)
        if place == "json":
            put(group, name, json.dumps({own.name: getattr(value, own.name) for own in fields(value)}, default=dict))
        elif isinstance(place, str):
            put(group, name, value, place)
        elif isinstance(place, list):
            for number, one in enumerate(value, start=1):
                put_object(group.create_group(_one_of(name, number)), one)
        elif place is Mapping:
            inner = group.create_group(name)
            put(inner, "names", tuple(value), "numbers")
            put(inner, "numbers", np.array([*value.values()], float), "numbers")
        elif place is Channel:
            inner = group.create_group(name)
            for word, axes in LAYOUT[Channel].items():
                put(inner, word, tuple(getattr(channel, word) for channel in value), str(axes))
        elif place is dict:
            put_numbers(group.create_group(name), value)
        elif value is not None:
            put_object(group.create_group(name), value)


def _one_of(name: str, number: int) -> str:
    """Place of one of several objects, counted from 1: `points/point1`."""
    return f"{name}/{name.removesuffix('s')}{number}"


def put_numbers(group: Any, numbers: Mapping[str, float]) -> None:
    """Write numbers by their names, sorted as they come back: the same analysis gives the same bytes."""
    for name in sorted(numbers):
        put(group, name, float(numbers[name]))


def put(group: Any, name: str, value: Any, place: str = "") -> None:
    """Write one dataset at its `place`, "axes; unit". Arrays are compressed and carry checksums, so damage is seen."""
    import h5py

    axes, _, unit = place.partition("; ")
    texts = value.name if isinstance(value, Enum) else value
    if value is None:
        dataset = group.create_dataset(name, data=h5py.Empty(np.float64))
    elif isinstance(texts, str):
        dataset = group.create_dataset(name, data=_storable(texts), dtype=h5py.string_dtype())
    elif isinstance(value, tuple) and "," not in axes and all(isinstance(text, _TEXT) for text in value):
        data = np.array([_storable(_json(text) if isinstance(text, Finding) else text or "") for text in value], object)
        dataset = group.create_dataset(name, data=data, dtype=h5py.string_dtype())
    elif isinstance(value, (Number, tuple, np.ndarray, np.bool_)):
        array = np.asarray(_filled(value) if isinstance(value, tuple) and "," in axes else value)
        array = array.astype(_DTYPES[array.dtype.kind], copy=False)
        # Noise does not compress: more than the lowest level takes time and saves nothing.
        packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}
        dataset = group.create_dataset(name, data=array, **(packed if array.ndim and array.size else {}))
    else:
        raise TypeError(f"{name} holds {value!r}: a result file has no form for that yet.")
    if axes:
        dataset.attrs["axes"] = axes
    if unit:
        dataset.attrs["unit"] = unit


_TEXT = (str, Finding, type(None))  # what tuples of texts hold; None is an empty text


def _filled(rows: tuple[tuple[int, ...], ...]) -> Integers:
    """Rows of whole numbers, of different lengths, filled up by -1."""
    longest = max(map(len, rows), default=0)
    return np.array([[*row, *[-1] * (longest - len(row))] for row in rows], np.int64).reshape(len(rows), longest)


def _json(finding: Finding) -> str:
    """A finding as JSON: its code, severity, numbers and where, and the sentence."""
    return json.dumps(as_mapping(finding), ensure_ascii=False)


def _storable(text: str) -> str:
    """`text` with what HDF5 cannot hold written as an escape: undecodable bytes of a file name, a NUL."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8").replace("\0", "\\x00")


def get_fields(group: Any, kind: type) -> dict[str, Any]:
    """The fields of an object of a `kind` that its layout has."""
    found: dict[str, Any] = {}
    for name, place in LAYOUT[kind].items():
        if name in ABSENT and name not in group:
            continue
        if isinstance(place, list):
            count = len(group[name]) if name in group else 0
            found[name] = tuple(get_object(group[_one_of(name, number + 1)], place[0]) for number in range(count))
        elif isinstance(place, type) and name not in group and name in optional_fields(kind):
            found[name] = None
        elif place == "json":
            found[name] = ShapeOptions(**json.loads(get(group, name, text=True)))
        elif place == "findings":
            found[name] = tuple(from_mapping(json.loads(text)) for text in get(group, name, "findings"))
        elif isinstance(place, str):
            found[name] = _as_declared(group, name, place, _declared(kind).get(name, ""))
        elif place is Mapping:
            names, numbers = (get(group[name], part, "numbers") for part in ("names", "numbers"))
            found[name] = dict(zip(names, numbers.tolist(), strict=True))
        elif place is Channel:
            found[name] = _channels(group[name])
        elif place is dict:
            found[name] = get_numbers(group[name])
        else:
            found[name] = get_object(group[name], place)
    return found


@cache
def _declared(kind: Any) -> dict[str, str]:
    """The types of the fields of a class, as it writes them."""
    return {field.name: str(field.type) for field in fields(kind)}


def _as_declared(group: Any, name: str, place: str, declared: str) -> Any:
    """The content of a dataset as a field of a type `declared` holds it: an array, or tuples, None for no text."""
    plain = re.search(r"\b(str|int|float|bool|complex)\b", declared)  # else by the name: kinds have types of their own
    value = get(group, name, place, text=None if plain is None else plain[0] == "str")
    if declared == "tuple[str | None, ...]":
        return tuple(text or None for text in value)
    if not isinstance(value, np.ndarray) or not declared.startswith("tuple["):
        return value
    whole: list[Any] = value.tolist()
    return tuple(tuple(one for one in row if one >= 0) if isinstance(row, list) else row for row in whole)


def get_object(group: Any, kind: Any) -> Any:
    """An object of a `kind` whose layout has all of its fields."""
    return kind(**get_fields(group, kind))


def get_numbers(group: Any) -> dict[str, float]:
    """Numbers by their names."""
    # By no place: a quantity of the operating point may be called as a text or a flag elsewhere.
    return {str(name): float(get(group, name, None)) for name in group}


def _channels(group: Any) -> tuple[Channel, ...]:
    columns = {word: get(group, word, "channels") for word in LAYOUT[Channel] if word in group}
    return tuple(channel_of(dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True))


def get(group: Any, name: str, place: str | None = "", *, text: bool | None = None) -> Any:
    """The content of the dataset at a `place`: None, a number, a flag, a text, a tuple of texts or a read-only array.

    A dataset with other axes than those of its place, or with numbers for texts, is damage: the types that are made
    of the content do not all look at it again. None is a place of no one kind; `text` says whether it holds text, by
    default the name does.
    """
    dataset = group[name]
    if dataset.shape is None:
        return None
    texts = dataset.dtype.kind == "O"
    if place is not None:
        axes = place.partition("; ")[0]
        if len(dataset.shape) != (axes.count(", ") + 1 if axes else 0):
            raise DamagedError(f"{dataset.name} has the shape {dataset.shape}, not the axes ({axes})")
        if dataset.size and (name in TEXTS if text is None else text) != texts:
            raise DamagedError(f"{dataset.name} holds {'text' if texts else 'numbers'}")
    if texts:
        found = np.asarray(dataset.asstr()[()]).tolist()
        return tuple(found) if dataset.shape else found
    value = dataset[()]
    if name in FLAGS:
        value = value == 1
    if not dataset.shape:
        return value.item()
    value.flags.writeable = False
    return value
