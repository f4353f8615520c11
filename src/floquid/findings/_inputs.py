"""Words of findings on records whose excitation goes on, with measured inputs or without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction

from floquid.findings._phrases import both, hertz

MOST_NAMED = 12  # harmonics of a repeating response that are named one by one: more make the line unreadable


def _at(frequencies: Sequence[float]) -> str:
    """Modes by their frequencies: «mode at 0.2 Hz»."""
    return f"mode{'s' * (len(frequencies) > 1)} at {hertz(frequencies)}"


AMBIENT: dict[str, str | Callable[..., str]] = {
    "ambient_constant": "No harmonic of any shape but the largest rises above the noise: the record does not show that "
    "the system is periodic.",
    "ambient_single": lambda frequencies: (
        f"Only one harmonic: {_at(frequencies)}. It may be a peak of the excitation, or a part that the rotation does "
        "not reach."
    ),
    "ambient_slow": lambda frequencies: (
        f"Hardly changes within the record: {_at(frequencies)}. It may be a drift, a wandering offset or a changing "
        "amplitude of the orbit, not a mode. Take it off before, record longer, or leave the channel out."
    ),
    "ambient_line": lambda frequencies: (
        f"Neither decays nor grows within the record: {_at(frequencies)}. It may be the mains or another machine, not "
        "a mode. Take it off before. If it is a mode, its decay needs a longer record."
    ),
    "ambient_fast": lambda frequencies: (
        f"Decays within a period: {_at(frequencies)}. Outputs alone do not tell such a mode from coloured excitation."
    ),
    "ambient_real": lambda frequencies: (
        f"Decays without oscillation, for longer than a period: {_at(frequencies)}. It may be a mode, a slow part of "
        "the excitation, or one mode too many. Outputs alone do not tell."
    ),
    "ambient_length": "Random excitation tells little of damping: that at {frequency:.4g} Hz is known to {share:.0%}. "
    "For 10 % it needs {seconds:.3g} s, {periods:.3g} periods.",
    "ambient_alike": lambda frequencies: (
        f"Nearer to each other than their decay or their deviations: {_at(frequencies)}. They may be one, or coloured "
        "excitation. Do not quote those that die within a period."
    ),
    "ambient_short": lambda frequencies, deviations, inputs=False: (
        f"The fit stopped {deviations:.2g} deviations short of its maximum: {_at(frequencies)}. Exponents may be off "
        "by that much more than their deviations. Use a longer record."
        + (" Where nothing acts beside the measured inputs, leave `excitation=` out." if inputs else "")
    ),
}
"""By code."""


HOLDS = {"zero": "held between samples", "first": "linear between samples", "none": "acting at samples alone"}
"""Words for inputs between their samples."""


def _inputs(channels: Sequence[str], hold: str) -> str:
    return f"Input{'s' * (len(channels) > 1)} {both(list(channels))}, {HOLDS[hold]}."


def _steady(harmonics: Sequence[float]) -> str:
    whole = all(float(harmonic).is_integer() for harmonic in harmonics)
    words = [str(Fraction(harmonic).limit_denominator(999)) for harmonic in harmonics]
    if len(words) > MOST_NAMED:
        words = [f"{', '.join(words[:MOST_NAMED])}, …", words[-1]]
    of = "period" if whole else "period or the revolution"
    return f"A response that repeats with the {of} was fitted beside the modes; {both(words)} a period."


def _instants(delay: int, hold: str, given: str) -> str:
    if delay:
        when = f"came one sample {'later' if delay > 0 else 'earlier'}"
        remedy = "If so, move them against the outputs"
    else:
        when, remedy = f"were {HOLDS[hold]}, not {HOLDS[given]}", f'If so, use `hold="{hold}"`'
    return (
        f"The response is explained better, with fewer parameters, if the inputs {when}. b and G would look right and "
        f"be wrong. {remedy}."
    )


def _untold(delay: int, hold: str, given: str, share: float) -> str:
    if delay:
        return (
            f"The record does not tell the inputs from the same one sample {'later' if delay > 0 else 'earlier'}. "
            f"Exponents and shapes would be the same; b would differ by {share:.0%}, and the direct term entirely. "
            "Check the delay of the inputs, or drive harder, or for longer."
        )
    return (
        f"The record does not tell inputs {HOLDS[given]} from inputs {HOLDS[hold]}. Exponents and shapes would be the "
        f"same; b and the direct term would differ, and G by up to {share:.0%} at the modes. For a D/A converter use "
        '`hold="zero"`, for a measured force `hold="first"`.'
    )


def _line(frequencies: Sequence[float], periods: int, real: bool, forced: Sequence[int] = ()) -> str:
    many = len(frequencies) > 1
    what = "do not decay and are at multiples" if many else "does not decay and is at a multiple"
    other = " Or it is a real negative multiplier at the limit of stability." if real else ""
    remedy = (
        f'Have it fitted beside the modes: `forced="{",".join(map(str, forced))}"`.'
        if forced
        else f"If a revolution holds {periods} periods, say so: `periods_per_revolution={periods}`."
    )
    return (
        f"The {_at(frequencies)} {what} of 1/{periods} of the period's frequency. Likely no mode{'s' * many}, but a "
        f"force once in {periods} periods, such as an imbalance.{other} {remedy}"
    )


def _unreached(frequencies: Sequence[float], line: bool) -> str:
    several = len(frequencies) > 1
    if line:
        decays, may, them = ("they do", "They", "them") if several else ("it does", "It", "it")
        return (
            f"No input reaches the {_at(frequencies)}, and {decays} not decay within the record. {may} may be the "
            f"mains or another machine. Take {them} off before, or measure what drives {them}."
        )
    shown = "only their initial states show them" if several else "only its initial state shows it"
    return f"No measured input reaches the {_at(frequencies)} in this record; {shown}."


def _began(record: int, seconds: float, channels: Sequence[str] = ()) -> str:
    which = f"{both(list(channels))} {'are' if len(channels) > 1 else 'is'}" if channels else "All inputs are"
    return (
        f"{which} constant in the first {seconds:.4g} s of record {record}, but the response does not ring down there. "
        "The inputs may have been measured from later on. Cut the record there, or leave it out."
    )


def _driven(squares: float, limit: float, sure: bool) -> str:
    if sure:
        return (
            f"Something drives the system beside the inputs (squared scores {squares:.3g}, limit {limit:.3g}). "
            "Deviations count it to first order. It may be an unmeasured force, noise on the measured inputs or a "
            "feedback. "
            'Measure the inputs better, or use `excitation="ambient"` with these inputs.'
        )
    return (
        f"Something may drive the system a little beside the inputs (squared scores {squares:.3g}, limit {limit:.3g} "
        "in 99 of 100 records). Deviations count it to first order. A longer record decides. For a force use "
        '`excitation="ambient"` with these inputs.'
    )


INPUTS: dict[str, str | Callable[..., str]] = {
    "inputs": _inputs,
    "steady_beside_inputs": _steady,
    "lines_between": "There are lines at multiples of 1/{periods} of the period's frequency; they were fitted beside "
    "the modes. If a revolution holds {periods} periods, say so: `periods_per_revolution={periods}`. If not, check the "
    'period; `forced="none"` leaves them to the modes.',
    "line_as_mode": _line,
    "states_unfit": "A(t) was not rebuilt: {reason}",
    "inputs_free": "Harmonics go on to the Nyquist frequency, so the matrices at each of the {phases} phases were "
    "fitted freely. The model says nothing between the samples.",
    "unreached": _unreached,
    "inputs_began": _began,
    "inputs_poor": lambda channels: (
        f"The harmonics of b are not determined for {both(list(channels))}. Exponents and shapes stand; b, B(t) and "
        "transfer functions from there do not. Blows at one phase, or one frequency alone, are not enough: excite at "
        "random, or at many phases."
    ),
    "outliers": lambda channel, number, share, record, sample: (
        f"{number} sample{'s' * (number > 1)} of {channel} {'are' if number > 1 else 'is'} many deviations off, with "
        f"{share:.0%} of the residual's power; the first is sample {sample} of record {record}. They may be spikes. "
        "Cut the record there, into two records."
    ),
    "inputs_instants": _instants,
    "inputs_untold": _untold,
    "inputs_nonlinear": "The residual follows squares and cubes of the response (squared scores {squares:.3g}, limit "
    "{limit:.3g}). The system is not linear at this force, and exponents belong to this level. Drive it less.",
    "inputs_noise": _driven,
    "inputs_harmonics": "A mode has as many harmonics as were looked for ({most}), and more may be missing. Raise "
    "`harmonics=`.",
    "measured_repeats": "{repeats} repeats of {turns} periods; the first {dropped} of each record are left out.",
    "measured_polynomials": "Polynomials over {lines} lines, {width:.3g} Hz: a resonance that is not several times as "
    "wide is flattened.",
    "measured_flattened": "Polynomials of a higher degree explain {ratio:.3g} times the noise power more. A resonance "
    "is flattened, and deviations there are too small. Record longer, or fit a model: `identify` with these `inputs`.",
    "measured_transient": "The first repeat used differs from the others by {ratio:.3g} times the noise power at some "
    "lines. The transient is not over, or the input differs, so nonlinearity was not tested. Leave out more than "
    "{dropped} (`drop=`).",
    "measured_nonlinear": "Output {channel} has {ratio:.3g} times the noise power at lines where a linear system has "
    "none. It is not linear at this force, or does not repeat with that period.",
    "modes_of_lines": "Modes fitted to the lines: {modes}. Their residual has {ratio:.3g} times the variance, with "
    "{degrees} degrees of freedom.",
    "modes_of_lines_real": "A pair of modes is within its deviation of the real axis: these lines do not tell it from "
    "two real multipliers. Its decay may be off by many deviations. Measure lines with less noise, or use `identify` "
    "on the record.",
    "modes_of_lines_undetermined": lambda frequencies: (
        f"The decay is not determined: {_at(frequencies)}. A resonance falls between the lines, or modes cancel one "
        "another. Exponents and their number may be wrong. Record longer, for closer lines, or use `identify` on the "
        "record."
    ),
    "modes_of_lines_flattened": lambda frequencies, window: (
        f"Narrower than the {window:.3g} Hz over which the lines were smoothed: {_at(frequencies)}. Decays are too "
        "large, and two modes may stand for one. Record longer, or use `identify` on the record."
    ),
    "modes_of_lines_misfit": "The residual of the modes has {ratio:.3g} times the variance of the lines. All "
    "deviations are widened by its root. Modes may be missing, the system may not be linear, or the deviations of the "
    "lines may be too small.",
    "inputs_copies": "Two modes are nearly one, and have as many harmonics as were looked for ({most}). One is likely "
    "a copy that replaces missing harmonics. Raise `harmonics=`, or sample faster.",
}
"""By code."""
