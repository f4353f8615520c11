"""A period or a rate that was rounded: the response repeats after a whole number of samples, and not as was said."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from floquid.core import ConstantPeriod, Record
from floquid.errors import FloquidError
from floquid.lifting import lift
from floquid.periodic import NEGLIGIBLE_SLIP, SIGNIFICANT, assemble, synchrony
from floquid.pipeline._find_poles import find_poles
from floquid.pipeline._settings import Settings
from floquid.sync import segment

NEAR = 0.01
"""The relative difference from a whole number of samples that a rounding may make."""


def rounded(records: tuple[Record, ...], settings: Settings, report: Callable[[str], None]) -> str:
    """What is wrong with a period that is nearly a whole number of samples; empty when nothing is seen.

    The records are cut at the whole number: where the response then has that period to within its deviation, and the
    period given is many deviations off, the period given or the sampling rate was rounded.
    """
    record = records[0]
    clock = record.clock
    assert isinstance(clock, ConstantPeriod)
    samples = clock.period * record.sample_rate
    whole = max(round(samples), 1)
    off = samples / whole - 1.0
    if abs(off) > NEAR or any(np.isnan(one.values).any() for one in records):
        return ""
    report("looking whether the period was rounded")
    period = whole / record.sample_rate
    try:
        cut = [one.with_clock(ConstantPeriod(period=period, origin=one.start)) for one in records]
        lifted, modal, _ = find_poles(lift(segment(cut), floor=settings.noise_floor), settings)
        found = synchrony(assemble(modal, lifted), lifted)
    except FloquidError:
        return ""
    # Of a response that is torn apart, or tells nothing, no period can be said.
    if found is None or found.broken or abs(off) < SIGNIFICANT * found.std:
        return ""
    if abs(off - found.relative) < abs(found.relative):
        return ""  # nearer to the period given
    slip = abs(off) * record.n_samples
    if slip < NEGLIGIBLE_SLIP:
        return ""
    return (
        f"The response does not repeat with the period given: its own is {period * (1.0 + found.relative):.10g} ± "
        f"{period * found.std:.1g} s, not {clock.period:.10g} s; over the record the phase slips by {slip:.3g} "
        f"samples. That is {whole} sampling intervals, a whole number: the period or the sampling interval of "
        f"{1.0 / record.sample_rate:.6g} s was rounded. Exponents and shapes would look right and be wrong.\n"
        f"  If the period is right, the sampling interval is {clock.period / whole:.10g} s: pass "
        f"`rate={whole / clock.period:.12g}` (`--rate`). If the rate is right, pass "
        f"`period={period:.12g}` (`--period`)."
    )
