"""The shape of the source: lengths, printing, and what importing it costs."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import floquid

ROOT = Path(floquid.__file__).parent

SLOW_TO_LOAD = [
    *("scipy.signal", "scipy.optimize", "scipy.integrate", "matplotlib", "h5py", "rich", "cyclopts"),
    *("control", "pandas", "xarray"),
]


TEXTS = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in ROOT.rglob("*.py")}


@pytest.fixture(scope="module")
def nodes():
    """Calls and imports of each module."""
    kinds = ast.Call, ast.ImportFrom
    return {name: [n for n in ast.walk(ast.parse(text)) if isinstance(n, kinds)] for name, text in TEXTS.items()}


def test_under_400_lines():
    assert TEXTS
    assert not [name for name, text in TEXTS.items() if len(text.splitlines()) >= 400]


def test_only_the_command_line_prints(nodes):
    calls = [
        (f"{name}:{node.lineno}", node.func)
        for name, found in nodes.items()
        if "cli" not in Path(name).parts
        for node in found
        if isinstance(node, ast.Call)
    ]
    assert calls
    assert not [place for place, called in calls if isinstance(called, ast.Name) and called.id == "print"]


def test_no_room_imports_what_is_private_to_another(nodes):
    """`floquid.a._b` is for modules in `floquid/a` alone, in its sub-rooms too; others import from `floquid.a`."""
    wrong, looked_at = [], 0
    for name, found in nodes.items():
        own = Path(name).parts[:-1]
        modules = [node.module or "" for node in found if isinstance(node, ast.ImportFrom)]
        for words in (module.split(".")[1:] for module in modules if module.startswith("floquid.")):
            looked_at += 1
            private = [at for at, word in enumerate(words) if at and word.startswith("_")]
            wrong += [f"{name} imports {'.'.join(words)}" for at in private if tuple(words[:at]) != own[:at]]
    assert looked_at
    assert not wrong


LOADS = """
import sys, floquid
print(*sys.modules)
import floquid.cli
for words in ("--version", "--help"):
    floquid.cli.run([words])
print(*sys.modules)
import floquid.pipeline
assert "scipy.linalg" not in sys.modules
record = floquid.systems.JeffcottRotor().simulate(n_periods=30)
found = floquid.identify(record, validate=False)
found.summary(), found._repr_html_(), repr(found.plot)
print(*sys.modules)
"""


def test_what_is_slow_to_load_is_loaded_by_those_who_use_it():
    """`import floquid` and `floquid --help` stay quick, and what draws nothing loads no plotting library."""
    run = subprocess.run([sys.executable, "-c", LOADS], capture_output=True, text=True, check=True)
    lines = [set(line.split()) for line in run.stdout.splitlines()]
    alone, command, identified = lines[0], lines[-2], lines[-1]
    assert "floquid" in alone
    assert not alone & set(SLOW_TO_LOAD)
    assert "floquid.cli" in command
    assert command & {*SLOW_TO_LOAD, "numpy", "scipy"} == {"rich", "cyclopts"}
    assert "floquid.pipeline" in identified
    assert not identified & {"matplotlib", "bokeh"}


def test_paths_that_the_page_for_contributors_names_exist():
    page = Path("CONTRIBUTING.md")
    places = re.findall(r"`([\w/*.]+/[\w*]+\.[\w.]+)`", page.read_text(encoding="utf-8"))
    assert len(places) > 10
    assert [own for own in places if not (list(ROOT.glob(own)) or list(page.parent.glob(own)))] == []
