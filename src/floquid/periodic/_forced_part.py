"""The forced response in a fit of samples: which harmonics it has, what they are, and the records without it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt, input_error, positive, wrong_value
from floquid.core import Channel, PhaseClock, Record
from floquid.errors import IdentificationError
from floquid.fit import HALF_DIGITS, SLOW, SURE, chi2_limit
from floquid.periodic._start import Known
from floquid.periodic.least_squares import (
    FOLLOWS,
    PLAIN,
    TREND,
    ModeParameters,
    estimates_of,
    forced_entries,
    linearise,
    record_blocks,
    shapes,
    solve,
)
from floquid.periodic.search import SearchResult, kept_with, read_as_modes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForcedResponse(Rebuilt):
    r"""The periodic response to what drives the system once a revolution and at its harmonics.

    .. math:: y_f(t) = b + d\,(t - \bar t) + 2 \Re \sum_{j > 0} F_j\, e^{i j \varphi(t)}

    with φ the angle of the shaft, or 2πt over the revolution where that is constant, zero at phase zero, and t̄ the
    middle of the record.

    Parameters
    ----------
    harmonics
        The harmonics j of the revolution, ascending (harmonics,).
    coefficients
        F (channels, hits, harmonics) [units of the channels].
    coefficient_std
        Their deviations, that of the real part as the real part (channels, hits, harmonics); None if not estimated, as
        the deviations of the others are then.
    offset, offset_std
        b and its deviation (channels, hits) [units of the channels]; zero where there is none.
    drift, drift_std
        d and its deviation (channels, hits) [units of the channels/s]; zero where there is none.
    revolution
        The revolution [s], its mean where the speed wanders.
    channels
        One `Channel` a row.
    speed_dependent
        Whether F was let follow the speed: then F is that at the mean speed.
    """

    harmonics: Integers
    coefficients: Complexes
    coefficient_std: Complexes | None
    offset: Floats
    offset_std: Floats | None
    drift: Floats
    drift_std: Floats | None
    revolution: float
    channels: tuple[Channel, ...]
    speed_dependent: bool = False

    def __post_init__(self) -> None:
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        self._freeze(dtype=np.complex128, coefficients=(len(self.channels), "hits", len(self.harmonics)))
        shape, rows = self.coefficients.shape, self.coefficients.shape[:2]
        self._freeze(dtype=np.complex128, coefficient_std=shape)
        self._freeze(offset=rows, offset_std=rows, drift=rows, drift_std=rows)
        object.__setattr__(self, "revolution", positive(self.revolution, "revolution", "ForcedResponse", unit="s"))

    @property
    def amplitudes(self) -> Floats:
        """2|F|, the amplitude of each harmonic (channels, hits, harmonics) [units of the channels]."""
        return 2.0 * np.abs(self.coefficients)

    def response(self, angles: ArrayLike) -> Floats:
        """The periodic part, offset included, at angles of the shaft [rad] (channels, hits, angles)."""
        turned = np.exp(1j * np.multiply.outer(self.harmonics, np.atleast_1d(np.asarray(angles, float))))
        return self.offset[:, :, None] + 2.0 * (self.coefficients @ turned).real


def forced_turns(
    forced: str | Sequence[int], known: Known | None, most: float, nu: float
) -> tuple[list[float], bool] | None:
    """Turns a period of the harmonics fitted in any case, at most `most`, and whether a drift is; None without any."""
    if known is not None and isinstance(forced, str) and forced == "auto":
        return (sorted({0.0, *(turn for turn in known.turns if turn <= most)}), known.drift) if known else None
    listed = _listed(forced, most, nu)
    drift = known is None or known.drift
    return None if listed is None else ([0.0, *(j / nu for j in listed)], drift)


def _listed(forced: str | Sequence[int], most: float, nu: float) -> tuple[int, ...] | None:
    """The harmonics of the revolution that are fitted in any case; None without a forced response."""
    remedy = 'Pass "auto", "none" or harmonics of the revolution, as (1, 2).'
    if isinstance(forced, str):
        if forced not in ("auto", "none"):
            raise wrong_value("forced", "fit", "be auto, none or a list of whole numbers", forced, remedy)
        return None if forced == "none" else ()
    chosen = tuple(dict.fromkeys(int(j) for j in forced))
    for j in chosen:
        if j < 1 or j / nu > most:
            must = f"lie between 1 and {int(most * nu)}, what the sampling shows"
            raise input_error("forced", "fit", must, f"has {j}", "Ask for lower harmonics, or sample faster.")
    return chosen


def forced_base(
    chosen: tuple[list[float], bool] | None, fundamental: float, *, wanders: bool, turning: bool = False
) -> ModeParameters:
    """Entries fitted in any case: offset, drift and the harmonics listed, let follow the speed where it wanders."""
    if chosen is None:
        return forced_entries([], fundamental)
    turns, drift = chosen
    base = forced_entries(turns, fundamental)
    if drift:
        base = base.joined(forced_entries([0.0], fundamental, factor=TREND))
    for factor in FOLLOWS if wanders else (TREND,) if turning else ():
        base = base.joined(
            forced_entries(turns if wanders else [turn for turn in turns if turn], fundamental, factor=factor)
        )
    return base


def angle_std(clocks: Sequence[PhaseClock], records: Sequence[Record]) -> tuple[float, ...]:
    """The deviation of the system's angle over each record, as the shaft has it [rad]; none of constant periods."""
    measured = [(clock, record) for clock, record in zip(clocks, records, strict=True) if clock.measured]
    return tuple(clock.angle_spread(record.times) * (clock.periods_per_revolution or 1.0) for clock, record in measured)


def without_noise(result: SearchResult) -> SearchResult:
    """Without those harmonics of the forced response, offset and drift that noise explains, or a mode beside them."""
    result = _without_twins(result)
    apart, entries = read_as_modes(result), result.solution.entries
    both = shapes(apart.blocks, apart.solution)
    place = int(np.flatnonzero(both.harmonics == 0)[0])
    paired = entries.columns().paired
    kept = ~entries.fixed | paired  # a pair near an axis that is held is no forced response
    at = np.cumsum(~paired) - 1  # modes of such pairs stand behind all others
    for entry in np.flatnonzero(~kept):
        value, std = both.coefficients[at[entry], ..., place], both.std[at[entry], ..., place]
        parts = [(value.real, std.real)] + ([] if entries.real[entry] else [(value.imag, std.imag)])
        score = sum(float(np.sum(np.divide(v, s, out=np.zeros_like(v), where=s > 0) ** 2)) for v, s in parts)
        kept[entry] = score > chi2_limit(len(parts) * value.size, SURE)
    # What follows the speed is kept with its harmonic alone.
    plain = entries.offsets[kept & entries.fixed & (entries.factors == PLAIN)]
    follows = entries.fixed & (entries.factors > TREND) & ~entries.columns().paired
    kept &= ~follows | (np.abs(entries.offsets[:, None] - plain) < HALF_DIGITS).any(axis=1)
    if kept.all():
        return result
    less = entries.picked(np.flatnonzero(kept))
    solution = linearise(result.blocks, less)
    with suppress(IdentificationError, np.linalg.LinAlgError):
        solution = solve(result.blocks, less)
    return kept_with(result, kept, solution)


def _without_twins(result: SearchResult) -> SearchResult:
    """Without the forced response on the lines of a real multiplier that hardly decays, where that alone will do."""
    entries, duration = result.solution.entries, max(block.last for block in result.blocks)
    free = ~entries.fixed & entries.real & (np.abs(entries.exponents.real) * duration < SLOW)
    turns = entries.offsets[:, None] - entries.offsets[free]
    plain = entries.fixed & (entries.exponents == 0.0) & (entries.factors == PLAIN)
    twins = plain & (np.abs(turns - np.rint(turns)) < HALF_DIGITS).any(axis=1)
    if not twins.any():
        return result
    with suppress(IdentificationError, np.linalg.LinAlgError):
        alone = solve(result.blocks, entries.picked(np.flatnonzero(~twins)), hold=True)
        fewer = sum(len(block.rows) for block in result.blocks) * int(np.where(entries.real[twins], 1, 2).sum())
        if alone.cost - result.solution.cost < chi2_limit(fewer, SURE):
            return kept_with(result, ~twins, alone)
    return result


def forced_of(
    result: SearchResult, nu: float, channels: tuple[Channel, ...], *, wanders: bool
) -> ForcedResponse | None:
    """The forced response of a fit; None where nothing of it is there."""
    entries = result.solution.entries
    forced = entries.fixed & (entries.exponents == 0.0)
    if not forced.any():
        return None
    both = shapes(result.blocks, result.solution)
    place = int(np.flatnonzero(both.harmonics == 0)[0])
    values, std = both.coefficients[..., place], both.std[..., place]
    plain = forced & (entries.factors == PLAIN)
    turning = sorted(np.flatnonzero(plain & (entries.offsets > 0)), key=lambda e: entries.offsets[e])
    nothing = np.zeros(values.shape[1:])

    def alone(which: Mask, scale: Floats | float = 1.0) -> tuple[NDArray, NDArray]:
        places = np.flatnonzero(which)
        return (values[places[0]].real / scale, std[places[0]].real / scale) if len(places) else (nothing, nothing)

    offset, offset_std = alone(plain & (entries.offsets == 0.0))
    half = np.ones(nothing.shape)
    for block in result.blocks:
        half[block.rows, block.hit] = block.half
    drift, drift_std = alone(forced & (entries.factors == TREND), half)
    return ForcedResponse(
        harmonics=np.array([round(entries.offsets[e] * nu) for e in turning], np.int64),
        coefficients=np.moveaxis(values[turning], 0, -1) if turning else np.zeros((*nothing.shape, 0), complex),
        coefficient_std=np.moveaxis(std[turning], 0, -1) if turning else np.zeros((*nothing.shape, 0), complex),
        offset=offset,
        offset_std=offset_std,
        drift=drift,
        drift_std=drift_std,
        revolution=2.0 * np.pi / entries.fundamental * nu,
        channels=channels,
        speed_dependent=wanders,
    )


def free_records(
    records: Sequence[Record], clocks: Sequence[PhaseClock], result: SearchResult, nu: float
) -> tuple[Record, ...]:
    """The records without what is fixed in the fit."""
    entries = result.solution.entries
    if not entries.fixed.any():
        return tuple(records)
    columns, whole = entries.columns(), estimates_of(result.blocks, result.solution)
    # A column without a sine counts once, the others with their conjugates.
    share = np.where(entries.sines(), 1.0, 0.5) * entries.fixed[columns.modes]
    values = [np.array(record.values) for record in records]
    for block in record_blocks(records, clocks, nu)[0]:
        coefficients = whole.coefficients[:, block.rows, block.hit] * share[:, None] * block.scales(columns)[:, None]
        _, residual = block.residual(columns, coefficients)
        taken = ~np.isnan(records[block.hit].values[block.rows[0]])
        values[block.hit][np.ix_(block.rows, np.flatnonzero(taken))] = residual
    for array in values:
        array.flags.writeable = False
    return tuple(replace(record, values=array) for record, array in zip(records, values, strict=True))
