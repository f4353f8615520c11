"""Words of findings on a result as a whole: what was done to its records, what a reader must be told, and A(t)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

SYSTEM: dict[str, str | Callable[..., str]] = {
    "structure_found": "Structure found: {structure}.",
    "structure_widened": "{name}: chi-square from {before:.4g} to {after:.4g}.",
    "structure_tested": (
        "{name} is left out: its {more} numbers take {gain:.3g} off the chi-square (p = {p_value:.2g}), and the "
        "deviations count what it could hide."
    ),
    "structure_conditional": (
        "{name} cannot be told from none by this record: the deviations are conditional on there being none."
    ),
}
"""By code."""


WHY = {
    "angle": "a shaft angle that is measured",
    "own period": "a period that is fitted too",
    "missing": "missing samples",
    "no whole number": "a period that is no whole number of samples",
}
"""Words for why samples are fitted at their own times."""


def _listed(instants: Sequence[float]) -> str:
    return ", ".join(f"{instant:.6g} s" for instant in instants[:12]) + (" …" if len(instants) > 12 else "")


def _impacts(instants: Sequence[float], hits: int) -> str:
    where = _listed(instants)
    if len(instants) == 1:
        return f"One impact was found, at {where}; the free response after it is a hit."
    return (
        f"{len(instants)} impacts were found, at {where}; the free responses after them are {hits} hits on one system."
    )


def _begins_later(periods: int) -> str:
    first = "The first period of each hit holds" if periods == 1 else f"The first {periods} periods of each hit hold"
    return (
        f"{first} what is gone after {'it' if periods == 1 else 'them'}: modes that decay within a period, or what is "
        f"not linear there. {'It was' if periods == 1 else 'They were'} left out (`skip=0` keeps all)."
    )


def _fails(misfit: float, order: bool, harmonics: bool, forced: bool) -> str:
    ways = ["let the order be found, or ask for a higher one (`order=`)"] * order
    ways += ["allow more harmonics (`harmonics=`)"] * harmonics
    ways += ["let a forced response be fitted (`forced=`)"] * forced
    return (
        f"The model fails: what it leaves of the record is {misfit:.3g} times the noise. How far its exponents and "
        "shapes are from those of the system cannot be told: they have no deviations. To try: "
        f"{''.join(f'{way}; ' for way in ways)}look at the record for steps, glitches and clipping; and, since what is "
        "left may be a nonlinearity, leave out its first periods, where it is largest (`skip=`)."
    )


def _forced(orders: Sequence[float], largest: Sequence[float], follows: bool) -> str:
    parts = [f"{j} a revolution (up to {size:.3g} times the noise)" for j, size in zip(orders, largest, strict=True)]
    speed = ", let follow the speed" if follows else ""
    return (
        f"A forced response was fitted beside the modes{speed}: {', '.join(parts)}. Without a force it is the limit "
        "cycle, whose own multiplier is 1."
    )


def _sum(channel: str, shares: Sequence[float], others: Sequence[str], beside: float) -> str:
    parts = " and ".join(f"{share:.4g} times {other}" for share, other in zip(shares, others, strict=True))
    return f"{channel} is {parts}, noise and all, but for {100.0 * beside:.2g} % of its noise"


def _angle(degrees: float, energy: float = 0.0, share: float = 0.0) -> str:
    size = f"{energy:.3g} in the misfit" if energy else f"{share:.2g} times the variance of the residual"
    return (
        f"The angle of the shaft is known to {degrees:.2g}° only. What that makes of the response stands out of the "
        f"noise ({size}). Weak modes, and those near a harmonic of the revolution, may be that. Sample the tachometer "
        "faster, take a wider pulse, or more of them a revolution."
    )


MODEL: dict[str, str | Callable[..., str]] = {
    "orbit_subtracted": "The periodic orbit that the file holds was subtracted.",
    "bad_samples": "Samples that are not the response's bend exponents and shapes: mark them as missing (NaN).",
    "more_gaps": "There are {number} more stretches of missing samples.",
    "begins_later": _begins_later,
    "skipped": "The first {periods:g} periods were left out.",
    "no_response": "Channel {channel} is a {quantity}, taken for no response and left out: if it is one, name all "
    "channels to use (`channels=`).",
    "no_impact": "No impact was found: the record is taken for one free response from its first sample.",
    "impacts": _impacts,
    "cut_at_blows": lambda instants, hits: (
        f"The response begins or is hit again at {_listed(instants)}: {hits} free "
        f"response{'s were' if hits > 1 else ' was'} cut out (`repair=False` takes the record as it is)."
    ),
    "spikes": lambda instants, number: (
        f"{number} spike{'s' * (number > 1)} that no response explains, at {_listed(instants)}, left out."
    ),
    "left_out": "{samples} of these samples of channel {channel} are taken for missing (`repair=False` keeps them).",
    "believed_down_to": "There is hardly any noise, and what modes leave is none: a nonlinearity, most likely. The "
    "record is believed down to {floor:g} of the largest value of each channel (`noise_floor=`).",
    "as_sampled": lambda why: f"Fitted as sampled: {WHY[why]}.",
    "forced": _forced,
    "no_forced": "No harmonic of the revolution rises above the noise beside the modes.",
    "offset": "An offset of the channels was fitted beside the modes.",
    "drift": "A drift of the channels, linear in time, was fitted beside the modes.",
    "model_fails": _fails,
    "sum_of_others": lambda **numbers: f"{_sum(**numbers)}: deviations are too small. Leave it out.",
    "copied_sum": lambda **numbers: f"{_sum(**numbers)}.",
    "order_too_low": "The order given, {order}, is too low: a further mode would take {share:.3g} times out of the "
    "misfit what noise explains, so that the others are bent by more than their deviations say. Let the order be "
    "found, or ask for a higher one.",
    "order_not_held": "The residues are not constrained to their harmonics: that many poles do not stay where they are "
    "then. The record holds fewer than the order asked for.",
    "misfit": "What the fit leaves is {misfit:.3g} times the noise: harmonics are missing, a mode is several that fold "
    "onto one another, or there is something that is no mode. Deviations are as many times those of the noise alone; "
    "exponents may be bent by more still. Allow more harmonics, or finish with `constrained=False`.",
    "uneven_speed": lambda reasons: (
        f"The speed of the shaft is not constant enough for a periodic model: {' '.join(reasons)} Use a part of the "
        "record where it is, or pass `trust_period=True`."
    ),
    "vague_angle": _angle,
    "order_ambiguous": lambda order, doubts: f"The order, {order}, is ambiguous: {' '.join(doubts)}",
    "under_a_peak": "A mode that hardly decays over the record lies where the noise has a peak: it may be noise.",
    "multiplier_one": "A component with a multiplier of 1 neither grows nor decays: it is most likely the forced "
    "periodic response (imbalance, an offset), not a mode.",
    "multiplier_minus_one": "A component with a multiplier of -1 neither grows nor decays: it is most likely the "
    "forced response of a shaft that turns once in two periods (imbalance), not a mode. Let it be fitted: "
    "`periods_per_revolution=2`, and `forced=` not none.",
    "weakly_determined": "{number} of {order} exponents are weakly determined (deviation above {limit:g} of the "
    "fundamental): each may stand for several modes that this record cannot tell apart. Do not quote their frequency "
    "and damping; a second hit at another place, or less noise, helps most.",
    "growing": "{number} of {order} exponents grow: the system is unstable, or it is being driven.",
}
"""By code."""
