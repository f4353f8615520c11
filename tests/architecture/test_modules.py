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


@pytest.fixture(scope="module")
def trees():
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in ROOT.rglob("*.py")}


def test_under_400_lines(trees):
    assert trees
    assert not [name for name in trees if len((ROOT / name).read_text(encoding="utf-8").splitlines()) >= 400]


def test_only_the_command_line_prints(trees):
    calls = [
        (f"{name}:{node.lineno}", node.func)
        for name, tree in trees.items()
        if "cli" not in Path(name).parts
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
    ]
    assert calls
    assert not [place for place, called in calls if isinstance(called, ast.Name) and called.id == "print"]


def test_no_room_imports_what_is_private_to_another(trees):
    """`floquid.a._b` is for modules in `floquid/a` alone, in its sub-rooms too; others import from `floquid.a`."""
    wrong, looked_at = [], 0
    for name, tree in trees.items():
        own = Path(name).parts[:-1]
        modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        for words in (module.split(".")[1:] for module in modules if module.startswith("floquid.")):
            looked_at += 1
            private = [at for at, word in enumerate(words) if at and word.startswith("_")]
            wrong += [f"{name} imports {'.'.join(words)}" for at in private if tuple(words[:at]) != own[:at]]
    assert looked_at
    assert not wrong


@pytest.mark.parametrize(("module", "needed"), [("floquid", set()), ("floquid.cli", {"rich", "cyclopts"})])
def test_import_loads_nothing_slow(module, needed):
    """`import floquid` and `floquid --help` stay quick: what is slow to load is loaded by those who use it."""
    code = f"import sys, {module}; print('\\n'.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert module in loaded
    assert loaded.intersection(SLOW_TO_LOAD) == needed


def test_paths_that_the_page_for_contributors_names_exist():
    page = Path("CONTRIBUTING.md")
    places = re.findall(r"`([\w/*.]+/[\w*]+\.[\w.]+)`", page.read_text(encoding="utf-8"))
    assert len(places) > 10
    assert [own for own in places if not (list(ROOT.glob(own)) or list(page.parent.glob(own)))] == []
