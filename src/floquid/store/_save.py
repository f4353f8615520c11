"""An analysis → `result.h5`."""

from __future__ import annotations

from dataclasses import fields
from io import BytesIO
from os import PathLike
from typing import Any, TypeAlias

import numpy as np

from floquid._checks import describe, input_error
from floquid._version import __version__
from floquid.checks import Validation
from floquid.core import Record
from floquid.inputs import Uncertainty
from floquid.io import as_path, atomic_path
from floquid.lti import AbstractIdentifier
from floquid.pipeline import Analysis, Decay, Driven, Settings, samples_of
from floquid.reconstruction import text_of
from floquid.store._datasets import put, put_numbers, put_object
from floquid.store._identifiers import to_text
from floquid.store._layout import DIRECT, FORMAT, LINES, SHAPE, VERSION
from floquid.transfer import MeasuredTransfer, TransferFit

ENDINGS = (".h5", ".hdf5")
"""Endings of the names of result files."""

Result: TypeAlias = Analysis | MeasuredTransfer | TransferFit


def save(analysis: Result, path: str | PathLike[str]) -> None:
    """Write everything that an analysis holds to one HDF5 file, from which `load` makes it again.

    The layout is that of the package's own page. The file is written under another name in the same folder and takes
    its own name when it is whole: whatever happens, `path` holds the old file or the new one. The same analysis gives
    the same bytes.

    `analysis` is what `identify`, `measure_transfer` or `fit_transfer` found; the file `path`, by custom `result.h5`,
    may exist. Raises InputError where `analysis` is something else, the
    name ends otherwise, or the file cannot be written there.
    """
    if not isinstance(analysis, Result):
        must = "be an Analysis"
        raise input_error("analysis", "save", must, f"is {describe(analysis)}", "Pass what `identify` gave.")
    place = as_path(path, of="save")
    if place.suffix.lower() not in ENDINGS and not place.is_dir():
        remedy = "A result is an HDF5 file; tables and .mat files are written by `export_modes`."
        raise input_error("path", "save", "end in .h5 or .hdf5", f"is {path}", remedy)
    with atomic_path(path, of="save") as temporary:
        # In memory first: when a disk is full or goes away, HDF5 itself does not end with an error but with a crash.
        content = BytesIO()
        _write(analysis, content)
        temporary.write_bytes(content.getbuffer())


def _write(analysis: Result, stream: BytesIO) -> None:
    import h5py

    with h5py.File(stream, "w") as file:
        file.attrs["format"] = FORMAT
        file.attrs["version"] = VERSION
        file.attrs["floquid"] = __version__
        if isinstance(analysis, (MeasuredTransfer, TransferFit)):
            _put_lines(file, analysis)
            return
        _put_settings(file.create_group("settings"), analysis.settings)
        for number, record in enumerate(analysis.records, start=1):
            _put_record(file.create_group(f"records/hit{number}"), record)
        _put_analysis(file, analysis)


def _put_analysis(file: Any, analysis: Analysis) -> None:
    """Write the findings of the records, and the fit that they belong to."""
    put_object(file, analysis)
    for number, shaft in enumerate(analysis.shafts, start=1):
        put_object(file.create_group(f"shafts/hit{number}"), shaft)
    if analysis.validation is not None:
        put_object(file.create_group("validation"), analysis.validation)
        _put_criteria(file["validation"], analysis.validation)
    _put_refinement(file, analysis)
    if analysis.decay is not None:
        _put_decay(file.create_group("decay"), analysis, analysis.decay)
    if analysis.driven is not None:
        _put_driven(file.create_group("driven"), analysis.driven)


def _put_decay(group: Any, analysis: Analysis, decay: Decay) -> None:
    """The fit of free responses, with its free response where that is not what the records are."""
    fit = decay.fit
    put_object(group.create_group("fit"), fit)
    if fit.forced is not None:
        put_object(group.create_group("fit/forced"), fit.forced)
    samples = samples_of(analysis.records, analysis.shafts, analysis.settings)
    for number, (record, own) in enumerate(zip(fit.free, samples, strict=True), start=1):
        if not np.array_equal(record.values, own.values, equal_nan=True):
            _put_record(group.create_group(f"fit/free/hit{number}"), record)
    for name in ("modal", "choice", "periodicity"):
        thing = getattr(decay, name)
        if thing is not None:
            put_object(group.create_group(name), thing)


def _put_driven(group: Any, fit: Driven) -> None:
    """A fit of records whose excitation goes on: its modes, and what cannot be made of them again."""
    if isinstance(fit, Uncertainty):
        put(group, "direct", fit.at.direct, "harmonics")
    else:
        put(group, "columns", fit.at.columns, "channels, columns; that of the channel")
        put(group, "initial", fit.at.initial, "records, states")
    for number, mode in enumerate(fit.at.modes, start=1):
        put_object(group.create_group(f"modes/mode{number}"), mode)


def _put_lines(file: Any, found: MeasuredTransfer | TransferFit) -> None:
    """Transfer functions that were measured, or a fit to such with its modes."""
    file.attrs["kind"] = LINES[type(found)]
    put_object(file, found)
    if isinstance(found, MeasuredTransfer):
        return
    for number, (mode, shape) in enumerate(zip(found.modal.modes, found.modal.shapes, strict=True), start=1):
        group = file.create_group(f"fit/modes/mode{number}")
        put_object(group, mode)
        put(group, "shape", shape, SHAPE)
    for turn, direct in enumerate(found.modal.direct):
        put(file["fit"], f"direct{turn}", direct, DIRECT)


def _put_refinement(file: Any, analysis: Analysis) -> None:
    """A(t) that was fitted with a structure, if one was asked for."""
    found = analysis.refinement
    if found is None:
        return
    put_object(file.create_group("refinement"), found)
    put(file["refinement"], "structure", text_of(found.structure))
    if found.state is not analysis.state:
        put_object(file.create_group("refinement/state"), found.state)


def _put_record(group: Any, record: Record) -> None:
    """One record, with its clock of whatever kind and its orbit if it has one."""
    put_object(group, record)
    put(group, "period", record.period, "; s")
    put(group, "origin", None if record.period is None else record.origin, "; s")
    if record.clock is not None and record.period is None:
        inner = group.create_group("clock")
        put(inner, "kind", type(record.clock).__name__)
        put_object(inner, record.clock)
    if record.orbit is not None:
        put(group, "orbit", record.orbit, "channels, phases; that of the channel")


def _put_criteria(group: Any, validation: Validation) -> None:
    put_numbers(group.create_group("limits"), {name: own.limit for name, own in validation.criteria.items()})
    failing = {name: own.failing for name, own in validation.criteria.items() if own.failing is not None}
    put_numbers(group.create_group("failing"), failing)
    least = tuple(sorted(name for name, own in validation.criteria.items() if own.at_least))
    put(group, "at_least", least, "criteria")


def _put_settings(group: Any, settings: Settings) -> None:
    """Each field by what it holds, so that a field that `Settings` gains is written without a word here."""
    for field in fields(settings):
        value = getattr(settings, field.name)
        text = to_text(value) if isinstance(value, AbstractIdentifier) else value
        put(group, field.name, text, "entries" if isinstance(value, tuple) else "")
