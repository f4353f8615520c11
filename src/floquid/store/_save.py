"""An `Analysis` → `result.h5`."""

from __future__ import annotations

from dataclasses import fields
from io import BytesIO
from numbers import Integral, Real
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from floquid._checks import describe, input_error
from floquid._version import __version__
from floquid.core import PeriodicModel
from floquid.io import atomic_path
from floquid.lti import AbstractIdentifier
from floquid.periodic import Periodicity
from floquid.pipeline import Analysis, Settings, samples_of
from floquid.reconstruction import Refinement, StateModel, text_of
from floquid.store import _layout as layout
from floquid.store._identifiers import to_text
from floquid.store._layout import Item
from floquid.store._put import put, put_fields, put_numbers
from floquid.store._save_records import put_channels, put_provenance, put_record, put_shaft
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

    with h5py.File(stream, "w") as file:
        file.attrs["format"] = layout.FORMAT
        file.attrs["version"] = layout.VERSION
        file.attrs["floquid"] = __version__
        put(file, layout.WARNINGS, analysis.warnings)
        put(file, layout.SYNCHRONISATION, analysis.synchronisation)
        if analysis.periodicity is not None:
            _put_periodicity(file.create_group("periodicity"), analysis.periodicity)
        _put_fit(file.create_group("fit"), analysis)
        _put_settings(file.create_group("settings"), analysis.settings)
        for number, record in enumerate(analysis.records, start=1):
            put_record(file.create_group(f"records/hit{number}"), record)
        for number, shaft in enumerate(analysis.shafts, start=1):
            put_shaft(file.create_group(f"shafts/hit{number}"), shaft)
        group = file.create_group("modal")
        put_fields(group, layout.MODAL, analysis.modal)
        put(group, layout.OUTCOME, analysis.modal.outcome.name)
        if analysis.choice is not None:
            put_fields(file.create_group("choice"), layout.CHOICE, analysis.choice)
        if analysis.modal.composites is not None:
            put_fields(group.create_group("composites"), layout.COMPOSITES, analysis.modal.composites)
        put_numbers(group.create_group("stats"), analysis.modal.stats)
        _put_model(file.create_group("model"), analysis.model)
        if analysis.validation is not None:
            _put_validation(file.create_group("validation"), analysis.validation)
        if analysis.state is None:
            put(file, Item("state", optional=True), None)
        else:
            _put_state(file.create_group("state"), analysis.state)
        if analysis.refinement is not None:
            _put_refinement(file.create_group("refinement"), analysis.refinement, analysis.state)


def _put_model(group: h5py.Group, model: PeriodicModel) -> None:
    put_fields(group, layout.MODEL, model)
    for name in ("estimates", "unselected"):
        estimates = getattr(model, name)
        if estimates is not None:
            put_fields(group.create_group(name), layout.ESTIMATES, estimates)
    put_channels(group, model.channels)
    put_provenance(group, model.provenance)


def _put_state(group: h5py.Group, state: StateModel) -> None:
    put_fields(group, (*layout.STATE, *layout.STATE_LATER), state)
    put_provenance(group, state.provenance)


def _put_refinement(group: h5py.Group, found: Refinement, state: StateModel | None) -> None:
    put_fields(group, layout.REFINEMENT, found)
    put(group, layout.STRUCTURE, text_of(found.structure))
    if found.state is not state:
        _put_state(group.create_group("state"), found.state)


def _put_fit(group: h5py.Group, analysis: Analysis) -> None:
    """The fit, with its free response where that is not what the records are."""
    fit = analysis.fit
    put_fields(group, layout.FIT, fit)
    if fit.forced is not None:
        put_fields(group.create_group("forced"), layout.FORCED, fit.forced)
    samples = samples_of(analysis.records, analysis.shafts, analysis.settings)
    for number, (record, own) in enumerate(zip(fit.free, samples, strict=True), start=1):
        if not np.array_equal(record.values, own.values, equal_nan=True):
            put_record(group.create_group(f"free/hit{number}"), record)


def _put_validation(group: h5py.Group, validation: Validation) -> None:
    put_fields(group, layout.VALIDATION, validation)
    # By name, as they come back: the same analysis gives the same bytes.
    criteria = dict(sorted(validation.criteria.items()))
    put_numbers(group.create_group("metrics"), dict(sorted(validation.metrics.items())))
    put_numbers(group.create_group("limits"), {name: own.limit for name, own in criteria.items()})
    put(group, layout.AT_LEAST, [name for name, own in criteria.items() if own.at_least])


def _put_periodicity(group: h5py.Group, found: Periodicity) -> None:
    put_fields(group, layout.PERIODICITY, found)
    for name in ("by_harmonic", "by_mode", "by_channel"):
        put_fields(group.create_group(name), layout.PARTIAL_TESTS, getattr(found, name))


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
        put(group, item, value)
