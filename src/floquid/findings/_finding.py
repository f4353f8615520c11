"""A finding: a code, how much it matters, numbers, and where it is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Any

import numpy as np

from floquid._checks import Rebuilt, wrong_value
from floquid.findings._inputs import AMBIENT, INPUTS
from floquid.findings._model import FIT, MODEL, ORDER, SYSTEM
from floquid.findings._records import PERIOD, RECORDS, SHAFT
from floquid.findings._verdict import DRAWS, VERDICT

WORDS: dict[str, str | Callable[..., str]] = {
    **RECORDS, **SHAFT, **ORDER, **FIT, **INPUTS, **AMBIENT, **PERIOD, **MODEL, **SYSTEM, **VERDICT, **DRAWS,
}  # fmt: skip
"""The words of each finding by its code: a template that the numbers are put into, or a function of them."""


class Severity(StrEnum):
    """Weight of a finding."""

    NOTE = "note"
    """Done, or in favour of a result."""
    WARNING = "warning"
    """Against a result, or to be known by its reader."""
    FAILURE = "failure"
    """The cause that a result fails by."""


@dataclass(frozen=True, slots=True)
class Finding(Rebuilt):
    """One result of a stage; `str(finding)` is the sentence for people.

    Raises InputError where the code is not in the table, and there are no words.

    Parameters
    ----------
    code
        The kind of finding, a key of the table of words.
    severity
        How much it matters: a `Severity` or its value.
    numbers
        What the words are made of: numbers, names, and tuples of them, by name.
    where
        The record that it is of, such as "record 2"; empty where it is of all.
    words
        The sentence of a finding that was read from a file; empty for that of the table.
    """

    code: str
    severity: Severity
    numbers: Mapping[str, Any] = field(default_factory=dict, hash=False)
    where: str = ""
    words: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        if not self.words and self.code not in WORDS:
            raise wrong_value("code", "Finding", "be one of the table of words", self.code)
        object.__setattr__(self, "severity", Severity(self.severity))
        plain = {name: _plain(value) for name, value in self.numbers.items()}
        object.__setattr__(self, "numbers", MappingProxyType(plain))

    def __str__(self) -> str:
        """The sentence, with the record that it is of ahead of it."""
        if self.words:
            return self.words
        words = WORDS[self.code]
        text = words.format(**self.numbers) if isinstance(words, str) else words(**self.numbers)
        text = f"{self.where}: {text}" if self.where else text
        return text[:1].upper() + text[1:]

    @property
    def clause(self) -> str:
        """Sentence as a part of another: without the record, the capital and the full stop."""
        text = str(replace(self, where=""))
        return text[:1].lower() + text[1:].removesuffix(".")


def as_mapping(finding: Finding) -> dict[str, Any]:
    """Code, severity, numbers, where and text of a `finding`, ready for JSON."""
    named = {"code": finding.code, "severity": finding.severity.value, "numbers": dict(finding.numbers)}
    return named | {"where": finding.where, "text": str(finding)}


def from_mapping(content: Mapping[str, Any]) -> Finding:
    """The finding of the `content` that `as_mapping` gave; one of another code or other words keeps its own words."""
    read = Finding(*(content[name] for name in ("code", "severity", "numbers", "where", "text")))
    with suppress(KeyError, TypeError, ValueError):
        own = replace(read, words="")
        return own if str(own) == read.words else read
    return read


def note(code: str, *, where: str = "", **numbers: Any) -> Finding:
    """A note of a `code` with its `numbers`: what was done, or what speaks for a result; `where` names the record."""
    return Finding(code, Severity.NOTE, numbers, where)


def warning(code: str, *, where: str = "", **numbers: Any) -> Finding:
    """A warning of a `code` with its `numbers`: what a reader must know; `where` names the record."""
    return Finding(code, Severity.WARNING, numbers, where)


def failure(code: str, *, where: str = "", **numbers: Any) -> Finding:
    """A failure of a `code` with its `numbers`: what a result fails by; `where` names the record."""
    return Finding(code, Severity.FAILURE, numbers, where)


def texts(findings: Iterable[Finding], *severities: Severity) -> tuple[str, ...]:
    """The sentences of those `findings` that are of one of the `severities`, or of all where none is named."""
    return tuple(str(one) for one in findings if not severities or one.severity in severities)


def _plain(value: Any) -> Any:
    """A number, a name or a tuple of them as Python has it, so that it can be pickled, compared and written as JSON."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return tuple(_plain(one) for one in value)
    if isinstance(value, complex):
        return (value.real, value.imag)
    return value
