"""What the residual of a fit with inputs says against its inputs, and against a linear system."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.findings import Finding, failure, warning
from floquid.inputs import Samples, Scores, Uncertainty, answering, gain_of, limit_of, solve

SURE = 1e-9
"""The probability at which noise may pass for something that is told."""

NOISE = 1e-4
"""The probability at which noise of sensors may pass for noise that drives the system."""

MORE = 2.0
"""What squares and cubes must gain, over what noise that drives the system does: it lets them gain by chance."""

UNTOLD = 15.0
"""The criterion of a fit of one size over another below which the record does not tell them: Φ(-√15) is 10⁻⁴/2."""

HOPELESS = -50.0
"""The gain to first order below which other instants are not fitted."""

STEPS = 10
"""Steps of the fit with other instants."""

VAGUE = 0.3
"""The deviation of a decay over it, from which on a mode may stand for inputs at other instants."""

AT_ONCE = 1.0
"""The decay from sample to sample from which on it may, too [nepers]."""


def doubts(fit: Uncertainty, scores: Scores) -> tuple[Finding, ...]:
    """Finding on inputs that act at other instants than it was said, on noise that drives the system, or on squares.

    Each leaves what the others do, too: squares and cubes gain several times what noise does where they are the cause.
    """
    by_noise, by_powers = scores.by_noise(), _by_powers(scores)
    return _instants(fit, scores) or (
        _driven_by_noise(scores, by_noise)
        if MORE * by_noise > by_powers.max(initial=0.0)
        else _nonlinear(by_powers, len(scores.now.left))
    )


def _moved(samples: Samples, lag: int) -> NDArray[np.float64]:
    """The inputs some samples ago, zero where there were none (inputs, samples)."""

    def of(own: NDArray) -> NDArray:
        found, count = np.zeros_like(own), own.shape[1]
        if abs(lag) < count:
            found[:, max(lag, 0) : count + min(lag, 0)] = own[:, max(-lag, 0) : count - max(lag, 0)]
        return found

    return samples.each(samples.inputs, of)


def _instants(fit: Uncertainty, scores: Scores) -> tuple[Finding, ...]:
    """Finding on inputs that come late or early, or between the samples in another way than `hold` says.

    Gains take up a delay but for the first samples of each response. For those a direct term stands, or modes that die
    at once: with the right instants none of that is needed. Else a fit to first order tells what no other needs to be.
    """
    samples, now = scores.samples, scores.now
    modes = [
        mode
        for mode, (place, _) in zip(now.modes, fit.places, strict=True)
        if fit.parameters[place.start, place.start] ** 0.5 < VAGUE * abs(mode.exponent.real)
        and -mode.exponent.real * samples.step < AT_ONCE
    ]
    if not modes:
        return ()
    plainly, others = not now.direct and len(modes) == len(now.modes), {}
    for (delay, hold), other in _others(samples):
        alike = [answering(samples, mode, other, delay) for mode in modes]
        if not (plainly and gain_of(scores, other, alike) < HOPELESS):
            others[delay, hold] = solve(other, alike, iterations=STEPS).criterion
    if not others:
        return ()

    # A direct term comes in by noise, too: as it was said, but without it, is one of those compared.
    plain = now.criterion if plainly else solve(samples, modes, iterations=STEPS).criterion
    delay, hold = max(others, key=lambda key: others[key])
    if others[delay, hold] > max(plain + UNTOLD, now.criterion):
        return (failure("inputs_instants", delay=delay, hold=hold, given=samples.hold),)
    delays = {own: other for (own, _), other in others.items() if own}
    delay = max(delays, key=lambda own: delays[own], default=0)
    if not delay or delays[delay] < max(plain, now.criterion) - UNTOLD:
        return ()
    share = max(abs(np.expm1(mode.exponent * delay * samples.step)) for mode in modes)
    return (warning("inputs_untold", delay=delay, share=share),)


def _others(samples: Samples) -> Iterator[tuple[tuple[int, str], Samples]]:
    """Samples of which the inputs act at other instants, with the delay in samples and the hold."""
    for delay in (1, -1):
        yield (delay, samples.hold), replace(samples, inputs=_moved(samples, delay))
    for hold in ("zero", "first", "none"):
        if hold != samples.hold:
            yield (0, hold), replace(samples, hold=hold)


def _driven_by_noise(scores: Scores, gain: float) -> tuple[Finding, ...]:
    """Finding on what drives the system beside the inputs: what is left follows through the modes from what was left.

    Noise w on an input u acts as a force -w that nobody measured (Söderström 2007).
    """
    limit = limit_of(1, NOISE)
    if gain < limit:
        return ()
    left = scores.now.left
    share = np.linalg.norm(left, axis=1) / np.linalg.norm(scores.samples.values - left, axis=1)
    return (failure("inputs_noise", squares=gain, limit=limit, share=float(share.min())),)


def _by_powers(scores: Scores) -> NDArray[np.float64]:
    """Gains by squares and cubes of the response as inputs of each mode (Billings and Voon 1983) (modes,)."""
    samples, now = scores.samples, scores.now
    fitted = samples.values - now.left
    size = fitted.std(axis=1, keepdims=True)
    fitted = (fitted - fitted.mean(axis=1, keepdims=True)) / np.where(size > 0.0, size, 1.0)
    powers = np.concatenate([fitted**2, fitted**3])
    powers -= powers.mean(axis=1, keepdims=True)
    return scores.by_inputs([(number, mode.lowest) for number, mode in enumerate(now.modes)], powers)


def _nonlinear(gains: NDArray[np.float64], channels: int) -> tuple[Finding, ...]:
    """Finding on squares and cubes of the response that drive the modes as inputs would."""
    limit = limit_of(4 * channels, SURE / max(len(gains), 1))
    if gains.max(initial=0.0) < limit:
        return ()
    return (failure("inputs_nonlinear", squares=float(gains.max()), limit=limit),)
