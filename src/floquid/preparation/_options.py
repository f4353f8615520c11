"""Settings as keywords of functions with their types, and files to records of one system as settings have them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, TypedDict, TypeVar, get_type_hints

from floquid._show import Brief
from floquid.core import Branch, Form, Hold, Record
from floquid.lti import AbstractIdentifier
from floquid.preparation._settings import Excitation, IdentifierName, Settings
from floquid.readers import read
from floquid.reconstruction import AbstractStructure


class RecordOptions(TypedDict, total=False):
    """Fields of `Settings` that say what records are taken for, as keywords of functions."""

    period: float | None
    channels: Sequence[str]
    inputs: Sequence[str]
    hold: Hold
    excitation: Excitation
    noise_floor: float
    trust_period: bool
    estimate_period: bool
    tach: str | None
    azimuth: str | None
    events: str | None
    pulses_per_revolution: int
    periods_per_revolution: float
    forced: str | Sequence[int]
    orbit: bool
    find_hits: bool
    skip: float | None
    repair: bool


class Options(RecordOptions, total=False):
    """The fields of `Settings` as keywords of functions, with the types that they take."""

    order: int | None
    harmonics: int | None
    states: Sequence[str]
    form: Form
    delay: float | None
    structure: AbstractStructure | str
    output_error: bool
    system_times: int
    identifier: AbstractIdentifier | IdentifierName | None
    mode_false_alarm: float
    harmonic_false_alarm: float
    seconds: float
    constrained: bool
    branch: Branch
    validate: bool


Function = TypeVar("Function", bound=Callable[..., Any])


def takes_settings(function: Function) -> Function:
    """A function that takes options by name, with a signature that names each of them with its default."""
    own = signature(function)
    before = [one for one in own.parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
    named, taken = {one.name for one in before}, get_type_hints(Options)
    options = [
        Parameter(field.name, Parameter.KEYWORD_ONLY, default=field.default, annotation=taken[field.name])
        for field in fields(Settings)
        if field.name not in named
    ]
    function.__signature__ = own.replace(parameters=[*before, *options])  # type: ignore[attr-defined]
    return function


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading(Brief):
    """Options of the reading of files, beside the settings of their identification.

    Parameters
    ----------
    rate
        The sampling rate [Hz], overriding what the files say; None for theirs.
    names
        Names to give the channels, or the path of a variable that holds them.
    origin
        The time of phase zero [s].
    header
        True where text tables have a line of names.
    point
        The operating point by quantity, beside what the files say of it.
    """

    rate: float | None = None
    names: tuple[str, ...] = ()
    origin: float = 0.0
    header: bool = True
    point: Mapping[str, float] = field(default_factory=dict)

    def records(
        self, files: Sequence[Path], settings: Settings, report: Callable[[str], None] = lambda _: None
    ) -> tuple[list[Record], Settings]:
        """The records in `files`, and the `settings` with the names that channels have from here on.

        Of the channels that the settings name, and of signals and inputs beside them; of all where they name none.
        Raises InputError as `read` does. A stage of the work is told to `report`.
        """
        signals = [name for name in (settings.tach, settings.azimuth, settings.events) if name is not None]
        beside = [name for name in (*signals, *settings.inputs) if name not in (*settings.channels, *self.names)]
        named = (*settings.channels, *beside) if settings.channels else None
        records = []
        for file in files:
            report(f"reading {file.name}")
            record = read(
                file, period=settings.period, rate=self.rate, channels=named, names=self.names or None,
                origin=self.origin, header=self.header,
            )  # fmt: skip
            records.append(record.with_point(self.point))
        if settings.channels:  # a path may stand for all rows of a matrix: from here on each has its name
            own = tuple(channel.name for channel in records[0].channels if channel.name not in beside)
            settings = replace(settings, channels=own)
        return records, settings
