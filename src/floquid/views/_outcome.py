"""Results beside the modes, a line each: noise, order, period, forced response, verdict."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from floquid._arrays import Floats
from floquid._checks import counted
from floquid.checks import Validation
from floquid.core import Channel, ModelInputs
from floquid.findings import Severity, texts
from floquid.pipeline import Analysis
from floquid.preparation import in_phase
from floquid.views._mode_table import mode_notes, with_error
from floquid.views._names import SpeedUnit, speed_texts, speed_words

ORDER = "all_needed"  # the code of the finding that the line on the order has
IN_LINES = (ORDER, "forced", "interference")  # the codes of all findings that a line of the outcome has, in short
AGREE = 3.0  # deviations within which two periods agree: beyond, chance has three in a thousand
BRIEF = 10  # periods of the longest record up to which multipliers have a line of their own
MOST_NAMED = 6  # harmonics of the forced response that are named


def outcome_lines(analysis: Analysis, speed_unit: SpeedUnit = "hz") -> dict[str, str]:
    """The outcome of an `analysis` beside its modes: the short lines that have something to say, by their names.

    The speed of the shaft is in `speed_unit`.
    """
    own = analysis.model.inputs
    lines = {
        "Innovations" if analysis.ambient else "Noise": _noise(analysis),
        "Order": _order(analysis),
        "Multipliers": _multipliers(analysis),
        "Period": _period(analysis, speed_unit),
        "Forced response": _forced(analysis),
        "Interference": _interference(analysis),
        "Reach": "" if own is None else _reach(analysis, own),
        "Direct": "" if own is None else _direct(own),
        "Verdict": verdict_line(analysis) + _untold(analysis),
    }
    return {name: words for name, words in lines.items() if words}


def done_words(analysis: Analysis, unit: SpeedUnit, *, beside_lines: bool = False) -> list[str]:
    """Steps of preparing the records of an `analysis`, and its notes, a sentence each, speeds in a `unit`.

    Without the order, and where they stand `beside_lines` without any note that a line of the outcome has.
    """
    steps = [step for record in analysis.records for step in record.provenance.steps]
    known = IN_LINES if beside_lines else (ORDER,)
    notes = speed_texts((own for own in analysis.findings if own.code not in known), unit, Severity.NOTE)
    return list(dict.fromkeys([*steps, *notes]))


def cycle_words(analysis: Analysis) -> list[str]:
    """The numbers of periods of each hit of an `analysis` that were fitted, and of how many if its modes end before."""
    assert analysis.decay is not None
    fitted, later = [hit.n_cycles for hit in analysis.cycles], analysis.decay.fit.later
    if later is None:
        return [str(cycles) for cycles in fitted]
    return [f"{cycles} of {cycles + more}" if more else str(cycles) for cycles, more in zip(fitted, later, strict=True)]


def in_short(words: str) -> tuple[str, str]:
    """The first sentence of the `words` of a finding, and its remedy, empty where there is none.

    The remedy is the first other sentence that names an option, else the last: a finding says what was seen, then what
    that means, then what to do.
    """
    first, *rest = re.split(r"(?<=\.)\s+(?=[A-Z])", words)
    return first, next((sentence for sentence in rest if "`" in sentence), rest[-1] if rest else "")


def verdict_line(analysis: Analysis) -> str:
    """The verdict on the model of an `analysis` in a line, with what it rests on if it passed."""
    if analysis.answer == "passes":
        assert analysis.validation is not None
        return f"passes: {passed_words(analysis.validation)}"
    if analysis.passed:
        return f"{analysis.answer} of the response, beyond the noise"
    return f"{analysis.answer}, for {counted(len(analysis.reasons), 'reason')}" if analysis.reasons else analysis.answer


def _noise(analysis: Analysis) -> str:
    if analysis.decay is None:
        levels = ", ".join(
            f"{value:.3g}{'' if channel.unit == '-' else f' {channel.unit}'} in {channel.name}"
            for value, channel in zip(analysis.noise[:, 0], analysis.model.channels, strict=True)
        )
        return f"each sample is predicted to {levels}" if analysis.ambient else f"taken for white, {levels}"
    peaks = np.array([np.abs(hit.values).max(axis=(1, 2)) for hit in analysis.cycles]).T
    shares = 100.0 * analysis.noise / peaks
    low, high = f"{shares.min():.2g}", f"{shares.max():.2g}"
    size = f"{low} %" if low == high else f"{low} to {high} %"
    if analysis.failed:
        return f"what the model leaves, noise and all, is {size} of the peaks"
    if analysis.whitening is None:
        return f"taken for white, {size} of the peaks"
    return f"coloured along the record; after the filter that whitens it, {size} of the peaks"


def _order(analysis: Analysis) -> str:
    order, modes = analysis.model.order, len(analysis.model.upper_modes)
    if analysis.settings.order is not None:
        return f"{order}, as asked for"
    if analysis.choice is None:
        needed = texts(own for own in analysis.findings if own.code == ORDER)
        return f"{order}. {' '.join(needed)}" if needed else ""
    if analysis.choice.ambiguous:
        return f"{order}, ambiguous: the warnings say why"
    weak = sum("weak" in mode_notes(analysis, r) for r in analysis.model.upper_modes)
    needed = "the one mode is needed" if modes == 1 else f"each of the {modes} modes is needed"
    return f"{order}, clear: {needed}" + (f", {weak} weakly determined" if weak else "")


def _multipliers(analysis: Analysis) -> str:
    """The multipliers with their intervals, where records are so brief that a period is much of a decay."""
    model, decay = analysis.model, analysis.decay
    if decay is None or max(hit.n_cycles for hit in decay.cycles) > BRIEF:
        return ""
    values, ends = model.multipliers, model.multiplier_interval
    words = []
    for mode in model.upper_modes:
        sides = None if ends is None else ends[mode]
        value, span = _within(values[mode].real, None if sides is None else sides[0])
        if not model.unpaired[mode]:
            imaginary, across = _within(abs(values[mode].imag), None if sides is None else sides[1])
            value, span = f"{value} ± {imaginary}i", f"{span} and {across}" if span else ""
        words.append(f"{value} ({span})" if span else value)
    return "; ".join(words) + ("" if ends is None else "; in brackets 95 % intervals")


def _within(value: float, ends: Floats | None) -> tuple[str, str]:
    """A value and the ends of its interval, to two digits of its width; four digits without one."""
    if ends is None or not ends[1] > ends[0]:
        return f"{value:.4g}", ""
    digits = int(np.clip(2 - np.ceil(np.log10(ends[1] - ends[0])), 0, 10))
    return f"{value:.{digits}f}", f"{ends[0]:.{digits}f} to {ends[1]:.{digits}f}"


def _period(analysis: Analysis, unit: SpeedUnit) -> str:
    between = in_phase(analysis.findings)
    if analysis.shafts or between:
        how = "the mean between events" if between else "the mean by the shaft angle"
    else:
        how = "fitted to the response" if analysis.clocks[0].fitted else "as given"
        if any(own.code == "speed_fitted" for own in analysis.findings):
            how += " (pulses are known to a sample)"
    line = f"{period_words(analysis)} s ({speed_words(analysis, unit)}), {how}"
    tested = analysis.periodicity
    if analysis.decay is not None and analysis.decay.fit.own_period is not None and not between:
        difference, std = analysis.decay.fit.own_period
        agrees = "agrees" if abs(difference) < AGREE * std else "differs"
        line += f"; the response {agrees} ({100.0 * difference:+.1g} ± {100.0 * std:.1g} %)"
    if tested is None or not tested.degrees:
        return line
    p = "p < 1e-300" if tested.p_value < 1e-300 else f"p = {tested.p_value:.2g}"
    words = {True: "time-periodic", False: "nothing periodic is seen", None: "periodicity undecided"}
    return f"{line}; {words[tested.periodic]} ({p})"


def _untold(analysis: Analysis) -> str:
    told = analysis.failed or analysis.model.exponent_std is not None
    return "" if told else "; this identifier gives no deviations, so the errors of the exponents are unknown"


def _interference(analysis: Analysis) -> str:
    tones = [tone.numbers for tone in analysis.interference]
    return "; ".join(
        f"{tone['frequency']:.5g} Hz, {tone['amplitude']:.3g}{'' if tone['unit'] == '-' else ' ' + tone['unit']} in "
        f"{tone['channel']}, taken off"
        for tone in tones
    )


def _forced(analysis: Analysis) -> str:
    forced = analysis.forced
    if forced is None:
        return ""
    parts = ["offset"] * bool(forced.offset.any()) + ["drift"] * bool(forced.drift.any())
    if len(forced.harmonics):
        names = [str(j) for j in forced.harmonics[:MOST_NAMED]] + ["…"] * (len(forced.harmonics) > MOST_NAMED)
        parts.append(f"{', '.join(names)} per revolution")
    return f"{' and '.join(parts)}, fitted beside the modes"


def _direct(own: ModelInputs) -> str:
    return f"at harmonics {own.direct_harmonics[0]}…{own.direct_harmonics[-1]}" if own.direct.size else ""


def _reach(analysis: Analysis, own: ModelInputs) -> str:
    """The input and the harmonic that do most to each mode, by the rms of the input."""
    model, driven = analysis.model, analysis.driven
    assert driven is not None
    size = driven.samples.input_size
    none = [own for one in analysis.findings if one.code == "unreached" for own in one.numbers["frequencies"]]
    words = []
    for number, mode in enumerate(model.upper_modes, start=1):
        if np.isclose(model.frequencies_hz[mode], none, rtol=1e-9).any():
            words.append(f"mode {number} by none")
            continue
        strength = np.abs(own.coefficients[mode]) * size[:, None]
        source, harmonic = np.unravel_index(int(np.argmax(strength)), strength.shape)
        turn = int(own.harmonics[harmonic])
        words.append(f"mode {number} by {own.channels[source].name}" + (f" at {turn:+d} a period" if turn else ""))
    return "; ".join(words)


def passed_words(validation: Validation) -> str:
    """Achievements of a model with a verdict in its favour (`validation`), in a sentence without its beginning."""
    error = validation.metrics["held_out_error"]
    if "fit" not in validation.metrics:
        return f"the last quarter, left out of a fit, is predicted to {error:.3g} times the expected error at most."
    fit = validation.metrics["fit"]
    return (
        f"{fit:.1%} of the response is predicted in cycles left out, with an error of {error:.3g} times the noise at "
        "most. Noise explains the rest."
    )


def whitening_words(whitening: Floats | None, channels: Sequence[Channel]) -> str:
    """Treatment of noise coloured along the record, by a `whitening` filter of each of the `channels`; may be empty."""
    if whitening is None:
        return ""
    taps = whitening.shape[1] - 1
    those = [c.name for c, own in zip(channels, whitening, strict=True) if own[1:].any()]
    where = "all channels" if len(those) == len(channels) else ", ".join(those)
    return (
        f"The noise is coloured along the record in {where}: a filter of {counted(taps, 'tap')} makes it "
        "white, and poles are found after it."
    )


def period_words(analysis: Analysis) -> str:
    """The period [s] that `identify` found (`analysis`), with its deviation where it was estimated."""
    period, std = analysis.model.period, analysis.period_std
    return f"{period:.8g}" if std is None else with_error(period, std)
