"""Every number of section 3 of the paper, and ours beside it: the setup (3), the response (3.1), A(t) (3.2 and 3.3)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from benchmarks.paper._experiment import MASS, WINDOW, Reproduction, cut_errors, paired, uncut
from benchmarks.paper._numbers import Estimate, Number
from benchmarks.paper._truth import frozen_range, instability_edges

from floquid._arrays import Floats
from floquid.core import PeriodicModel
from floquid.pipeline import Analysis
from floquid.reconstruction import reconstruct
from floquid.systems import JeffcottRotor

PRINTED_BANDS = (("0.72", "0.755"), ("0.785", "0.825"), ("0.848", "0.92"))
"""The speeds between which the rotor is unstable, as printed."""

IDENTIFIED = ((-0.002051, 0.1302), (-0.002036, 0.2594))
"""The exponents that the paper identified, real and imaginary parts, as printed."""

ANALYTICAL = (("-0.002000", "0.13034"), ("-0.002000", "0.25939"))  # the exponents that the paper computed, as printed

PARTS = (("real", "Re"), ("imag", "Im"))

SCATTER = "Of a normal error the mean size is 0.8 deviations. The deviations are those of maximum likelihood."

SHOWN = 22  # the index of the 23rd lifted response

FINE = 1440
"""Instants of a period at which the extremes of the stiffness are looked for: every eighth of a degree of the shaft."""

BRANCH = "The harmonics m are counted from the branch on which the dominant one is 0."

_ELEMENTS = (
    ("a31", "A(3,1) at 0°, that is -K11", "-0.5", "z.4f", ""),
    ("k12_at_0", "K12 at 0°", "0", "z.4f", ""),
    ("k12_at_90", "K12 at 90°", "0", "z.4f", ""),
    ("k12_angle", "angle of the largest |K12| [deg]", "45", ".1f", "Where cos 2θ = 1/29, a degree before 45°."),
    ("k12_share", "|K12| over K11 at 45° [%]", "just under 20", ".2f", "Exactly an eighth: 0.068966 of 0.551724."),
    ("k11_swing", "fluctuation of K11, of its least [%]", "about 20", ".1f", "From 0.5 to 0.6."),
)

_ERRORS = (  # key, section, what, printed
    ("three", "3.2", "largest error of A(t), 3 dominant", "0.013"),
    ("three_damping", "3.2", "  in the damping block, of c_f [%]", "almost 100"),
    ("turntable_three", "3.2", "  turntable's states, 3 dominant", "0.031"),
    ("turntable_one_harmonic", "3.2", "  turntable's states, m = -1…1", "0.031"),
    ("turntable_two_harmonics", "3.2", "  turntable's states, m = -2…2", ""),
    ("four", "3.3", "largest error of A(t), 4 dominant", "accurate"),
    ("four_near", "3.3", f"  4 dominant among m = -{WINDOW}…{WINDOW}", "accurate"),
    ("two_harmonics", "3.3", "largest error of A(t), m = -2…2", "accurate"),
    ("three_harmonics", "3.3", "largest error of A(t), m = -3…3", "0.062"),
    ("own", "3.3", "largest error of A(t), floquid's choice", ""),
)

_NOTES = {
    "three": "Corrected is what is left without noise: the exact residues, cut as ours are. The paper's error is 1.3 % "
    "of the largest coefficient, which is 1.",
    "three_damping": "The paper's 0.013 lies in the damping block, whose largest element is c_f = 0.004: that is 325 "
    "%, not almost 100 %.",
    "turntable_three": "The third coefficient of some of the turntable's residues is below the noise. The third "
    "largest of all fifty is then of any harmonic, and A(t) multiplies its error by the square of its frequency.",
    "turntable_one_harmonic": "Three coefficients again, and about the printed error: most of it is the truncation.",
    "four": "The fourth coefficient is below the noise: the fourth largest of all fifty is of any harmonic.",
    "four_near": "The fourth one looked for beside the others only: this may be what the paper did.",
    "two_harmonics": BRANCH,
    "own": "The band of harmonics that `identify` keeps by default.",
}


def numbers(reproduction: Reproduction) -> tuple[Number, ...]:
    """Every number of section 3 of Allen 2009, ours of a `reproduction` beside it, and the right ones."""
    parts = (_rotor, _stability, _record, _peaks, _lifted, _identified, _analytical)
    parts += (_coefficients, _elements, _errors, _decay)
    return tuple(number for part in parts for number in part(reproduction))


def _row(section: str, key: str, what: str, printed: str, ours: Sequence[float | Estimate] = (), **more: Any) -> Number:
    """A number of a section; ours are AMI's and maximum likelihood's, plain where they have no deviation."""
    estimates = [one if isinstance(one, Estimate) else Estimate(value=one) for one in ours]
    ami, ml = estimates or (None, None)
    return Number(section=section, key=key, what=what, printed=printed, ami=ami, maximum_likelihood=ml, **more)


def _both(done: Reproduction) -> tuple[Analysis, Analysis]:
    return done.ami, done.maximum_likelihood


def _given(key: str, what: str, printed: str, value: float, note: str = "") -> Number:
    """A number that is put in, not found."""
    return _row("3", key, what, printed, (value, value), form=".6g", note=note)


def _rotor(done: Reproduction) -> Iterator[Number]:
    rotor = done.rotor
    yield _given("rotor_x", "shaft stiffness k_Rx/k_Fx", "1", rotor.rotor_x)
    yield _given("rotor_y", "shaft stiffness k_Ry/k_Fx", "1.5", rotor.rotor_y)
    yield _given("support_y", "support stiffness k_Fy/k_Fx", "2", rotor.support_y)
    words = "C = c_f K_F as eq. (22) prints it does not give the paper's exponents; C = c_f I does."
    yield _given("damping", "damping factor c_f", "0.004", rotor.damping, words)
    yield _given("speed", "speed of the shaft Ω", "0.5", rotor.speed)
    period = done.maximum_likelihood.model.period
    what = "period T_A, half a revolution"
    yield _row("3", "period", what, "2π", (period, period), corrected=rotor.period, form=".7g")


def _stability(done: Reproduction) -> Iterator[Number]:
    found, truth = [_frozen(analysis) for analysis in _both(done)], frozen_range(done.rotor)
    words = "Ours are from the identified stiffness, whose errors are those of A(t)."
    for index, (key, name, printed) in enumerate((("low", "lowest", "0.707"), ("high", "highest", "0.926"))):
        ours, note = [own[index] for own in found], "" if index else words
        what = f"{name} natural frequency, shaft still"
        yield _row("3", f"frozen_{key}", what, printed, ours, corrected=truth[index], form=".5f", note=note)
    edges = iter(instability_edges())
    for number, printed in enumerate(PRINTED_BANDS, start=1):
        for side, text in zip(("lower", "upper"), printed, strict=True):
            what = f"{side} edge of unstable band {number}, in Ω"
            note = "No damping, neither form of it, gives the printed edge: 0.902 in each case." * (text == "0.92")
            yield _row("3", f"band_{number}_{side}", what, text, corrected=next(edges), form=".4f", note=note)


def _frozen(analysis: Analysis) -> tuple[float, float]:
    """The range of the natural frequencies of the identified stiffness over the period."""
    assert analysis.state is not None
    stiffness = -analysis.state.system[:, 2:, :2]
    squares = np.linalg.eigvalsh(0.5 * (stiffness + stiffness.transpose(0, 2, 1)))
    return float(np.sqrt(squares.min())), float(np.sqrt(squares.max()))


def _record(done: Reproduction) -> Iterator[Number]:
    record, cycles = done.record, done.maximum_likelihood.cycles[0]
    words = "A unit impulse on a unit mass: it starts with x' = y' = cos 45°."
    yield _given("impulse", "direction of the impulse [deg]", "45", 45.0, words)
    words = "2π/50. 0.126 itself would drift by 0.27 % and move the frequencies by 2e-3."
    step = 1.0 / record.sample_rate
    more: dict[str, Any] = {"corrected": 2.0 * np.pi / 50.0, "form": ".7f", "note": words}
    yield _row("3", "sampling", "sampling interval Δt", "0.126", (step, step), **more)
    yield _given("samples", "samples in half a revolution", "50", cycles.n_phases)
    yield _given("revolutions", "revolutions in the record", "512", cycles.n_cycles / 2)
    models = [*(analysis.model for analysis in _both(done)), done.exact]
    *ours, truth = (float(np.exp(model.exponents.real.max() * record.n_samples * step)) for model in models)
    what = "what is left of the response at the end"
    yield _row("3", "decay", what, "small", ours, corrected=truth, form=".1e")
    yield _given("outputs", "outputs measured", "4", record.n_channels)
    largest = np.abs(done.exact.response(record.times)).max(axis=(1, 2))
    shares = [100.0 * float(np.mean(analysis.lifted.noise[:, 0] / largest)) for analysis in _both(done)]
    words = "Ours is the noise found in the record, mean of the four channels."
    yield _row("3", "noise", "noise, share of the largest response [%]", "2", shares, form=".3f", note=words)


def _peaks(done: Reproduction) -> Iterator[Number]:
    fundamental = done.exact.fundamental
    what, ours = "spacing of the harmonics ω_A [rad/s]", [analysis.model.fundamental for analysis in _both(done)]
    yield _row("3.1", "fundamental", what, "1.0", ours, corrected=2.0 * done.rotor.speed)
    for printed, harmonic in (("0.8", 0), ("0.2", -1), ("1.8", 1)):
        truth = np.abs(done.exact.exponents.imag[::2] + harmonic * fundamental)
        families = [_family(analysis, harmonic) for analysis in _both(done)]
        for place, name in zip(np.argsort(truth), ("lower", "upper"), strict=True):
            what, peaks = f"{name} peak near {printed} rad/s", [family[place] for family in families]
            note = "|Im λ + mω| with m = 0, -1 and 1." if (harmonic, name) == (0, "lower") else ""
            more: dict[str, Any] = {"corrected": float(truth[place]), "form": ".7f", "note": note}
            yield _row("3.1", f"peak_{printed}_{name}", what, printed, peaks, **more)
    pairs = [_pseudo_modes(analysis) for analysis in _both(done)]
    words = "Pairs λ + mω whose harmonic is above the noise in some channel: two modes of three harmonics."
    yield _row("3.1", "active_modes", "modes that seem active in the record", "at least 6", pairs, form="g", note=words)


def _family(analysis: Analysis, harmonic: int) -> list[Estimate]:
    """|Im λ + mω| of the two upper modes, with deviations, by ascending |λ|."""
    model, std = analysis.model, analysis.model.exponent_std
    upper = np.flatnonzero(model.exponents.imag > 0)
    values = np.abs(model.exponents.imag[upper] + harmonic * model.fundamental)
    deviations = [None] * len(upper) if std is None else [float(std[r].imag) for r in upper]
    return [Estimate(value=float(value), std=own) for value, own in zip(values, deviations, strict=True)]


def _pseudo_modes(analysis: Analysis) -> int:
    model = analysis.model
    kept = (model.coefficients != 0).any(axis=(1, 2))
    return int(kept[model.exponents.imag > 0].sum())


def _lifted(done: Reproduction) -> Iterator[Number]:
    sizes = (
        ("sets", "lifted responses of each output", "50", lambda a: a.lifted.n_phases),
        ("responses", "lifted responses in all", "200", lambda a: a.lifted.responses.n_outputs),
        ("modes", "modes found, pairs", "2", lambda a: a.model.order / 2),
    )
    for key, what, printed, value in sizes:
        yield _row("3.1", key, what, printed, [float(value(analysis)) for analysis in _both(done)], form="g")
    step = 180.0 / done.maximum_likelihood.lifted.n_phases
    for name, index, printed in (("1st", 0, ("0", "180")), ("23rd", SHOWN, ("79.2", "259.2"))):
        for later, text in zip((0.0, 180.0), printed, strict=True):
            words = "  and half a revolution later [deg]" if later else f"angle of the {name} response [deg]"
            yield _row("3.1", f"angle_{name}_{later:g}", words, text, corrected=index * step + later, form=".1f")


def _identified(done: Reproduction) -> Iterator[Number]:
    bound = done.maximum_likelihood.model
    found = [paired(a.model, done.exact, a.model) for a in _both(done)]
    limits = paired(bound, done.exact, bound)
    branch = (
        "On the principal branch, as the paper has them: λ1 is 0.8697 i less one ω, conjugated; λ2 is 0.7406 i alike."
    )
    for number, printed in enumerate(IDENTIFIED, start=1):
        for (part, name), own in zip(PARTS, printed, strict=True):
            mode, first = number - 1, (number, part) == (1, "real")
            ours = [Estimate(value=getattr(of[mode][0], part), std=getattr(of[mode][2], part)) for of in found]
            truth, std = (getattr(limits[mode][place], part) for place in (1, 2))
            text = f"{own:.6f}" if part == "real" else f"{own:.4f}"
            more: dict[str, Any] = {"corrected": truth, "form": ".7f", "note": branch if first else ""}
            yield _row("3.1", f"identified_{number}_{part}", f"{name} λ{number}, identified [1/s]", text, ours, **more)
            errors = [
                _over_draws([draw.ami[f"{part}_{number}"] for draw in done.draws]),
                _over_draws([draw.maximum_likelihood[f"{part}_{number}"] for draw in done.draws]),
            ]
            note = SCATTER if first else ""
            if part == "imag":  # what the printed digits can say at all
                note = f"Printed to four digits: the rounding alone is up to {5e-5 / std:.0f} deviations."
            words, text = "  its error, in Cramér-Rao deviations", f"{abs(own - truth) / std:.0f}"
            yield _row("3.1", f"error_{number}_{part}", words, text, errors, form=".2f", note=note)


def _over_draws(values: list[float]) -> Estimate:
    return Estimate(value=values[0], draws=tuple(values))


def _analytical(done: Reproduction) -> Iterator[Number]:
    bound = done.maximum_likelihood.model
    exact = [truth for _, truth, _ in paired(bound, done.exact, bound)]
    support = JeffcottRotor(damping_form="support").exponents()
    other = sorted(support[support.imag > 0], key=lambda value: value.imag)
    words = "Equation (22) as printed: its λ1 decays twice as fast as the paper's own."
    for key, told, values in (("analytical", ", by the equations", exact), ("support", " if C = c_f K_F", other)):
        for number, printed in enumerate(ANALYTICAL, start=1):
            for (part, name), own in zip(PARTS, printed, strict=True):
                what, value = f"{name} λ{number}{told} [1/s]", float(getattr(values[number - 1], part))
                note = words if (key, number, part) == ("support", 1, "real") else ""
                yield _row("3.1", f"{key}_{number}_{part}", what, own, corrected=value, form=".7f", note=note)


def _coefficients(done: Reproduction) -> Iterator[Number]:
    ours = [float((analysis.model.coefficients != 0).sum(axis=-1).max()) for analysis in _both(done)]
    words = f"{BRANCH} Ours are a band common to the channels, chosen by a chi-square test and not by eye."
    yield _row("3.2", "kept", "Fourier coefficients kept of a residue", "3", ours, form="g", note=words)
    phases = done.ami.lifted.n_phases
    yield _row("3.2", "of_all", "  of", "50", (phases, phases), form="g")
    assert done.ami.state is not None
    instants, what = len(done.ami.state.times), "instants of a period at which A(t) is given"
    yield _row("3.2", "instants", what, "50", (instants, instants), form="g")


def _features(stiffness: Floats) -> dict[str, float]:
    """Rows of section 3.2 on K(t), from its values over a period (times, 2, 2)."""
    count = len(stiffness)
    k11, k12 = stiffness[:, 0, 0], stiffness[:, 0, 1]
    at = {degrees: round(degrees / 180.0 * count) for degrees in (0, 45, 90)}
    return {
        "a31": -float(k11[0]),
        "k12_at_0": float(k12[0]),
        "k12_at_90": float(k12[at[90]]),
        "k12_angle": 180.0 * float(np.argmin(k12[: count // 2])) / count,
        "k12_share": 100.0 * float(abs(k12[at[45]]) / k11[at[45]]),
        "k11_swing": 100.0 * float(np.ptp(k11) / k11.min()),
    }


def _elements(done: Reproduction) -> Iterator[Number]:
    times = np.arange(FINE) * done.rotor.period / FINE
    truth = _features(done.rotor.stiffness(times))
    systems = [reconstruct(a.model, MASS, times=times, harmonics="model").system for a in _both(done)]
    features = [_features(-system[:, 2:, :2]) for system in systems]
    for key, what, printed, form, note in _ELEMENTS:
        ours = [own[key] for own in features]
        yield _row("3.2", key, what, printed, ours, corrected=truth[key], form=form, note=note)
    states = [analysis.state.system for analysis in _both(done) if analysis.state is not None]
    means, largest = [float(-one[:, 2, 2].mean()) for one in states], [float(np.abs(one).max()) for one in states]
    what, damping = "element (1,1) of the damping, mean", done.rotor.damping
    yield _row("3.2", "c11", what, "constant", means, corrected=damping, form=".4f")
    most = float(np.abs(done.rotor.system(times)).max())
    yield _row("3.2", "largest", "largest coefficient of A(t)", "1", largest, corrected=most, form=".3f")


def _errors(done: Reproduction) -> Iterator[Number]:
    exact = cut_errors(done.rotor, done.exact)
    for key, section, what, printed in _ERRORS:
        scale, form = (100.0 / done.rotor.damping, ".0f") if key == "three_damping" else (1.0, ".2g")
        ours = [
            _over_draws([scale * draw.ami[key] for draw in done.draws]),
            _over_draws([scale * draw.maximum_likelihood[key] for draw in done.draws]),
        ]
        corrected = scale * exact[key] if key in exact else None
        yield _row(section, key, what, printed, ours, corrected=corrected, form=form, note=_NOTES.get(key, ""))


def _ratios(model: PeriodicModel, most: int) -> list[float]:
    """The largest |B_m| and |B_-m| of X and Y in a mode, over its largest |B_0|: the worse mode, m = 1 … most."""
    size = np.abs(model.coefficients[:, :2]).max(axis=(1, 2))
    middle = size[:, model.harmonics == 0][:, 0]
    return [float((size[:, np.abs(model.harmonics) == m].max(axis=1) / middle).max()) for m in range(1, most + 1)]


def _decay(done: Reproduction) -> Iterator[Number]:
    truth = _ratios(done.exact, 3)
    found = [_ratios(uncut(analysis), 3) for analysis in _both(done)]
    notes = ("Steeper than 10^-m, and not even.", "Ours is noise, as it is for m = 3.", "")
    for m, note in enumerate(notes, start=1):
        what, ours = f"largest coefficient at |m| = {m}, of that at 0", [own[m - 1] for own in found]
        more: dict[str, Any] = {"corrected": truth[m - 1], "form": ".2g", "note": note}
        yield _row("3.3", f"decay_{m}", what, f"about {10.0**-m:g}", ours, **more)
