"""The way of measured inputs to the modes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid.checks._check import Evidence
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure, warning
from floquid.fit import SURE, chi2_limit, wald_rise
from floquid.inputs import Uncertainty

if TYPE_CHECKING:
    from floquid.checks._excited import Parted

POOR = 2.0
"""Deviations that some b of an input must be from zero, or it is not known how the input reaches the modes."""

BUSY = 0.5
"""The share of samples at which an input that began late moves from then on: one that is silent often is blows."""


def reach(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on modes that no input reaches, and on inputs that were measured from later on alone."""
    found = _unreached(case.fit)
    ringing = any(not own.numbers["line"] for own in found)
    return (*found, *(_began(case.own) if case.coloured or ringing else ()))


def _unreached(fit: Uncertainty) -> tuple[Finding, ...]:
    """Findings on modes that no input reaches as far as the record shows: what does not decay there is a line."""
    found, longest = [], max(own.stop - own.start for own in fit.samples.records) * fit.samples.step
    for number, mode in enumerate(fit.at.modes):
        place, free = fit.places[number]
        size, starts = mode.gains.size, len(mode.initial)
        own = np.concatenate([mode.gains.real.ravel(), mode.gains.imag.ravel()])
        # The imaginary part of a real multiplier's turn zero is no parameter.
        there = np.concatenate([np.ones(size, bool), np.tile(mode.reach > 0.0, len(mode.gains)) | (not mode.real)])
        later = 1 + size if mode.real else 2 + size + starts
        rows = np.concatenate([np.arange(1, 1 + size), np.arange(later, later + size)])[there]
        flat = own[there]
        if not free[rows].all():
            continue  # its scale is that of an input: that one reaches it
        index = place.start + np.cumsum(free)[rows] - 1
        spread = fit.parameters[np.ix_(index, index)]
        if wald_rise(flat, spread) < chi2_limit(len(index), SURE):
            half = mode.turns[0] % 1.0 if mode.real else 0.0  # of a negative multiplier
            exponent = mode.exponent + 1j * half * fit.samples.fundamental
            line = abs(exponent.real) * longest < 1.0
            told, hertz = failure if line else warning, abs(exponent) / (2.0 * np.pi)
            found.append(told("unreached", frequency=hertz, line=line))
    return tuple(found)


def _began(own: Parted) -> tuple[Finding, ...]:
    """Findings on inputs that begin later than a record, as where they were measured from then on alone.

    What drove the system before is taken for modes that ring from the begin, which no input reaches.
    """
    samples, found = own.samples, []
    for number, part in enumerate(samples.records, start=1):
        moves = samples.inputs[:, part] != samples.inputs[:, part.start, None]
        quiet = moves.argmax(axis=1)
        busy = [bool(row[first:].mean() > BUSY) for row, first in zip(moves, quiet, strict=True)]
        late = np.flatnonzero(busy & (quiet * samples.step * samples.fundamental > 2.0 * np.pi))
        if len(late):
            names, seconds = [own.inputs[row].name for row in late], float(quiet[late].max()) * samples.step
            found.append(failure("inputs_began", channels=names, record=number, seconds=seconds))
    return tuple(found)


def undriven(model: PeriodicModel) -> tuple[Finding, ...]:
    """Finding on inputs of which no b is told from none: they act at too few phases of the period, or frequencies."""
    own = model.inputs
    if own is None or own.coefficient_std is None:
        return ()
    size, std = np.abs(own.coefficients), np.abs(own.coefficient_std)
    # The b that is the scale of a mode has no deviation: it is told if the others of that mode are known by it.
    fixed = np.where(std == 0.0, size, 0.0).max(axis=-1) > POOR * std.max(axis=-1)
    told = np.any(((size > POOR * std) & (std > 0.0)).any(axis=-1) | fixed, axis=0)
    names = [own.channels[row].name for row in np.flatnonzero(~told)]
    return (warning("inputs_poor", channels=names),) if names else ()
