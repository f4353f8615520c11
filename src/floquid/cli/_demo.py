"""`floquid demo`: simulate, identify, compare with the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from rich.table import Table

from floquid._checks import input_error
from floquid.cli._folder import result_folder
from floquid.cli._identify import STAGES
from floquid.cli._options import Debug, Format, Place, Whole
from floquid.cli._output import NAMES, print_json, write_result
from floquid.cli._progress import progress
from floquid.cli._settings import Choices
from floquid.cli._simulate import system_named
from floquid.cli._terminal import print_analysis, print_folder, print_title, terminal
from floquid.core import Record
from floquid.errors import IdentificationError
from floquid.pipeline import Analysis, validated
from floquid.pipeline import identify as identify_records
from floquid.reconstruction import StateModel, reconstruct
from floquid.systems import JeffcottRotor
from floquid.testing import pair_exponents
from floquid.views import with_error

PUBLISHED = {"X, Y": 0.013, "X_tt, Y_tt": 0.031}
"""The largest errors of A(t) that the paper states: 0.013 with the mass's displacements, 3.1 % with the turntable's."""


STATES = ("X", "Y")

PAPER_FILES = ("paper.md", *(f"figures/paper_{number}.png" for number in range(2, 9)))
"""What --paper writes beside the usual files."""


def demo(
    system: str = "jeffcott",
    /,
    *,
    out: Place = Path("floquid-demo"),
    periods: Whole = 1024,
    noise: float = 0.02,
    seed: Whole = 0,
    paper: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    draws: Whole = 10,
    format: Format = "text",  # noqa: A002
    debug: Debug = False,
) -> None:
    """Simulate the experiment of Allen's paper, identify it, and compare with the truth.

    Parameters
    ----------
    system
        The system: jeffcott, a rotor on an anisotropic shaft in anisotropic bearings.
    out
        A folder for record.npz, result.h5, summary.json, settings.toml, figures/ and report.html.
    periods
        The length of the record, in periods of the system.
    noise
        Standard deviation of white noise, as a share of the largest free response of each channel: 0.02 is 2 %.
    seed
        The seed of the noise.
    paper
        Redraw the figures 2 to 8 of the paper, and hold every number of its section 3 against ours by both algorithms.
    draws
        With --paper: over how many draws of the noise, from `seed` on, errors are taken.
    format
        text prints tables; json prints summary.json alone.
    debug
        Show the traceback of an error.
    """
    del debug
    rotor = system_named(system)
    if paper:
        _demo_of_paper(out, periods, noise, seed, draws, format)
        return
    with result_folder(out, NAMES) as folder, progress(STAGES + 6) as report:
        report("simulating")
        record = rotor.simulate(n_periods=periods, noise=noise, seed=seed)
        analysis = _identify(rotor, record, report)
        comparison = compare(rotor, analysis)
        dense = np.linspace(0.0, rotor.period, 361)
        settings = Choices(settings=analysis.settings).text()
        write_result(folder, analysis, settings, report, record=record, truth=(dense, rotor.system(dense)))
    if format == "json":
        print_json(analysis)
        return
    print_analysis(analysis)
    print_comparison(comparison)
    print_folder(out, "record.npz")


def _demo_of_paper(out: Path, periods: int, noise: float, seed: int, draws: int, format: str) -> None:  # noqa: A002
    """The paper's experiment by both algorithms; the result written is that of maximum likelihood."""
    from floquid.cli._paper import files_of_paper, print_numbers
    from floquid.paper import figures, numbers, reproduce

    if draws < 1:
        raise input_error("--draws", "floquid demo", "be at least 1", f"is {draws}")
    with result_folder(out, (*NAMES, *PAPER_FILES)) as folder, progress(draws + 8) as report:
        done = reproduce(seed=seed, draws=draws, n_periods=periods, noise=noise, report=report)
        report("collecting the numbers")
        rows = numbers(done)
        report("drawing the figures of the paper")
        files = files_of_paper(figures(done), rows)
        analysis, rotor = done.maximum_likelihood, done.rotor
        dense = np.linspace(0.0, rotor.period, 361)
        settings, truth = Choices(settings=analysis.settings).text(), (dense, rotor.system(dense))
        write_result(folder, analysis, settings, report, record=done.record, truth=truth, others=files)
    if format == "json":
        print_json(analysis)
        return
    print_numbers(rows)
    terminal().print(f"The figures beside the paper's words, and this table: {out / 'paper.md'}", soft_wrap=True)
    print_folder(out, "record.npz", "paper.md")


def _identify(rotor: JeffcottRotor, record: Record, report: Callable[[str], None]) -> Analysis:
    """The analysis with A(t); its order is found first, since states can only be chosen for the modes there are."""
    analysis = identify_records(record, validate=False, report=report)
    order, true_order = analysis.model.order, len(rotor.exponents())
    if order != true_order:
        raise IdentificationError(
            f"{order} exponents were found where the system has {true_order}: too much noise in too short a record to "
            "compare them.\n  Use more --periods or less --noise."
        )
    settings = replace(analysis.settings, states=STATES, validate=True)
    state = reconstruct(analysis.model, STATES, times=settings.system_times)
    return validated(replace(analysis, settings=settings, state=state), report=report)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Identified values beside the true ones: exponents (pairs,), and the largest error of A(t) by choice of states."""

    truth: np.ndarray
    estimate: np.ndarray
    std: np.ndarray
    system_errors: dict[str, float]


def compare(rotor: JeffcottRotor, analysis: Analysis) -> Comparison:
    """Hold an analysis of the rotor's record against the rotor.

    Exponents are paired by assignment, modulo iω; A(t) is rebuilt with the displacements of the mass as states, and
    with those of the turntable.
    """
    model = analysis.model
    truth = rotor.exponents()
    upper = truth.imag > 0
    pairs = pair_exponents(model.exponents, truth, model.period)
    std = model.exponent_std
    assert std is not None
    errors: dict[str, float] = {}
    for states, system in ((("X", "Y"), rotor.system), (("X_tt", "Y_tt"), rotor.turntable_system)):
        found: StateModel = reconstruct(model, states)
        errors[", ".join(states)] = float(np.abs(found.system - system(found.times)).max())
    return Comparison(truth[upper], (truth + pairs.differences)[upper], std[pairs.permutation][upper], errors)


def print_comparison(comparison: Comparison) -> None:
    """The comparison as two tables."""
    console = terminal()
    print_title(console, "Principal Floquet exponents, against the truth")
    table = Table(box=None)
    for name in ("", "true", "identified", "error", "in deviations"):
        table.add_column(name, justify="right")
    for number, (true, found, std) in enumerate(
        zip(comparison.truth, comparison.estimate, comparison.std, strict=True), start=1
    ):
        for part in ("real", "imag"):
            value, exact, deviation = (getattr(x, part) for x in (found, true, std))
            label = f"{'Re' if part == 'real' else 'Im'} λ{number} [1/s]"
            table.add_row(
                label,
                f"{exact:.7f}",
                with_error(value, deviation),
                f"{value - exact:+.1e}",
                f"{(value - exact) / deviation:+.2f}",
            )
    console.print(table)
    print_title(console, "Largest error of A(t), over all elements and the period")
    table = Table(box=None)
    for name in ("states", "here", "in the paper"):
        table.add_column(name, justify="left" if name == "states" else "right")
    for states, error in comparison.system_errors.items():
        table.add_row(states, f"{error:.4f}", f"{PUBLISHED[states]:.3f}")
    console.print(table)
