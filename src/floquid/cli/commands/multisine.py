"""`floquid multisine`: the inputs to measure harmonic transfer functions with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from floquid._checks import input_error, wrong_value
from floquid.cli.arguments.shared import Frequency, NewRecordFile, OptionalWhole, Whole, period_of, split
from floquid.cli.output.terminal import terminal
from floquid.core import Channel
from floquid.readers import write
from floquid.transfer import Multisine
from floquid.transfer import multisine as designed

DESIGN = "floquid multisine"

_BAND = "The lowest and the highest line [Hz], with a comma; by default up to a fifth of the rate."


def multisine(
    *,
    period: float | None = None,
    frequency: Frequency = None,
    rate: Annotated[float | None, Parameter(help="The sampling rate [Hz].")] = None,
    turns: Whole = 128,
    band: Annotated[str, Parameter(help=_BAND)] = "",
    inputs: str = "u",
    unit: str = "-",
    rms: float = 1.0,
    repeats: OptionalWhole = 5,
    seed: Whole = 0,
    out: NewRecordFile = Path("multisine.csv"),
) -> None:
    """Write inputs for measuring harmonic transfer functions: random lines whose sidebands do not meet.

    Parameters
    ----------
    period
        The period of the system [s].
    turns
        Periods of the system in a repeat: half as many lines at most.
    inputs
        The names of the channels, with commas.
    unit
        Their unit, as N or V, by which a file of the answer tells them from responses.
    rms
        That of each input, in its unit.
    repeats
        How often it is repeated: the first for the transient, four and more for a variance.
    seed
        The seed of lines and phases.
    out
        The file; its suffix chooses the format.
    """
    own = period_of(period, frequency, DESIGN)
    if own is None or rate is None:
        name = "--period" if own is None else "--rate"
        raise input_error(name, DESIGN, "be given", "is not", "As --period 0.5 --rate 40.")
    names = split(inputs)
    if not names:
        raise input_error("--inputs", DESIGN, "name a channel", "names none", "As --inputs F1,F2.")
    asked = _band(band)
    design = designed(own, rate, turns=turns, band=asked, inputs=len(names), rms=rms, seed=seed)
    channels = names if unit == "-" else [Channel(name=name, unit=unit) for name in names]
    write(design.record(5 if repeats is None else repeats, channels), out)
    _print_design(terminal(), design, names)
    if asked is not None and asked[1] > 0.5 * rate:
        terminal().print(f"There are no lines beyond half the rate, {0.5 * rate:.5g} Hz: the band ends there.")
    terminal().print(f"Written to {out}.", soft_wrap=True)


def _print_design(console: Console, design: Multisine, names: tuple[str, ...]) -> None:
    """Print the lines of each input and what a repeat is."""
    for name, hertz in zip(names, design.frequencies_hz, strict=True):
        console.print(f"{name}: {len(hertz)} lines from {hertz[0]:.5g} to {hertz[-1]:.5g} Hz.")
    samples = design.values.shape[1]
    console.print(
        f"A repeat is {design.turns} periods, {samples} samples, {samples / design.sample_rate:.6g} s; "
        f"peak over rms {design.peak:.3g}. Play it without a gap, its begin at phase zero or at any other, and measure "
        f"at {design.sample_rate:.8g} Hz what is played and what answers."
    )


def _band(text: str) -> tuple[float, float] | None:
    """Two frequencies with a comma; None where none are named."""
    if not text.strip():
        return None
    try:
        low, high = (float(word) for word in split(text))
    except ValueError:
        raise wrong_value("--band", DESIGN, "be two frequencies with a comma", text, "As --band 0.1,2.") from None
    return low, high
