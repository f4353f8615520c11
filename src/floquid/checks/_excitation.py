"""Modes of outputs alone that may be the excitation's own, or none."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.checks._check import Evidence, is_undetermined
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure, note, warning
from floquid.fit import DEVIATIONS, EVIDENT, SURE, is_vague
from floquid.innovations import GONE, Fit, alike, gap_of, left_over
from floquid.search import NEAR


def repetition(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Finding on innovations that repeat with another period."""
    # Lines of a narrow band alone pass for a period of the response, and are none where the model takes account of
    # them.
    if not (case.other and left_over(case.own.samples, case.residual, case.other)):
        return ()
    return (failure("wrong_period", given=case.model.period, own=2.0 * np.pi / case.other, fraction=True),)


SHORT = (0.5, 2.0)
"""Deviations of an exponent from the maximum of the likelihood, from which on that is told, and it is no estimate."""

OWN = 0.5  # the share of a shape's energy beside another's from which on two modes of one multiplier are two

STILL = 10.0  # radians that a mode turns, and nepers that it decays, in a record, less than which it is likely a drift


def excitation_of(
    fit: Fit, model: PeriodicModel, relative: Floats, duration: float, as_read: Collection[int]
) -> tuple[Finding, ...]:
    """Findings on the modes: how long a record their damping needs, which may be the excitation's, which nearly one."""
    # Whether a pair of one harmonic is two real multipliers does not matter: it is the excitation's own.
    from scipy.special import chdtrc

    findings, varying = [], []
    for number in range(len(fit.at.modes)):
        squares, degrees = fit.varying(number)
        varying.append(bool(degrees and chdtrc(degrees, squares) < SURE))
    if not any(varying):
        findings.append(note("ambient_constant"))
    places = np.cumsum([0, *(mode.rows for mode in fit.at.modes)])[:-1]
    shares, hertz = relative[places], np.abs(model.exponents[places]) / (2.0 * np.pi)
    decays, certain = np.abs(model.exponents[places].real), _own(fit)
    # Two real multipliers that were read from one block are two, however near; each block has two, or a pair.
    reals = [number for number in sorted(as_read) if fit.at.modes[number].real]
    couples = set(zip(reals[::2], reals[1::2], strict=False))
    groups = [
        np.array(group)
        for group in alike(fit.at.modes, model.fundamental)
        if len(group) > 1 and tuple(sorted(group)) not in couples
    ]
    findings += _no_estimates(fit, model, shares, certain, groups)
    longest = max(np.diff(fit.samples.begins)) * fit.samples.step
    still, low = ~certain & (_away(fit) * longest < STILL), hertz * 2.0 * np.pi * longest < STILL
    for report, which in ((failure, still & low), (warning, still & ~low)):  # a line of the period may be a mode's
        if which.any():
            findings.append(report("ambient_slow", frequencies=hertz[which].tolist()))
    several = len(fit.samples.records) > 1  # many short ones may tell a decay
    line = ~(certain | still) & (decays * longest < 1.0) & ~(several & (shares < 1.0 / DEVIATIONS))
    if line.any():
        findings.append(failure("ambient_line", frequencies=hertz[line].tolist()))
    no_axis = np.array([mode.axis == 0.0 for mode in fit.at.modes])
    single = ~(still | line.any()) & ~np.array(varying) & any(varying) & no_axis  # a line spoils what is said of others
    gone, real = decays * model.period > GONE, np.array([mode.real for mode in fit.at.modes])
    fast, lasts = gone & ~single & ~certain, real & ~(gone | single | still | line | certain)
    for code, which in (("ambient_single", single), ("ambient_fast", fast), ("ambient_real", lasts)):
        if which.any():
            findings.append(warning(code, frequencies=hertz[which].tolist()))
    if (shares[~(still | line)] > EVIDENT).any():
        worst = int(np.argmax(np.where(still | line, 0.0, shares)))
        report = warning if is_vague(shares[worst], 1.0) else note
        periods = duration / model.period * (shares / EVIDENT) ** 2
        findings.append(
            report(
                "ambient_length",
                frequency=float(hertz[worst]),
                share=float(shares[worst]),
                periods=float(periods[worst]),
                seconds=float(periods[worst] * model.period),
            )
        )
    copies = _copies(fit, shares * decays, ~gone, groups, couples)
    if groups or copies:
        report = failure if copies else warning
        findings.append(
            report("ambient_alike", frequencies=hertz[np.unique(np.concatenate([*groups, *copies]))].tolist())
        )
    return tuple(findings)


def _no_estimates(
    fit: Fit, model: PeriodicModel, shares: Floats, certain: Mask, groups: Sequence[Integers]
) -> list[Finding]:
    """Findings on modes whose fit is no maximum, or whose decay is not determined."""
    # Of poles of the excitation that are nearly one no decay is claimed, which another finding says.
    places = np.cumsum([0, *(mode.rows for mode in fit.at.modes)])[:-1]
    decays, hertz = np.abs(model.exponents[places].real), np.abs(model.exponents[places]) / (2.0 * np.pi)
    grouped = np.isin(np.arange(len(decays)), np.concatenate([*groups, []]))
    claimed = ~(grouped & (decays * model.period > GONE) & ~certain)
    short = np.array([fit.short(number) for number in range(len(decays))])
    dead = is_undetermined(shares * decays, decays, model.period) & claimed
    findings = [failure("undetermined", frequencies=hertz[dead].tolist())] if dead.any() else []
    which = claimed & (short > SHORT[0])
    if which.any():
        report, most = failure if short[which].max() > SHORT[1] else warning, float(short[which].max())
        inputs = bool(len(fit.samples.inputs))
        findings.append(report("ambient_short", frequencies=hertz[which].tolist(), deviations=most, inputs=inputs))
    return findings


def _away(fit: Fit) -> Floats:
    """The distance of each exponent from the multiples of iω, where an offset and what repeats is (modes,) [1/s]."""
    omega = fit.samples.fundamental
    rates = np.array([complex(mode.exponent.real, mode.exponent.imag + mode.axis * omega) for mode in fit.at.modes])
    return np.abs(rates - 1j * omega * np.rint(rates.imag / omega))


def _own(fit: Fit) -> Mask:
    """True of modes that are the system's: driven by a measured input, or with a negative multiplier (modes,)."""
    # Coloured excitation is driven by none, and what decays in it without turning has a positive one.
    from scipy.special import chdtrc

    certain, omega = [], fit.samples.fundamental
    for number, (mode, place) in enumerate(zip(fit.at.modes, fit.places, strict=True)):
        squares, degrees = fit.reached(number)
        halves = 2.0 * (mode.axis + mode.exponent.imag / omega)
        away, std = 0.5 * omega * abs(halves - round(halves)), fit.parameters[(place.start + mode.rows - 1,) * 2] ** 0.5
        negative = round(halves) % 2 == 1 and away <= min(DEVIATIONS * std, NEAR * abs(mode.exponent.real))
        certain.append(negative or bool(degrees and chdtrc(degrees, squares) < SURE))
    return np.array(certain)


def _copies(
    fit: Fit, std: Floats, lasting: Mask, groups: Sequence[Integers], couples: Collection[tuple[int, int]] = ()
) -> list[Integers]:
    """Pairs of modes that neither their deviations (modes,) nor their shapes separate: one of them may be a copy."""
    # A copy is seen as the other is. Both outlast a period, or one, and the other is as near as a mode of its group.
    from scipy.special import chdtrc

    modes, omega, found = fit.at.modes, fit.samples.fundamental, []
    grouped = {pair for group in groups for pair in combinations(sorted(group.tolist()), 2)}
    for first, second in combinations(range(len(modes)), 2):
        last = lasting[[first, second]]
        if (first, second) in couples or not (last.all() or (last.any() and (first, second) in grouped)):
            continue
        if gap_of(modes[first], modes[second], omega)[0] < DEVIATIONS * float(np.hypot(std[first], std[second])):
            squares, degrees, share = fit.beside(first, second)
            if share < OWN or chdtrc(degrees, squares) > SURE:
                found.append(np.array([first, second]))
    return found
