"""The numbers of section 3 before 3.1: the rotor, its stability and the experiment."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from floquid.paper._experiment import Reproduction
from floquid.paper._numbers import Estimate, Number
from floquid.paper._truth import frozen_range, instability_edges
from floquid.pipeline import Analysis

SECTION = "3"

PRINTED_BANDS = (("0.72", "0.755"), ("0.785", "0.825"), ("0.848", "0.92"))
"""The speeds between which the rotor is unstable, as printed."""


def rows_of_setup(done: Reproduction) -> Iterator[Number]:
    """The rotor, then what it does by its equations, then the record."""
    yield from _rotor(done)
    yield from _stability(done)
    yield from _record(done)


def _given(key: str, what: str, printed: str, value: float, *, note: str = "") -> Number:
    """A number that is put in, not found."""
    same = Estimate(value=value)
    return Number(
        key=key, section=SECTION, what=what, printed=printed, ami=same, maximum_likelihood=same, form=".6g", note=note
    )


def _rotor(done: Reproduction) -> Iterator[Number]:
    rotor = done.rotor
    yield _given("rotor_x", "shaft stiffness k_Rx/k_Fx", "1", rotor.rotor_x)
    yield _given("rotor_y", "shaft stiffness k_Ry/k_Fx", "1.5", rotor.rotor_y)
    yield _given("support_y", "support stiffness k_Fy/k_Fx", "2", rotor.support_y)
    words = "C = c_f K_F as eq. (22) prints it does not give the paper's exponents; C = c_f I does."
    yield _given("damping", "damping factor c_f", "0.004", rotor.damping, note=words)
    yield _given("speed", "speed of the shaft Ω", "0.5", rotor.speed)
    model = done.maximum_likelihood.model
    yield Number(
        key="period", section=SECTION, what="period T_A, half a revolution", printed="2π", corrected=rotor.period,
        ami=Estimate(value=model.period), maximum_likelihood=Estimate(value=model.period), form=".7g",
    )  # fmt: skip


def _stability(done: Reproduction) -> Iterator[Number]:
    found = [_frozen(analysis) for analysis in (done.ami, done.maximum_likelihood)]
    words = "Ours are from the identified stiffness, whose errors are those of A(t)."
    for index, (key, name, printed) in enumerate(
        (("frozen_low", "lowest", "0.707"), ("frozen_high", "highest", "0.926"))
    ):
        yield Number(
            key=key, section=SECTION, what=f"{name} natural frequency, shaft still", printed=printed,
            corrected=frozen_range(done.rotor)[index], ami=Estimate(value=found[0][index]),
            maximum_likelihood=Estimate(value=found[1][index]), form=".5f", note=words if index == 0 else "",
        )  # fmt: skip
    edges = iter(instability_edges())
    for number, printed in enumerate(PRINTED_BANDS, start=1):
        for side, text in zip(("lower", "upper"), printed, strict=True):
            yield Number(
                key=f"band_{number}_{side}", section=SECTION, what=f"{side} edge of unstable band {number}, in Ω",
                printed=text, corrected=next(edges), form=".4f",
                note="No damping, neither form of it, gives the printed edge: 0.902 in each case." if text == "0.92"
                else "",
            )  # fmt: skip


def _frozen(analysis: Analysis) -> tuple[float, float]:
    """The range of the natural frequencies of the identified stiffness over the period."""
    assert analysis.state is not None
    stiffness = -analysis.state.system[:, 2:, :2]
    squares = np.linalg.eigvalsh(0.5 * (stiffness + stiffness.transpose(0, 2, 1)))
    return float(np.sqrt(squares.min())), float(np.sqrt(squares.max()))


def _record(done: Reproduction) -> Iterator[Number]:
    record, cycles = done.record, done.maximum_likelihood.cycles[0]
    words = "A unit impulse on a unit mass: it starts with x' = y' = cos 45°."
    yield _given("impulse", "direction of the impulse [deg]", "45", 45.0, note=words)
    words = "2π/50. 0.126 itself would drift by 0.27 % and move the frequencies by 2e-3."
    step = 1.0 / record.sample_rate
    yield Number(
        key="sampling", section=SECTION, what="sampling interval Δt", printed="0.126", corrected=2.0 * np.pi / 50.0,
        ami=Estimate(value=step), maximum_likelihood=Estimate(value=step), form=".7f", note=words,
    )  # fmt: skip
    yield _given("samples", "samples in half a revolution", "50", cycles.n_phases)
    yield _given("revolutions", "revolutions in the record", "512", cycles.n_cycles / 2)
    length = record.n_samples * step
    decay = [
        Estimate(value=float(np.exp(analysis.model.exponents.real.max() * length)))
        for analysis in (done.ami, done.maximum_likelihood)
    ]
    yield Number(
        key="decay", section=SECTION, what="what is left of the response at the end", printed="small",
        corrected=float(np.exp(done.exact.exponents.real.max() * length)), ami=decay[0], maximum_likelihood=decay[1],
        form=".1e",
    )  # fmt: skip
    yield _given("outputs", "outputs measured", "4", record.n_channels)
    largest = np.abs(done.exact.response(record.times)).max(axis=(1, 2))
    shares = [
        100.0 * float(np.mean(analysis.lifted.noise[:, 0] / largest))
        for analysis in (done.ami, done.maximum_likelihood)
    ]
    yield Number(
        key="noise", section=SECTION, what="noise, share of the largest response [%]", printed="2",
        ami=Estimate(value=shares[0]), maximum_likelihood=Estimate(value=shares[1]), form=".3f",
        note="Ours is the noise found in the record, mean of the four channels.",
    )  # fmt: skip
