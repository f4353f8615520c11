"""Messages of inner functions in the words of the caller: who calls `identify` has not called `shaft_angle`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields

from floquid.errors import InputError
from floquid.preparation._settings import Settings

_SUBJECT = re.compile(r"Argument `([^`]*)` of `([^`]*)` must ")

_STRUCTURES = ("structure_of", "Block", "SecondOrder", "FirstOrder")

_OWN = {"names": "channels", "channel": "tach", "shortest": "period", "longest": "period"}
"""Options by the arguments of inner functions where these have other names; what is none is of the records."""


@contextmanager
def own_names(of: str) -> Iterator[None]:
    """The errors of what is called within, as errors of the callable `of` that takes records and the settings."""
    try:
        yield
    except InputError as error:
        match = _SUBJECT.match(str(error))
        if match is None or match[2] in (of, "Settings"):
            raise
        name = "structure" if match[2] in _STRUCTURES else _OWN.get(match[1], match[1])
        name = name if name in {field.name for field in fields(Settings)} else "records"
        raise type(error)(f"Argument `{name}` of `{of}` must {str(error)[match.end() :]}") from error
