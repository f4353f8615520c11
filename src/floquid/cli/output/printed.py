"""A result on the terminal: its modes, its verdict, A(t) and its structure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress

import numpy as np
from rich.console import Console
from rich.table import Table

from floquid._arrays import Floats
from floquid._checks import counted
from floquid.cli.output.terminal import new_table, print_title, print_whole, terminal, width_of
from floquid.core import Channel
from floquid.findings import Severity
from floquid.pipeline import Analysis
from floquid.reconstruction import Refinement
from floquid.views import (
    DAMPING_WORDS,
    DampingUnit,
    SpeedUnit,
    branch_words,
    couple_words,
    cycle_words,
    done_words,
    in_short,
    input_unit,
    mode_table,
    note_meanings,
    outcome_lines,
    speed_texts,
    whitening_words,
    with_error,
)

LEGEND = (
    "λ: Floquet exponent, known up to multiples of iω; the branch shown is that {branch}. f = |λ|/2π and "
    "{damping} go with that line. |μ| = e^(Re λ T), the decay in one period, and folded, |Im λ| modulo ω over ω, do not"
)
DEVIATIONS = "in brackets: one standard deviation, in the last digits"
NO_DEVIATIONS = "this identifier gives no standard deviations (its -ml form does)"
FAILS = "there are no standard deviations, since the model fails"
NOISE = "White noise found, standard deviation"
LEFT = "What the model leaves, noise and all, standard deviation"
MOST_DONE = 2  # sentences on what was done with the record that are printed without `--verbose`: the last ones
MOST_SENTENCES = 3  # reasons and warnings that are printed without `--verbose`: with eight modes they fit 34 lines
RARE = 0.01  # the probability of a structure's misfit below which it is told that chance seldom leaves as much


def print_analysis(
    analysis: Analysis,
    *,
    verbose: bool = False,
    speed_unit: SpeedUnit = "hz",
    damping_unit: DampingUnit = "percent",
) -> None:
    """Print the result, with `verbose` all of the reasons too, and A(t)."""
    console = terminal()
    print_found(console, analysis, verbose=verbose, speed_unit=speed_unit, damping_unit=damping_unit)
    if verbose:
        _print_reasons(console, analysis)
    if analysis.state is not None:
        print_state(console, analysis)


def print_found(
    console: Console,
    analysis: Analysis,
    *,
    verbose: bool = False,
    speed_unit: SpeedUnit = "hz",
    damping_unit: DampingUnit = "percent",
) -> None:
    """Print the record, the modes, a line for each other finding, and the reasons and warnings with their remedies."""
    _print_record(console, analysis, speed_unit, verbose=verbose)
    modes = "Modes of a model that fails" if analysis.failed else "Modes"
    print_title(console, f"{modes}: order {analysis.model.order}, conjugates counted one by one")
    print_modes(console, analysis, damping_unit)
    _print_legend(console, analysis, damping_unit, verbose=verbose)
    lines = Table(box=None, show_header=False, padding=(0, 1, 0, 0), pad_edge=False)
    lines.add_column(no_wrap=True)
    lines.add_column()
    for name, words in outcome_lines(analysis, speed_unit).items():
        lines.add_row(name, words)
    console.print(lines)
    warnings = [f"Warning: {words}" for words in speed_texts(analysis.findings, speed_unit, Severity.WARNING)]
    sentences = [*(f"  {reason}" for reason in analysis.reasons), *warnings]
    if verbose:
        for words in sentences:
            console.print(words, style="yellow")
        return
    for words in sentences[:MOST_SENTENCES]:
        seen, remedy = in_short(words)
        console.print(f"{seen}\n    → {remedy}" if remedy else seen, style="yellow")
    if len(sentences) > MOST_SENTENCES:
        console.print(f"… and {len(sentences) - MOST_SENTENCES} more.", style="dim")


def _print_legend(console: Console, analysis: Analysis, unit: DampingUnit, *, verbose: bool) -> None:
    """Print a legend of the table of modes: with `verbose` all columns, else what a table cannot say itself."""
    meanings = [*note_meanings(mode_table(analysis)), *couple_words(analysis.model)]
    without = FAILS if analysis.failed else NO_DEVIATIONS
    deviations = without if analysis.model.exponent_std is None else DEVIATIONS
    parts = [f"±: a conjugate pair; {deviations}"]
    if verbose:
        kept = ", as asked for" if analysis.settings.harmonics is not None else " that rise above the noise"
        kept += ", the residues held to them" if analysis.constrained else ""
        legend = LEGEND.format(damping=DAMPING_WORDS[unit], branch=branch_words(analysis))
        parts += [legend, f"m: harmonics of the shape{kept}"]
    console.print("; ".join([*parts, *meanings]) + ".", style="dim")


def _print_reasons(console: Console, analysis: Analysis) -> None:
    """Print the reasons for the order, and the test for periodicity."""
    console.print()
    if analysis.choice is not None and not analysis.choice.ambiguous:
        console.print(f"The order is clear. {' '.join(analysis.choice.reasons)}", style="dim")
    for sentence in () if analysis.periodicity is None else analysis.periodicity.sentences:
        console.print(sentence, style="dim")


def _print_record(console: Console, analysis: Analysis, speed_unit: SpeedUnit, *, verbose: bool) -> None:
    """Print the size of the records and what was done with them; with `verbose` all of it, and the noise."""
    first, model = analysis.records[0], analysis.model
    rates = list(dict.fromkeys(record.sample_rate for record in analysis.records))
    samples = counted(", ".join(f"{rate * model.period:.6g}" for rate in rates), "sample")
    if analysis.decay is None:
        sides = f"{counted(len(analysis.inputs), 'input')} and " if analysis.inputs else ""
        sides += counted(len(model.channels), "output")
        periods = f"{sum(record.duration for record in analysis.records) / model.period:.6g} periods in all"
    else:
        sides = counted(first.n_channels, "channel")
        periods = f"{', '.join(cycle_words(analysis))} periods"
    turn = f"; ω = {model.fundamental:.6g} rad/s" if verbose else ""
    console.print(
        f"{counted(len(analysis.records), 'record')}, {sides} at {', '.join(f'{rate:.8g}' for rate in rates)} Hz"
        f"{turn}: {samples} a period, {periods}."
    )
    if not verbose:
        done = done_words(analysis, speed_unit, beside_lines=True)
        for sentence in done[-MOST_DONE:]:
            console.print(f"  {in_short(sentence)[0]}")
        if len(done) > MOST_DONE:
            console.print(f"  … and {len(done) - MOST_DONE} more.", style="dim")
        return
    for sentence in done_words(analysis, speed_unit):
        console.print(f"  {sentence}")
    if analysis.decay is None:
        return
    coloured = analysis.whitening is not None
    title = "Noise found, standard deviation after the whitening filter" if coloured else NOISE
    print_title(console, LEFT if analysis.failed else title)
    console.print(_noise_table(analysis))
    print_whitening(console, analysis.whitening, analysis.model.channels)


def print_whitening(console: Console, whitening: Floats | None, channels: Sequence[Channel]) -> None:
    """Print the treatment of noise that is coloured, if it is."""
    if words := whitening_words(whitening, channels):
        console.print(words, style="dim")


def _noise_table(analysis: Analysis) -> Table:
    """The noise of each channel in each hit; of more than two hits, the quietest and the loudest."""
    noise = analysis.noise
    peaks = np.array([np.abs(hit.values).max(axis=(1, 2)) for hit in analysis.cycles]).T
    several = noise.shape[1]
    titles = {1: ["noise"], 2: ["hit 1", "hit 2"]}.get(several, [f"least of {several} hits", "most"])
    table = new_table(["channel"], [name for title in titles for name in (title, "of the peak")])
    for channel, own, peak in zip(analysis.model.channels, noise, peaks, strict=True):
        shown = range(several) if several <= 2 else (int(np.argmin(own / peak)), int(np.argmax(own / peak)))
        unit = f" {channel.unit}" if channel.unit != "-" else ""
        cells = [cell for hit in shown for cell in (f"{own[hit]:.3g}{unit}", f"{100 * own[hit] / peak[hit]:.2g} %")]
        table.add_row(channel.name, *cells)
    return table


def print_modes(console: Console, analysis: Analysis, unit: DampingUnit = "percent") -> None:
    """The table of modes, damping in a `unit`, with deviations of f and damping where it is not too wide for them."""
    table = modes_table(analysis, unit, derived=True)
    table.padding, table.pad_edge = (0, 1, 0, 0), False
    if width_of(console, table) > console.width:
        table = modes_table(analysis, unit)
    print_whole(console, table)


def modes_table(analysis: Analysis, unit: DampingUnit = "percent", *, derived: bool = False) -> Table:
    """The table of modes, if wanted with the deviations of what is derived from exponents."""
    modes = mode_table(analysis, derived=derived, damping_unit=unit)
    shown = [not column.on_page for column in modes.columns]
    columns = list(compress(modes.columns, shown))
    numbers, words = ([own.heading for own in columns if own.is_text == text] for text in (False, True))
    table = new_table([""], numbers, words)
    for number, row in enumerate(modes.rows, start=1):
        table.add_row(str(number), *compress(row, shown))
    return table


def print_state(console: Console, analysis: Analysis) -> None:
    """Rows of A(t), and of B(t) where inputs were measured: smallest and largest values over the period, deviations."""
    state = analysis.state
    assert state is not None
    second = analysis.settings.form == "second-order"
    n = len(state.states)
    half = n // 2 if second else 0
    # The names of delayed states are long; the sentence below has them in order.
    names = [str(k) for k in range(1, n + 1)] if analysis.settings.form == "delayed" else state.states
    rows = [f"d²/dt² {name}" if second else f"d/dt {name}" for name in names[: n - half]]
    blocks = (slice(0, half), slice(half, None))[0 if second else 1 :]
    print_title(console, f"A(t) [{'1/s², 1/s' if second else '1/s'}]: smallest … largest over the period")
    shown = _print_elements(console, rows, names, state.system, state.system_std, blocks)
    if state.inputs is not None and analysis.model.inputs is not None:
        print_title(console, "B(t): smallest … largest over the period")
        inputs = []
        for own in analysis.model.inputs.channels:
            units = dict.fromkeys(input_unit(state, i, own, analysis.model.channels) for i in range(half, n))
            inputs.append(f"{own.name} [{', '.join(units)}]")
        shown |= _print_elements(console, rows, inputs, state.inputs, state.inputs_std, (slice(None),))
    if shown and state.system_std is not None:
        console.print("Deviation: the largest standard deviation over the period.", style="dim")
    console.print(f"Condition number of the modes' shapes in these states: {state.condition.max():.3g} at most.")
    if not second or "+" in state.coordinates or "all" in analysis.settings.states:
        console.print(f"The states are {state.coordinates}.")
    if analysis.refinement is not None:
        print_structure(console, analysis.refinement)


def _print_elements(
    console: Console,
    rows: Sequence[str],
    names: Sequence[str],
    values: Floats,
    stds: Floats | None,
    blocks: Sequence[slice],
) -> bool:
    """Print the last rows of matrices over a period (times, states, columns), the digits of each block alike."""
    low, high = values.min(axis=0), values.max(axis=0)
    places = range(values.shape[1] - len(rows), values.shape[1])
    cells = [[cell for block in blocks for cell in _alike(low[i, block], high[i, block])] for i in places]
    for width in (len(names), -(-len(names) // 2)):
        tables = []
        for part in (slice(0, width), slice(width, None))[: 1 + (width < len(names))]:
            tables.append(new_table([""], names[part]))
            for i, name, own in zip(places, rows, cells, strict=True):
                tables[-1].add_row(name, *own[part])
                if stds is not None:
                    most = stds[:, i, part].max(axis=0)
                    tables[-1].add_row("  deviation", *(f"{std:.2g}" for std in most), style="dim")
        if all(width_of(console, table) <= console.width for table in tables):
            console.print(*tables, sep="\n")
            return True
    size = f"{values.shape[1]} × {values.shape[2]}"
    console.print(f"{size}, too wide for here: summary.json has it (--out DIR or --format json).")
    return False


def print_structure(console: Console, found: Refinement) -> None:
    """The structure that A(t) was fitted with, how well it fits, and its parameters with their deviations."""
    print_title(console, f"Structure {'found' if found.reasons else 'given'}: {found.structure.words()}")
    for reason in found.reasons[1:]:
        console.print(reason, style="dim")
    p_value = f"p = {found.p_value:.2g}" if found.p_value >= 1e-300 else "p < 1e-300"
    verdict = "the structure does not contradict the record"
    if found.p_value < RARE:
        verdict = "chance seldom leaves as much, so that something small may be missing in the structure"
    console.print(
        f"What is left between it and the free model is a chi-square of {found.chi_square:.4g} for {found.degrees} "
        f"degrees of freedom ({p_value}): {verdict}."
    )
    table = _parameters_table(found)
    if width_of(console, table) > console.width:
        table = new_table([""], ["value"])
        for name, value, std in zip(found.names, found.parameters, found.std, strict=True):
            table.add_row(name, with_error(value, std))
    print_whole(console, table)
    units = "stiffness [1/s²] and damping [1/s] are over the mass; " if found.structure.degree == 2 else "in 1/s; "
    console.print(
        f"{units[0].upper()}{units[1:]}{DEVIATIONS}; rows and columns count from zero, in the order of the states.",
        style="dim",
    )
    if found.conditional_on:
        console.print(f"The deviations are conditional on: {'; '.join(found.conditional_on)}.")


def _parameters_table(found: Refinement) -> Table:
    """An element a row, its mean and its harmonics beside each other."""
    rows: dict[str, dict[str, str]] = {}
    for name, value, std in zip(found.names, found.parameters, found.std, strict=True):
        element, _, part = name.partition(" ")
        rows.setdefault(element, {})[part or "mean"] = with_error(value, std)
    parts = list(dict.fromkeys(part for cells in rows.values() for part in cells))
    table = new_table([""], parts)
    for element, cells in rows.items():
        table.add_row(element, *(cells.get(part, "") for part in parts))
    return table


def _alike(lows: Floats, highs: Floats) -> list[str]:
    """Ranges, all to the third digit of the largest value; one number where both ends read the same."""
    largest = float(max(np.abs(lows).max(), np.abs(highs).max()))
    form = ".2e" if not 1e-6 < largest < 1e6 else f".{max(0, 2 - int(np.floor(np.log10(largest))))}f"
    ends = [(f"{low:{form}}", f"{high:{form}}") for low, high in zip(lows, highs, strict=True)]
    return [low if low == high else f"{low}…{high}" for low, high in ends]
