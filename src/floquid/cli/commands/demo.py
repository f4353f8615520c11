"""`floquid simulate`: a record of an example system; `floquid demo`: identify one, and compare with the truth."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from rich.table import Table

from floquid._checks import wrong_value
from floquid.cli.arguments.options import Choices
from floquid.cli.arguments.shared import Format, NewRecordFile, Noise, Periods, Place, Seed, Whole
from floquid.cli.commands.identify import STAGES
from floquid.cli.output.folder import NAMES, draw_result, result_folder, write_result
from floquid.cli.output.printed import print_analysis
from floquid.cli.output.terminal import json_text, new_table, print_folder, print_title, print_whole, progress, terminal
from floquid.core import Record
from floquid.errors import IdentificationError
from floquid.exports import summary
from floquid.pipeline import Analysis, validated
from floquid.pipeline import identify as identify_records
from floquid.readers import write
from floquid.reconstruction import reconstruct
from floquid.systems import SYSTEMS, JeffcottRotor, Run
from floquid.testing import pair_exponents
from floquid.views import with_error

OUT_OF_STEP = 1.00371  # samples a period over those asked for, in a run that is sampled out of step

PUBLISHED = {"X, Y": 0.013, "X_tt, Y_tt": 0.031}
"""The largest errors of A(t) that the paper states: 0.013 with the mass's displacements, 3.1 % with the turntable's."""

STATES = ("X", "Y")


def simulate(
    system: str = "jeffcott",
    /,
    *,
    out: NewRecordFile = Path("record.npz"),
    periods: Periods = 1024,
    samples_per_period: Whole = 50,
    noise: Noise = 0.02,
    seed: Seed = 0,
    impulse_deg: float = 45.0,
    as_measured: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Write the free response of an example system to a file.

    Parameters
    ----------
    system
        The system: jeffcott, the rotor of Allen's paper.
    out
        The file; its suffix chooses the format.
    samples_per_period
        Samples a period.
    impulse_deg
        The direction of the blow at the start, from the X axis [deg].
    as_measured
        As a test rig would see it: sampled out of step, the speed wandering by 0.2 %, an imbalance response five times
        the free one, and a tachometer in the channel tach.
    """
    rotor = _system_named(system)
    with progress(2) as report:
        report(f"simulating {system}")
        common = {"n_periods": periods, "noise": noise, "seed": seed, "impulse_deg": impulse_deg}
        if as_measured:
            record = Run(rotor=rotor, samples_per_period=samples_per_period * OUT_OF_STEP, **common).record()
        else:
            record = rotor.simulate(samples_per_period=samples_per_period, **common)
        report("writing the record")
        write(record, out)
    console = terminal()
    console.print(
        f"Written to {out}: {record.n_channels} channels, {record.n_samples} samples at {record.sample_rate:.8g} Hz, "
        f"period {rotor.period:.12g} s.",
        soft_wrap=True,
    )
    clock = "--tach tach --periods-per-rev 2" if as_measured else f"--period {rotor.period!r}"
    console.print(f"Identify it: floquid identify {shlex.quote(str(out))} {clock} --states X,Y", soft_wrap=True)


def _system_named(name: str) -> JeffcottRotor:
    """The example system of that name, with its parameters as published."""
    if name not in SYSTEMS:
        must = "be the name of an example system"
        raise wrong_value("SYSTEM", "floquid", must, name, f"There is: {', '.join(SYSTEMS)}.")
    return SYSTEMS[name]()


def demo(
    system: str = "jeffcott",
    /,
    *,
    out: Place = Path("floquid-demo"),
    periods: Periods = 1024,
    noise: Noise = 0.02,
    seed: Seed = 0,
    format: Format = "text",  # noqa: A002
) -> None:
    """Simulate the experiment of Allen's paper, identify it, and compare with the truth.

    Parameters
    ----------
    system
        The system: jeffcott, a rotor on an anisotropic shaft in anisotropic bearings.
    out
        A folder for record.npz, result.h5, summary.json, settings.toml, figures/ and report.html.
    format
        text prints tables; json prints summary.json alone.
    """
    rotor = _system_named(system)
    with result_folder(out, NAMES) as folder, progress(STAGES + 3) as report:
        report("simulating")
        record = rotor.simulate(n_periods=periods, noise=noise, seed=seed)
        analysis = _identify(rotor, record, report)
        mark = write_result(folder, analysis, Choices(settings=analysis.settings).text(), report, record=record)
    if format == "json":
        sys.stdout.write(json_text(summary(analysis)))
    else:
        print_analysis(analysis)
        for title, table in _compared(rotor, analysis).items():
            print_title(terminal(), title)
            print_whole(terminal(), table)
    with progress(3) as report:
        # The true A(t) over a period
        dense = np.linspace(0.0, rotor.period, 361)
        draw_result(out, analysis, mark, report, figures=True, truth=(dense, rotor.system(dense)))
    if format == "text":
        print_folder(out, "record.npz", figures=True)


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


def _compared(rotor: JeffcottRotor, analysis: Analysis) -> dict[str, Table]:
    """The analysis of the rotor's record held against the rotor: exponents, and the largest errors of A(t), by title.

    Exponents are paired by assignment, modulo iω; A(t) is rebuilt with the displacements of the mass as states, and
    with those of the turntable.
    """
    model, truth, deviations = analysis.model, rotor.exponents(), analysis.model.exponent_std
    assert deviations is not None
    pairs = pair_exponents(model.exponents, truth, model.period)
    exponents = new_table([""], ["true", "identified", "error", "in deviations"])
    # Numbers and order are those of the table of modes above.
    conjugates = np.abs(np.subtract.outer(model.exponents, model.exponents.conj())).argmin(axis=0)
    of_mode = {int(mode): int(r) for r, mode in enumerate(pairs.permutation) if truth[r].imag > 0.0}
    for number, upper in enumerate(model.upper_modes, start=1):
        mode = upper if upper in of_mode else int(conjugates[upper])
        r = of_mode[mode]
        three = truth[r] + pairs.differences[r], truth[r], deviations[mode]
        for part, name in (("real", "Re"), ("imag", "Im")):
            value, exact, std = (getattr(one, part) for one in three)
            numbers = f"{value - exact:+.1e}", f"{(value - exact) / std:+.2f}"
            exponents.add_row(f"{name} λ{number} [1/s]", f"{exact:.7f}", with_error(value, std), *numbers)
    errors = new_table(["states"], ["here", "in the paper"])
    for states, system in ((("X", "Y"), rotor.system), (("X_tt", "Y_tt"), rotor.turntable_system)):
        found, name = reconstruct(model, states), ", ".join(states)
        error = float(np.abs(found.system - system(found.times)).max())
        errors.add_row(name, f"{error:.4f}", f"{PUBLISHED[name]:.3f}")
    return {
        "Principal Floquet exponents, against the truth": exponents,
        "Largest error of A(t), over all elements and the period": errors,
    }
