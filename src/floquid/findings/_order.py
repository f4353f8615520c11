"""Words of findings on the order, and on how an identification ended."""

from __future__ import annotations

from collections.abc import Callable


def _mode(real: float | None, share: float) -> str:
    """A mode by its multiplier where that is real, else by its angle over ω."""
    return f"the mode folded to {share:.4f} of ω" if real is None else f"the real multiplier {real:.4g}"


def _needed(needed: bool, modes: int, real: float | None, share: float, rise: float, just: bool) -> str:
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
    "modes_needed": _needed,
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
    "clear free decay, or start it closer to the blow.",
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
