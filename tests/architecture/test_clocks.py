"""No type of a clock is asked for: each answers `Clock` or `PhaseClock`, and one room reads those that are measured."""

import ast
from pathlib import Path

import floquid
from floquid.core import CLOCKS

ROOT = Path(floquid.__file__).parent
MEASURED = {kind.__name__ for kind in CLOCKS if kind.__name__ != "ConstantPeriod"}
CONCRETE = {kind.__name__ for kind in CLOCKS} | {"Clock", "CLOCKS", "ShaftAngle"}

CHECKS_AN_ARGUMENT = {"core/_record.py", "plot/_record.py"}
"""Modules that refuse an argument by its class: the clock of a record, and the shaft of a figure."""

NAME_MEASURED = {
    "__init__.py", "core/__init__.py", "core/_clock.py",
    "preparation/_clocks.py", "preparation/_settings.py", "sync/_read_clock.py",
    "systems/_run.py",
}  # fmt: skip
"""Modules that name the class of a measured clock: its own, the contents pages, its reader, its option, an example."""


def names_in(node):
    return {own.id for own in ast.walk(node) if isinstance(own, ast.Name)} | {
        own.attr for own in ast.walk(node) if isinstance(own, ast.Attribute)
    }


def asks_for_a_class(text):
    """Lines where the class of a clock is asked for: by `isinstance`, by `type`, or by a pattern."""
    lines = []
    for node in ast.walk(ast.parse(text)):
        called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
        asked = (
            (called in ("isinstance", "issubclass") and names_in(node.args[1]) & CONCRETE)
            or (isinstance(node, ast.Compare) and "type" in names_in(node) and names_in(node) & CONCRETE)
            or (isinstance(node, ast.MatchClass) and names_in(node.cls) & CONCRETE)
        )
        if asked:
            lines.append(node.lineno)
    return lines


def names_of_imports(text):
    return {
        alias.name for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom) for alias in node.names
    }


def sources(words):
    """Modules that hold one of the words: the others need not be parsed."""
    texts = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in ROOT.rglob("*.py")}
    return {name: text for name, text in texts.items() if any(word in text for word in words)}


def test_no_module_asks_for_the_class_of_a_clock():
    asking = {name for name, text in sources(CONCRETE).items() if asks_for_a_class(text)}
    assert asking == CHECKS_AN_ARGUMENT


def test_few_modules_name_a_measured_clock():
    naming = {name for name, text in sources(MEASURED).items() if names_of_imports(text) & MEASURED}
    assert naming | {"core/_clock.py"} == NAME_MEASURED


def test_one_that_asks_would_be_found():
    text = (
        "isinstance(record.clock, ConstantPeriod)\n"
        "isinstance(record.clock, (TachometerSignal, core.AzimuthSignal))\n"
        "isinstance(clock, ConstantPeriod | PulseTimes)\n"
        "type(clock) is ShaftAngle\n"
        "match clock:\n    case ConstantPeriod():\n        pass\n"
        "isinstance(record, Record)\nclock.measured\nConstantPeriod(period=1.0)\n"
    )
    assert asks_for_a_class(text) == [1, 2, 3, 4, 6]
    assert names_of_imports("from floquid.core import ConstantPeriod, PulseTimes as Times") & MEASURED == {"PulseTimes"}
