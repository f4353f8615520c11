"""One random system identified with order and noise unknown, and judged by what could be known."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass

import numpy as np
from benchmarks.order.random_systems import RandomSystem

from floquid.errors import IdentificationError
from floquid.lifting import lift
from floquid.pipeline import Settings, find_poles
from floquid.testing import pair_exponents

OFF = 10.0
"""The bounds by which a mode may be off before it counts as lost."""


@dataclass(frozen=True)
class Found:
    """What an identifier says of a record."""

    poles: np.ndarray
    ambiguous: bool
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Row:
    """One system and draw: what was there, what was found, and whether that is right."""

    seed: int
    draw: int
    classes: tuple[str, ...]
    n_outputs: int
    n_cycles: tuple[int, ...]
    n_modes: int
    noise: float
    true: int
    """The order of the system."""
    expected: int
    """The number of poles of modes that must be found."""
    order: int
    ambiguous: bool
    reasons: tuple[str, ...]
    lost: int
    """Poles that must be found, and are missed or off by more than ten bounds."""
    extra: int
    """Poles beyond those of the system."""
    stray: int
    """Poles farther from every one of the system than its decay and ten bounds."""
    squares: tuple[float, ...]
    """Squared errors over the bound of both parts of each pole that must be found and was not lost."""
    all_squares: tuple[float, ...]
    """The same of every pole of the system, where as many were found."""
    seconds: float

    @property
    def told(self) -> bool:
        """Whether every mode of the system can be told by its bound."""
        return self.expected == self.true

    @property
    def right(self) -> bool:
        """Whether no mode is lost, none is stray, and there are no more poles than the system has.

        Modes that need not be found may be found or not; where all must, this is the right order.
        """
        return not self.lost and not self.stray and self.expected <= self.order <= self.true

    @property
    def silent(self) -> bool:
        """Whether the answer is wrong and nothing says so."""
        return not self.right and not self.ambiguous

    def as_json(self) -> dict:
        """The row with what follows from it."""
        return {**asdict(self), "told": self.told, "right": self.right, "silent": self.silent}


def identified(system: RandomSystem, draw: int) -> Found:
    """What the chain says of the lifted record of one draw, from its own estimate of the noise."""
    try:
        _, model, choice = find_poles(lift(system.cycles(draw)), Settings())
    except IdentificationError as error:
        # A refusal says that something is wrong, except where it says that there is nothing.
        return Found(np.zeros(0, complex), "no mode rises" not in str(error), (str(error),))
    assert choice is not None
    return Found(model.poles, choice.ambiguous, choice.doubts)


def judged(system: RandomSystem, draw: int) -> Row:
    """The row of one system and draw."""
    begin = time.perf_counter()
    found = identified(system, draw)
    seconds = time.perf_counter() - begin
    truth, period = system.truth, system.truth.period
    yardsticks = system.findable()
    must = np.all([f.must for f in yardsticks], axis=0)
    bound = np.max([np.stack([f.std.real, f.std.imag]) for f in yardsticks], axis=0)
    least = 1e-9 * truth.fundamental
    wanted, poles = truth.exponents[must], found.poles
    # A real multiplier has no deviation of its imaginary part; found as a pair, it is judged by that of the real one.
    allowed = np.maximum(np.where(bound > 0, bound, bound.max(axis=0)), least)
    counted = bound > least
    error = np.full((2, truth.order), np.inf)
    error[:, must] = _errors(poles, wanted, period)
    lost = must & (error / allowed > OFF).any(axis=0)
    squares = (error / allowed)[counted & must & ~lost] ** 2
    whole = len(poles) == truth.order
    all_squares = (_errors(poles, truth.exponents, period) / allowed)[counted] ** 2 if whole else np.zeros(0)
    largest = np.abs(system.clean()[0][0]).max()
    return Row(
        seed=system.seed,
        draw=draw,
        classes=system.classes,
        n_outputs=len(truth.channels) * system.n_phases,
        n_cycles=tuple(int(n) for n in system.lengths),
        n_modes=int((system.multipliers.imag >= 0).sum()),
        noise=float(system.noise[0, 0] / largest),
        true=truth.order,
        expected=int(must.sum()),
        order=len(poles),
        ambiguous=found.ambiguous,
        reasons=found.reasons,
        lost=int(lost.sum()),
        extra=max(0, len(poles) - truth.order),
        stray=_stray(poles, truth.exponents, bound.max(axis=0), truth.fundamental),
        squares=tuple(float(x) for x in squares),
        all_squares=tuple(float(x) for x in all_squares),
        seconds=seconds,
    )


def _errors(poles: np.ndarray, wanted: np.ndarray, period: float) -> np.ndarray:
    """What each wanted exponent is off by, real and imaginary part; infinite where there are too few (2, wanted)."""
    off = np.full(len(wanted), complex(np.inf, np.inf))
    if len(poles) >= len(wanted):
        off = pair_exponents(poles, wanted, period).differences
    elif len(poles):
        pairing = pair_exponents(wanted, poles, period)
        off[pairing.permutation] = pairing.differences
    return np.stack([np.abs(off.real), np.abs(off.imag)])


def _stray(poles: np.ndarray, truth: np.ndarray, bound: np.ndarray, fundamental: float) -> int:
    """The poles that belong to no true one: a merged pair lies near both, what noise made near none."""
    gap = np.subtract.outer(poles, truth)
    gap = np.abs(gap - 1j * fundamental * np.rint(gap.imag / fundamental))
    return int((gap > np.abs(truth.real) + OFF * bound).all(axis=1).sum())
