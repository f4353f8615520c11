"""Words of findings on a whole result: the preparation of its records, warnings for its reader, and A(t)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

SYSTEM: dict[str, str | Callable[..., str]] = {
    "structure_found": "Structure found: {structure}.",
    "structure_widened": "{name}: chi-square from {before:.4g} to {after:.4g}.",
    "structure_tested": "{name} is left out: its {more} numbers lower the chi-square by {gain:.3g} (p = {p_value:.2g})."
    " The deviations include what it could hide.",
    "structure_conditional": "This record cannot tell {name} from none: the deviations are conditional on there being "
    "none.",
}
"""By code."""


WHY = {
    "angle": "the shaft angle is measured",
    "own period": "the period is fitted too",
    "missing": "samples are missing",
    "no whole number": "a period is no whole number of samples",
}
"""Words for why samples are fitted at their own times."""


def _listed(instants: Sequence[float]) -> str:
    return ", ".join(f"{instant:.6g} s" for instant in instants[:12]) + (" …" if len(instants) > 12 else "")


def _impacts(instants: Sequence[float], hits: int) -> str:
    if len(instants) == 1:
        return f"One impact, at {_listed(instants)}: the free response after it is a hit."
    return (
        f"{len(instants)} impacts, at {_listed(instants)}: the free responses after them are {hits} hits on one system."
    )


def _begins_later(periods: int) -> str:
    first = "The first period" if periods == 1 else f"The first {periods} periods"
    were = "was" if periods == 1 else "were"
    return (
        f"{first} of each hit {were} left out (`skip=0` keeps all). A part of the response dies there: modes that "
        "decay within a period, or a nonlinearity."
    )


def _fails(misfit: float, order: bool, harmonics: bool, forced: bool) -> str:
    ways = ["Let the order be found, or ask for a higher one (`order=`)."] * order
    ways += ["Allow more harmonics (`harmonics=`)."] * harmonics
    ways += ["Let a forced response be fitted (`forced=`)."] * forced
    return (
        f"The model fails: its residual is {misfit:.3g} times the noise. Exponents and shapes have no deviations, "
        f"since their errors are unknown. {''.join(f'{way} ' for way in ways)}Look at the record for steps, glitches "
        "and clipping. A nonlinearity is largest in the first periods: leave them out (`skip=`)."
    )


def _forced(orders: Sequence[float], largest: Sequence[float], follows: bool) -> str:
    parts = [f"{j} a revolution (up to {size:.3g} times the noise)" for j, size in zip(orders, largest, strict=True)]
    speed = ", following the speed" if follows else ""
    return (
        f"A forced response was fitted beside the modes{speed}: {'; '.join(parts)}. Without a force it is the limit "
        "cycle, whose own multiplier is 1."
    )


def _sum(channel: str, shares: Sequence[float], others: Sequence[str], beside: float) -> str:
    return f"{channel} equals {_parts(shares, others)}, noise included, except for {100.0 * beside:.2g} % of its noise"


def _parts(shares: Sequence[float], others: Sequence[str]) -> str:
    return " and ".join(f"{share:.4g} times {other}" for share, other in zip(shares, others, strict=True))


def _angle(degrees: float, energy: float = 0.0, share: float = 0.0) -> str:
    size = f"{energy:.3g} in the misfit" if energy else f"{share:.2g} times the variance of the residual"
    return (
        f"The tachometer gives the shaft angle to ±{degrees:.2g}°. This error makes more of the response than noise "
        f"does ({size}). Weak modes, and modes near a harmonic of the revolution, may be artefacts of it. Sample the "
        "tachometer faster, widen its pulse, or use more pulses a revolution."
    )


MODEL: dict[str, str | Callable[..., str]] = {
    "orbit_subtracted": "The periodic orbit in the file was subtracted.",
    "bad_samples": "Such samples bend exponents and shapes: mark them as missing (NaN).",
    "more_gaps": "There are {number} more stretches of missing samples.",
    "begins_later": _begins_later,
    "skipped": "The first {periods:g} periods were left out.",
    "no_response": "Channel {channel} is a {quantity} and was left out. If it is a response, name all channels to use "
    "(`channels=`).",
    "no_impact": "No impact was found: the record is taken for one free response from its first sample.",
    "impacts": _impacts,
    "cut_at_blows": lambda instants, hits: (
        f"The response begins or is hit again at {_listed(instants)}: {hits} free "
        f"response{'s were' if hits > 1 else ' was'} cut out (`repair=False` takes the record as it is)."
    ),
    "spikes": lambda instants, number: (
        f"{number} spike{'s' * (number > 1)} that no response explains, at {_listed(instants)}, left out."
    ),
    "partly_missing": "{samples} samples that some channels miss count as missing in all: a sample counts as a whole "
    "where excitation goes on.",
    "left_out": "{samples} of these samples of channel {channel} count as missing (`repair=False` keeps them).",
    "believed_down_to": "There is hardly any noise, and the residual is no noise: most likely a nonlinearity. The fit "
    "ignores what is below {floor:g} of the largest value of each channel (`noise_floor=`).",
    "rings": "The modes ring in the first {cycles} of {of} periods: these were fitted and checked. The later ones tell "
    "the noise alone.",
    "as_sampled": lambda why: f"Fitted at the original sampling times: {WHY[why]}.",
    "forced": _forced,
    "no_forced": "No harmonic of the revolution rises above the noise beside the modes.",
    "offset": "An offset of the channels was fitted beside the modes.",
    "drift": "A drift of the channels, linear in time, was fitted beside the modes.",
    "model_fails": _fails,
    "sum_of_others": lambda **numbers: f"{_sum(**numbers)}: deviations are too small. Leave it out.",
    "copied_sum": lambda **numbers: f"{_sum(**numbers)}.",
    "sum_left_out": lambda channel, shares, others, **_: (
        f"{channel} was left out: it is {_parts(shares, others)}, noise included, and tells nothing more."
    ),
    "order_too_low": "The order given, {order}, is too low: a further mode lowers the misfit by {share:.3g} times the "
    "limit for noise. The others are biased by more than their deviations. Let the order be found, or ask for a higher "
    "one.",
    "other_order": "The model has {found} poles and not {order}: noise explains more, or poles come in pairs.",
    "order_not_held": "The residues are not constrained to their harmonics, since the poles would not stay that many. "
    "The record holds fewer than the order asked for.",
    "misfit": "The residual is {misfit:.3g} times the noise, and all deviations are widened by that. Harmonics may be "
    "missing, or modes may fold onto one another. Exponents may be off by more still. Allow more harmonics "
    "(`harmonics=`), or finish with `constrained=False`.",
    "uneven_speed": lambda reasons, **_: (
        f"The shaft speed is not constant enough for a periodic model: {' '.join(reasons)} Use a part of the record "
        "where it is, or pass `trust_period=True`."
    ),
    "vague_angle": _angle,
    "beside_harmonics": lambda frequencies: (
        f"At {', '.join(f'{own:.4g}' for own in frequencies)} Hz, beside a harmonic of the revolution, a wander of the "
        "speed would look like a mode. Nothing that was measured tells the two apart."
    ),
    "order_ambiguous": lambda order, doubts: f"The order, {order}, is ambiguous: {' '.join(doubts)}",
    "under_a_peak": "A mode that hardly decays lies at a peak of the noise: it may be noise.",
    "multiplier_one": "A component with a multiplier of 1 neither grows nor decays. Most likely it is the forced "
    "periodic response (an imbalance, an offset), not a mode.",
    "multiplier_minus_one": "A component with a multiplier of -1 neither grows nor decays. Most likely it is the "
    "imbalance response of a shaft that turns once in two periods, not a mode. Let it be fitted: "
    "`periods_per_revolution=2`, and `forced=` not none.",
    "partner_missing": "A negative real multiplier is missing: {number} found, and a real system has an even number. "
    "It may be next to one that is found, whose decay is the mean of both then. A hit with another initial state would "
    "show it.",
    "weakly_determined": "{number} of {order} exponents are weakly determined (deviation above {limit:g} of the "
    "fundamental). Each may stand for several modes, so do not quote their frequency and damping. A second hit at "
    "another place, or less noise, helps most.",
    "growing": "{number} of {order} exponents grow: the system is unstable, or it is being driven.",
}
"""By code."""
