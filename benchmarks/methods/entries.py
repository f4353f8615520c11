"""The methods, each a thin configuration of a shared routine or of a room of floquid."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace

import numpy as np
from benchmarks.methods import lines, single, subspace
from benchmarks.methods.records import Case
from numpy.typing import NDArray

import floquid as fq
from floquid.errors import IdentificationError
from floquid.findings import Finding, Severity, texts
from floquid.innovations import h_oma
from floquid.inputs import TransferFunctions
from floquid.lifting import lift
from floquid.lti import AMI, ERA, LSCF, AbstractIdentifier, MaximumLikelihood, TimeResponses
from floquid.sync import segment

Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class Found:
    """Exponents on any branch, with deviations where there are any, and transfer functions of samples."""

    exponents: Complexes | None = None
    std: Complexes | None = None
    transfer: TransferFunctions | None = None


@dataclass(frozen=True)
class Method:
    """A method: what its user needs and gets, and the kinds of records it runs on."""

    name: str
    source: str
    kind: str
    order: str
    returns: str
    run: Callable[[Case], Found]
    only: str = ""


def of_model(model: fq.PeriodicModel) -> Found:
    """The exponents of a model of floquid."""
    return Found(model.exponents, model.exponent_std)


def of_multipliers(values: Complexes, case: Case) -> Found:
    """Exponents on the principal branch."""
    return Found(np.log(values[np.isfinite(values) & (values != 0)]) / case.system.period)


def lifted(identifier: AbstractIdentifier) -> Callable[[Case], Found]:
    """An LTI identifier on the lifted record."""

    def run(case: Case) -> Found:
        state = identifier.prepare(lift(segment(case.record())).responses)
        model = identifier.extract(state, None if identifier.decides else case.order)
        if model.covariance is None:
            return Found(model.poles)
        both = np.sqrt(np.diag(model.covariance)).reshape(2, -1)
        return Found(model.poles, both[0] + 1j * both[1])

    return run


def raw_free(case: Case) -> Found:
    """ERA of the record as it is, thrice the order."""
    values, _ = case.data
    state = ERA().prepare(TimeResponses(values=values[:, None], dt=case.step))
    return Found(ERA().extract(state, 3 * case.order).poles)


def windows(case: Case, phases: int, length: int) -> tuple[NDArray, NDArray]:
    """Outputs and inputs in windows of a record."""
    values, inputs = case.data
    return subspace.by_periods(values, phases, length), subspace.by_periods(inputs, phases, length)


def by_periods(case: Case) -> Found:
    """Columns are periods."""
    outputs, inputs = windows(case, case.phases, case.phases + 2 * case.depth)
    return of_multipliers(subspace.multipliers(outputs, inputs, case.phases, case.depth, case.order), case)


def by_experiments(case: Case) -> Found:
    """Columns are experiments."""
    outputs, inputs = case.experiments
    found = subspace.multipliers(outputs, inputs, case.phases, case.depth // 2, case.order)
    return of_multipliers(found, case)


def by_predictor(case: Case) -> Found:
    """Columns are periods, the past predicts."""
    past, future = max(8, case.periods // 20), 4
    outputs, inputs = windows(case, case.phases, case.phases + past + future)
    found = subspace.predictor_multipliers(outputs, inputs, case.phases, past, future, case.order)
    return of_multipliers(found, case)


def by_cycles(case: Case) -> Found:
    """LTI subspace of the cycled signals, one phase; its multipliers to the power of the phases."""
    values, inputs = (subspace.cycled(own, case.phases) for own in case.data)
    depth = case.depth // 2
    outputs, inputs = (subspace.by_periods(own, 1, 2 * depth + 1) for own in (values, inputs))
    found = subspace.multipliers(outputs, inputs, 1, depth, case.order * case.phases) ** case.phases
    return of_multipliers(subspace.gathered(found, case.phases), case)


def delayed_states(case: Case) -> Found:
    """Least squares of the monodromy."""
    return of_multipliers(single.delayed(case.data[0], case.phases, case.order), case)


def believed(model: fq.PeriodicModel, findings: tuple[Finding, ...]) -> Found:
    """Exponents and deviations of a model; one that its own method says is wrong counts as lost."""
    for told in texts(findings, Severity.FAILURE):
        raise IdentificationError(told)
    return of_model(model)


def driven(case: Case) -> Found:
    """floquid's chain for measured inputs, with G of samples."""
    names = [f"u{k}" for k in range(len(case.data[1]))]
    analysis = fq.identify(case.record(), inputs=names, validate=False)
    found = believed(analysis.model, analysis.findings)
    return replace(found, transfer=analysis.transfer(None, (-1, 0, 1), sampled=True))


def ambient(case: Case) -> Found:
    """floquid's chain for outputs alone."""
    analysis = fq.identify(case.record(), validate=False, excitation="ambient")
    return believed(analysis.model, analysis.findings)


def polynomials(case: Case) -> Found:
    """G line by line of the record as it is."""
    names = [f"u{k}" for k in range(len(case.data[1]))]
    return Found(
        transfer=fq.measure_transfer(case.record(), inputs=names, harmonics=(-1, 0, 1), method="polynomials").transfer
    )


def by_multisine(case: Case) -> fq.transfer.MeasuredTransfer:
    """G of a multisine repeated four times, in a record of the same length."""
    number, rate = len(case.data[1]), 1.0 / case.step
    names = [f"u{k}" for k in range(number)]
    design = fq.multisine(case.system.period, rate, turns=case.periods // 4, inputs=number, seed=case.seed)
    inputs = np.tile(design.values, 4)
    record = case.record(case.response(inputs, 1), inputs)
    return fq.measure_transfer(record, inputs=names, harmonics=(-1, 0, 1))


def fit_of_lines(case: Case) -> Found:
    """Modes fitted to the lines of a multisine."""
    measured = by_multisine(case)
    fit = fq.fit_transfer(measured)
    found = believed(fit.model, fit.findings)
    return replace(found, transfer=fit.transfer(measured.transfer.frequencies_hz, sampled=True))


def ssi(values: NDArray, inputs: NDArray | None, depth: int, order: int) -> Complexes:
    """Multipliers a sample by the subspace of pyOMA2, with inputs or without."""
    from pyoma2.functions import ssi as peer

    hankel, _ = peer.build_hank(values, values, depth, "cov" if inputs is None else "IOcov", U=inputs)
    return np.linalg.eigvals(peer.SSI_fast(hankel, depth, order)[1][order]).astype(complex)


def raw_ssi(case: Case) -> Found:
    """pyOMA2 on the samples as they are, thrice the order: the sidebands want poles, too."""
    values, inputs = case.data
    depth = case.phases if case.kind == "ambient" else 2 * case.phases
    found = ssi(values, inputs if len(inputs) else None, depth, 3 * case.order)
    return Found(np.log(found) / case.step)


def lifted_signal(signal: NDArray, phases: int) -> NDArray:
    """The samples of a period as channels, one sample a period (phases · channels, periods)."""
    return (
        signal.reshape(len(signal), signal.shape[1] // phases, phases)
        .transpose(2, 0, 1)
        .reshape(phases * len(signal), signal.shape[1] // phases)
    )


def lifted_ssi(case: Case) -> Found:
    """pyOMA2 on the lifted samples."""
    values, inputs = (lifted_signal(own, case.phases) for own in case.data)
    depth = max(case.lags // 2, 2)
    return of_multipliers(ssi(values, inputs if len(inputs) else None, depth, case.order), case)


def silenced(run: Callable[[Case], Found]) -> Callable[[Case], Found]:
    """Progress bars and warnings of others kept quiet."""

    def quiet(case: Case) -> Found:
        before = logging.root.manager.disable
        logging.disable(logging.CRITICAL)
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                with redirect_stderr(io.StringIO()), redirect_stdout(io.StringIO()):
                    return run(case)
        finally:
            logging.disable(before)

    return quiet


FOUND, GIVEN, NONE = "found", "given", ""
LTI, DISCRETE, STATE, LINES = "λ, shapes", "λ, Aₖ, Bₖ, Cₖ", "λ, A(t)", "G"
SURE = " ±"

METHODS: tuple[Method, ...] = (
    Method(
        "floquid.identify",
        "allen2009",
        "free",
        FOUND,
        STATE + SURE,
        lambda c: of_model(fq.identify(c.record(), validate=False).model),
    ),
    Method("maximum likelihood, lifted", "markovsky2014", "free", FOUND, LTI + SURE, lifted(MaximumLikelihood())),
    Method("AMI, lifted", "allen2006", "free", FOUND, LTI + SURE, lifted(AMI())),
    Method("LSCF, lifted", "guillaume2003", "free", GIVEN, LTI, lifted(LSCF())),
    Method("ERA, lifted", "juang1985", "free", GIVEN, LTI, lifted(ERA())),
    Method("Peters and Wang", "wang1998", "free", GIVEN, "λ", delayed_states),
    Method(
        "restoring force",
        "masri1979",
        "free",
        GIVEN,
        STATE,
        lambda c: Found(single.restoring_force(c.data[0], c.step, c.system.period)),
        "Mathieu",
    ),
    Method(
        "Hilbert",
        "feldman1994",
        "free",
        GIVEN,
        STATE,
        lambda c: Found(single.free_vibration(c.data[0], c.step, c.system.period)),
        "Mathieu",
    ),
    Method("plain LTI (ERA, raw)", "juang1985", "free", GIVEN, "lines", raw_free),
    Method("floquid.identify", "", "driven", FOUND, "λ, A(t), B(t), G" + SURE, driven),
    Method("Hench; Verhaegen and Yu", "verhaegen1995", "driven", GIVEN, DISCRETE, by_periods),
    Method("Liu; Shi, Law and Li", "liu1997", "driven", GIVEN, DISCRETE, by_experiments),
    Method("Felici et al.", "felici2007", "driven", GIVEN, DISCRETE, by_predictor),
    Method("Okajima", "okajima2025", "driven", GIVEN, DISCRETE, by_cycles, "Mathieu"),
    Method("plain LTI (pyOMA2, raw)", "peeters1999", "driven", GIVEN, "lines", silenced(raw_ssi)),
    Method("plain LTI (pyOMA2, lifted)", "peeters1999", "driven", GIVEN, DISCRETE, silenced(lifted_ssi)),
    Method(
        "multisine, repeats",
        "louarroudi2012",
        "driven",
        NONE,
        LINES + SURE,
        lambda c: Found(transfer=by_multisine(c).transfer),
    ),
    Method("modes fitted to these lines", "", "driven", FOUND, "λ, G" + SURE, fit_of_lines),
    Method("local polynomials", "louarroudi2012", "driven", NONE, LINES + SURE, polynomials),
    Method(
        "chirps, penalised curvature",
        "siddiqi2001",
        "driven",
        NONE,
        LINES,
        lambda c: Found(transfer=lines.chirps(c)),
        "Mathieu",
    ),
    Method(
        "chirps, local polynomials",
        "louarroudi2012",
        "driven",
        NONE,
        LINES + SURE,
        lambda c: Found(transfer=lines.chirps_by_polynomials(c)),
        "Mathieu",
    ),
    Method(
        "sines one after another",
        "",
        "driven",
        NONE,
        LINES + SURE,
        lambda c: Found(transfer=lines.scan(c)),
        "Mathieu",
    ),
    Method(
        "floquid.identify",
        "",
        "ambient",
        FOUND,
        LTI + SURE,
        ambient,
    ),
    Method("Jhinaoui et al.", "jhinaoui2014", "ambient", GIVEN, "λ, Aₖ, Cₖ", by_periods),
    Method(
        "H-OMA, frequency domain",
        "allen2011",
        "ambient",
        GIVEN,
        LTI,
        lambda c: Found(h_oma(c.samples, c.order, lags=c.lags).poles),
    ),
    Method(
        "H-OMA, time domain",
        "allen2011",
        "ambient",
        GIVEN,
        LTI,
        lambda c: Found(h_oma(c.samples, c.order, lags=c.lags, form="time").poles),
    ),
    Method("H-OMA, time domain (pyOMA2)", "peeters1999", "ambient", GIVEN, LTI, silenced(lifted_ssi)),
    Method("plain OMA (pyOMA2, raw)", "peeters1999", "ambient", GIVEN, "lines", silenced(raw_ssi)),
)
