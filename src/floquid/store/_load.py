"""`result.h5` → the `Analysis` it was written from."""

from __future__ import annotations

from dataclasses import fields
from os import PathLike
from typing import Any

from floquid._checks import input_error
from floquid.core import Estimates, PeriodicModel
from floquid.io import DamagedError, readable_file
from floquid.lti import Composites, ModalModel, Outcome
from floquid.order import Choice
from floquid.periodic import PartialTests, Periodicity
from floquid.pipeline import Analysis, Settings, lifted_views
from floquid.reconstruction import AbstractStructure, Refinement, StateModel, structure_of
from floquid.store import _layout as layout
from floquid.store._get import get, get_fields
from floquid.store._identifiers import from_text
from floquid.store._layout import Item
from floquid.store._load_fit import fit_of_version_1, get_fit
from floquid.store._load_records import get_channels, get_provenance
from floquid.validation import Criterion, Validation

MUST = "be a result file that `save` wrote"
AGAIN = "Write it again: `floquid identify ... --out DIR`, or `save(analysis, path)`."


def load(path: str | PathLike[str]) -> Analysis:
    """The analysis in a file that `save` wrote, every intermediate included.

    The free response is cut into periods and lifted again, which gives the same numbers; nothing is identified again.

    Parameters
    ----------
    path
        The file, by custom `result.h5`.

    Returns
    -------
    Analysis
        Equal to the one saved, field by field.

    Raises
    ------
    InputError
        There is no such file, it is no result file, it is of a later version of floquid, or it is damaged.
    """
    import h5py

    file = readable_file(path, of="load")
    if not h5py.is_hdf5(file):
        raise input_error("path", "load", MUST, f"{file} is no HDF5 file", AGAIN)
    try:
        with h5py.File(file, "r") as opened:
            said: dict[str, Any] = dict(opened.attrs)
            if str(said.get("format")) == layout.FORMAT and int(said["version"]) <= layout.VERSION:
                return _read(opened, int(said["version"]))
    except Exception as error:  # noqa: BLE001  # damage raises anything: OSError, KeyError, OverflowError, ...
        detail = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        raise input_error("path", "load", MUST, f"{file} is damaged or not whole: {detail}", AGAIN) from None
    if str(said.get("format")) != layout.FORMAT:
        raise input_error("path", "load", MUST, f"{file} has no attribute `format` of {layout.FORMAT!r}", AGAIN)
    must = f"be a result file of version {layout.VERSION}, the latest that this floquid knows"
    got = f"{file} is of version {said['version']}, written by floquid {said.get('floquid')}"
    raise input_error("path", "load", must, got, "Update floquid.")


def _read(file: Any, version: int) -> Analysis:
    settings = _get_settings(file["settings"])
    model = _get_model(file["model"])
    records, shafts, fit = (fit_of_version_1 if version == 1 else get_fit)(file, model, settings)
    cycles, lifted = lifted_views(fit, shafts, settings)
    modal = _get_modal(file["modal"])
    state = _get_state(file)
    return Analysis(
        settings=settings,
        records=records,
        fit=fit,
        cycles=cycles,
        lifted=lifted,
        modal=modal,
        model=model,
        state=state,
        refinement=_get_refinement(file, state),
        choice=_get_choice(file, modal),
        shafts=shafts,
        periodicity=_get_periodicity(file),
        synchronisation=get(file, layout.SYNCHRONISATION) if layout.SYNCHRONISATION.name in file else (),
        validation=_get_validation(file),
        warnings=get(file, layout.WARNINGS),
    )


def _get_model(group: Any) -> PeriodicModel:
    return PeriodicModel(
        **get_fields(group, layout.MODEL),
        estimates=_get_estimates(group, "estimates"),
        unselected=_get_estimates(group, "unselected"),
        channels=get_channels(group),
        provenance=get_provenance(group),
    )


def _get_estimates(model: Any, name: str) -> Estimates | None:
    if name not in model:
        return None
    values = get_fields(model[name], layout.ESTIMATES)
    return Estimates(**values | {"real": values["real"] == 1})


def _get_refinement(file: Any, state: StateModel | None) -> Refinement | None:
    if "refinement" not in file:
        return None
    group = file["refinement"]
    own = _state_in(group["state"]) if "state" in group else state
    structure = structure_of(get(group, layout.STRUCTURE))
    if own is None or not isinstance(structure, AbstractStructure):
        raise DamagedError("it has a refinement without " + ("a structure" if own is not None else "a state"))
    return Refinement(**get_fields(group, layout.REFINEMENT), structure=structure, state=own)


def _get_choice(file: Any, modal: ModalModel) -> Choice | None:
    if "choice" not in file:
        return None
    return Choice(order=modal.order, model=modal, **get_fields(file["choice"], layout.CHOICE))


def _get_periodicity(file: Any) -> Periodicity | None:
    if "periodicity" not in file:
        return None
    group = file["periodicity"]
    parts: dict[str, Any] = {
        name: PartialTests(**get_fields(group[name], layout.PARTIAL_TESTS))
        for name in ("by_harmonic", "by_mode", "by_channel")
    }
    return Periodicity(**get_fields(group, layout.PERIODICITY), **parts)


def _get_validation(file: Any) -> Validation | None:
    if "validation" not in file:
        return None
    group = file["validation"]
    values, least = get_fields(group, layout.VALIDATION), get(group, layout.AT_LEAST)
    metrics, limits = (
        {str(name): get(part, Item(str(name))) for name in part} for part in (group["metrics"], group["limits"])
    )
    criteria = {name: Criterion(limit=limit, at_least=name in least) for name, limit in limits.items()}
    return Validation(**values | {"metrics": metrics, "criteria": criteria, "passed": values["passed"] == 1})


def _get_settings(group: Any) -> Settings:
    known = [field.name for field in fields(Settings)]
    for name in group:
        if name not in known:
            raise DamagedError(f"it has the setting {name!r}, which this floquid does not know (update floquid)")
    found = {name: _get_any(group, name) for name in known if name in group or name in layout.SETTINGS_OF_VERSION_1}
    if isinstance(found.get("identifier"), str):
        found["identifier"] = from_text(found["identifier"])
    flags = {field.name for field in fields(Settings) if isinstance(field.default, bool)}
    return Settings(**{name: value == 1 if name in flags else value for name, value in found.items()})


def _get_any(group: Any, name: str) -> Any:
    """One setting: its form in the file says its type."""
    is_text, axes = group[name].dtype.kind == "O", group[name].shape
    return get(group, Item(name, "text" if is_text else "real", ("entries",) if axes else ()))


def _get_modal(group: Any) -> ModalModel:
    stats = group["stats"]
    return ModalModel(
        **get_fields(group, layout.MODAL),
        outcome=Outcome[get(group, layout.OUTCOME)],
        stats={str(name): get(stats, Item(str(name))) for name in stats},
        composites=Composites(**get_fields(group["composites"], layout.COMPOSITES)) if "composites" in group else None,
    )


def _get_state(file: Any) -> StateModel | None:
    import h5py

    return _state_in(file["state"]) if isinstance(file["state"], h5py.Group) else None


def _state_in(group: Any) -> StateModel:
    later = get_fields(group, [item for item in layout.STATE_LATER if item.name in group])
    return StateModel(**get_fields(group, layout.STATE), **later, provenance=get_provenance(group))
