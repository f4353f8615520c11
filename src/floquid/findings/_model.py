"""Words of findings on the order, the fit and a whole result: modes, lines, preparation, and A(t)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import tau

from floquid.findings._phrases import both, hertz, resolved, valued


def _mode(real: float | None, share: float) -> str:
    """A mode by its multiplier where that is real, else by its angle over ω."""
    return f"the mode folded to {share:.4f} of ω" if real is None else f"the real multiplier {real:.4g}"


def _order_needed(needed: bool, modes: int, real: float | None, share: float, rise: float, just: bool) -> str:
    weakest, more = _mode(real, share), f"{rise:.3g} times what noise explains{': only just more' if just else ''}."
    if modes == 1:  # or several modes of one multiplier
        known = "is needed" if needed else "is not needed"
        return f"{weakest[:1].upper()}{weakest[1:]} {known}: without it the misfit rises by {more}"
    return (
        f"{'Each' if needed else 'Not each'} of the {modes} modes is needed. "
        f"Without the weakest, {weakest}, the misfit rises by {more}"
    )


def _further(share: float, doubtful: bool) -> str:
    if share >= 1.0:
        return f"The best further candidate exceeds the limit ({share:.2f} of it): a mode is missing."
    doubt = " Noise alone rarely comes so close." if doubtful else ""
    return f"The best further candidate stays below the limit ({share:.2f} of it).{doubt}"


def _drift(number: int) -> str:
    modes = "One mode changes" if number == 1 else f"{number} modes change"
    return f"{modes} by less than one turn over the record, and the noise is coloured. Its drift may look like that."


def _shared(number: int, hits: int) -> str:
    multipliers = "One multiplier belongs" if number == 1 else f"{number} multipliers belong"
    return f"{multipliers} to two modes or more: the residues of the {hits} hits have that rank."


def _white(colour: float, taps: int, independent: float) -> str:
    how = f"white after a filter of {taps} taps" if taps else "white noise"
    worth = "" if independent > 0.9 else f"; its responses are worth {independent:.0%} of their number"
    return f"The residual is {how} ({colour:.2g} standard deviations from it){worth}."


ORDER: dict[str, str | Callable[..., str]] = {
    "modes_needed": _order_needed,
    "well_determined": "Each mode is well determined.",
    "hardly_determined": lambda number, real, share: (
        f"{number} of the modes are weakly determined, {_mode(real, share)} most: each may stand for several."
    ),
    "resolution": "Two modes nearer than about {widths:.2g} half-power widths would be seen as one. Weaker ones than "
    "the strongest need more distance.",
    "nearest_modes": lambda gap, near: (
        f"The two nearest modes are {gap:.3g} standard deviations apart"
        f"{': they may be one mode, or three' if near else ''}."
    ),
    "further_mode": _further,
    "modes_move": "With one more mode the others move by up to {moved:.3g} standard deviations.",
    "modes_or_drift": _drift,
    "one_initial_condition": "With one initial condition, modes of equal multipliers are seen as one.",
    "shared_multipliers": _shared,
    "no_shared_multipliers": "No two modes share a multiplier: the residues are outer products of shape and hit.",
    "not_white": "The residual is not white noise ({colour:.3g} standard deviations from it). Modes may be missing, or "
    "some of them may be noise.",
    "white": _white,
    "poles_found": "The poles were found.",
    "no_mode": "No mode rises above the noise, as far as the whole periods of the record tell. Of few periods use "
    "more, or several hits; else a record with a clear free decay, or start it closer to the blow. Of random "
    'excitation that goes on use a longer one, with `excitation="ambient"`.',
    "too_few_samples": "The responses are too short for the modes in them: the order reached the most that this many "
    "samples can hold. Record more samples, or fix a lower order.",
    "modes_without_end": "The search found mode after mode without an end: the residual is not white noise, or there "
    "are more than some thirty modes. Likely: a step or a glitch, samples rounded to a few levels, coloured noise, a "
    "coarse simulation or a nonlinearity. Raise the noise floor (`noise_floor=`) to the level down to which the record "
    "is right, or fix the order.",
    "poles_without_end": "The search for poles was not at its end when its processor time was over. Likely: a second "
    "blow, or channels that drift. Cut the record at the blow, or give the search longer (`seconds=`).",
    "order_unreached": "The data do not hold as many poles as were asked for: ask for fewer, or let the order be "
    "found.",
}
"""By code."""


def _needed(number: int, frequency: float | None = None, rise: float = 0.0) -> str:
    modes = "One mode is" if number == 1 else f"{number} modes, a pair counted once, are"
    if frequency is None:
        return f"{modes} needed: noise explains none of them, nor do the harmonics of another."
    size = f"{rise:.2g}" if rise < 100.0 else "more than 100"
    clear = "clear of" if rise >= 2.0 else "only just above"
    weakest = "It" if number == 1 else f"The weakest, at {frequency:.4g} Hz,"
    return f"{modes} needed. {weakest} is {clear} the noise (χ² of its shape {size} times the limit)."


def _undetermined(frequencies: Sequence[float] = ()) -> str:
    which = f" at {hertz(frequencies)}" if frequencies else ""
    return (
        f"The decay of a mode{which} is not determined. It may die at once, or modes may cancel one another. There may "
        "be fewer modes, or others: compare with a lower `order=`."
    )


def _peak(frequency: float, share: float, loud: bool) -> str:
    if not loud:
        return f"The strongest peak of the residual, at {frequency:.4g} Hz, is {share:.2f} of the limit for noise."
    size = f"{share:.2f}" if share < 10.0 else f"{float(f'{share:.2g}'):,.0f}".replace(",", " ")
    return (
        f"A peak of the residual at {frequency:.4g} Hz, {size} times the limit for noise, is not explained. A mode may "
        "be missing; a nonlinearity, a drifting amplitude or another tone leave such peaks too."
    )


def _undamped(frequencies: Sequence[float], on: int) -> str:
    return (
        f"Lines that do not decay, at {hertz(frequencies)}, are a steady response: to a force, or a limit cycle. "
        f"{on} of {len(frequencies)} are at multiples of half the fundamental."
    )


def _families(lines: int, spacings: int, families: int, frequency: float, odds: float) -> str:
    modes = "one mode" if families == 1 else f"{families} modes"
    are = f"multiples of {frequency:.6g} Hz away from stronger ones: sidebands of {modes}"
    if spacings == 1:
        are = f"a multiple of {frequency:.6g} Hz away from a stronger one: a sideband of one mode"
    some = f"One of {lines} lines that decay is" if spacings == 1 else f"{spacings} of {lines} lines that decay are"
    return f"{some} {are}. The odds against chance, by frequencies alone, are 1e{odds:.1f} to 1."


def _chance(probability: float) -> str:
    return "below 1e-99" if probability < 1e-99 else f"{probability:.2g}"


def _unlike(
    frequency: float,
    hits: Sequence[int],
    decays: Sequence[float],
    frequencies: Sequence[float],
    probability: float,
    torn: bool = False,
) -> str:
    gap, real = max(max(decays) - min(decays), tau * (max(frequencies) - min(frequencies))), len(set(frequencies)) == 1
    turning = [f"has {resolved(alone, 5, gap / tau)} Hz and " for alone in frequencies]
    each = [
        f"hit {hit} {'' if real else turns}decays by {resolved(decay, 4, gap)} 1/s"
        for hit, turns, decay in zip(hits, turning, decays, strict=True)
    ]
    return (
        f"The hits disagree on the {'real multiplier' if real else 'mode'} at {frequency:.4g} Hz "
        f"(by chance: {_chance(probability)}): {'; '.join(each)}. "
        + ("No exponent fits all. " if torn else "Its deviation covers both. ")
        + "It may depend on the strength of the blow, or the machine may have changed in between. Identify each hit "
        "alone and compare."
    )


def _disagree(frequency: float, share: float, probability: float, groups: Sequence[Sequence[int]] = ()) -> str:
    names = [f"{'hits' if len(hits) > 1 else 'hit'} {', '.join(map(str, hits))}" for hits in groups]
    has = "share" if groups and len(groups[0]) > 1 else "has"
    told = f"{names[0].capitalize()} {has} one shape, and {names[1]} another. " if names else ""
    return (
        f"The hits disagree on the shape of the mode at {frequency:.4g} Hz by {100.0 * share:.2g} % (by chance: "
        f"{_chance(probability)}), so no common shape was fitted. "
        f"{told}Two modes may share its multiplier, its shape may depend on the strength of the blow, or the machine "
        "may have changed in between. Identify each hit alone and compare."
    )


FIT: dict[str, str | Callable[..., str]] = {
    "all_needed": _needed,
    "strongest_peak": _peak,
    "coloured_noise": "The noise is not white: about {loud:.4g} Hz it is {ratio:.3g} times that about {quiet:.4g} Hz, "
    "but the fit takes it for white. Intervals are too short where it is loud, and too long where it is quiet. A weak "
    "mode where it is loud may be noise.",
    "interference": lambda frequency, amplitude, unit, channel: (
        f"A steady tone at {frequency:.5g} Hz, {valued(f'{amplitude:.3g}', unit)} in channel {channel}, was fitted "
        "and taken off. It does not decay. Likely: the mains, another machine, or a mode that decays too slowly for "
        "this record."
    ),
    "cluster": "The mode at {frequency:.4g} Hz is most likely several that fold onto one another: its harmonics ask "
    "for different exponents. Its deviation covers them.",
    "one_shape": "The {hits} hits share one shape of each mode and differ in its initial state only.",
    "several_shapes": "The hits share {number} shapes of the mode at {frequency:.4g} Hz: {number} modes have its "
    "multiplier.",
    "hits_disagree": _disagree,
    "hits_unlike": _unlike,
    "two_of_one_multiplier": "The mode at {frequency:.4g} Hz may be two of one multiplier: the hits do not share its "
    "shape. Three hits or more that excite both in other proportions tell.",
    "double": "The modes at {first:.4g} Hz and {second:.4g} Hz are whole fundamentals apart, to within {decays:g} of "
    "their decay. They may be one mode with more harmonics than were fitted: raise `harmonics=`.",
    "one_that_moves": "The modes at {first:.4g} Hz and {second:.4g} Hz share a shape, and are closer than they decay. "
    "Most likely they are one mode whose frequency or damping changes with time or amplitude. Do not quote either "
    "damping. Use a later part of the record (`skip=`), or a smaller blow.",
    "kind_open": "The mode at {frequency:.4g} Hz is a pair of conjugates or two real multipliers: this record does not "
    "decide. The two exponents differ by at most {apart:.2g} 1/s either way, and their deviations cover both.",
    "hidden_partner": "A second real multiplier at {frequency:.4g} Hz, with a decay within {apart:.2g} 1/s of "
    "{decay:.4g} 1/s, would not show in this record. A hit with another initial state would show it.",
    "product": lambda frequency, of: (
        f"The mode at {frequency:.4g} Hz is most likely no mode: its multiplier is the product of those at "
        f"{both([f'{factor:.4g} Hz' for factor in of])}. A nonlinearity makes such products."
    ),
    "search_ended": "The search ended at {number} modes, its limit, with more above the noise. Likely: noise that is "
    "not white, or a nonlinearity. Compare with a fixed `order=`.",
    "undetermined": _undetermined,
    "noise_unsettled": "The noise cannot be told from the response: its estimate does not settle as modes are fitted. "
    "The model is the best that was found. Modes that die within a period may be why: leave periods out with `skip=`.",
    "out_of_time": "The search ended after {seconds:.4g} s of processor time: modes or harmonics may be missing. A "
    "pair may be two real multipliers. Give it longer (`seconds=`), a shorter record or fewer channels.",
    "undamped_lines": _undamped,
    "line_families": _families,
    "beside_steady": lambda turns: (
        f"A steady response, {both([f'{turn:g}' for turn in turns[:8]])} times the fundamental, was taken off first, "
        "and no decay was seen on it. A limit cycle shows its multipliers only where it is disturbed: disturb it more, "
        "or sample faster."
    ),
}
"""By code."""


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
    "cut_at_gaps": lambda periods, parts: (
        f"Gaps longer than {periods:g} periods cut the records into {parts} part{'s' * (parts > 1)}. Each begins with "
        "a state of its own, since what drove the system in a gap was not measured. Parts shorter than a period are "
        "left out."
    ),
    "left_out": "{samples} of these samples of channel {channel} count as missing (`repair=False` keeps them).",
    "believed_down_to": "The residual is no noise of one level: most likely a nonlinearity, or errors in proportion to "
    "the response, as of rounding to some digits. The fit ignores what is below {floor:g} of the largest value of each "
    "channel (`noise_floor=`), modes as weak as that, too.",
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
