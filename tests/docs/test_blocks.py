"""Every command and every Python block of the README and the documentation, run as a reader would run it.

The blocks of a page run in order, in one empty folder beside a copy of `examples/`, and its Python blocks share their
names. Floquid's own commands run in this process, a record is identified once for all pages, records that take long
are smaller (`INSTEAD`), and figures and the report are files of the right names alone; `make slow` runs the README in a
shell, pictures and all. A line of a `console` block that begins with "$ " is a command
and what follows is its output; every line of a `bash` block is a command. Commands that set a machine up (`git clone`,
`make`, `pip install`) are not run: of `make`, the targets must exist. Cells that the build of the site executes
(`{code-cell}`) run here as Python: a kernel a page, and its pictures, would take twice the time.
"""

import contextlib
import io
import os
import pickle
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pytest
from markdown_it import MarkdownIt
from tests.cli.conftest import no_command_is_assembled_twice, nothing_is_identified_twice, quick_pictures

import floquid
import floquid.reporting
from floquid.cli import run
from floquid.pipeline import _identify
from floquid.pipeline._identify import CHAINS

__all__ = ["no_command_is_assembled_twice", "nothing_is_identified_twice", "quick_pictures"]

ROOT = Path(__file__).parents[2]
DOCS = [path for path in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in path.parts]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS]

SHELL = {"console", "bash"}
# Shown, not run: other languages, and the directives of the documentation's own language.
SHOWN = {"text", "toml", "json", "csv", "bibtex", "bibliography", "toctree", "eval-rst", "mermaid", "math",
         "note", "warning", "tip", "admonition", "figure", "image", "glue",
         "literalinclude"}  # fmt: skip

CELL = "code-cell"
NO_PYTHON = re.compile(r"^[%:].*$", re.MULTILINE)
"""Lines of a cell that are none of its code: magic commands, and options such as `:tags: [hide-input]`."""

SETS_UP = ("git clone ", "cd ", "pip install ", "python3 -m venv ", "python -m pip install ")


def blocks(text):
    """(language, content) of each fenced block of a page."""
    for token in MarkdownIt("commonmark").parse(text):
        if token.type == "fence":
            words = token.info.split()
            yield words[0].strip("{}") if words else "", token.content


def commands(language, content):
    """The commands of a shell block, continued lines joined."""
    lines = re.sub(r"\\\n(> )?", " ", content).splitlines()
    if language == "console":
        return [line[2:] for line in lines if line.startswith("$ ")]
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]


def make_targets():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z]+):(?!=)", makefile, flags=re.MULTILINE))


PLAIN = re.compile(r"(floquid [\w ./,=:+-]*(?:\"[^\"$`\\\\]*\"[\w ./,=:+-]*)*)(?: \|\| test \$\? -eq (\d))?")
"""What needs no shell, and so no process of its own: half of such a process' time is that of loading."""


INSTEAD = {
    "docs/bootstrap.md": {
        "draws=60": "draws=20",
        "--periods 200": "--periods 60",
        "--draws 40": "--draws 20 --workers 1",
    },
    "docs/comparison.md": {"n_periods=60": "n_periods=30"},
    "docs/fleets.md": {"--over load": "--over load --workers 1"},
    "docs/guides/bad-records.md": {"for bad in RECORDS if": "for bad in RECORDS[::4] if"},
    "docs/gallery.md": {"0.98, 17)": "0.98, 9)"},
    "docs/guides/tachometer.md": {"n_periods=80": "n_periods=40", "--periods 120": "--periods 60"},
    "docs/identifiers.md": {"--periods 200": "--periods 60", "n_periods=400": "n_periods=100"},
    "docs/known.md": {
        "--periods 300": "--periods 60",
        "for seed in range(2)": "for seed in range(1)",
        "-2, 10, 37": "-2, 10, 13",
        "0, 6, 19": "0, 6, 7",
        "0.6, 1.0, 41": "0.6, 1.0, 21",
    },
    "docs/learn/what-is-ltp.md": {"n_periods=300": "n_periods=100"},
    "docs/monitoring.md": {"n_periods=60": "n_periods=25", "--no-validate": "--no-validate --workers 1"},
    "docs/paper.md": {"draws=2": "draws=1"},
    "docs/periodicity.md": {"simulate(noise": "simulate(n_periods=200, noise"},
    "docs/records.md": {
        "n_periods=300": "n_periods=80",
        "n_periods=200": "n_periods=100",
        "--periods 150": "--periods 60",
    },
    "docs/sharp_bits.md": {"n_periods=100": "n_periods=50", "n_periods=150": "n_periods=100"},
    "docs/state_matrix.md": {"--periods 400": "--periods 100", "simulate(noise": "simulate(n_periods=200, noise"},
    "docs/surveys.md": {
        "run2.npz run3.npz run4.npz run5.npz run6.npz run7.npz": "run2.npz",
        "--out survey": "--out survey --workers 1",
    },
    "docs/tutorials/ambient.md": {"np.pi, 20, 400": "np.pi, 20, 300"},
    "docs/tutorials/converter.md": {"0.02, 40, 60": "0.02, 40, 30"},
    "docs/tutorials/first-record.md": {"--periods 400": "--periods 100"},
    "docs/tutorials/rotor-over-speed.md": {"--out survey": "--out survey --workers 1"},
    "docs/tutorials/turbine-over-wind.md": {
        "8 * 315": "8 * 165",
        "points=9": "points=5",
        "--out survey": "--out survey --workers 1",
    },
    "docs/verdict.md": {"--periods 300": "--periods 100"},
}
"""Sizes on a page by which it takes long, and smaller ones: the build of the site runs the cells as they stand."""


def run_command(command, folder, within=False):
    """Run one command in `folder` with this Python's first on the path, and fail if it does.

    With `within`, floquid's own run in this process.
    """
    if command.startswith(SETS_UP):
        return
    if command == "make" or command.startswith("make "):
        targets = [word for word in shlex.split(command, comments=True)[1:] if "=" not in word and word[0] != "-"]
        unknown = set(targets) - make_targets()
        assert not unknown, f"`{command}`: the Makefile has no target {unknown}"
        return
    if within and (plain := PLAIN.fullmatch(command)):
        code = run(shlex.split(plain[1])[1:])
        assert code == int(plain[2] or 0), f"`{command}` ended with {code}"
        return
    path = [str(Path(sys.executable).parent), os.environ["PATH"]]
    ended = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", command],
        cwd=folder,
        env=os.environ | {"PATH": os.pathsep.join(path), "NO_COLOR": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, f"`{command}` ended with {ended.returncode}\n{ended.stdout}\n{ended.stderr}"


def run_page(text, name, folder, within=False):
    """Run a page's blocks in order in `folder`, the current one, and return how many ran."""
    names = {"__name__": "__main__"}
    ran = 0
    for number, (language, content) in enumerate(blocks(text), start=1):
        if language in SHELL:
            for command in commands(language, content):
                run_command(command, folder, within)
        elif language in ("python", CELL):
            code = NO_PYTHON.sub("", content) if language == CELL else content
            exec(compile(code, f"{name}, block {number}", "exec"), names)
        else:
            assert language in SHOWN, f"block {number} is in «{language}»: neither run nor in the list of what is not"
            continue
        ran += 1
    return ran


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder with the examples in it, and the current one."""
    import matplotlib.pyplot as plt

    if (ROOT / "examples").is_dir():
        shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FLOQUID_ROOT", str(ROOT))
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(plt, "show", plt.close)
    with patch.dict(os.environ), plt.rc_context():
        yield tmp_path
    plt.close("all")


FOUND = {}
"""What was identified on a page, by the records as prepared and their kind."""


@pytest.fixture
def quick(quick_pictures, monkeypatch):
    """Identify each record once, however many pages do; start no process for a command of a cell; draw no file."""

    def remembered(kind, chain):
        def found(prepared, report):
            period = prepared.settings.period  # the records have it, whether it is an option or the clock of a file
            settings = replace(prepared.settings, period=None)
            try:
                key = kind, pickle.dumps(replace(prepared, settings=settings))
            except pickle.PicklingError:  # with an identifier of the page's own
                return chain(prepared, report)
            if key not in FOUND:
                FOUND[key] = chain(prepared, report)
            own = FOUND[key]
            return replace(own, settings=replace(own.settings, period=period))

        return found

    def started(command, *words, **options):
        if isinstance(command, str) and PLAIN.fullmatch(command):
            with contextlib.redirect_stdout(io.StringIO()) as printed:
                code = run(shlex.split(command)[1:])
            return subprocess.CompletedProcess(command, code, printed.getvalue(), "")
        return outside(command, *words, **options)

    outside = subprocess.run
    monkeypatch.setattr(subprocess, "run", started)
    monkeypatch.setattr(_identify, "CHAINS", {kind: remembered(kind, chain) for kind, chain in CHAINS.items()})
    monkeypatch.setattr("floquid.plot._style._write", lambda figure, path, *_, **__: path.touch())
    monkeypatch.setattr(floquid, "report", floquid.reporting.report)
    monkeypatch.setattr("floquid.cli.commands.identify.write_report", floquid.reporting.report)


@pytest.mark.parametrize("path", PAGES, ids=[str(path.relative_to(ROOT)) for path in PAGES])
def test_page(path, folder, quick, capsys):
    text = path.read_text(encoding="utf-8")
    for whole, smaller in INSTEAD.get(str(path.relative_to(ROOT)), {}).items():
        assert whole in text
        text = text.replace(whole, smaller)
    run_page(text, path.name, folder, within=True)
    if path.name == "README.md":
        printed = {line.rstrip() for line in capsys.readouterr().out.splitlines()}
        (table,) = (content for language, content in blocks(text) if language == "text")
        assert set(table.splitlines()) <= printed


def test_pages_that_are_made_smaller_exist():
    assert set(INSTEAD) <= {str(path.relative_to(ROOT)) for path in PAGES}


@pytest.mark.slow
def test_the_readme_as_a_reader_runs_it(folder):
    run_page(PAGES[0].read_text(encoding="utf-8"), PAGES[0].name, folder)


def test_the_readme_shows_the_two_commands():
    shown = [c for language, text in blocks(PAGES[0].read_text("utf-8")) for c in commands(language, text)]
    assert {"make demo", "make test"} <= set(shown)


GOOD = """
```console
$ printf 'a\\n' \\
> > made.txt
a
```

- in a list

  ```python
  from pathlib import Path
  told = Path("made.txt").read_text()
  ```

```bash
# set up
make test
test -s made.txt
```

```python
assert told == "a\\n"
```
"""


def test_blocks_run_in_order_and_share_names(folder):
    assert run_page(GOOD, "page.md", folder) == 4


def test_a_command_within_this_process_fails_as_it_would_in_another(folder, capsys):
    run_page("```console\n$ floquid info none.npz || test $? -eq 2\n```\n", "page.md", folder, within=True)
    assert "there is no file" in capsys.readouterr().err
    with pytest.raises(AssertionError, match="ended with 2"):
        run_page("```console\n$ floquid info none.npz\n```\n", "page.md", folder, within=True)


@pytest.mark.parametrize(
    ("language", "text", "error"),
    [
        ("console", "$ false", "ended with 1"),
        ("console", "$ false | true", "ended with 1"),
        ("bash", "true\nfalse", "ended with 1"),
        ("console", "$ floquid-does-not-exist", "ended with 127"),
        ("console", "$ make no-such-target", "no target"),
        ("python", "raise ValueError('as written')", "as written"),
        ("fortran", "end", "neither run"),
        ("", "what is this", "neither run"),
    ],
)
def test_a_wrong_block_fails(folder, language, text, error):
    with pytest.raises((AssertionError, ValueError), match=error):
        run_page(f"```{language}\n{text}\n```\n", "page.md", folder)
