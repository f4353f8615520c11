"""The numbers of section 3.1: spectra, lifted responses and exponents."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from floquid.paper._experiment import Reproduction, paired
from floquid.paper._numbers import Estimate, Number
from floquid.pipeline import Analysis
from floquid.systems import JeffcottRotor

SECTION = "3.1"

IDENTIFIED = ((-0.002051, 0.1302), (-0.002036, 0.2594))
"""The exponents that the paper identified, real and imaginary parts, as printed."""

ANALYTICAL = (("-0.002000", "0.13034"), ("-0.002000", "0.25939"))
"""The exponents that the paper computed, as printed."""

PARTS = (("real", "Re"), ("imag", "Im"))

SCATTER = "Of a normal error the mean size is 0.8 deviations. The deviations are those of maximum likelihood."

SHOWN = 22
"""The index of the 23rd lifted response."""


def rows_of_response(done: Reproduction) -> Iterator[Number]:
    """The peaks, the lifted responses, then the exponents."""
    yield from _peaks(done)
    yield from _lifted(done)
    yield from _identified(done)
    yield from _analytical(done)


def _peaks(done: Reproduction) -> Iterator[Number]:
    fundamental = done.exact.fundamental
    yield Number(
        key="fundamental", section=SECTION, what="spacing of the harmonics ω_A [rad/s]", printed="1.0",
        corrected=2.0 * done.rotor.speed, form=".4g", ami=Estimate(value=done.ami.model.fundamental),
        maximum_likelihood=Estimate(value=done.maximum_likelihood.model.fundamental),
    )  # fmt: skip
    for printed, harmonic in (("0.8", 0), ("0.2", -1), ("1.8", 1)):
        truth = np.abs(done.exact.exponents.imag[::2] + harmonic * fundamental)
        order = np.argsort(truth)
        ours = [_family(analysis, harmonic) for analysis in (done.ami, done.maximum_likelihood)]
        for place, name in zip(order, ("lower", "upper"), strict=True):
            yield Number(
                key=f"peak_{printed}_{name}", section=SECTION, what=f"{name} peak near {printed} rad/s",
                printed=printed, corrected=float(truth[place]), ami=ours[0][place], maximum_likelihood=ours[1][place],
                form=".7f", note="|Im λ + mω| with m = 0, -1 and 1." if (harmonic, name) == (0, "lower") else "",
            )  # fmt: skip
    pairs = [_pseudo_modes(analysis) for analysis in (done.ami, done.maximum_likelihood)]
    yield Number(
        key="active_modes", section=SECTION, what="modes that seem active in the record", printed="at least 6",
        ami=Estimate(value=pairs[0]), maximum_likelihood=Estimate(value=pairs[1]), form="g",
        note="Pairs λ + mω whose harmonic is above the noise in some channel: two modes of three harmonics.",
    )  # fmt: skip


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
    for key, what, printed, value in (
        ("sets", "lifted responses of each output", "50", lambda a: a.lifted.n_phases),
        ("responses", "lifted responses in all", "200", lambda a: a.lifted.responses.n_outputs),
        ("modes", "modes found, pairs", "2", lambda a: a.model.order / 2),
    ):
        ami, ml = (Estimate(value=float(value(analysis))) for analysis in (done.ami, done.maximum_likelihood))
        yield Number(
            key=key, section=SECTION, what=what, printed=printed, ami=ami, maximum_likelihood=ml, form="g"
        )  # fmt: skip
    step = 180.0 / done.maximum_likelihood.lifted.n_phases
    for name, index, printed in (("1st", 0, ("0", "180")), ("23rd", SHOWN, ("79.2", "259.2"))):
        for later, text in zip((0.0, 180.0), printed, strict=True):
            words = "  and half a revolution later [deg]" if later else f"angle of the {name} response [deg]"
            yield Number(
                key=f"angle_{name}_{later:g}", section=SECTION, what=words, printed=text,
                corrected=index * step + later, form=".1f",
            )  # fmt: skip


def _identified(done: Reproduction) -> Iterator[Number]:
    bound = done.maximum_likelihood.model
    found = [paired(a.model, done.exact, a.model) for a in (done.ami, done.maximum_likelihood)]
    limits = paired(bound, done.exact, bound)
    for number, printed in enumerate(IDENTIFIED, start=1):
        for (part, name), own in zip(PARTS, printed, strict=True):
            estimates = [
                Estimate(value=getattr(of[number - 1][0], part), std=getattr(of[number - 1][2], part)) for of in found
            ]
            truth, std = (getattr(limits[number - 1][place], part) for place in (1, 2))
            yield Number(
                key=f"identified_{number}_{part}", section=SECTION, what=f"{name} λ{number}, identified [1/s]",
                printed=f"{own:.6f}" if part == "real" else f"{own:.4f}", corrected=truth, ami=estimates[0],
                maximum_likelihood=estimates[1], form=".7f",
                note="On the principal branch, as the paper has them: λ1 is 0.8697 i less one ω, conjugated; λ2 is "
                "0.7406 i alike." if (number, part) == (1, "real") else "",
            )  # fmt: skip
            name_of_error = f"{part}_{number}"
            yield Number(
                key=f"error_{number}_{part}", section=SECTION, what="  its error, in Cramér-Rao deviations",
                printed=f"{abs(own - truth) / std:.0f}", form=".2f",
                ami=_over_draws([draw.ami[name_of_error] for draw in done.draws]),
                maximum_likelihood=_over_draws([draw.maximum_likelihood[name_of_error] for draw in done.draws]),
                note=_of_digits(std) if part == "imag" else SCATTER if number == 1 else "",
            )  # fmt: skip


def _of_digits(std: float) -> str:
    """What the printed digits can say at all."""
    return f"Printed to four digits: the rounding alone is up to {5e-5 / std:.0f} deviations."


def _over_draws(values: list[float]) -> Estimate:
    return Estimate(value=values[0], draws=tuple(values))


def _analytical(done: Reproduction) -> Iterator[Number]:
    bound = done.maximum_likelihood.model
    exact = paired(bound, done.exact, bound)
    support = JeffcottRotor(damping_form="support").exponents()
    other = sorted(support[support.imag > 0], key=lambda value: value.imag)
    for number, printed in enumerate(ANALYTICAL, start=1):
        for (part, name), own in zip(PARTS, printed, strict=True):
            yield Number(
                key=f"analytical_{number}_{part}", section=SECTION, what=f"{name} λ{number}, by the equations [1/s]",
                printed=own, corrected=getattr(exact[number - 1][1], part), form=".7f",
            )  # fmt: skip
    for number, printed in enumerate(ANALYTICAL, start=1):
        for (part, name), own in zip(PARTS, printed, strict=True):
            yield Number(
                key=f"support_{number}_{part}", section=SECTION, what=f"{name} λ{number} if C = c_f K_F [1/s]",
                printed=own, corrected=float(getattr(other[number - 1], part)), form=".7f",
                note="Equation (22) as printed: its λ1 decays twice as fast as the paper's own." if number == 1
                and part == "real" else "",
            )  # fmt: skip
