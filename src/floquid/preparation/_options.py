"""The fields of `Settings` as keywords of functions, with the types that they take."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from inspect import Parameter, signature
from typing import Any, TypedDict, TypeVar, get_type_hints

from floquid.core import Branch, Form, Hold
from floquid.lti import AbstractIdentifier
from floquid.preparation._settings import Excitation, IdentifierName, Settings
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
