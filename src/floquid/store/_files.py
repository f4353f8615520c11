"""`result.h5`: an analysis written, and read back whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from floquid._checks import input_error, wrong_value
from floquid._version import __version__
from floquid.checks import Criterion, Validation
from floquid.comparison import Comparison, Updated
from floquid.core import CLOCKS, Clock, ConstantPeriod, PeriodicModel, Record
from floquid.innovations import Mode
from floquid.inputs import InputMode
from floquid.io import (
    GUARD,
    LARGE_FORMAT,
    RESULT_ENDINGS,
    RESULT_FORMAT,
    DamagedError,
    as_path,
    atomic_path,
    is_result,
    readable_file,
)
from floquid.large import LARGE_VERSION, LargeResult, opened
from floquid.lti import AbstractIdentifier, ModalModel, Outcome
from floquid.monitoring import Monitor
from floquid.order import Choice
from floquid.periodic import Fit, ForcedResponse, Periodicity
from floquid.pipeline import (
    Analysis,
    Decay,
    Driven,
    Settings,
    ambient_fit,
    blas_threads,
    driven_fit,
    lifted_views,
    samples_of,
)
from floquid.reconstruction import AbstractStructure, Refinement, StateModel, structure_of, text_of
from floquid.store._datasets import (
    from_text,
    get,
    get_fields,
    get_numbers,
    get_object,
    put,
    put_numbers,
    put_object,
    to_text,
)
from floquid.store._layout import ABSENT, DIRECT, KINDS, SHAPE, VERSION
from floquid.surveys import Survey
from floquid.sync import ShaftAngle
from floquid.transfer import MeasuredTransfer, Modal, TransferFit

Result: TypeAlias = Analysis | MeasuredTransfer | TransferFit | Survey | Comparison | Updated | Monitor


def save(analysis: Result, path: str | PathLike[str]) -> None:
    """Write everything that an analysis holds to one HDF5 file, from which `load` makes it again.

    The layout is that of the package's own page. The file is written under another name in the same folder and takes
    its own name when it is whole: whatever happens, `path` holds the old file or the new one. The same analysis gives
    the same bytes.

    `analysis` is what `identify`, `measure_transfer`, `fit_transfer`, `survey`, `compare`, `update` or `monitor`
    found; the file `path`, by custom `result.h5`, may be a result. Raises InputError where `analysis` is something
    else, the name ends otherwise, the file is none that `save` wrote, or cannot be written there.
    """
    if not isinstance(analysis, Result):
        raise wrong_value("analysis", "save", "be an Analysis", analysis, "Pass what `identify` gave.")
    place = as_path(path, of="save")
    if place.suffix.lower() not in RESULT_ENDINGS and not place.is_dir():
        remedy = "A result is an HDF5 file; tables and .mat files are written by `export_modes`."
        raise input_error("path", "save", "end in .h5 or .hdf5", f"is {path}", remedy)
    if place.is_file() and not is_result(place):
        raise input_error("path", "save", "be no file but a result", f"{path} holds something else", "Name another.")
    with atomic_path(path, of="save") as temporary:
        # In memory first: when a disk is full or goes away, HDF5 itself does not end with an error but with a crash.
        content = BytesIO()
        _write(analysis, content)
        temporary.write_bytes(content.getbuffer())


def _write(analysis: Result, stream: BytesIO) -> None:
    import h5py

    with h5py.File(stream, "w") as file:
        file.attrs["format"] = RESULT_FORMAT
        file.attrs["version"] = VERSION
        file.attrs["floquid"] = __version__
        if analysis.kind in KINDS:
            file.attrs["kind"] = analysis.kind
        writers: dict[str, Callable[[Any, Any], None]] = {"analysis": _put_analysis, "fitted": _put_fit}
        writers.get(analysis.kind, put_object)(file, analysis)


def _put_analysis(file: Any, analysis: Analysis) -> None:
    """Write the settings, the records with their findings, and the fit."""
    _put_settings(file.create_group("settings"), analysis.settings)
    for number, record in enumerate(analysis.records, start=1):
        _put_record(file.create_group(f"records/hit{number}"), record)
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
    samples = samples_of(analysis.records, analysis.shafts)
    for number, (record, own) in enumerate(zip(fit.free, samples, strict=True), start=1):
        if not np.array_equal(record.values, own.values, equal_nan=True):
            _put_record(group.create_group(f"fit/free/hit{number}"), record)
    for name in ("modal", "choice", "periodicity"):
        thing = getattr(decay, name)
        if thing is not None:
            put_object(group.create_group(name), thing)


def _put_driven(group: Any, fit: Driven) -> None:
    """A fit of records whose excitation goes on: its modes, and what cannot be made of them again."""
    for name, (array, axes) in fit.stored.items():
        put(group, name, array, axes)
    for number, mode in enumerate(fit.at.modes, start=1):
        put_object(group.create_group(f"modes/mode{number}"), mode)


def _put_fit(file: Any, found: TransferFit) -> None:
    """A fit to transfer functions with its modes."""
    put_object(file, found)
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
    if record.clock is not None and (record.period is None or record.clock.fitted):
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


_CLOCKS: dict[str, Any] = {kind.__name__: kind for kind in CLOCKS}

MUST = "be a result file that `save` wrote"
AGAIN = "Write it again: `floquid identify ... --out DIR`, or `save(analysis, path)`."


def load(path: str | PathLike[str]) -> Result | LargeResult:
    """The analysis in a file that `save` wrote, every intermediate included; or what `identify_large` wrote.

    The free response is cut into periods and lifted again. Where the excitation goes on the fit is linearised at its
    modes again, with the same numbers; nothing is identified again. Residues of a record larger than memory stay in the
    file.

    It is equal to the one saved, field by field. The `path` is by custom `result.h5`. Raises InputError where there is
    no such file, it is no result file, it is of another version of the layout, or it is damaged.
    """
    file = readable_file(path, of="load")
    try:
        return GUARD.call(file, _load, file)
    except DamagedError as error:
        raise input_error("path", "load", MUST, f"{file} is damaged or not whole: {error}", AGAIN) from None


def _load(file: Path) -> Result | LargeResult:
    import h5py

    if not h5py.is_hdf5(file):
        raise input_error("path", "load", MUST, f"{file} is no HDF5 file", AGAIN)
    try:
        with h5py.File(file, "r") as stored:
            said: dict[str, Any] = dict(stored.attrs)
            known = {RESULT_FORMAT: VERSION, LARGE_FORMAT: LARGE_VERSION}.get(str(said.get("format")))
            if known is not None and int(said["version"]) == known:
                return opened(file) if said["format"] == LARGE_FORMAT else _read(stored)
    except Exception as error:  # noqa: BLE001  # damage raises anything: OSError, KeyError, OverflowError, ...
        detail = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        raise input_error("path", "load", MUST, f"{file} is damaged or not whole: {detail}", AGAIN) from None
    if known is None:
        raise input_error("path", "load", MUST, f"{file} has no attribute `format` of {RESULT_FORMAT!r}", AGAIN)
    must = f"be a result file of version {known}, the one that this floquid knows"
    got = f"{file} is of version {said['version']}, written by floquid {said.get('floquid')}"
    raise input_error("path", "load", must, got, "Update floquid." if int(said["version"]) > known else AGAIN)


def _read_fit(file: Any) -> TransferFit:
    """A fit to transfer functions."""
    modes = [file[f"fit/modes/mode{number}"] for number in range(1, len(file["fit/modes"]) + 1)]
    count = sum(1 for name in file["fit"] if name.startswith("direct"))
    modal = Modal(
        tuple(get_object(mode, InputMode) for mode in modes),
        tuple(get(mode, "shape", SHAPE) for mode in modes),
        tuple(get(file["fit"], f"direct{turn}", DIRECT) for turn in range(count)),
    )
    found = get_fields(file, TransferFit)
    if sum(1 if mode.real else 2 for mode in modal.modes) != found["model"].order:
        raise DamagedError("fit/modes are not those of the model")
    return TransferFit(modal=modal, **found)


def _read(file: Any) -> Result:
    kind = str(file.attrs.get("kind", ""))
    if kind:
        if kind not in KINDS:
            raise DamagedError(f"it is of the kind {kind!r}, which this floquid does not know (update floquid)")
        return _read_fit(file) if kind == "fitted" else get_object(file, KINDS[kind])
    settings, found = _settings(file["settings"]), get_fields(file, Analysis)
    model, state, count = found["model"], found.get("state"), len(file["records"])
    shafts = tuple(get_object(hit, ShaftAngle) for hit in _hits(file, "shafts", count)) if "shafts" in file else ()
    found |= {"settings": settings, "records": tuple(map(_record, _hits(file, "records", count))), "shafts": shafts}
    if "validation" in file:
        found["validation"] = _validation(file["validation"])
    if "refinement" in file:
        found["refinement"] = _refinement(file["refinement"], state)
    if "decay" in file:
        return Analysis(**found, decay=_decay(file["decay"], model, settings, found["records"], shafts))
    return Analysis(**found, driven=_driven(file["driven"], model, settings, found["records"]))


def _decay(
    group: Any, model: PeriodicModel, settings: Settings, records: tuple[Record, ...], shafts: tuple[ShaftAngle, ...]
) -> Decay:
    """The fit of free responses; it is cut into periods and lifted again."""
    if len(records) != model.n_hits:
        raise DamagedError("model/coefficients are not of as many hits as there are records")
    fit = _fit(group["fit"], model, samples_of(records, shafts))
    with blas_threads(fit.free):  # as when it was identified: the same to the last digit
        cycles, lifted = lifted_views(fit, shafts, settings)
    own = get_fields(group["modal"], ModalModel)
    own["outcome"] = Outcome[own["outcome"]]
    modal = ModalModel(**own)
    choice = get_fields(group["choice"], Choice) if "choice" in group else None
    return Decay(
        fit=fit,
        cycles=cycles,
        lifted=lifted,
        modal=modal,
        choice=None if choice is None else Choice(order=modal.order, model=modal, **choice),
        periodicity=get_object(group["periodicity"], Periodicity) if "periodicity" in group else None,
    )


def _driven(group: Any, model: PeriodicModel, settings: Settings, records: tuple[Record, ...]) -> Driven:
    """The fit of records whose excitation goes on, linearised at its modes again."""
    modes = [group[f"modes/mode{number}"] for number in range(1, len(group["modes"]) + 1)]
    if sum(1 if get(mode, "real") else 2 for mode in modes) != model.order:
        raise DamagedError("driven/modes are not those of the model")
    if settings.excitation == "ambient":
        parts = get(group, "columns", "channels, columns"), get(group, "initial", "records, states")
        return ambient_fit(records, settings, [get_object(mode, Mode) for mode in modes], *parts)
    direct = tuple(map(float, get(group, "direct", "harmonics")))
    return driven_fit(records, settings, [get_object(mode, InputMode) for mode in modes], direct)


def _refinement(group: Any, state: StateModel | None) -> Refinement:
    own = get_object(group["state"], StateModel) if "state" in group else state
    structure = structure_of(get(group, "structure"))
    if own is None or not isinstance(structure, AbstractStructure):
        raise DamagedError("it has a refinement without " + ("a structure" if own is not None else "a state"))
    return Refinement(**get_fields(group, Refinement), structure=structure, state=own)


def _validation(group: Any) -> Validation:
    least, limits = get(group, "at_least", "criteria"), get_numbers(group["limits"])
    failing = get_numbers(group["failing"]) if "failing" in group else {}
    criteria = {
        name: Criterion(limit=limit, at_least=name in least, failing=failing.get(name))
        for name, limit in limits.items()
    }
    return Validation(**get_fields(group, Validation), criteria=criteria)


def _settings(group: Any) -> Settings:
    known = [field.name for field in fields(Settings)]
    for name in group:
        if name not in known:
            raise DamagedError(f"it has the setting {name!r}, which this floquid does not know (update floquid)")
    found = {name: get(group, name, None) for name in known if name in group or name not in ABSENT}
    if isinstance(found["identifier"], str):
        found["identifier"] = from_text(found["identifier"])
    flags = {field.name for field in fields(Settings) if isinstance(field.default, bool)}
    return Settings(**{name: value == 1 if name in flags else value for name, value in found.items()})


def _fit(group: Any, model: PeriodicModel, samples: tuple[Record, ...]) -> Fit:
    """The fit of free responses, to `samples` with the forced response in them."""
    names = [f"free/hit{number}" for number in range(1, model.n_hits + 1)]
    free = tuple(_record(group[name]) if name in group else one for name, one in zip(names, samples, strict=True))
    found = get_fields(group, Fit)
    period, forced = found["own_period"], None
    later = found.get("later")
    for hit, (was, own) in enumerate(zip(samples, free, strict=True)):
        quiet = 0 if later is None else int(later[hit]) * round(model.period * was.sample_rate)
        if [channel.name for channel in own.channels] != [channel.name for channel in model.channels]:
            raise DamagedError("model/channels are not those of the records")
        if found["constrained"] and own.n_samples != was.n_samples - quiet:
            raise DamagedError("fit/free is not the response that the records hold")
    if "forced" in group:
        forced = ForcedResponse(**get_fields(group["forced"], ForcedResponse), channels=model.channels)
    found |= {"own_period": None if period is None else (float(period[0]), float(period[1]))}
    return Fit(model=model, forced=forced, free=free, **found)


def _hits(group: Any, name: str, count: int) -> list[Any]:
    return [group[f"{name}/hit{hit + 1}"] for hit in range(count)]


def _record(group: Any) -> Record:
    """One record, with its clock and its orbit."""
    orbit = get(group, "orbit", "channels, phases") if "orbit" in group else None
    return Record(**get_fields(group, Record), clock=_clock(group), orbit=orbit)


def _clock(group: Any) -> Clock | None:
    if "clock" in group:
        return get_object(group["clock"], _CLOCKS[get(group["clock"], "kind")])
    period, origin = get(group, "period"), get(group, "origin")
    return None if period is None else ConstantPeriod(period=period, origin=origin)
