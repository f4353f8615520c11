"""Every sentence for people: it can be made from its numbers, is short, and has none of the phrases that puzzle."""

import re
from string import Formatter

import pytest

from floquid.findings import note
from floquid.findings._finding import WORDS

LONGEST = 25
"""Words of a sentence: beyond, most readers lose its beginning (Cutts, Oxford Guide to Plain English)."""

PUZZLING = re.compile(
    r"\b(but for|of which|so many|by itself|is had by|at the begin|as far as can be told|what is left|told apart)\b",
    re.I,
)

ONE = {"channel": "tip x", "unit": "m/s2", "name": "stiffness with 1 harmonic", "structure": "stiffness 2; damping 0"}
TEXTS = {"what": "pulses", "quantity": "force", "error": "Give a shorter record.", "reason": "Give states."}
NUMBERS = ONE | TEXTS | {"name": "velocity of tip x"}
"""What a template is given; every other field is a number."""

TWO = {"channels": ("tip x", "tip y"), "hits": (1, 2)}
HARMONICS = {"harmonics": (-7, 3), "frequencies": (0.325, 31.5), "shares": (0.017, 0.02), **TWO}
SPREADS = {"names": ("exponents", "system"), "elements": (4, 16), "most": (1.2, 1.3)}
SAMPLES = {
    "clipped": {"channel": "z", "unit": "m", "levels": (-1.0, 1.0), "samples": 12, "share": 0.12},
    "stands_still": {"channel": "z", "unit": "m", "level": 1.0, "first": 1.0, "last": 2.0, "samples": 9},
    "missing_samples": {"channels": ("x", "y"), "first": 1.0, "last": 2.0, "samples": 5, "of": 3},
    "wraps_round": {"channel": "z", "bits": 16, "jumps": 2},
    "impact": {"start": 1.0, "end": 1.1, "strength": 0.5, "double": True, "channel": "hammer"},
    "speed_runs": {"percent": 7.0, "hz": 31.6},
    "between_events": {"records": 20, "periods": 125, "period": 1.1, "spread": 0.012, "phases": 34},
    "common_orbit": {"records": 20, "periods": 125},
    "absent_lines": {"absent": tuple(range(50, 58)), "lines": 60},
    "angle_bridged": {"first": 1.0, "last": 3.5, "revolutions": 25.0, "more": 2},
    "beyond_angle": {"before": 2.0, "after": 3.0},
    "modes_needed": {"needed": False, "modes": 8, "real": None, "share": 0.25, "rise": 1.2, "just": True},
    "hardly_determined": {"number": 2, "real": None, "share": 0.125},
    "nearest_modes": {"gap": 2.1, "near": True},
    "further_mode": {"share": 0.92, "doubtful": True},
    "modes_or_drift": {"number": 2},
    "shared_multipliers": {"number": 2, "hits": 3},
    "white": {"colour": 1.2, "taps": 3, "independent": 0.5},
    "all_needed": {"number": 3, "frequency": 31.2, "rise": 1.4},
    "strongest_peak": {"frequency": 32.81, "share": 105640.18, "loud": True},
    "hits_disagree": {"frequency": 32.81, "share": 0.02, "probability": 1e-120, "groups": [[1, 2], [3]]},
    "several_shapes": {"frequency": 32.81, "number": 2},
    "two_of_one_multiplier": {"frequency": 32.81},
    "hits_unlike": {
        "frequency": 2.5,
        "hits": [1, 3],
        "decays": [0.25, 0.27],
        "frequencies": [2.51, 2.5],
        "probability": 1e-9,
        "torn": True,
    },
    "product": {"frequency": 5.0, "of": (2.0, 3.0)},
    "interference": {"frequency": 50.0, "amplitude": 0.02, "unit": "-", "channel": "tip x"},
    "undetermined": {"frequencies": (2.0, 3.0)},
    "undamped_lines": {"frequencies": (1.25, 2.5), "on": 1},
    "line_families": {"lines": 6, "spacings": 4, "families": 2, "frequency": 2.5, "odds": 3.0},
    "beside_steady": {"turns": (1.0, 2.0)},
    **{
        code: {"frequencies": (0.2, 0.3)}
        for code in ("ambient_single", "ambient_slow", "ambient_line", "ambient_fast", "ambient_real", "ambient_alike")
    },
    "ambient_short": {"frequencies": (0.2, 0.3), "deviations": 1.5},
    "inputs": {"channels": ("F", "G"), "hold": "zero"},
    "steady_beside_inputs": {"harmonics": tuple(0.5 * number for number in range(20))},
    "inputs_instants": {"delay": 0, "hold": "first", "given": "zero"},
    "inputs_untold": {"delay": 0, "hold": "first", "given": "zero", "share": 0.08},
    "line_as_mode": {"frequencies": (15.8, 47.4), "periods": 2, "real": True, "forced": (1, 3)},
    "unreached": {"frequencies": (12.0, 17.0), "line": True},
    "inputs_began": {"record": 2, "seconds": 1.5, "channels": ("F", "G")},
    "inputs_poor": {"channels": ("F", "G")},
    "inputs_noise": {"squares": 99.0, "limit": 21.0, "sure": False},
    "outliers": {"channel": "tip x", "number": 3, "share": 0.4, "record": 1, "sample": 71},
    "modes_of_lines_undetermined": {"frequencies": (2.0, 3.0)},
    "modes_of_lines_flattened": {"frequencies": (2.0, 3.0), "window": 0.4},
    "wrong_period": {"given": 0.04, "own": 0.0400005, "std": 3e-7, "slip": 2.1, "rate": 511.97, "whole": 20},
    "branch_left": {"frequency": 13.7, "share": 0.6},
    "branch_uneven": {"squares": 842.0, "limit": 71.3},
    "period_multiple": {"given": 0.04, "times": 2},
    "period_twice": {"given": 0.04, "even": 900.0, "odd": 3.0, "limit": 21.0},
    "records_phase": {"record": 2, "deviations": 11.0},
    "period_of_orbit": {"period": 0.02, "orbit": 0.04, "harmonics": (1, 3, 5, 7, 9, 11, 13, 15), "symmetric": True},
    "periodic": {"p": 1e-20, "harmonic": 2, "mode": 1, "channel": "tip x"},
    "not_periodic": {"p": 0.5, "least": 0.01, "most": 0.05, "low": 2, "high": 1, "power": 0.95},
    "periodic_untold": {"p": 1e-20, "spacing": 0.4},
    "untested": {"modes": (1, 2), "harmonics": (3, 4)},
    "locked": {"modes": (1, 2)},
    "begins_later": {"periods": 2},
    "impacts": {"instants": (1.0, 2.0), "hits": 2},
    "cut_at_blows": {"instants": (1.0, 2.0), "hits": 2},
    "cut_at_gaps": {"periods": 0.2, "parts": 2},
    "spikes": {"instants": (1.0, 2.0), "number": 2},
    "as_sampled": {"why": "no whole number"},
    "forced": {"orders": (1, 2), "largest": (120.0, 3.0), "follows": True},
    "model_fails": {"misfit": 41.0, "order": True, "harmonics": True, "forced": True},
    "vague_angle": {"degrees": 0.86, "energy": 4.9e5},
    "beside_harmonics": {"frequencies": (32.81, 40.0)},
    "uneven_speed": {"reasons": ("The speed wanders.",)},
    "order_ambiguous": {"order": 4, "doubts": ("A mode may be missing.",)},
    **{
        code: {"channel": "tip x", "shares": (1.0, 2.0), "others": ("tip y", "tip z"), "beside": 0.01}
        for code in ("sum_of_others", "copied_sum", "sum_left_out")
    },
    "tone_left": {"turns": (0.0, 1.0), "per_revolution": 2.0, "sizes": (30.0, 40.0), **TWO},
    "harmonic_left": HARMONICS,
    "line_left": {"frequencies": (32.81, 40.0), "sizes": (30.0, 40.0), **TWO},
    "colour_left": {"squares": (0.02, 0.03), **TWO},
    "held_out_fit": {"fit": 0.71, "channel": "tip x", "hit": 1, "least": 0.5},
    "held_out_error": {"ratio": 3.1, "channel": "tip x", "hit": 1, "part": "first part"},
    "mode_weak": {"frequencies": (2.0,), "shares": (0.4,)},
    "system_other": {"pair": ((1.0, 0.1), (1.1, 0.2)), "trace": True, "composition": 0.02},
    "deviations_hold": {"tested": 20, "draws": 200, "error": 0.05},
    "deviations_wrong": {**SPREADS, "wrong": (1, 2), "least": (1.1, 1.2), "right": ("period",), "error": 0.05},
    "deviations_wide": {"names": ("exponents", "system"), "ratios": (1.5, 2.0), "misfit": True},
    "bias": {**SPREADS, "large": (1, 2)},
    "draws_failed": {"failed": 2, "draws": 200, "numbers": (2,), "errors": ("No mode rises above the noise.",)},
    "draws_orders": {"draws": 20, "same": 18, "orders": (4, 6), "numbers": (18, 2)},
}  # fmt: skip
"""Numbers that a function of words takes, where they make the sentence longest."""


def sample(code):
    """A finding of the code: a template gets a name, or a number of four digits, for each field."""
    if code in SAMPLES:
        return note(code, **SAMPLES[code])
    fields = {field for _, field, _, _ in Formatter().parse(WORDS[code]) if field}
    return note(code, **{field: NUMBERS.get(field, 12.34) for field in fields})


def too_long(text):
    """Sentences of more than so many words; the items of a list, which semicolons part, are counted one by one."""
    return [part for part in re.split(r"(?<=[.?!;])\s+(?=\S)", text) if len(part.split()) > LONGEST]


@pytest.mark.parametrize("code", sorted(WORDS))
def test_each_sentence_is_short_and_plain(code):
    text = str(sample(code))
    assert too_long(text) == []
    assert not PUZZLING.search(text)
    assert text[-1] in ".?"
    assert "{" not in text
    assert not re.search(r"\d -(\s|,|\.)", text)  # a unit that is none


def test_a_hit_that_is_alone_has_a_shape():
    told = str(note("hits_disagree", **{**SAMPLES["hits_disagree"], "groups": [[1], [2, 3]]}))
    assert "Hit 1 has one shape, and hits 2, 3 another." in told


@pytest.mark.parametrize(
    ("decays", "frequencies", "words"),
    [
        ((0.120003, 0.120006), (2.5, 2.5), ("decays by 0.120003 1/s", "decays by 0.120006 1/s")),
        ((0.12, 0.12), (2.500001, 2.500003), ("has 2.500001 Hz", "has 2.500003 Hz")),
        ((0.251234, 0.27), (2.512345, 2.5), ("has 2.5123 Hz", "decays by 0.2512 1/s")),
    ],
    ids=["decays", "frequencies", "far"],
)
def test_values_on_which_hits_disagree_differ_in_print(decays, frequencies, words):
    """Before: «0.12 and 0.12»."""
    told = str(note("hits_unlike", **{**SAMPLES["hits_unlike"], "decays": decays, "frequencies": frequencies}))
    assert all(word in told for word in words)


def test_a_long_sentence_would_be_found():
    text = "The " + "very " * LONGEST + "end."
    assert too_long(f"Short. {text} Short.") == [text]
