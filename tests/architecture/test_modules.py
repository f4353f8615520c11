"""The shape of the source: lengths, printing, and what importing it costs."""

import ast
import os
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


def test_under_400_lines():
    assert TEXTS
    assert not [name for name, text in TEXTS.items() if len(text.splitlines()) >= 400]


def prints(text):
    """Lines that print; a module without the word need not be parsed."""
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)] if "print" in text else []
    return [node.lineno for node in calls if isinstance(node.func, ast.Name) and node.func.id == "print"]


def test_only_the_command_line_prints():
    assert prints("if True:\n    print(3)\n") == [2]
    found = {name: prints(text) for name, text in TEXTS.items() if "cli" not in Path(name).parts}
    assert {name: lines for name, lines in found.items() if lines} == {}


def test_no_room_imports_what_is_private_to_another():
    """`floquid.a._b` is for modules in `floquid/a` alone, in its sub-rooms too; others import from `floquid.a`."""
    wrong, looked_at = [], 0
    for name, text in TEXTS.items():
        own = Path(name).parts[:-1]
        modules = re.findall(r"^\s*from (floquid\.[\w.]+) import\b", text, flags=re.MULTILINE)
        for words in (module.split(".")[1:] for module in modules):
            looked_at += 1
            private = [at for at, word in enumerate(words) if at and word.startswith("_")]
            wrong += [f"{name} imports {'.'.join(words)}" for at in private if tuple(words[:at]) != own[:at]]
    assert looked_at
    assert not wrong


FITTING = ("checks", "exports", "innovations", "inputs", "lti", "periodic", "pipeline", "plot", "store", "transfer")
"""Rooms without which `floquid info` says what a file holds."""

LOADS = """
import os, sys, floquid
print(*sys.modules)
import floquid.cli
for words in ("--version", "--help"):
    floquid.cli.run([words])
print(*sys.modules, flush=True)
if not (child := os.fork()):
    code = floquid.cli.run(["info", sys.argv[1]])
    print(*sys.modules, flush=True)
    os._exit(code)
assert os.waitpid(child, 0)[1] == 0
import floquid.pipeline
assert "scipy.linalg" not in sys.modules
record = floquid.systems.JeffcottRotor().simulate(n_periods=30)
found = floquid.identify(record, validate=False)
found.summary(), found._repr_html_(), repr(found.plot)
print(*sys.modules)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_what_is_slow_to_load_is_loaded_by_those_who_use_it(tmp_path):
    """`import floquid` and `floquid --help` stay quick, and what draws nothing loads no plotting library."""
    from tests.cli.test_info_command import pulses, saved, struck

    force, response = struck([2.0])
    path = saved(tmp_path / "force.npz", {"F [N]": force, "x [m]": response[0], "tach": pulses()})
    run = subprocess.run([sys.executable, "-c", LOADS, str(path)], capture_output=True, text=True, check=True)
    lines = [set(line.split()) for line in run.stdout.splitlines()]
    alone, command, info, identified = [line for line in lines if {"sys", "builtins"} <= line]
    assert "floquid" in alone
    assert not alone & set(SLOW_TO_LOAD)
    assert "floquid.cli" in command
    assert command & {*SLOW_TO_LOAD, "numpy", "scipy"} == {"rich", "cyclopts"}
    assert "Possible clock: tach" in run.stdout
    assert "floquid.readers" in info
    assert not info & {f"floquid.{room}" for room in FITTING}
    assert "floquid.pipeline" in identified
    assert not identified & {"matplotlib", "bokeh"}


def test_paths_that_the_page_for_contributors_names_exist():
    page = Path("CONTRIBUTING.md")
    places = re.findall(r"`([\w/*.]+/[\w*]+\.[\w.]+)`", page.read_text(encoding="utf-8"))
    assert len(places) > 10
    assert [own for own in places if not (list(ROOT.glob(own)) or list(page.parent.glob(own)))] == []
