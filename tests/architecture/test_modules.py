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


def test_import_loads_nothing_slow():
    """`import floquid` and `floquid --help` stay quick: what is slow to load is loaded by those who use it."""
    code = "import sys, floquid; print('\\n'.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert "floquid" in loaded
    assert not loaded.intersection(SLOW_TO_LOAD)
