"""Bytes of MATLAB files and of universal files, the same content giving the same bytes.

MATLAB files are of version 5, which GNU Octave reads too. Modes as a universal file are datasets 151 (header), 15
(nodes) and 55 (data at nodes). Source: "Universal Dataset Number 151: Header", "... 15: Nodes", "... 55: Data at
Nodes", Structural Dynamics Research Laboratory, University of Cincinnati. A real number has the format 1PE13.5; there
is none of more digits.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes
from floquid._checks import frozen_array, input_error
from floquid._version import __version__
from floquid.core import Channel, PeriodicModel
from floquid.readers import UFF_KINDS

PLAIN = str.maketrans({"µ": "u", "μ": "u", "ε": "e", "°": "deg", "²": "^2", "³": "^3", "·": "."})
"""Units in ASCII: GNU Octave reads texts of other letters byte by byte, and cuts them."""

_TEXT = 116  # bytes at the head of the file that are free text
_NAME = 56  # letters of a name that MATLAB keeps, less those of a number behind it


def mat_file(content: Mapping[str, Any], what: str) -> bytes:
    """The file, named by what it holds; what is None is an empty matrix."""
    from scipy.io import savemat

    stream = BytesIO()
    empty = np.zeros((0, 0))
    whole = {name: empty if value is None else value for name, value in content.items()}
    savemat(stream, whole, oned_as="column", long_field_names=True)
    file = bytearray(stream.getbuffer())
    written = f"MATLAB 5.0 MAT-file, {what}, by floquid {__version__}"
    file[:_TEXT] = written.encode().ljust(_TEXT)
    return bytes(file)


def mat_structs(rows: Sequence[Mapping[str, Any]]) -> Any:
    """A struct array of MATLAB, an element for each of some rows of one set of fields."""
    names = list(rows[0]) if rows else ["none"]
    array = np.empty((1, len(rows)), dtype=[(name, object) for name in names])
    for place, row in enumerate(rows):
        for name in names:
            array[0, place][name] = row[name]
    return array


def mat_names(words: Sequence[str]) -> list[str]:
    """Names of fields in MATLAB for some words, no two alike."""
    found: list[str] = []
    for word in words:
        plain = re.sub(r"\W+", "_", word.translate(PLAIN), flags=re.ASCII).strip("_")[:_NAME]
        name = plain if re.match("[A-Za-z]", plain) else f"x{plain}"
        found.append(name if name not in found else f"{name}_{len(found) + 1}")
    return found


def mat_cells(words: Any) -> Any:
    """A column of texts as MATLAB has it."""
    cells = np.empty((len(words), 1), dtype=object)
    cells[:, 0] = list(words)
    return cells


_STRUCTURAL, _FIRST_ORDER, _TRANSLATIONS, _WITH_ROTATIONS, _COMPLEX = 1, 3, 2, 3, 5
_SPECIFIC = UFF_KINDS | {"force": 1}
"""Quantity of a shape: the codes of dataset 58, except a force, whose 13 is an energy in dataset 55. 1 is general."""

_DIRECTION = re.compile(r"([+-]?)(R?)([XYZ])")
_MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")
_END = f"{-1:6d}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Dof:
    """Place of a channel in the file: a node, one of its six components (0 to 5), and the sign along it."""

    node: int
    component: int
    sign: int


def uff_bytes(
    model: PeriodicModel, coordinates: Mapping[str, ArrayLike], joined: Sequence[Sequence[str]] = ()
) -> bytes:
    """The file: a shape for each mode, harmonic, hit, and kind of channels; the nodes and lines between them first."""
    places = degrees_of_freedom(model.channels)
    lines = [*_header(), *_nodes(model.channels, places, coordinates), *_traces(model.channels, places, joined)]
    number = 0
    for mode in model.upper_modes:
        for index in np.flatnonzero((model.coefficients[mode] != 0).any(axis=(0, 1))):
            number += 1
            for hit in range(model.n_hits):
                for rows in _alike(model.channels):
                    lines += _shape(model, mode, int(index), hit, rows, places, number)
    return ("\n".join(lines) + "\n").encode()


def degrees_of_freedom(channels: Sequence[Channel]) -> list[Dof]:
    """A node and a direction for each channel."""
    # Channels of one location share its node, whose number is the one that the location ends in ("12", "blade 3"), or
    # else the next that is free. A channel without a location, without a direction along an axis ("+X", "-RZ"), or of a
    # direction that another of its kind has there, has a node to itself; without a direction it is along x.
    found = [_DIRECTION.fullmatch(channel.direction.strip().upper()) for channel in channels]
    keys: list[tuple[str, int]] = []
    taken: set[tuple[object, ...]] = set()
    for row, (channel, match) in enumerate(zip(channels, found, strict=True)):
        own = (channel.location, channel.quantity, channel.unit, match and match[2] + match[3])
        alone = not channel.location or match is None or own in taken
        taken.add(own)
        keys.append((channel.location, row if alone else -1))
    numbers = _node_numbers(list(dict.fromkeys(keys)))
    return [
        Dof(
            node=numbers[key],
            component=0 if match is None else "XYZ".index(match[3]) + (3 if match[2] else 0),
            sign=-1 if match is not None and match[1] == "-" else 1,
        )
        for key, match in zip(keys, found, strict=True)
    ]


def _node_numbers(keys: Sequence[tuple[str, int]]) -> dict[tuple[str, int], int]:
    numbers: dict[tuple[str, int], int] = {}
    for key in keys:
        ending = re.search(r"(\d{1,9})$", key[0].strip())
        if ending and int(ending[1]) > 0 and int(ending[1]) not in numbers.values():
            numbers[key] = int(ending[1])
    following = 1
    for key in keys:
        if key not in numbers:
            while following in numbers.values():
                following += 1
            numbers[key] = following
    return numbers


def _alike(channels: Sequence[Channel]) -> list[list[int]]:
    """The channels of one quantity and unit together: a shape has one of each."""
    groups: dict[tuple[str, str], list[int]] = {}
    for row, channel in enumerate(channels):
        groups.setdefault((str(channel.quantity), channel.unit), []).append(row)
    return list(groups.values())


def _header() -> list[str]:
    now = datetime.now().astimezone()
    day, time = f"{now.day:02d}-{_MONTHS[now.month - 1]}-{now.year % 100:02d}", now.strftime("%H:%M:%S")
    program = f"floquid {__version__}"
    return [
        _END,
        f"{151:6d}",
        "Floquet modes",
        "One shape a harmonic: eigenvalue = Floquet exponent + i harmonic 2 pi/period",
        program,
        f"{day:10s}{time:10s}{0:10d}{0:10d}{0:10d}",
        f"{day:10s}{time:10s}",
        program,
        f"{day:10s}{time:10s}",
        _END,
    ]


def _nodes(channels: Sequence[Channel], places: Sequence[Dof], coordinates: Mapping[str, ArrayLike]) -> list[str]:
    of = "export_modes"
    names = [channel.location or channel.name for channel in channels]
    unknown = sorted(set(coordinates) - set(names))
    if unknown:
        listing = "There are: " + ", ".join(dict.fromkeys(names)) + "."
        raise input_error("coordinates", of, "be of locations of channels", f"has {unknown[0]!r}", listing)
    at = {place.node: (0.0, 0.0, 0.0) for place in places}
    for name, place in zip(names, places, strict=True):
        if name in coordinates:
            at[place.node] = tuple(frozen_array(coordinates[name], "coordinates", of, axes=(3,)).tolist())
    rows = [f"{node:10d}{0:10d}{0:10d}{1:10d}{_reals(where)[0]}" for node, where in sorted(at.items())]
    return [_END, f"{15:6d}", *rows, _END]


def _traces(channels: Sequence[Channel], places: Sequence[Dof], joined: Sequence[Sequence[str]]) -> Iterator[str]:
    """Datasets 82: the lines that a viewer draws from node to node."""
    names = [channel.location or channel.name for channel in channels]
    nodes: dict[str, int] = {}
    for name, place in zip(names, places, strict=True):
        nodes.setdefault(name, place.node)  # two channels of one direction there have a node each
    for number, line in enumerate(joined, start=1):
        unknown = [name for name in line if name not in nodes]
        if unknown:
            listing = "There are: " + ", ".join(nodes) + "."
            raise input_error("lines", "export_modes", "be of locations of channels", f"has {unknown[0]!r}", listing)
        if len(line) < 2:
            continue
        own = "".join(f"{nodes[name]:10d}" for name in line)
        rows = [own[first : first + 80] for first in range(0, len(own), 80)]
        yield from (_END, f"{82:6d}", f"{number:10d}{len(line):10d}{1:10d}", f"line {number}", *rows, _END)


def _shape(
    model: PeriodicModel, mode: int, index: int, hit: int, rows: Sequence[int], places: Sequence[Dof], number: int
) -> Iterator[str]:
    """A dataset 55: the coefficients of one harmonic of one mode in one hit, of channels that are alike."""
    exponent, harmonic = complex(model.exponents[mode]), int(model.harmonics[index])
    std = None if model.exponent_std is None else complex(model.exponent_std[mode])
    rate = exponent + 1j * harmonic * model.fundamental
    channel = model.channels[rows[0]]
    turning = any(places[row].component > 2 for row in rows)
    width = 6 if turning else 3
    values: dict[int, Complexes] = {}
    for row in rows:
        place = places[row]
        own = values.setdefault(place.node, np.zeros(width, complex))
        own[place.component] = place.sign * model.coefficients[mode, row, hit, index]
    yield from (_END, f"{55:6d}")
    yield f"Mode {mode + 1}, harmonic {harmonic:+d}, hit {hit + 1}: {channel.quantity} [{channel.unit}]"[:80]
    yield f"floquid exponent={exponent!r} 1/s"
    yield "NONE"
    yield f"floquid mode={mode + 1} harmonic={harmonic} hit={hit + 1} period={model.period!r} s"
    yield "NONE" if std is None else f"floquid exponent_std={std!r} 1/s"
    characteristic = _WITH_ROTATIONS if turning else _TRANSLATIONS
    kind = _SPECIFIC[str(channel.quantity)]
    yield "".join(f"{n:10d}" for n in (_STRUCTURAL, _FIRST_ORDER, characteristic, kind, _COMPLEX, width))
    yield "".join(f"{n:10d}" for n in (2, 6, hit + 1, number))
    # Of A y' + B y = 0 with a unit A: the shape is the response itself, not scaled to a mass.
    yield from _reals((rate.real, rate.imag, 1.0, 0.0, -rate.real, -rate.imag))
    for node, own in sorted(values.items()):
        yield f"{node:10d}"
        yield from _reals(own.view(np.float64))
    yield _END


def _reals(numbers: Iterable[float]) -> list[str]:
    """Real numbers, six a line."""
    words = [f"{float(number):13.5E}" for number in numbers]
    return ["".join(words[first : first + 6]) for first in range(0, len(words), 6)]
