"""`result.h5` → the `Analysis` it was written from."""

from __future__ import annotations

from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._checks import input_error
from floquid.core import Estimates, PeriodicModel
from floquid.errors import FloquidError, InputError
from floquid.io import readable_file
from floquid.lti import Composites, ModalModel, Outcome
from floquid.order import Choice
from floquid.periodic import PartialTests, Periodicity
from floquid.pipeline import Analysis, Settings, lifted_views
from floquid.reconstruction import AbstractStructure, Refinement, StateModel, structure_of
from floquid.store import _layout as layout
from floquid.store._check import attributes_of, check_content
from floquid.store._get import DamagedError, dataset_in, get, get_fields, group_in
from floquid.store._identifiers import from_text
from floquid.store._layout import Item
from floquid.store._load_fit import fit_of_version_1, get_fit
from floquid.store._load_records import get_channels, get_provenance
from floquid.validation import Criterion, Validation

if TYPE_CHECKING:
    import h5py

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
    file = readable_file(path, of="load")
    while True:
        before = _identity(file)
        try:
            found = _loaded(file)
        except InputError:
            if _identity(file) == before:
                raise
        else:
            if _identity(file) == before:
                return found
        # Another program has put a new result in its place meanwhile: what was read may be of both.


def _identity(file: Path) -> tuple[int, ...]:
    """What changes when a file is replaced or written to."""
    try:
        now = file.stat()
    except OSError:
        return ()
    return now.st_dev, now.st_ino, now.st_size, now.st_mtime_ns


def _loaded(file: Path) -> Analysis:
    """The analysis in a file that stays as it is."""
    import h5py

    try:
        if not h5py.is_hdf5(file):
            raise input_error("path", "load", MUST, f"{file} is no HDF5 file", AGAIN)
        with h5py.File(file, "r") as opened:
            version = _version(attributes_of(opened), file)
            check_content(opened)
            return _read(opened, version)
    except DamagedError as error:
        detail = str(error)
    except FloquidError as error:
        if isinstance(error, InputError) and str(error).startswith("Argument `path` of `load`"):
            raise
        detail = str(error).splitlines()[0].rstrip(".")
    except Exception as error:  # noqa: BLE001  # damage raises anything: OSError, KeyError, OverflowError, ...
        detail = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
    raise input_error("path", "load", MUST, f"{file} is damaged or not whole: {detail}", AGAIN)


def _version(said: dict[str, Any], path: Path) -> int:
    """The version of the layout; another program's file is refused, and one of a later layout."""
    kind, version = said.get("format"), said.get("version")
    if not isinstance(kind, str) or kind != layout.FORMAT:
        raise input_error("path", "load", MUST, f"{path} has no attribute `format` of {layout.FORMAT!r}", AGAIN)
    if not isinstance(version, (int, np.integer)) or version < 1:
        raise DamagedError(f"its version is {version!r}")
    if version > layout.VERSION:
        raise input_error(
            "path",
            "load",
            f"be a result file of version {layout.VERSION}, the latest that this floquid knows",
            f"{path} is of version {version}, written by floquid {said.get('floquid')}",
            "Update floquid.",
        )
    return int(version)


def _read(file: h5py.File, version: int) -> Analysis:
    settings = _get_settings(group_in(file, "settings"))
    model = _get_model(group_in(file, "model"))
    records, shafts, fit = (fit_of_version_1 if version == 1 else get_fit)(file, model, settings)
    cycles, lifted = lifted_views(fit, shafts, settings)
    modal = _get_modal(group_in(file, "modal"))
    stored, needed = modal.residues.shape[1:], lifted.responses.values.shape[:2]
    if stored != needed:
        raise DamagedError(f"modal/residues is {stored}, but the records give {needed}")
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
        validation=_get_validation(file, model),
        warnings=get(file, layout.WARNINGS),
    )


def _get_model(group: h5py.Group) -> PeriodicModel:
    return PeriodicModel(
        **get_fields(group, layout.MODEL),
        estimates=_get_estimates(group, "estimates"),
        unselected=_get_estimates(group, "unselected"),
        channels=get_channels(group),
        provenance=get_provenance(group),
    )


def _get_estimates(model: h5py.Group, name: str) -> Estimates | None:
    if name not in model:
        return None
    values = get_fields(group_in(model, name), layout.ESTIMATES)
    return Estimates(**values | {"real": values["real"] == 1})


def _get_refinement(file: h5py.File, state: StateModel | None) -> Refinement | None:
    if "refinement" not in file:
        return None
    group = group_in(file, "refinement")
    own = _state_in(group_in(group, "state")) if "state" in group else state
    structure = structure_of(get(group, layout.STRUCTURE))
    if own is None or not isinstance(structure, AbstractStructure):
        raise DamagedError("it has a refinement without " + ("a structure" if own is not None else "a state"))
    return Refinement(**get_fields(group, layout.REFINEMENT), structure=structure, state=own)


def _get_choice(file: h5py.File, modal: ModalModel) -> Choice | None:
    if "choice" not in file:
        return None
    return Choice(order=modal.order, model=modal, **get_fields(group_in(file, "choice"), layout.CHOICE))


def _get_periodicity(file: h5py.File) -> Periodicity | None:
    if "periodicity" not in file:
        return None
    group = group_in(file, "periodicity")
    parts: dict[str, Any] = {
        name: PartialTests(**get_fields(group_in(group, name), layout.PARTIAL_TESTS))
        for name in ("by_harmonic", "by_mode", "by_channel")
    }
    return Periodicity(**get_fields(group, layout.PERIODICITY), **parts)


def _get_validation(file: h5py.File, model: PeriodicModel) -> Validation | None:
    if "validation" not in file:
        return None
    group = group_in(file, "validation")
    values, least = get_fields(group, layout.VALIDATION), get(group, layout.AT_LEAST)
    metrics, limits = (
        {str(name): get(part, Item(str(name))) for name in part}
        for part in (group_in(group, "metrics"), group_in(group, "limits"))
    )
    if values["fit"].shape != model.coefficients.shape[1:3]:
        raise DamagedError(f"validation/fit has the shape {values['fit'].shape}")
    criteria = {name: Criterion(limit=limit, at_least=name in least) for name, limit in limits.items()}
    return Validation(**values | {"metrics": metrics, "criteria": criteria, "passed": values["passed"] == 1})


def _get_settings(group: h5py.Group) -> Settings:
    known = [field.name for field in fields(Settings)]
    for name in group:
        if name not in known:
            raise DamagedError(f"it has the setting {name!r}, which this floquid does not know (update floquid)")
    found = {name: _get_any(group, name) for name in known if name in group or name in layout.SETTINGS_OF_VERSION_1}
    if isinstance(found.get("identifier"), str):
        found["identifier"] = from_text(found["identifier"])
    flags = {field.name for field in fields(Settings) if isinstance(field.default, bool)}
    return Settings(**{name: value == 1 if name in flags else value for name, value in found.items()})


def _get_any(group: h5py.Group, name: str) -> Any:
    """One setting: its form in the file says its type."""
    import h5py

    dataset = dataset_in(group, name)
    if dataset.shape is None:
        return None
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return get(group, Item(name, "text", ("entries",) if dataset.ndim else ()))
    return get(group, Item(name, "integer" if dataset.dtype.kind == "i" else "real"))


def _get_modal(group: h5py.Group) -> ModalModel:
    outcome = get(group, layout.OUTCOME)
    if outcome not in Outcome.__members__:
        raise DamagedError(f"{group.name}/outcome is {outcome!r}")
    stats = group_in(group, "stats")
    return ModalModel(
        **get_fields(group, layout.MODAL),
        outcome=Outcome[outcome],
        stats={str(name): get(stats, Item(str(name))) for name in stats},
        composites=Composites(**get_fields(group_in(group, "composites"), layout.COMPOSITES))
        if "composites" in group
        else None,
    )


def _get_state(file: h5py.File) -> StateModel | None:
    import h5py

    state = file.get("state")
    if isinstance(state, h5py.Dataset) and state.shape is None:
        return None
    return _state_in(group_in(file, "state"))


def _state_in(group: h5py.Group) -> StateModel:
    later = get_fields(group, [item for item in layout.STATE_LATER if item.name in group])
    return StateModel(**get_fields(group, layout.STATE), **later, provenance=get_provenance(group))
