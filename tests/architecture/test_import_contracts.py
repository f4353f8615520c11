"""Tests of a test: the import contracts of pyproject.toml, each broken on purpose in a package of empty rooms.

`make lint` holds the real source to them. Here every room of the design exists, or none but the first ones do, so that
a contract that has lost its teeth, or that cannot bear a room that is not yet built, is seen at once.
"""

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"
CONTRACTS = {
    contract["id"]: contract
    for contract in tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]
}
NAMES = {name.strip("() ") for layer in CONTRACTS["layers"]["layers"] for name in layer.split("|")}
OPTIONAL = {
    name.strip(" ()")
    for layer in CONTRACTS["layers"]["layers"]
    for name in layer.split("|")
    if name.strip().startswith("(")
}
OPEN_TO_ALL = ["errors", "_arrays", "_checks", "_bar", "_json", "_show", "_version"]


@pytest.fixture
def lint(tmp_path):
    """A function: write a package of `rooms` with the imports {module: line}, lint it, name the broken contracts."""
    shutil.copy(PYPROJECT, tmp_path)
    package = tmp_path / "floquid"

    def lint(imports, rooms=NAMES):
        for room in rooms:
            (package / room).mkdir(parents=True, exist_ok=True)
            (package / room / "__init__.py").touch()
        (package / "__init__.py").touch()
        for name in OPEN_TO_ALL:
            (package / f"{name}.py").touch()
        for module, line in imports.items():
            path = package / f"{module}.py" if module in OPEN_TO_ALL else package / module / "_inside.py"
            path.parent.mkdir(exist_ok=True)
            (path.parent / "__init__.py").touch()
            path.write_text(line + "\n", encoding="utf-8")
        run = subprocess.run(
            [
                sys.executable,
                "-c",
                "from importlinter.cli import lint_imports_command; lint_imports_command()",
                "--no-cache",
            ],
            cwd=tmp_path,
            env={"PYTHONPATH": str(tmp_path), "PYTHONWARNINGS": "default", "COLUMNS": "200"},
            capture_output=True,
            text=True,
            check=False,
        )
        lines = run.stdout.splitlines()
        broken, kept = (
            {key for key, of in CONTRACTS.items() if any(line.startswith(f"{of['name']} {word}") for line in lines)}
            for word in ("BROKEN", "KEPT")
        )
        assert broken | kept == set(CONTRACTS), run.stdout + run.stderr
        assert run.returncode == (1 if broken else 0), run.stdout + run.stderr
        return broken

    return lint


ALLOWED = {
    "cli": "import floquid.systems, floquid.plot, floquid.testing, floquid.store, floquid.pipeline, floquid.floquet",
    "plot": "import matplotlib, bokeh, floquid.pipeline",
    "reporting": "import jinja2, bokeh, floquid.plot",
    "pipeline": "import floquid.checks, floquid.lifting, floquid.lti, floquid.readers, floquid.errors",
    "periodic": "import floquid.lti, floquid.order, floquid.fit",
    "systems": "import floquid.floquet, floquid._checks",
    "floquet": "import floquid.core, floquid._checks, floquid.io, floquid._bar, scipy",
    "core": "import floquid.fit, floquid._checks",
    "readers": "import floquid.tables, floquid.io, floquid.core",
    "tables": "import floquid.core, floquid.io",
    "exports": "import floquid.views, floquid.readers",
    "io": "import floquid._checks",
    "_checks": "import floquid.errors",
}


def test_what_the_design_allows_is_allowed(lint):
    assert lint(ALLOWED) == set()


def test_rooms_that_are_not_built_need_not_exist(lint):
    assert lint({}, rooms=NAMES - OPTIONAL) == set()


def test_a_room_that_is_built_has_lost_its_parentheses():
    source = PYPROJECT.parent / "src" / "floquid"
    assert not {room for room in OPTIONAL if (source / room).exists() or (source / f"{room}.py").exists()}


WRONG = [
    ("core", "import floquid.readers", "layers"),
    ("lti", "from floquid.periodic import _inside", "layers"),
    ("readers", "import floquid.lti", "layers"),
    ("store", "import floquid.plot", "layers"),
    ("pipeline", "def late():\n    import floquid.plot", "layers"),
    ("lifting", "import floquid.order", "layers"),
    ("pipeline", "import floquid.reporting", "layers"),
    ("surprise", "import floquid.core", "layers"),
    ("lti", "import floquid.core", "lti-is-anonymous"),
    ("errors", "import floquid.core", "foundations"),
    ("_checks", "import floquid.io", "foundations"),
    ("io", "import floquid.core", "layers"),
    ("tables", "import floquid.readers", "layers"),
    ("core", "def late():\n    import floquid.tables", "layers"),
    ("store", "import floquid.exports", "layers"),
    ("_bar", "import floquid.pipeline", "foundations"),
    ("_show", "import floquid.plot", "foundations"),
    ("pipeline", "import floquid.systems", "oracle"),
    ("periodic", "import floquid.floquet", "oracle"),
    ("reconstruction", "import floquid.systems", "oracle"),
    ("order", "import floquid.floquet", "oracle"),
    ("floquet", "import floquid.fit", "oracle-shares-no-code"),
    ("pipeline", "import matplotlib.pyplot", "plotting"),
    ("cli", "import matplotlib", "plotting"),
    ("store", "import jinja2", "plotting"),
    ("systems", "def draw():\n    from bokeh import plotting", "plotting"),
]


def test_every_contract_can_be_broken(lint):
    """A wrong import for each, all in one package; of `make slow`, many more, each alone."""
    wrong = {contract: (room, line) for room, line, contract in reversed(WRONG)} | {
        "plotting": ("cli", "import matplotlib"),
        "floquet-rooms": ("floquet/matrices", "import floquid.floquet.control"),
        "periodic-rooms": ("periodic/expansion", "import floquid.periodic.search"),
    }
    assert set(wrong) == set(CONTRACTS)
    assert lint({**dict(wrong.values()), "floquet/control": "", "periodic/search": ""}) == set(CONTRACTS)


@pytest.mark.slow
@pytest.mark.parametrize(("room", "line", "contract"), WRONG)
def test_a_wrong_import_breaks_its_contract(lint, room, line, contract):
    assert contract in lint({room: line})


def test_an_import_through_another_room_is_seen(lint):
    assert "oracle" in lint({"pipeline": "import floquid.lifting", "lifting": "import floquid.systems"})


@pytest.mark.first(2)
@pytest.mark.parametrize(
    ("room", "other"),
    [("hill_method", "monodromy_matrix"), ("monodromy_matrix", "hill_method"), ("matrices", "control")],
)
def test_inside_floquet_imports_go_downwards(lint, room, other):
    """Integration and Hill's method share no code: each is the check of the other."""
    broken = lint({f"floquet/{room}": f"import floquid.floquet.{other}", f"floquet/{other}": ""})
    assert "floquet-rooms" in broken
