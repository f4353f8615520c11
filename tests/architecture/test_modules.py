"""The shape of the source: lengths, printing, and what importing it costs."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import floquid

ROOT = Path(floquid.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))
EVERY_MODULE = pytest.mark.parametrize("path", MODULES, ids=[str(path.relative_to(ROOT)) for path in MODULES])

SLOW_TO_LOAD = [
    *("scipy.signal", "scipy.optimize", "scipy.integrate", "matplotlib", "h5py", "rich", "cyclopts"),
    *("control", "pandas", "xarray"),
]


@EVERY_MODULE
def test_under_400_lines(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) < 400


@EVERY_MODULE
def test_only_the_command_line_prints(path):
    if "cli" in path.relative_to(ROOT).parts:
        return
    calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    printing = [node.lineno for node in calls if isinstance(node.func, ast.Name) and node.func.id == "print"]
    assert not printing, f"print( on lines {printing}"


@EVERY_MODULE
def test_no_room_imports_what_is_private_to_another(path):
    """`floquid.a._b` is for modules in `floquid/a` alone, in its sub-rooms too; others import from `floquid.a`."""
    own = path.relative_to(ROOT).parts[:-1]
    nodes = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.ImportFrom)]
    named = [(node.module or "").split(".")[1:] for node in nodes if (node.module or "").startswith("floquid.")]
    foreign = [(words, at) for words in named for at, word in enumerate(words) if at and word.startswith("_")]
    assert not [".".join(words) for words, at in foreign if tuple(words[:at]) != own[:at]]


def test_import_loads_nothing_slow():
    """`import floquid` and `floquid --help` stay quick: what is slow to load is loaded by those who use it."""
    code = "import sys, floquid; print('\\n'.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert "floquid" in loaded
    assert not loaded.intersection(SLOW_TO_LOAD)
