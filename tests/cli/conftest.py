"""Records to type commands about, and a folder that holds an earlier result."""

import copy
import functools
import io
import itertools
import pickle
import re
from importlib import import_module
from pathlib import Path

import h5py
import numpy as np
import pytest
from cyclopts import App
from cyclopts.argument import ArgumentCollection

from floquid.cli._app import COMMANDS
from floquid.systems import JeffcottRotor

ROOT = Path(__file__).parents[2]
ROTOR = [str(ROOT / "examples" / "rotor" / f"hit{number}.npz") for number in (1, 2)]
ROTOR_PERIOD = "0.015789473684210523"


def hdf5(kind):
    """The bytes of an HDF5 file that says what it is."""
    with h5py.File(content := io.BytesIO(), "w") as file:
        file.attrs["format"] = kind
    return content.getvalue()


EARLIER = {
    "result.h5": hdf5("floquid-result"),
    "summary.json": b'{"format": "earlier"}',
    "settings.toml": b"period = 1.0\n",
    "record.npz": b"an earlier record",
    "report.html": b"<p>an earlier page</p>",
    "notes.txt": b"what the owner wrote",
    "figures/time_record.png": b"an earlier picture",
    "figures/composite.png": b"another",
    "figures/system_elements.png": b"and another",
}


PICTURES = """
import pathlib, floquid.plot, floquid.reporting

def save_figures(analysis, folder, **_):
    for name in dir(analysis.plot):
        (folder / f"{name}.png").write_text(f"{name} {analysis.model.coefficients}")

def report(analysis, path, **_):
    path = pathlib.Path(path)
    path.write_text(f"report {analysis.model.coefficients if hasattr(analysis, 'model') else analysis}")
    return path

floquid.plot.save_figures, floquid.reporting.report = save_figures, report
"""
"""Run in a process of its own, or by `quicken`: figures and the report are files of the right names alone."""


def quicken(patch):
    """Write figures and the report in no time until the patch is undone."""
    import floquid.plot
    import floquid.reporting

    for module, *_ in COMMANDS.values():  # imported under the patch they would keep it
        import_module(f"floquid.cli.commands.{module}")
    patch.setattr(floquid.plot, "save_figures", floquid.plot.save_figures)
    patch.setattr(floquid.reporting, "report", floquid.reporting.report)
    exec(PICTURES, {})


@pytest.fixture
def quick_pictures(monkeypatch):
    """Write figures and the report in no time, where a test is about something else."""
    quicken(monkeypatch)


DRAWN = ("test_commands", "test_report_command")
"""Modules that look at pictures and at the report; in the others these would take most of the time."""


@pytest.fixture(autouse=True)
def no_pictures_but_where_they_are_looked_at(request):
    if request.module.__name__.rpartition(".")[2] not in DRAWN:
        request.getfixturevalue("quick_pictures")


FOUND = {}
"""What was identified or fitted, by the function, what it was given and the options."""


@pytest.fixture(autouse=True)
def nothing_is_identified_twice(monkeypatch):
    """Commands are about what comes before and after: the same records with the same settings are identified once.

    The stages of an identification are told that once alone: tests of them run a process of their own.
    """
    from floquid.cli.arguments import points
    from floquid.cli.commands import demo, identify, transfer
    from floquid.fleets import _fleet

    def remembered(name, real):
        def found(given, *options, report=None, **named):
            key = name, pickle.dumps((given, options, named))
            if key not in FOUND:
                FOUND[key] = real(given, *options, **named, **({} if report is None else {"report": report}))
            return FOUND[key]

        return found

    for module, names in (
        (identify, ["identify_records"]),
        (transfer, ["identify_records", "fit_transfer"]),
        (demo, ["identify_records"]),
        (points, ["identify"]),
        (_fleet, ["identify"]),
    ):
        for name in names:
            monkeypatch.setattr(module, name, remembered(name, getattr(module, name)))


ASSEMBLED = {}
"""The arguments of a command, by its function and what is asked of them."""


def unused(arguments):
    """Copy arguments that hold no words yet."""
    copies = {id(own): copy.copy(own) for own in arguments}
    for own in copies.values():
        own.tokens = []
        own.children = ArgumentCollection(copies[id(child)] for child in own.children)
    return ArgumentCollection(copies.values())


@pytest.fixture(autouse=True, scope="session")
def no_command_is_assembled_twice():
    """To read the options off the annotations takes most of the time of a command that is refused."""
    real = App.assemble_argument_collection

    def assembled(app, **asked):
        key = app.default_command, *asked.items()
        if key not in ASSEMBLED:
            ASSEMBLED[key] = real(app, **asked)
        return unused(ASSEMBLED[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(App, "assemble_argument_collection", assembled)
        yield


@functools.cache
def simulated(periods=40, samples=8):
    """A record of the example rotor: 4 channels, 2 % noise."""
    return JeffcottRotor().simulate(n_periods=periods, samples_per_period=samples, noise=0.02, seed=1)


def save_npz(path, values=None, **changes):
    """Write a .npz file as its documentation says, but for `changes`; one that is None is left out."""
    record = simulated()
    values = record.values if values is None else values
    content = {"values": values, "sample_rate": record.sample_rate, "channels": [c.name for c in record.channels]}
    content |= changes
    np.savez(path, **{key: value for key, value in content.items() if value is not None})


def after_stages(stderr):
    """What a command says on stderr, without the lines before that tell its stages: each once, none of them drawn."""
    lines = stderr.splitlines(keepends=True)
    told = list(itertools.takewhile(re.compile(r"[a-z][^:]*\n").fullmatch, lines))
    assert len(set(told)) == len(told)
    assert not re.search(r"[\r\x1b]", stderr)
    return "".join(lines[len(told) :])


def contents(folder):
    """Every file under `folder` with its bytes."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty current folder with `good.npz`, and an earlier result in `out`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    save_npz(tmp_path / "good.npz")
    for name, data in EARLIER.items():
        path = tmp_path / "out" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return tmp_path
