"""The period by which the steady response of records keeps its phase: a better one to start from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from floquid.core import PhaseClock, Record
from floquid.fit import ROUNDING, SURE
from floquid.periodic._fit_records import Samples
from floquid.periodic._forced_part import forced_base, forced_turns
from floquid.periodic._start import Known
from floquid.periodic.least_squares import PLAIN, TREND, ModeParameters, shapes
from floquid.periodic.search import Point, priced


def steady_period(
    records: Sequence[Record],
    clocks: Sequence[PhaseClock],
    start: ModeParameters,
    known: Known,
    *,
    forced: str | Sequence[int] = "auto",
    periods_per_revolution: float = 1.0,
) -> float:
    r"""Period [s] by which the steady response of records keeps its phase, in a fit beside modes.

    .. math:: \frac{2\pi}{T} = \omega
              + \frac{\sum_{c,h,j} j\, \Im(\bar F_{c,h,j} \dot F_{c,h,j}) / s_{c,h}^2}
                     {\sum_{c,h,j} j^2 |F_{c,h,j}|^2 / s_{c,h}^2}

    with F the harmonics j a period, which may change linearly with time, F' what they change by in a second, s the
    noise, and ω that of the `clocks`. Without a steady response it is their period. To first order in the slip over the
    record: once more with the period found is better yet.

    Raises InputError where records or clocks do not belong together, or the forced response cannot be what is asked
    for.

    Parameters
    ----------
    records
        One record, or one a hit on the same system, of equal channels.
    clocks
        The constant period of each, the same of all.
    start
        The modes beside (`groups`).
    known
        The forced response that was found in the lifted responses.
    forced
        The harmonics of the revolution in it, as `fit` takes them.
    periods_per_revolution
        Periods of the system in a revolution of the shaft.
    """
    samples = Samples.of(records, clocks, None, known, periods_per_revolution)
    chosen = forced_turns(forced, known, samples.half, samples.nu)
    base = forced_base(chosen, samples.fundamental, wanders=False, turning=True)
    prices = priced(samples.final, base, ROUNDING, mode_alarm=SURE, harmonic_alarm=SURE)
    begin = replace(start, fundamental=samples.fundamental)
    return 2.0 * np.pi / _turned(Point.at(samples.final, *prices, base.joined(begin)).settled())


def _turned(point: Point) -> float:
    """Fundamental [rad/s] with which the steady response of a fit that lets it change keeps its phase."""
    entries, both = point.entries, shapes(point.blocks, point.solution)
    values, above, below = both.coefficients[..., both.harmonics == 0][..., 0], 0.0, 0.0
    for entry in np.flatnonzero(entries.fixed & (entries.factors == TREND) & (entries.offsets != 0.0)):
        turn = entries.offsets[entry]
        plain = int(np.flatnonzero(entries.fixed & (entries.factors == PLAIN) & (entries.offsets == turn))[0])
        for block in point.blocks:
            own, change = values[plain, block.rows, block.hit], values[entry, block.rows, block.hit] / block.half
            above += turn * float(np.sum((own.conj() * change).imag / block.noise**2))
            below += turn**2 * float(np.sum(np.abs(own) ** 2 / block.noise**2))
    return entries.fundamental + (above / below if below else 0.0)
