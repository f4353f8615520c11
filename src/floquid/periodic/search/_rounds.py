"""The fit of samples in rounds of bands, modes and lines until nothing changes; whitened where noise is coloured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from floquid._arrays import Floats
from floquid.periodic.least_squares import Block, ModeParameters, filtered_blocks, residual_filter, solve
from floquid.periodic.search._final import on_steady_branches
from floquid.periodic.search._moves import joined, parted, unshared, without_needless
from floquid.periodic.search._new_lines import with_lines
from floquid.periodic.search._state import ROUGHLY, Limits, State, released, with_bands

ROUNDS = 4  # rounds in which modes and bands may change
STRONG = 0.1  # the sum of squared correlations from which on what modes leave is coloured noise and no weak mode

Report = Callable[[str], None]


def begun(blocks: tuple[Block, ...], entries: ModeParameters, limits: Limits, *, noisy: bool = False) -> State:
    """The fit nearest to the start, with the noise that it leaves, unless the blocks are `noisy` with their own."""
    state = State(blocks, solve(blocks, entries, at_rest=ROUGHLY, hold=True))
    return state if noisy else state.with_noise(limits.floor)


def searched(state: State, limits: Limits, search: bool, report: Report) -> State:
    """With bands, and with `search` modes, changed until nothing does."""
    passed: list[float] = []
    refused: set[bytes] = set()
    for number in range(ROUNDS):
        before = state.solution.entries
        state = with_bands(released(state), limits, refused=refused)
        if not search:
            break
        # Before lines are added: on a wrong branch a mode leaves lines of its own.
        if not number:
            state, _ = on_steady_branches(state, state.solution.entries.bands)
        if len(state.solution.entries.exponents):
            report("parting and joining modes")
            # Bands that are given stay: modes are not parted or joined then.
            state = joined(parted(state, limits), limits) if limits.choose else state
            state = without_needless(state, limits)
        if number and _same(before, state.solution.entries):
            break
        state = with_lines(state, limits, report, passed)
    return unshared(state, limits)


def searched_white(state: State, limits: Limits, report: Report) -> tuple[State, Floats | None]:
    """The same after the filter that whitens what is left, and that filter (channels, taps); None where it is white.

    The colour is judged twice: by what few modes leave, none of which is noise yet, and by what all of them leave.
    """
    plain = state.blocks
    state, taps = _whitened(with_lines(state, replace(limits, loud=True), report), limits, report)
    state = searched(state, limits, True, report)
    if taps is None:
        again, taps = _whitened(state, limits, report)
        return (state if taps is None else searched(again, limits, True, report)), taps
    again, taps = _whitened(begun(plain, state.solution.entries, limits), limits, report)
    return with_bands(again, limits), taps


def _whitened(state: State, limits: Limits, report: Report) -> tuple[State, Floats | None]:
    """The fit of the samples after the filter that whitens what is left, and that filter; None where it is white."""
    taps = residual_filter(state.blocks, state.solution, least=STRONG)
    after = None if taps is None else filtered_blocks(state.blocks, taps)
    if taps is None or after is None:
        return state, None
    report(f"the noise is coloured along the record: whitened by {taps.shape[1] - 1} taps")
    return begun(after, state.solution.entries, limits), taps


def _same(one: ModeParameters, other: ModeParameters) -> bool:
    """True where modes and bands are the same."""
    return len(one.exponents) == len(other.exponents) and bool((one.bands == other.bands).all())
