"""Identifiers as text and back: a name and its options as JSON, and nothing in it is ever run."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any, cast

from floquid import lti
from floquid._checks import input_error
from floquid.errors import InputError
from floquid.lti import AbstractIdentifier

KNOWN: dict[str, type[AbstractIdentifier]] = {
    kind.__name__: kind for kind in (lti.AMI, lti.ERA, lti.LSCF, lti.MaximumLikelihood, lti.PolyLSCF)
}


def to_text(identifier: AbstractIdentifier) -> str:
    """The identifier as JSON: `{"name": …, "options": {…}}`, another identifier among its options the same way."""
    kind = type(identifier)
    if KNOWN.get(kind.__name__) is not kind:
        must, got = f"be found by an identifier of floquid ({', '.join(KNOWN)})", f"was found by {kind.__qualname__}"
        remedy = "Save it with replace(analysis, settings=replace(analysis.settings, identifier=None))."
        raise input_error("analysis", "save", must, got, remedy)
    return json.dumps(_plain(identifier))


def _plain(identifier: AbstractIdentifier) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for field in fields(cast("Any", identifier)):
        value = getattr(identifier, field.name)
        options[field.name] = _plain(value) if isinstance(value, AbstractIdentifier) else value
    return {"name": type(identifier).__name__, "options": options}


def from_text(text: str) -> AbstractIdentifier:
    """The identifier that `to_text` wrote."""
    try:
        return _built(json.loads(text))
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise InputError(f"the identifier {text!r:.80} cannot be read ({error})") from None


def _built(content: dict[str, Any]) -> AbstractIdentifier:
    kind = KNOWN[content["name"]]
    options = {name: _option(value) for name, value in content["options"].items()}
    return kind(**options)


def _option(value: Any) -> Any:
    if isinstance(value, dict):
        return _built(value)
    return tuple(value) if isinstance(value, list) else value
