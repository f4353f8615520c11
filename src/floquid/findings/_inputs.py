"""Words of findings on records whose excitation goes on, with measured inputs or without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction

from floquid.findings._phrases import both

MOST_NAMED = 12
"""Harmonics of a response that repeats, at most, that are named one by one."""


def _at(frequencies: Sequence[float]) -> str:
    """Modes by their frequencies: «mode at 0.2 Hz»."""
    return f"mode{'s' if len(frequencies) > 1 else ''} at {both([f'{own:.4g}' for own in frequencies])} Hz"


AMBIENT: dict[str, str | Callable[..., str]] = {
    "ambient_constant": "No harmonic of any shape but the largest rises above the noise: the record does not show that "
    "the system is periodic.",
    "ambient_single": lambda frequencies: (
        f"One harmonic alone: {_at(frequencies)}. Likely the excitation's own, coloured there, or a part that the "
        "rotation does not reach."
    ),
    "ambient_slow": lambda frequencies: (
        f"Hardly changes within the record: {_at(frequencies)}. Likely a drift, a wandering offset or an amplitude of "
        "the orbit that changes, no mode. Take it off before, record for longer, or leave the channel out."
    ),
    "ambient_line": lambda frequencies: (
        f"Neither decays nor grows within the record: {_at(frequencies)}. Likely a line of the mains or of another "
        "machine, no mode. Take it off before; if it is a mode, its decay needs a longer record."
    ),
    "ambient_fast": lambda frequencies: (
        f"Too fast to be told from the excitation's own: {_at(frequencies)}. What is gone within a period may be "
        "the system's, or coloured excitation that reaches it; of outputs alone both look the same."
    ),
    "ambient_real": lambda frequencies: (
        f"Decays without turning, for longer than a period: {_at(frequencies)}. It may be the system's, a slow part of "
        "the excitation, or a mode too many that takes up what the others leave; of outputs alone all look the same."
    ),
    "ambient_length": "Random excitation tells little of damping: that at {frequency:.4g} Hz is known to {share:.0%}, "
    "and to 10 % it needs {seconds:.3g} s, {periods:.3g} periods.",
    "ambient_alike": lambda frequencies: (
        f"Nearer to each other than they decay, or than their deviations tell: {_at(frequencies)}. They may be one, or "
        "coloured excitation; what is gone within a period is no claim then."
    ),
    "ambient_short": lambda frequencies, deviations: (
        f"The fit ended {deviations:.2g} deviations short of its maximum, in a narrow valley or next to growing: "
        f"{_at(frequencies)}. Exponents may be off by as much more than their deviations say. Where no other "
        "force acts beside measured inputs leave `excitation` out, else take a longer record."
    ),
}
"""By code."""


HOLDS = {
    "zero": "held between samples",
    "first": "linear between samples",
    "none": "acting at samples alone",
}
"""Words for inputs between their samples."""


def _inputs(channels: Sequence[str], hold: str) -> str:
    return f"Input{'s' * (len(channels) > 1)} {both(list(channels))}, {HOLDS[hold]}."


def _steady(harmonics: Sequence[float]) -> str:
    whole = all(float(own).is_integer() for own in harmonics)
    words = [str(Fraction(own).limit_denominator(999)) for own in harmonics]
    if len(words) > MOST_NAMED:
        words = [f"{', '.join(words[:MOST_NAMED])}, …", words[-1]]
    of = "period" if whole else "period or the revolution"
    return f"A response that repeats with the {of} was fitted beside the modes: {both(words)} a period."


def _instants(delay: int, hold: str, given: str) -> str:
    if delay:
        when = "came one sample later" if delay > 0 else "came one sample earlier"
        remedy = "If so, move them against the outputs"
    else:
        when, remedy = f"were {HOLDS[hold]}, not {HOLDS[given]}", f'If so, use hold="{hold}"'
    return (
        f"The response is explained better, and with fewer parameters, if the inputs {when}: the way that they reach "
        f"the modes would look right and be wrong. {remedy}."
    )


def _untold(delay: int, hold: str, given: str, share: float) -> str:
    if delay:
        when = "later" if delay > 0 else "earlier"
        return (
            f"The record does not tell the inputs as they are from the same one sample {when}: exponents and shapes "
            f"would be the same, but b would differ by {share:.0%}, and the direct term would be another, or none. "
            "Make sure of the instants of the inputs, or drive harder, or for longer."
        )
    return (
        f"The record does not tell inputs {HOLDS[given]} from inputs {HOLDS[hold]}: exponents and shapes would be the "
        f"same, but b and the direct term would be others, and G by at most some {share:.0%} at the modes. "
        'A converter holds its inputs (`hold="zero"`), a force that was measured runs on (`hold="first"`).'
    )


def _line(frequencies: Sequence[float], periods: int, real: bool, forced: Sequence[int] = ()) -> str:
    many = len(frequencies) > 1
    what = "do not decay and are at multiples" if many else "does not decay and is at a multiple"
    other = ", or a real negative multiplier at the limit of stability" if real else ""
    remedy = (
        f'Name it by its harmonics of the revolution, and it is fitted beside: `forced="{",".join(map(str, forced))}"`.'
        if forced
        else f"If a revolution holds {periods} periods, say so: `periods_per_revolution={periods}`."
    )
    return (
        f"The {_at(frequencies)} {what} of 1/{periods} of the period's frequency: likely no mode{'s' * many}, but what "
        f"drives the system once in {periods} periods, as an imbalance does{other}. {remedy}"
    )


def _unreached(frequency: float, line: bool) -> str:
    if line:
        return (
            f"No input reaches what is at {frequency:.4g} Hz, and it does not decay within the record. Likely it is a "
            "line of the mains or of another machine. Take it off before, or measure what drives it."
        )
    return f"No input reaches the mode at {frequency:.4g} Hz as far as the record shows: only its first state does."


def _began(record: int, seconds: float, channels: Sequence[str] = ()) -> str:
    who = f"{both(list(channels))} {'stand' if len(channels) > 1 else 'stands'}" if channels else "All inputs stand"
    return (
        f"{who} still in the first {seconds:.4g} s of record {record}, where the response does not ring down. "
        "Likely the measurement of the inputs began later. Cut the record there, or leave it out."
    )


def _driven(squares: float, limit: float, sure: bool) -> str:
    size = f"squared scores of {squares:.3g}; noise of sensors alone stays below {limit:.3g}"
    if sure:
        return (
            f"The residual follows through the modes from the residual before ({size}): something drives the system "
            "beside the inputs. It may be a force that nobody measured, noise on the measured inputs or a feedback. "
            'Deviations are too small. Measure the inputs better, or use `excitation="ambient"` with these inputs.'
        )
    return (
        f"The residual follows a little through the modes from the residual before ({size} in 99 of 100 records). "
        "Likely there is a little noise on the measured inputs, or a weak force that nobody measured; deviations are "
        'then too small. A longer record tells. `excitation="ambient"` with these inputs takes account of a force.'
    )


INPUTS: dict[str, str | Callable[..., str]] = {
    "inputs": _inputs,
    "steady_beside_inputs": _steady,
    "lines_between": "There are lines between the multiples of the period's frequency, at multiples of 1/{periods} of "
    "it: an imbalance, where a revolution holds {periods} periods? They were fitted beside the modes. If it does, say "
    "so: `periods_per_revolution={periods}`; if not, the period is another one, or a mode hardly decays, which "
    '`forced="none"` leaves in.',
    "line_as_mode": _line,
    "states_unfit": "A(t) was not rebuilt: {reason}",
    "inputs_free": "Harmonics go on to the Nyquist frequency: the matrices at each of the {phases} phases were fitted, "
    "all of them free. Between the samples the model says nothing.",
    "unreached": _unreached,
    "inputs_began": _began,
    "inputs_poor": lambda channels: (
        f"It is not determined how {both(list(channels))} reach{'es' * (len(channels) == 1)} the modes: a blow at one "
        "phase of the period, one frequency alone, or one that does next to nothing does not tell the harmonics of b. "
        "Exponents and shapes stand; b, B(t) and transfer functions from there do not. Excite at random, or with blows "
        "at many phases."
    ),
    "outliers": lambda channel, number, share, record, sample: (
        f"{number} sample{'s' * (number > 1)} of {channel} {'are' if number > 1 else 'is'} many deviations off (the "
        f"first is sample {sample} of record {record}), {share:.0%} of the power that is left: spikes, no response? "
        "Cut the record there, into two records."
    ),
    "inputs_instants": _instants,
    "inputs_untold": _untold,
    "inputs_nonlinear": "What is left goes with squares and cubes of the response (squared scores of {squares:.3g}; "
    "noise alone stays below {limit:.3g}): the system is not linear at this force, and exponents are those of this "
    "level. Drive it less.",
    "inputs_noise": _driven,
    "inputs_harmonics": "A mode has as many harmonics as are looked for ({most}): what it has beyond them is missing. "
    "Name a number that is enough: `harmonics`.",
    "measured_repeats": "{repeats} repeats of {turns} periods; the first {dropped} of each record are left out.",
    "measured_polynomials": "Polynomials over {lines} lines, {width:.3g} Hz: a resonance that is not several times as "
    "wide is flattened.",
    "measured_flattened": "Polynomials of a higher degree explain {ratio:.3g} times the power of the noise more: a "
    "resonance is flattened, deviations there are too small. Record for longer, or fit a model: "
    "`identify` with these `inputs`.",
    "measured_transient": "The first repeat that is used differs from the others by {ratio:.3g} times the power of the "
    "noise at some lines: what rang at the begin is not over, or the input is not the same. What is not linear is "
    "not told beside it. Leave out more than {dropped}.",
    "measured_nonlinear": "Output {channel} has {ratio:.3g} times the power of the noise at lines where a linear "
    "system has none: it is not linear at this force, or does not repeat with that period.",
    "modes_of_lines": "Modes fitted to the lines: {modes}. They leave {ratio:.3g} times the variance, {degrees} "
    "degrees of freedom.",
    "modes_of_lines_real": "A pair of modes is within its deviation of the axis of real multipliers: it may be two "
    "real ones, which these lines do not part. Its decay may be off by many deviations. Lines of less noise tell, or "
    "`identify` on the record itself.",
    "modes_of_lines_undetermined": lambda frequencies: (
        f"The decay is not determined: {_at(frequencies)}. A resonance falls between the lines, or modes make up for "
        "one another: exponents may be wrong, and how many there are. Record for longer, so that lines are closer, or "
        "use `identify` on the record itself."
    ),
    "modes_of_lines_flattened": lambda frequencies, window: (
        f"Narrower than the {window:.3g} Hz over which the lines were smoothed: {_at(frequencies)}. That flattens a "
        "resonance: decays are too large, and two modes may stand for one. "
        "Record for longer, or use `identify` on the record itself."
    ),
    "modes_of_lines_misfit": "The modes leave {ratio:.3g} times the variance of the lines: modes are missing, the "
    "system is not linear, or the deviations of the lines are too small. All deviations are widened by its root.",
    "inputs_copies": "Two modes are nearly one, and have as many harmonics as are looked for ({most}): one is likely a "
    "copy that makes up for harmonics beyond them. Name a number that is enough, `harmonics`, or sample faster.",
}
"""By code."""
