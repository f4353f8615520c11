"""The records of a result file with what was fitted to them, read."""

from __future__ import annotations

from typing import Any

from floquid.core import PeriodicModel, Record
from floquid.io import DamagedError
from floquid.periodic import Fit, ForcedResponse
from floquid.pipeline import Settings, samples_of
from floquid.store import _layout as layout
from floquid.store._get import get_fields
from floquid.store._load_records import get_hits, get_record, get_shaft
from floquid.sync import ShaftAngle

Stored = tuple[tuple[Record, ...], tuple[ShaftAngle, ...], Fit]


def get_fit(file: Any, model: PeriodicModel, settings: Settings) -> Stored:
    """The records used, the angle of the shaft in each that has one, and the fit."""
    records, shafts = _records(file, "records", model)
    samples, group = samples_of(records, shafts, settings), file["fit"]
    names = [f"free/hit{number}" for number in range(1, model.n_hits + 1)]
    pairs = zip(names, samples, strict=True)
    own = tuple(get_record(group[name]) if name in group else one for name, one in pairs)
    return records, shafts, _fit(group, get_fields(group, layout.FIT), model, own, samples)


def fit_of_version_1(file: Any, model: PeriodicModel, settings: Settings) -> Stored:
    """The same of a file whose `records` are those used where there is no group `measured`, else the free response.

    `measured` and `shafts` are in the group `fit`, if there is one: of samples fitted out of step, or beside a forced
    response.
    """
    group = file.get("fit", file)
    if group is not file and "measured" not in group:
        raise DamagedError("it is of an early floquid, which did not keep the record as it was measured")
    records, shafts = _records(group, "measured" if "measured" in group else "records", model)
    samples, own = samples_of(records, shafts, settings), None
    if "measured" in group:
        name = "records" if group is file else "free"
        own = tuple(get_record(hit) for hit in get_hits(group, name, model.n_hits))
    found: dict[str, Any] = dict.fromkeys(("period_std", "own_period", "misfit", "whitening"))
    found |= {"held": 0, "reasons": (), "doubts": ()}
    for place in (file, file["lifted"] if group is file else group):
        found |= get_fields(place, [item for item in layout.FIT if item.name in place])
    found["held"] = int(group is not file or found["held"] == 1)
    if found["held"] and found["misfit"] is None:  # of an early file
        found["misfit"] = 1.0
    return records, shafts, _fit(group, found, model, own or samples, samples)


def _fit(
    group: Any,
    found: dict[str, Any],
    model: PeriodicModel,
    free: tuple[Record, ...],
    samples: tuple[Record, ...],
) -> Fit:
    period, held = found["own_period"], found["held"] == 1
    for was, own in zip(samples, free, strict=True):
        if [channel.name for channel in own.channels] != [channel.name for channel in model.channels]:
            raise DamagedError("model/channels are not those of the records")
        if held and own.n_samples != was.n_samples:
            raise DamagedError("fit/free is not the response that the records hold")
    found |= {"own_period": None if period is None else (float(period[0]), float(period[1])), "held": held}
    return Fit(model=model, forced=_forced(group, model), free=free, **found)


def _forced(group: Any, model: PeriodicModel) -> ForcedResponse | None:
    if "forced" not in group:
        return None
    found = get_fields(group["forced"], layout.FORCED)
    follows = found.pop("speed_dependent") == 1
    return ForcedResponse(**found, channels=model.channels, speed_dependent=follows)


def _records(group: Any, name: str, model: PeriodicModel) -> tuple[tuple[Record, ...], tuple[ShaftAngle, ...]]:
    """The records as they were measured, and the angle of the shaft in each that has one."""
    records = tuple(get_record(hit) for hit in get_hits(group, name, model.n_hits))
    shafts = tuple(get_shaft(hit) for hit in get_hits(group, "shafts", model.n_hits)) if "shafts" in group else ()
    return records, shafts
