"""Objects that show themselves: a `repr` of one line, and results with `summary()`, `_repr_html_` and `plot`.

What makes tables, pages and figures stands above the results: it is asked for by name when it is used, here and
nowhere else (decision 0027).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields
from enum import Enum
from functools import partial, update_wrapper
from html import escape
from importlib import import_module
from itertools import islice
from typing import Any, Literal, cast

import numpy as np

_WIDEST, _PART, _FEW = 200, 60, 4
"""Characters of a `repr` and of one part of it, and how many entries of a tuple are looked at."""

Drawings = dict[str, tuple[object, dict[str, object]]]
"""Names of functions of `floquid.plot`, each with its first argument, or a function that makes it, and options."""


class Brief:
    """A dataclass whose `repr` is one short line: shapes of arrays, no values that are the default."""

    __slots__ = ()

    def __init_subclass__(cls, **options: object) -> None:
        """Set the `repr` in the class itself: one that is inherited would be replaced by that of the dataclass."""
        super().__init_subclass__(**options)
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__

    def __repr__(self) -> str:
        given = [(field, getattr(self, field.name)) for field in fields(cast("Any", self)) if field.repr]
        words = [f"{field.name}={_brief(value)}" for field, value in given if not _is_default(field, value)]
        room = _WIDEST - len(type(self).__name__)
        kept = [word for number, word in enumerate(words) if sum(map(len, words[: number + 1])) + 2 * number < room]
        return f"{type(self).__name__}({', '.join(kept + ['…'] * (len(kept) < len(words)))})"


def _is_default(field: Field[Any], value: object) -> bool:
    default = field.default if field.default_factory is MISSING else field.default_factory()
    return value is default or (type(value) is type(default) and not isinstance(value, np.ndarray) and value == default)


def _brief(value: Any) -> str:
    """A value in a few words; whole where it is short, so that options can be copied from a `repr`."""
    match value:
        case np.ndarray():
            return str(value.shape)
        case Mapping():
            text = _few([f"{name!r}: {_brief(value[name])}" for name in islice(value, _FEW)], len(value))
            return f"{{{text}}}"
        case tuple() | list():
            return f"({_few([_brief(one) for one in value[:_FEW]], len(value))}{',' * (len(value) == 1)})"
        case Enum():
            return f"{type(value).__name__}.{value.name}"
    text = repr(value.item() if isinstance(value, np.generic) else value)
    if len(text) >= _PART and isinstance(value, str):
        return f"{text[: _PART // 2]}…{text[0]}"
    short = len(text) < _PART and not callable(value)
    return text if short else f"{getattr(value, '__name__', type(value).__name__)}(…)"


def _few(words: list[str], number: int) -> str:
    """The first entries of `number`, or the first alone where they are long."""
    whole = ", ".join(words)
    if number <= len(words) and len(whole) < _PART:
        return whole
    return f"{whole if len(whole) < _PART else words[0]}, … {number} in all"


class Told:
    """A result that says in words what it is."""

    __slots__ = ()

    def summary(
        self, *, speed_unit: Literal["hz", "rpm"] = "hz", damping_unit: Literal["percent", "decrement"] = "percent"
    ) -> str:
        """The result as text: the tables and the verdict that the command line prints.

        The speed of a shaft is in `speed_unit`; frequencies of vibration are in Hz. Damping is the ratio ζ in percent,
        or the logarithmic decrement δ. Raises InputError where a unit is none.
        """
        return late("cli", "text_of")(self, speed_unit=speed_unit, damping_unit=damping_unit)

    def _repr_html_(self) -> str:
        """Text of the object as HTML, for a notebook."""
        return f"<pre>{escape(self.summary())}</pre>"


class Drawn:
    """A result that figures can be drawn of."""

    __slots__ = ()

    def _figures(self) -> Drawings:
        """Subject and options of each figure of `floquid.plot` that exists."""
        raise NotImplementedError

    @property
    def plot(self) -> Figures:
        """The figures that there are, a method each, with the options of the function of `floquid.plot` of its name."""
        return Figures(type(self).__name__, self._figures())


class Figures:
    """The figures of one result, a method each; `dir` lists them."""

    __slots__ = ("_figures", "_of")

    def __init__(self, of: str, figures: Drawings) -> None:
        self._of, self._figures = of, figures

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in self._figures:
            raise AttributeError(f"this {self._of} has no figure {name!r}; those it has: {', '.join(dir(self))}")
        function, (first, options) = late("plot", name), self._figures[name]
        draw = update_wrapper(partial(function, first() if callable(first) else first, **options), function)
        del draw.__wrapped__  # or the signature would be that with the first argument
        return cast("Callable[..., Any]", draw)

    def __dir__(self) -> list[str]:
        return sorted(self._figures)

    def __repr__(self) -> str:
        return f"Figures({', '.join(dir(self))})"


def late(room: str, name: str) -> Any:
    """A name of a room that stands above the caller, imported when it is used."""
    return getattr(import_module(f"floquid.{room}"), name)


def named_late(room: str, **names: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The `__getattr__` of a `room` that imports a module when a name of it is asked for, and its `__dir__`.

    `names` are those of each module, apart by spaces. A room has one where parts of it are used without the others,
    and those take long to import: `floquid info` proposes settings, and fits nothing.
    """
    module_of = {name: module for module, listed in names.items() for name in listed.split()}

    def asked(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        value = getattr(import_module(f"{room}.{module_of[name]}"), name)
        setattr(sys.modules[room], name, value)
        return value

    return asked, lambda: sorted(module_of)
