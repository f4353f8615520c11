"""Errors of the angle of a shaft, and what they make of the response."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid.checks._check import Evidence
from floquid.findings import Finding, failure, warning

if TYPE_CHECKING:
    from floquid.checks._decays import Decays
    from floquid.checks._parted import Parted

ENERGY = 400.0  # misfit that errors of the angle may add, spread over the lines about each harmonic

SHAKEN, BLURRED = 0.5, 2.0
"""Shares of the variance of what is left that errors of the shaft's angle may make, and up to which a model stands."""


def angle(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on errors of the angle of the shaft that stand out of the noise."""
    return case.vague_angles() if case.shafts else ()


def blurred(case: Decays) -> tuple[Finding, ...]:
    r"""Finding on what the error of the shaft's angle makes of the response.

    .. math:: \sum_{c,h} \frac{\sigma_{\theta,h}^2}{s_{c,h}^2} \Big( \frac{N_h}{2} \sum_j (j\, a_{c,h,j})^2
              + \sum_r \sum_n e^{2 \Re \lambda_r t_n} \sum_m |m B_{r,c,h,m}|^2 \Big)

    with a the amplitudes of the harmonics j of the forced response, B the coefficients of the modes, σ the deviation of
    the angle [rad], and s the noise.
    """
    forced, model = case.forced, case.model
    energy, degrees = 0.0, 0.0
    for hit, (shaft, record) in enumerate(zip(case.shafts, case.records, strict=True)):
        std = float(np.sqrt(np.mean(shaft.angle_std(np.clip(record.times, shaft.first, shaft.last)) ** 2)))
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


def shaken(own: Parted, columns: Floats, noise: Floats) -> tuple[Finding, ...]:
    r"""Findings on what the error of the shaft's angle makes of the response, over the variance of what is left.

    .. math:: \max_c \frac{\sigma_\theta^2}{s_c^2} \Big(\frac12 \sum_j (j\, a_{c,j})^2 + \sigma_c^2\Big)

    with a the amplitudes of the harmonics j of the steady response, of `columns` (channels, known), σ the deviations of
    the angle of the system and of the rest of the response, and s the `noise` (channels,).
    """
    samples, several = own.samples, own.periods_per_revolution
    columns = columns[:, : len(samples.known)]  # inputs that act at once may follow
    parts = columns[:, len(samples.records) :].reshape(len(columns), len(own.turns), 2)
    steady = 0.5 * np.sum((np.array(own.turns)[:, None] * parts) ** 2, axis=(1, 2))
    power = float(np.max((steady + np.var(samples.values - columns @ samples.known, axis=1)) / noise**2))
    found = []
    for shaft, record in zip(own.shafts, own.records, strict=True):
        std = several * float(np.sqrt(np.mean(shaft.angle_std(np.clip(record.times, shaft.first, shaft.last)) ** 2)))
        if (share := std**2 * power) > SHAKEN:
            told = failure if share > BLURRED else warning
            found.append(told("vague_angle", degrees=float(np.degrees(std / several)), share=share))
        left = several**2 * float(np.mean(shaft.residuals[shaft.kept] ** 2))
        found += [finding for finding in shaft.findings if finding.code == "angle_alike" and left * power > SHAKEN]
    return tuple(found)
