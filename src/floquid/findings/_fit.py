"""Words of findings on the order and the fit of a record: its modes and its lines."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from floquid.findings._phrases import both


def _mode(real: float | None, share: float) -> str:
    """A mode by its multiplier where that is real, else by its angle over ω."""
    return f"the mode folded to {share:.4f} of ω" if real is None else f"the real multiplier {real:.4g}"


def _order_needed(needed: bool, modes: int, real: float | None, share: float, rise: float, just: bool) -> str:
    return (
        f"{'Each' if needed else 'Not each'} of the {modes} modes is needed: without the one that would be missed "
        f"least, {_mode(real, share)}, the misfit rises by {rise:.3g} times what noise explains"
        f"{': only just more' if just else ''}."
    )


def _further(share: float, doubtful: bool) -> str:
    text = f"The clearest further mode takes {share:.2f} of what it must take out of the misfit"
    if share >= 1.0:
        return f"{text}: a mode is missing."
    return f"{text}: too little to be kept, but more than noise mostly has." if doubtful else f"{text}."


def _drift(number: int) -> str:
    names = "One mode turns and decays" if number == 1 else f"{number} modes turn and decay"
    return f"{names} by less than once over the record, and the noise is coloured: its drift may look so."


def _shared(number: int, hits: int) -> str:
    count = "One multiplier is" if number == 1 else f"{number} multipliers are"
    return f"{count} that of two modes or more: the residues of the {hits} hits have that rank."


def _white(colour: float, taps: int, independent: float) -> str:
    how = f"white once {taps} taps have taken its colour off" if taps else "white noise"
    worth = "" if independent > 0.9 else f"; its responses are worth {independent:.0%} of their number"
    return f"What is left is {how} ({colour:.2g} standard deviations from it){worth}."


ORDER: dict[str, str | Callable[..., str]] = {
    "modes_needed": _order_needed,
    "well_determined": "Each mode is well determined.",
    "hardly_determined": lambda number, real, share: (
        f"{number} of the modes are weakly determined, {_mode(real, share)} most: each may stand for several."
    ),
    "resolution": "Two modes nearer to each other than about {widths:.2g} half-power widths would be seen as one, "
    "weaker ones than the strongest here from farther away.",
    "nearest_modes": lambda gap, near: (
        f"The two modes nearest to each other are {gap:.3g} standard deviations apart"
        f"{': they may be one mode, or three' if near else ''}."
    ),
    "further_mode": _further,
    "modes_move": "With one more mode the others move by up to {moved:.3g} standard deviations.",
    "modes_or_drift": _drift,
    "one_initial_condition": "With one initial condition, modes of equal multipliers are seen as one.",
    "shared_multipliers": _shared,
    "no_shared_multipliers": "No two modes share a multiplier: the residues are outer products of shape and hit.",
    "not_white": "What is left is not white noise ({colour:.3g} standard deviations from it): modes may be missing, or "
    "some that were found may be noise.",
    "white": _white,
    "poles_found": "The poles were found.",
    "no_mode": "No mode rises above the noise: the responses cannot be told from white noise. Use a record with a "
    "clear free decay, or start it closer to the blow; of random excitation that goes on use a longer one, with "
    '`excitation="ambient"`.',
    "too_few_samples": "The responses are too short for the modes in them: the order reached the most that this many "
    "samples can hold. Record more samples, or fix a lower order.",
    "modes_without_end": "Mode after mode was found in what the fit leaves, without an end: the residual is not white "
    "noise. There may be a step or a glitch in the record, samples rounded to a few levels, or coloured noise; the "
    "simulation may be coarse, or the response nonlinear. Look at the record for these; raise the noise floor "
    "(`noise_floor=`) to the level down to which it can be believed, or fix the order.",
    "order_unreached": "The data do not hold as many poles as were asked for: ask for fewer, or let the order be "
    "found.",
}
"""By code."""


def _needed(number: int, frequency: float | None = None, rise: float = 0.0) -> str:
    words = "One mode is" if number == 1 else f"{number} modes, a pair counted once, are"
    if frequency is None:
        return f"{words} needed: noise explains none of them, nor do the harmonics of another."
    size = f"{rise:.2g}" if rise < 100.0 else "more than 100"
    clear = "clear of" if rise >= 2.0 else "only just above"
    least = "it" if number == 1 else f"the one missed least, at {frequency:.4g} Hz,"
    return f"{words} needed: {least} is {clear} the noise (χ² of its shape {size} times the limit)."


def _undetermined(frequencies: Sequence[float] = ()) -> str:
    which = f" at {both([f'{own:.4g}' for own in frequencies])} Hz" if frequencies else ""
    return (
        f"The decay of a mode{which} is not determined. It dies at once, or modes make up for one another: there may "
        "be fewer modes, or others."
    )


def _peak(frequency: float, share: float, loud: bool) -> str:
    more = ": what is left is not all noise (a nonlinearity, a drifting amplitude, another tone)" if loud else ""
    return (
        f"The strongest peak that is left, at {frequency:.4g} Hz, is {share:.2f} of the highest that noise alone "
        f"mostly has{more}."
    )


def _undamped(frequencies: Sequence[float], on: int) -> str:
    heard = ", ".join(f"{frequency:.4g}" for frequency in frequencies)
    return (
        f"Lines that do not decay, at {heard} Hz, are a steady response: that to a force, or a limit cycle. "
        f"{on} of {len(frequencies)} are at multiples of half the fundamental."
    )


def _families(lines: int, spacings: int, families: int, frequency: float, odds: float) -> str:
    spaced = "one spacing" if spacings == 1 else f"{spacings} spacings"
    several = "one family" if families == 1 else f"{families} families"
    return (
        f"{lines} lines that decay are {several} with {spaced} of multiples of {frequency:.6g} Hz; odds against "
        f"chance, from frequencies alone, are 1e{odds:.1f}."
    )


def _disagree(frequency: float, share: float, probability: float) -> str:
    chance = "below 1e-99" if probability < 1e-99 else f"{probability:.2g}"
    return (
        f"The hits disagree on the shape of the mode at {frequency:.4g} Hz by {100.0 * share:.2g} % (by chance: "
        f"{chance}), so no one shape was fitted. Two modes may share its multiplier, or its shape may depend "
        "on the amplitude of the blow. Identify each hit alone and compare."
    )


FIT: dict[str, str | Callable[..., str]] = {
    "all_needed": _needed,
    "strongest_peak": _peak,
    "coloured_noise": "The noise is not white along the record: about {loud:.4g} Hz it is {ratio:.3g} times that about "
    "{quiet:.4g} Hz. It is taken for white: the intervals of modes are too short where it is loud, and too long where "
    "it is quiet; a weak mode where it is loud may be noise.",
    "interference": "A steady tone at {frequency:.5g} Hz, {amplitude:.3g} {unit} in channel {channel}: it does not "
    "decay, and nothing beside it follows the period. Interference (the mains, another machine), or a mode whose decay "
    "this record does not show: it was fitted beside the modes and taken off.",
    "cluster": "The mode at {frequency:.4g} Hz is most likely a cluster of several that fold onto one another: its "
    "harmonics ask for different exponents. Its deviation covers them.",
    "one_shape": "The {hits} hits share one shape of each mode: they differ by its state in each hit alone.",
    "hits_disagree": _disagree,
    "double": "The modes at {first:.4g} Hz and {second:.4g} Hz are whole numbers of fundamentals apart within "
    "{decays:g} of their decay: they may be one mode with harmonics that its band leaves out.",
    "one_that_moves": "The modes at {first:.4g} Hz and {second:.4g} Hz have one shape and are nearer to each other "
    "than they decay: most likely one mode whose frequency or damping changes over the record, by a drift or with its "
    "amplitude. Neither damping is to be believed: use a later part of the record (`skip=`), or a smaller blow.",
    "kind_open": "The mode at {frequency:.4g} Hz is a pair of conjugates or two real multipliers: this record does not "
    "tell which. The two exponents differ by at most {apart:.2g} 1/s either way, and their deviations cover both.",
    "hidden_partner": "A second real multiplier with a decay within {apart:.2g} 1/s of {decay:.4g} 1/s, at "
    "{frequency:.4g} Hz, would not be seen in this record. A hit with another start tells.",
    "product": lambda frequency, of: (
        f"The mode at {frequency:.4g} Hz is most likely no mode: its multiplier is a product of those at "
        f"{both([f'{own:.4g} Hz' for own in of])}, which a nonlinearity makes."
    ),
    "search_ended": "The search for modes was ended at {number}, the most that it may find, with more to be found. "
    "So many are often noise that is not white along the record, or what a nonlinearity leaves.",
    "undetermined": _undetermined,
    "out_of_time": "The search for modes was ended after {seconds:.4g} s of processor time: modes or harmonics may be "
    "missing, and a pair may be two real multipliers. Give it longer (`seconds`); a shorter record, or fewer channels, "
    "end sooner.",
    "undamped_lines": _undamped,
    "line_families": _families,
    "beside_steady": lambda turns: (
        f"A steady response, {both([f'{turn:g}' for turn in turns[:8]])} times the fundamental, was taken off first: "
        "an orbit on which nothing is seen to decay. A limit cycle shows its multipliers where it is disturbed, and "
        "only those that last for some samples: disturb it more, or sample faster."
    ),
}
"""By code."""
