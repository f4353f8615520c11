"""The numbers of sections 3.2 and 3.3: the coefficients kept, and A(t)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel
from floquid.paper._experiment import MASS, WINDOW, Reproduction, cut_errors, uncut
from floquid.paper._numbers import Estimate, Number
from floquid.pipeline import Analysis
from floquid.reconstruction import reconstruct

FINE = 1440
"""Instants of a period at which the extremes of the stiffness are looked for: every eighth of a degree of the shaft."""

BRANCH = "The harmonics m are counted from the branch on which the dominant one is 0."


def rows_of_system(done: Reproduction) -> Iterator[Number]:
    """The coefficients and the elements of A(t), then their errors, then how fast the coefficients fall."""
    yield from _coefficients(done)
    yield from _elements(done)
    yield from _errors(done)
    yield from _decay(done)


def _both(done: Reproduction) -> tuple[Analysis, Analysis]:
    return done.ami, done.maximum_likelihood


def _coefficients(done: Reproduction) -> Iterator[Number]:
    def kept(analysis: Analysis) -> float:
        return float((analysis.model.coefficients != 0).sum(axis=-1).max())

    ours = [Estimate(value=kept(analysis)) for analysis in _both(done)]
    yield Number(
        key="kept", section="3.2", what="Fourier coefficients kept of a residue", printed="3", ami=ours[0],
        maximum_likelihood=ours[1], form="g",
        note=f"{BRANCH} Ours are a band common to the channels, chosen by a chi-square test and not by eye.",
    )  # fmt: skip
    of = Estimate(value=done.ami.lifted.n_phases)
    yield Number(
        key="of_all", section="3.2", what="  of so many", printed="50", ami=of, maximum_likelihood=of, form="g"
    )  # fmt: skip
    assert done.ami.state is not None
    instants = Estimate(value=len(done.ami.state.times))
    yield Number(
        key="instants", section="3.2", what="instants of a period at which A(t) is given", printed="50", ami=instants,
        maximum_likelihood=instants, form="g",
    )  # fmt: skip


def _stiffness(model: PeriodicModel, times: NDArray[np.float64]) -> NDArray[np.float64]:
    return -reconstruct(model, MASS, times=times, harmonics="model").system[:, 2:, :2]


def _features(stiffness: NDArray[np.float64]) -> dict[str, float]:
    """What section 3.2 says of K(t), from its values over a period (times, 2, 2)."""
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


_ELEMENTS = (
    ("a31", "A(3,1) at 0°, that is -K11", "-0.5", "z.4f", ""),
    ("k12_at_0", "K12 at 0°", "0", "z.4f", ""),
    ("k12_at_90", "K12 at 90°", "0", "z.4f", ""),
    ("k12_angle", "angle of the largest |K12| [deg]", "45", ".1f", "Where cos 2θ = 1/29, a degree before 45°."),
    ("k12_share", "|K12| over K11 at 45° [%]", "just under 20", ".2f", "Exactly an eighth: 0.068966 of 0.551724."),
    ("k11_swing", "fluctuation of K11, of its least [%]", "about 20", ".1f", "From 0.5 to 0.6."),
)


def _elements(done: Reproduction) -> Iterator[Number]:
    times = np.arange(FINE) * done.rotor.period / FINE
    truth = _features(done.rotor.stiffness(times))
    ami, ml = (_features(_stiffness(analysis.model, times)) for analysis in _both(done))
    for key, what, printed, form, note in _ELEMENTS:
        yield Number(
            key=key, section="3.2", what=what, printed=printed, corrected=truth[key], ami=Estimate(value=ami[key]),
            maximum_likelihood=Estimate(value=ml[key]), form=form, note=note,
        )  # fmt: skip
    states = [analysis.state for analysis in _both(done)]
    means = [Estimate(value=float(-state.system[:, 2, 2].mean())) for state in states if state is not None]
    yield Number(
        key="c11", section="3.2", what="element (1,1) of the damping, mean", printed="constant",
        corrected=done.rotor.damping, ami=means[0], maximum_likelihood=means[1], form=".4f",
    )  # fmt: skip
    largest = [Estimate(value=float(np.abs(state.system).max())) for state in states if state is not None]
    yield Number(
        key="largest", section="3.2", what="largest coefficient of A(t)", printed="1",
        corrected=float(np.abs(done.rotor.system(times)).max()), ami=largest[0], maximum_likelihood=largest[1],
        form=".3f",
    )  # fmt: skip


_ERRORS = (
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
"""Key, section, what, printed."""

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
    "own": "The band of harmonics that `identify` keeps by itself.",
}


def _errors(done: Reproduction) -> Iterator[Number]:
    exact = cut_errors(done.rotor, done.exact)
    for key, section, what, printed in _ERRORS:
        scale, form = (100.0 / done.rotor.damping, ".0f") if key == "three_damping" else (1.0, ".2g")
        ami = tuple(scale * draw.ami[key] for draw in done.draws)
        ml = tuple(scale * draw.maximum_likelihood[key] for draw in done.draws)
        yield Number(
            key=key, section=section, what=what, printed=printed, form=form, note=_NOTES.get(key, ""),
            corrected=scale * exact[key] if key in exact else None,
            ami=Estimate(value=ami[0], draws=ami), maximum_likelihood=Estimate(value=ml[0], draws=ml),
        )  # fmt: skip


def ratios(model: PeriodicModel, most: int) -> list[float]:
    """The largest |B_m| and |B_-m| of X and Y in a mode, over its largest |B_0|: the worse mode, m = 1 … most."""
    size = np.abs(model.coefficients[:, :2]).max(axis=(1, 2))
    middle = size[:, model.harmonics == 0][:, 0]
    return [float((size[:, np.abs(model.harmonics) == m].max(axis=1) / middle).max()) for m in range(1, most + 1)]


def _decay(done: Reproduction) -> Iterator[Number]:
    truth = ratios(done.exact, 3)
    ami, ml = (ratios(uncut(analysis), 3) for analysis in _both(done))
    notes = ("Steeper than 10^-m, and not even.", "Ours is noise, as it is for m = 3.", "")
    for m in (1, 2, 3):
        yield Number(
            key=f"decay_{m}", section="3.3", what=f"largest coefficient at |m| = {m}, of that at 0",
            printed=f"about {10.0**-m:g}", corrected=truth[m - 1], ami=Estimate(value=ami[m - 1]),
            maximum_likelihood=Estimate(value=ml[m - 1]), form=".2g", note=notes[m - 1],
        )  # fmt: skip
