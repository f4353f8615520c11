"""Every public name is documented, and every parameter of it.

A constructor documents its parameters in a `Parameters` section. A function or method may instead name one in its
text, in backticks: "The phase at `time` [s]". Where there is only one, the bare word will do: "The stiffness K(t)".
"""

import ast
import importlib
import inspect
import pkgutil
import re
from dataclasses import fields
from enum import Enum
from pathlib import Path

import pytest
from numpydoc.docscrape import NumpyDocString

import floquid

NAMES = [info.name for info in pkgutil.iter_modules(floquid.__path__) if not info.name.startswith("_")]
SETTINGS = [field.name for field in fields(floquid.Settings)]
EVERY_ROOM = pytest.mark.parametrize("room", sorted(f"floquid.{name}" for name in NAMES))


def public_callables(package):
    """Each public class, its own public methods, and each public function, by name."""
    for name in getattr(package, "__all__", []):
        thing = getattr(package, name)
        if inspect.isclass(thing):
            yield name, thing
            for member, value in vars(thing).items():
                method = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
                if not member.startswith("_") and inspect.isfunction(method):
                    yield f"{name}.{member}", method
        elif inspect.isfunction(thing):
            yield name, thing


def undocumented(thing) -> list[str]:
    """The parameters of `thing` that its docstring does not explain."""
    text = inspect.getdoc(thing) or ""
    if inspect.isclass(thing) and (
        issubclass(thing, (BaseException, Enum))
        or "__init__" not in vars(thing)
        or getattr(thing, "_is_protocol", False)
    ):
        return []  # nothing of its own to construct
    section = {name.strip("* ") for entry in NumpyDocString(text)["Parameters"] for name in entry.name.split(",")}
    names = [name for name in inspect.signature(thing).parameters if name not in ("self", "cls")]
    if "options" in getattr(thing, "__annotations__", {}):  # fields of the settings, which document them
        names = [name for name in names if name not in SETTINGS]
    named = "" if inspect.isclass(thing) else r"\b{}\b" if len(names) == 1 else "`{}`"
    return [name for name in names if name not in section and not (named and re.search(named.format(name), text))]


@EVERY_ROOM
def test_a_room_is_its_own_contents_page(room):
    package = importlib.import_module(room)
    assert package.__doc__
    if hasattr(package, "__path__"):
        assert len(set(package.__all__)) == len(package.__all__)
        assert not [name for name in package.__all__ if not hasattr(package, name)]


@EVERY_ROOM
def test_public_names_and_their_parameters_are_documented(room):
    things = dict(public_callables(importlib.import_module(room)))
    assert not [name for name, thing in things.items() if not inspect.getdoc(thing)]
    assert not {name: missing for name, thing in things.items() if (missing := undocumented(thing))}


def test_the_test_can_fail():
    def half_told(first, second, third):
        """The `first`.

        Parameters
        ----------
        second
            The second.
        """

    class Untold:
        """Names `first`, in passing."""

        def __init__(self, first):
            self.first = first

    def told(cycles):
        """The record that was cut into cycles."""

    def untold(lifted):
        """The way back."""

    assert undocumented(half_told) == ["third"]
    assert undocumented(told) == []
    assert undocumented(untold) == ["lifted"]
    assert undocumented(Untold) == ["first"]


def test_the_walk_finds_types_methods_and_functions():
    found = dict(public_callables(importlib.import_module("floquid.core")))
    assert {"Record", "Record.select", "Provenance.merge", "channels_named"} <= set(found)


def test_rooms_that_import_late_list_what_they_name():
    """What a type checker reads and what is imported at run time are the same names, and completion finds them."""
    text = (Path(floquid.__file__).parent / "preparation" / "__init__.py").read_text(encoding="utf-8")
    (block,) = (node for node in ast.parse(text).body if isinstance(node, ast.If))
    read = {alias.name: node.module for node in block.body for alias in node.names}
    assert sorted(read) == dir(floquid.preparation)
    assert all(
        getattr(floquid.preparation, name) is getattr(importlib.import_module(at), name) for name, at in read.items()
    )
