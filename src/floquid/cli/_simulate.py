"""`floquid simulate`: a record of an example system."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from floquid._checks import input_error
from floquid.cli._options import Debug, NewRecordFile, Whole
from floquid.cli._progress import progress
from floquid.cli._terminal import terminal
from floquid.readers import write
from floquid.systems import SYSTEMS, JeffcottRotor, Run

OUT_OF_STEP = 1.00371
"""Samples a period over those asked for, in a run that is sampled out of step."""


def simulate(
    system: str = "jeffcott",
    /,
    *,
    out: NewRecordFile = Path("record.npz"),
    periods: Whole = 1024,
    samples_per_period: Whole = 50,
    noise: float = 0.02,
    seed: Whole = 0,
    impulse_deg: float = 45.0,
    as_measured: Annotated[bool, Parameter(negative=())] = False,
    debug: Debug = False,
) -> None:
    """Write the free response of an example system to a file.

    Parameters
    ----------
    system
        The system: jeffcott, the rotor of Allen's paper.
    out
        The file; its suffix chooses the format.
    periods
        The length of the record, in periods of the system.
    samples_per_period
        Samples a period.
    noise
        Standard deviation of white noise, as a share of the largest free response of each channel: 0.02 is 2 %.
    seed
        The seed of the noise.
    impulse_deg
        The direction of the blow at the start, from the X axis [deg].
    as_measured
        As a test rig would see it: sampled out of step, the speed wandering by 0.2 %, an imbalance response five times
        the free one, and a tachometer in the channel tach.
    debug
        Show the traceback of an error.
    """
    del debug
    rotor = system_named(system)
    with progress(2) as report:
        report(f"simulating {system}")
        if as_measured:
            run = Run(
                rotor=rotor,
                n_periods=periods,
                samples_per_period=samples_per_period * OUT_OF_STEP,
                noise=noise,
                impulse_deg=impulse_deg,
                seed=seed,
            )
            record = run.record()
        else:
            record = rotor.simulate(
                n_periods=periods,
                samples_per_period=samples_per_period,
                noise=noise,
                seed=seed,
                impulse_deg=impulse_deg,
            )
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


def system_named(name: str) -> JeffcottRotor:
    """The example system of that name, with its parameters as published.

    Raises
    ------
    InputError
        There is none.
    """
    if name not in SYSTEMS:
        raise input_error(
            "SYSTEM", "floquid", "be the name of an example system", f"is {name!r}", f"There is: {', '.join(SYSTEMS)}."
        )
    return SYSTEMS[name]()
