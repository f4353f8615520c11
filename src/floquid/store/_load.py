"""`result.h5` → the analysis it was written from."""

from __future__ import annotations

from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Any

from floquid._checks import input_error
from floquid.core import AzimuthSignal, Clock, ConstantPeriod, PeriodicModel, PulseTimes, Record, TachometerSignal
from floquid.innovations import Mode
from floquid.inputs import InputMode
from floquid.io import GUARD, DamagedError, readable_file
from floquid.lti import ModalModel, Outcome
from floquid.order import Choice
from floquid.periodic import Fit, ForcedResponse, Periodicity
from floquid.pipeline import (
    AmbientAnalysis,
    Analysis,
    DrivenAnalysis,
    ExcitedAnalysis,
    Settings,
    ambient_fit,
    blas_threads,
    driven_fit,
    lifted_views,
    samples_of,
)
from floquid.reconstruction import AbstractStructure, Refinement, StateModel, structure_of
from floquid.store._datasets import get, get_fields, get_findings, get_numbers, get_object
from floquid.store._identifiers import from_text
from floquid.store._layout import DIRECT, EXCITED, FORMAT, LINES, SHAPE, VERSION
from floquid.store._save import Result
from floquid.sync import ShaftAngle
from floquid.transfer import MeasuredTransfer, Modal, TransferFit
from floquid.validation import Criterion, Validation

_SIGNALS: dict[str, Any] = {kind.__name__: kind for kind in (TachometerSignal, AzimuthSignal, PulseTimes)}
Stored = tuple[tuple[Record, ...], tuple[ShaftAngle, ...], Fit]

MUST = "be a result file that `save` wrote"
AGAIN = "Write it again: `floquid identify ... --out DIR`, or `save(analysis, path)`."


def load(path: str | PathLike[str]) -> Result:
    """The analysis in a file that `save` wrote, every intermediate included.

    The free response is cut into periods and lifted again, and where the excitation goes on the fit is linearised at
    its modes again, which gives the same numbers; nothing is identified again.

    It is equal to the one saved, field by field. The `path` is by custom `result.h5`. Raises InputError where there is
    no such file, it is no result file, it is of another version of the layout, or it is damaged.
    """
    file = readable_file(path, of="load")
    try:
        return GUARD.call(file, _load, file)
    except DamagedError as error:
        raise input_error("path", "load", MUST, f"{file} is damaged or not whole: {error}", AGAIN) from None


def _load(file: Path) -> Result:
    import h5py

    if not h5py.is_hdf5(file):
        raise input_error("path", "load", MUST, f"{file} is no HDF5 file", AGAIN)
    try:
        with h5py.File(file, "r") as opened:
            said: dict[str, Any] = dict(opened.attrs)
            if str(said.get("format")) == FORMAT and int(said["version"]) == VERSION:
                return _read(opened)
    except Exception as error:  # noqa: BLE001  # damage raises anything: OSError, KeyError, OverflowError, ...
        detail = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        raise input_error("path", "load", MUST, f"{file} is damaged or not whole: {detail}", AGAIN) from None
    if str(said.get("format")) != FORMAT:
        raise input_error("path", "load", MUST, f"{file} has no attribute `format` of {FORMAT!r}", AGAIN)
    must = f"be a result file of version {VERSION}, the one that this floquid knows"
    got = f"{file} is of version {said['version']}, written by floquid {said.get('floquid')}"
    raise input_error("path", "load", must, got, "Update floquid." if int(said["version"]) > VERSION else AGAIN)


def _read_excited(file: Any, kind: str) -> ExcitedAnalysis:
    """A result of records whose excitation goes on."""
    if kind not in EXCITED.values():
        raise DamagedError(f"it is of the kind {kind!r}, which this floquid does not know (update floquid)")
    settings, (records, _) = _settings(file["settings"]), _measured(file, len(file["records"]))
    group, made = file["fit"], next(one for one, name in EXCITED.items() if name == kind)
    modes = [group[f"modes/mode{number}"] for number in range(1, len(group["modes"]) + 1)]
    found = get_fields(file, made)
    if sum(1 if get(mode, "real") else 2 for mode in modes) != found["model"].order:
        raise DamagedError("fit/modes are not those of the model")
    if "refinement" in file:
        found["refinement"] = _refinement(file["refinement"], found["state"])
    if made is AmbientAnalysis:
        parts = get(group, "columns", "channels, columns"), get(group, "initial", "records, states")
        fit = ambient_fit(records, settings, [get_object(mode, Mode) for mode in modes], *parts)
        return AmbientAnalysis(settings=settings, records=records, fit=fit, **found)
    direct = tuple(map(float, get(group, "direct", "harmonics")))
    fit = driven_fit(records, settings, [get_object(mode, InputMode) for mode in modes], direct)
    return DrivenAnalysis(settings=settings, records=records, fit=fit, **found)


def _read_lines(file: Any, kind: str) -> MeasuredTransfer | TransferFit:
    """Transfer functions that were measured, or a fit to such."""
    if kind == LINES[MeasuredTransfer]:
        return get_object(file, MeasuredTransfer)
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
    import h5py

    kind = str(file.attrs.get("kind", ""))
    if kind in LINES.values():
        return _read_lines(file, kind)
    if kind:
        return _read_excited(file, kind)
    settings = _settings(file["settings"])
    model: PeriodicModel = get_object(file["model"], PeriodicModel)
    records, shafts, fit = _fit(file, model, settings)
    with blas_threads(fit.free):  # in as many threads as when it was identified: the same to the last digit
        cycles, lifted = lifted_views(fit, shafts, settings)
    found = get_fields(file["modal"], ModalModel)
    found["outcome"] = Outcome[found["outcome"]]
    modal = ModalModel(**found)
    state = get_object(file["state"], StateModel) if isinstance(file["state"], h5py.Group) else None
    choice = get_fields(file["choice"], Choice) if "choice" in file else None
    return Analysis(
        settings=settings,
        records=records,
        fit=fit,
        cycles=cycles,
        lifted=lifted,
        modal=modal,
        model=model,
        state=state,
        refinement=_refinement(file["refinement"], state) if "refinement" in file else None,
        choice=None if choice is None else Choice(order=modal.order, model=modal, **choice),
        shafts=shafts,
        periodicity=get_object(file["periodicity"], Periodicity) if "periodicity" in file else None,
        validation=_validation(file["validation"]) if "validation" in file else None,
        findings=get_findings(file),
    )


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
    found = {name: get(group, name, None) for name in known}
    if isinstance(found["identifier"], str):
        found["identifier"] = from_text(found["identifier"])
    flags = {field.name for field in fields(Settings) if isinstance(field.default, bool)}
    return Settings(**{name: value == 1 if name in flags else value for name, value in found.items()})


def _fit(file: Any, model: PeriodicModel, settings: Settings) -> Stored:
    """The records used, the angle of the shaft in each that has one, and the fit."""
    records, shafts = _measured(file, model.n_hits)
    samples, group = samples_of(records, shafts, settings), file["fit"]
    names = [f"free/hit{number}" for number in range(1, model.n_hits + 1)]
    free = tuple(_record(group[name]) if name in group else one for name, one in zip(names, samples, strict=True))
    return records, shafts, _made_fit(group, get_fields(group, Fit), model, free, samples)


def _made_fit(
    group: Any, found: dict[str, Any], model: PeriodicModel, free: tuple[Record, ...], samples: tuple[Record, ...]
) -> Fit:
    period, forced = found["own_period"], None
    for was, own in zip(samples, free, strict=True):
        if [channel.name for channel in own.channels] != [channel.name for channel in model.channels]:
            raise DamagedError("model/channels are not those of the records")
        if found["constrained"] and own.n_samples != was.n_samples:
            raise DamagedError("fit/free is not the response that the records hold")
    if "forced" in group:
        forced = ForcedResponse(**get_fields(group["forced"], ForcedResponse), channels=model.channels)
    found |= {"own_period": None if period is None else (float(period[0]), float(period[1]))}
    return Fit(model=model, forced=forced, free=free, **found)


def _measured(group: Any, count: int) -> tuple[tuple[Record, ...], tuple[ShaftAngle, ...]]:
    """The records as they were measured, and the angle of the shaft in each that has one."""
    shafts = _hits(group, "shafts", count) if "shafts" in group else []
    return tuple(map(_record, _hits(group, "records", count))), tuple(get_object(hit, ShaftAngle) for hit in shafts)


def _hits(group: Any, name: str, count: int) -> list[Any]:
    return [group[f"{name}/hit{hit + 1}"] for hit in range(count)]


def _record(group: Any) -> Record:
    """One record, with its clock and its orbit."""
    orbit = get(group, "orbit", "channels, phases") if "orbit" in group else None
    return Record(**get_fields(group, Record), clock=_clock(group), orbit=orbit)


def _clock(group: Any) -> Clock | None:
    if "clock" in group:
        return get_object(group["clock"], _SIGNALS[get(group["clock"], "kind")])
    period, origin = get(group, "period"), get(group, "origin")
    return None if period is None else ConstantPeriod(period=period, origin=origin)
