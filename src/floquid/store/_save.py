"""An `Analysis` → `result.h5`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from importlib import import_module
from io import BytesIO
from numbers import Integral, Real
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._checks import describe, input_error
from floquid._files import atomic_path
from floquid.core import Channel, ConstantPeriod, PeriodicModel, Provenance, Record
from floquid.lti import AbstractIdentifier
from floquid.periodic import Fit, Periodicity
from floquid.pipeline import Analysis, Settings
from floquid.reconstruction import Refinement, StateModel, text_of
from floquid.store import _layout as layout
from floquid.store._identifiers import to_text
from floquid.store._layout import Item
from floquid.validation import Validation

if TYPE_CHECKING:
    import h5py


def save(analysis: Analysis, path: str | PathLike[str]) -> None:
    """Write everything that `identify` found to one HDF5 file, from which `load` makes it again.

    The layout is that of the package's own page. The file is written under another name in the same folder and takes
    its own name when it is whole: whatever happens, `path` holds the old file or the new one. The same analysis gives
    the same bytes.

    Parameters
    ----------
    analysis
        What `identify` found.
    path
        The file to write, by custom `result.h5`; it may exist.

    Raises
    ------
    InputError
        `analysis` is something else, or the file cannot be written there.
    """
    if not isinstance(analysis, Analysis):
        raise input_error(
            "analysis", "save", "be an Analysis", f"is {describe(analysis)}", "Pass what `identify` gave."
        )
    with atomic_path(path, of="save") as temporary:
        # In memory first: when a disk is full or goes away, HDF5 itself does not end with an error but with a crash.
        content = BytesIO()
        _write(analysis, content)
        temporary.write_bytes(content.getbuffer())


def _write(analysis: Analysis, stream: BytesIO) -> None:
    import h5py

    # Not an import statement: the top level imports this room, and stays above it.
    version = import_module("floquid").__version__
    with h5py.File(stream, "w") as file:
        file.attrs["format"] = layout.FORMAT
        file.attrs["version"] = layout.VERSION
        file.attrs["floquid"] = version
        _put(file, layout.WARNINGS, analysis.warnings)
        _put(file, layout.HELD, int(analysis.held))
        _put(file, layout.SYNCHRONISATION, analysis.synchronisation)
        if analysis.periodicity is not None:
            _put_periodicity(file.create_group("periodicity"), analysis.periodicity)
        if analysis.fit is not None:
            _put_fit(file.create_group("fit"), analysis.fit)
        _put_settings(file.create_group("settings"), analysis.settings)
        for number, record in enumerate(analysis.records, start=1):
            _put_record(file.create_group(f"records/hit{number}"), record)
        lifted = analysis.lifted
        group = file.create_group("lifted")
        values = (lifted.n_phases, lifted.first_phase, lifted.responses.lengths, lifted.noise)
        for item, value in zip(layout.LIFTED, values, strict=True):
            _put(group, item, value)
        if lifted.whitening is not None:
            _put(group, layout.WHITENING, lifted.whitening)
        group = file.create_group("modal")
        _put_fields(group, layout.MODAL, analysis.modal)
        _put(group, layout.OUTCOME, analysis.modal.outcome.name)
        if analysis.choice is not None:
            _put_fields(file.create_group("choice"), layout.CHOICE, analysis.choice)
        if analysis.modal.composites is not None:
            _put_fields(group.create_group("composites"), layout.COMPOSITES, analysis.modal.composites)
        _put_numbers(group.create_group("stats"), analysis.modal.stats)
        _put_model(file.create_group("model"), analysis.model)
        if analysis.validation is not None:
            _put_validation(file.create_group("validation"), analysis.validation)
        if analysis.state is None:
            _put(file, Item("state", optional=True), None)
        else:
            _put_state(file.create_group("state"), analysis.state)
        if analysis.refinement is not None:
            _put_refinement(file.create_group("refinement"), analysis.refinement, analysis.state)


def _put_model(group: h5py.Group, model: PeriodicModel) -> None:
    _put_fields(group, layout.MODEL, model)
    for name in ("estimates", "unselected"):
        estimates = getattr(model, name)
        if estimates is not None:
            _put_fields(group.create_group(name), layout.ESTIMATES, estimates)
    _put_channels(group, model.channels)
    _put_provenance(group, model.provenance)


def _put_state(group: h5py.Group, state: StateModel) -> None:
    _put_fields(group, (*layout.STATE, *layout.STATE_LATER), state)
    _put_provenance(group, state.provenance)


def _put_refinement(group: h5py.Group, found: Refinement, state: StateModel | None) -> None:
    _put_fields(group, layout.REFINEMENT, found)
    _put(group, layout.STRUCTURE, text_of(found.structure))
    if found.state is not state:
        _put_state(group.create_group("state"), found.state)


def _put_fit(group: h5py.Group, fit: Fit) -> None:
    _put_fields(group, layout.FIT, fit)
    if fit.forced is not None:
        _put_fields(group.create_group("forced"), layout.FORCED, fit.forced)


def _put_validation(group: h5py.Group, validation: Validation) -> None:
    _put_fields(group, layout.VALIDATION, validation)
    # By name, as they come back: the same analysis gives the same bytes.
    criteria = dict(sorted(validation.criteria.items()))
    _put_numbers(group.create_group("metrics"), dict(sorted(validation.metrics.items())))
    _put_numbers(group.create_group("limits"), {name: own.limit for name, own in criteria.items()})
    _put(group, layout.AT_LEAST, [name for name, own in criteria.items() if own.at_least])


def _put_periodicity(group: h5py.Group, found: Periodicity) -> None:
    _put_fields(group, layout.PERIODICITY, found)
    for name in ("by_harmonic", "by_mode", "by_channel"):
        _put_fields(group.create_group(name), layout.PARTIAL_TESTS, getattr(found, name))


def _put_settings(group: h5py.Group, settings: Settings) -> None:
    """Each field by what it holds, so that a field that `Settings` gains is written without a word here."""
    for field in fields(settings):
        value = getattr(settings, field.name)
        if isinstance(value, AbstractIdentifier):
            item, value = Item(field.name, "text", optional=True), to_text(value)
        elif isinstance(value, Integral):
            # HDF5 has no truth values: 0 and 1, which `load` turns back by the field's default.
            item, value = Item(field.name, "integer"), int(value)
        elif value is None or isinstance(value, Real):
            item = Item(field.name, optional=True)
        elif isinstance(value, str):
            item = Item(field.name, "text")
        elif isinstance(value, tuple) and all(isinstance(entry, str) for entry in value):
            item = Item(field.name, "text", ("entries",))
        else:
            raise TypeError(f"Settings.{field.name} holds {value!r}: a result file has no form for that yet.")
        _put(group, item, value)


def _put_record(group: h5py.Group, record: Record) -> None:
    _put_fields(group, layout.RECORD, record)
    for item in layout.CLOCK:
        _put(group, item, getattr(record.clock, item.name) if isinstance(record.clock, ConstantPeriod) else None)
    _put_channels(group, record.channels)
    _put_provenance(group, record.provenance)


def _put_channels(group: h5py.Group, channels: Sequence[Channel]) -> None:
    inner = group.create_group("channels")
    for item in layout.CHANNELS:
        _put(inner, item, [getattr(channel, item.name) for channel in channels])


def _put_provenance(group: h5py.Group, provenance: Provenance) -> None:
    _put_fields(group.create_group("provenance"), layout.PROVENANCE, provenance)


def _put_numbers(group: h5py.Group, numbers: Mapping[str, float]) -> None:
    for name, value in numbers.items():
        _put(group, Item(name), value)


def _put_fields(group: h5py.Group, items: Sequence[Item], thing: object) -> None:
    for item in items:
        _put(group, item, getattr(thing, item.name))


def _put(group: h5py.Group, item: Item, value: Any) -> None:
    """One dataset. Arrays are compressed and carry checksums, so that damage is seen."""
    import h5py

    dtype = h5py.string_dtype() if item.kind == "text" else np.dtype(layout.DTYPES[item.kind])
    if value is None:
        assert item.optional, item
        dataset = group.create_dataset(item.name, data=h5py.Empty(dtype))
    elif item.kind == "text":
        data = np.array([_storable(text) for text in value], dtype=object) if item.axes else _storable(value)
        dataset = group.create_dataset(item.name, data=data, dtype=dtype)
    else:
        array = np.asarray(value, dtype=dtype)
        assert array.ndim == len(item.axes), item
        # Noise does not compress: more than the lowest level takes time and saves nothing.
        packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}
        dataset = group.create_dataset(item.name, data=array, **(packed if array.ndim and array.size else {}))
    if item.axes:
        dataset.attrs["axes"] = ", ".join(item.axes)
    if item.unit:
        dataset.attrs["unit"] = item.unit


def _storable(text: str) -> str:
    """`text` with what HDF5 cannot hold written as an escape: undecodable bytes of a file name, a NUL."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8").replace("\0", "\\x00")
