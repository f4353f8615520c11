"""The period of the response against that of the model, the phases of records, and errors of the shaft's angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid.checks._check import Evidence
from floquid.checks._residual import BESIDE
from floquid.findings import Finding, failure, warning
from floquid.fit import SIGNIFICANT
from floquid.innovations import turned_records

if TYPE_CHECKING:
    from floquid.checks._decays import Decays
    from floquid.checks._excited import Parted


@dataclass(frozen=True, slots=True, kw_only=True)
class Off:
    """Difference of the response's own period from that of the model, over the latter, to first order."""

    relative: float
    std: float | None  # None where it is not to be quoted
    deviations: float
    limit: float
    near: bool = True  # a step so small that first order tells the own period


def period(case: Any, evidence: Evidence) -> tuple[Finding, ...]:
    """Finding on a period that is not that of the response."""
    off: Off | None = case.period_off()
    if off is None or evidence.kept("period", off.deviations, off.limit):
        return ()
    given, numbers = case.model.period, dict[str, Any](deviations=off.deviations)
    if off.near:
        numbers |= {"own": given * (1.0 + off.relative), "std": None if off.std is None else given * off.std}
    return evidence.against("wrong_period", "period", given=given, **numbers)


def phases(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on records after the first that are at another phase."""
    # By half a period the slope along the phase is none: that is told by how their products turn.
    steps = case.phase_steps()
    turned = turned_records(case.own.samples) if steps else []
    return (
        *(failure("records_phase", record=number + 1) for number in turned),
        *(
            failure("records_phase", record=number + 1, deviations=abs(step) / std)
            for number, (step, std) in enumerate(steps, start=1)
            if number not in turned and abs(step) > SIGNIFICANT * std
        ),
    )


ENERGY = 400.0  # misfit that errors of the angle may add, spread over the lines about each harmonic

SHAKEN, BLURRED = 0.5, 2.0
"""Shares of the variance of what is left that errors of the shaft's angle may make, and up to which a model stands."""


def blurred(case: Decays) -> tuple[Finding, ...]:
    r"""Finding on what the error of the shaft's angle makes of the response.

    .. math:: \sum_{c,h} \frac{\sigma_{\theta,h}^2}{s_{c,h}^2} \Big( \frac{N_h}{2} \sum_j (j\, a_{c,h,j})^2
              + \sum_r \sum_n e^{2 \Re \lambda_r t_n} \sum_m |m B_{r,c,h,m}|^2 \Big)

    with a the amplitudes of the harmonics j of the forced response, B the coefficients of the modes, σ the deviation of
    the angle [rad], and s the noise.
    """
    forced, model = case.forced, case.model
    energy, degrees = 0.0, 0.0
    for hit, (clock, record) in enumerate(zip(case.clocks, case.records, strict=True)):
        std = clock.angle_spread(record.times)
        noise = case.noise[:, hit, None]
        if forced is not None:
            shares = forced.harmonics * forced.amplitudes[:, hit] / noise
            energy += 0.5 * record.n_samples * std**2 * float(np.sum(shares**2))
        step = np.minimum(2.0 * model.exponents.real / record.sample_rate, -np.finfo(float).tiny)
        lasting = np.expm1(record.n_samples * step) / np.expm1(step)
        turned = np.abs(model.harmonics * model.coefficients[:, :, hit] / noise) ** 2
        energy += std**2 * float(lasting @ turned.sum(axis=(1, 2)))
        degrees = max(degrees, float(np.degrees(std)))
    return () if energy < ENERGY else (warning("vague_angle", degrees=degrees, energy=energy),)


def beside_harmonics(case: Decays) -> tuple[Finding, ...]:
    r"""Finding on modes beside the forced response of a shaft whose angle no pulse tells finely, only its mean speed.

    .. math:: \min_{j, m} |\Im \lambda_r / \omega + m - j / \nu| \, N < 4

    with j the harmonics of the revolution in the forced response, ν periods in one, and N the periods of the longest
    record: lines on either side of a tone, as its residual is searched. There a wander of the speed makes modes.
    """
    forced, model = case.forced, case.model
    if forced is None or not any(clock.fitted for clock in case.clocks):
        return ()
    periods = max(record.duration for record in case.records) / model.period
    off = np.subtract.outer(
        model.exponents.imag / model.fundamental, forced.harmonics * model.period / forced.revolution
    )
    near = periods * np.abs(off - np.rint(off)).min(axis=1, initial=np.inf) < BESIDE
    modes = np.flatnonzero(near & (model.exponents.imag >= 0.0))
    return (warning("beside_harmonics", frequencies=model.frequencies_hz[modes]),) if len(modes) else ()


def shaken(parted: Parted, columns: Floats, noise: Floats) -> tuple[Finding, ...]:
    r"""Findings on what the error of the shaft's angle makes of the response, over the variance of what is left.

    .. math:: \max_c \frac{\sigma_\theta^2}{s_c^2} \Big(\frac12 \sum_j (j\, a_{c,j})^2 + \sigma_c^2\Big)

    with a the amplitudes of the harmonics j of the steady response, of `columns` (channels, known), σ the deviations of
    the angle of the system and of the rest of the response, and s the `noise` (channels,).
    """
    samples, several = parted.samples, parted.periods_per_revolution
    columns = columns[:, : len(samples.known)]  # inputs that act at once may follow
    first, turns = len(samples.records), len(parted.turns)
    parts = columns[:, first : first + 2 * turns].reshape(len(columns), turns, 2)
    steady = 0.5 * np.sum((np.array(parted.turns)[:, None] * parts) ** 2, axis=(1, 2))
    power = float(np.max((steady + np.var(samples.values - columns @ samples.known, axis=1)) / noise**2))
    findings = []
    for shaft, record in zip(parted.shafts, parted.records, strict=True):
        std = several * shaft.angle_spread(record.times)
        if (share := std**2 * power) > SHAKEN:
            report = failure if share > BLURRED else warning
            findings.append(report("vague_angle", degrees=float(np.degrees(std / several)), share=share))
        scatter = several**2 * float(np.mean(shaft.residuals[shaft.kept] ** 2))
        findings += [
            finding for finding in shaft.findings if finding.code == "angle_alike" and scatter * power > SHAKEN
        ]
    return tuple(findings)
