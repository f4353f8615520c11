"""Gains of a fit by more of its harmonics, to first order, and their limits: one linearisation for all tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid.fit import HALF_DIGITS, ROUNDING, chi2_limit, inverse_root, score_gain, wald_rise
from floquid.inputs._modes import InputMode, followed, reached_by
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, carried, linearise, scale_of, slopes_of, state_slopes
from floquid.inputs.search._structure import Limits

SIDES = (HALF_DIGITS, -HALF_DIGITS)

TINY = float(np.finfo(float).tiny)  # added where nothing may be divided by: a channel that says nothing of a mode
DRAWS = 30  # draws of white noise by which a fit is told from noise
FEW, FAR = 5, 0.25  # draws that tell a gain to a quarter of its deviation, and the share of a limit below which they do


class Scores:
    """Gains in twice the logarithm of the likelihood by groups of columns or parameters more (score tests).

    Of a group with gradient g the gain is g' S⁻¹ g, S its information less what all that is fitted takes of it.
    """

    def __init__(self, samples: Samples, now: Linearisation, *, rough: bool = True) -> None:
        self.samples, self.now = samples, now
        self.precision = np.float32 if rough else np.float64
        least = ROUNDING * float(np.finfo(self.precision).eps / np.finfo(float).eps)
        inner = np.complex64 if rough else np.complex128
        states = [own.astype(inner if np.iscomplexobj(own) else self.precision) for own in state_slopes(samples, now)]
        self.weights = 1.0 / now.noise
        self.columns = now.columns.astype(self.precision)
        self.left = (now.left * self.weights[:, None]).astype(self.precision)
        self.slopes = [slopes_of(samples, now, c, states, w) for c, w in enumerate(self.weights)] if now.modes else []
        self.along = [(own @ self.columns.T).astype(float) @ now.inverse for own in self.slopes]
        matrix = np.zeros((len(self.slopes[0]),) * 2) if self.slopes else np.zeros((0, 0))
        for own, along in zip(self.slopes, self.along, strict=True):
            matrix += own @ own.T - along @ (self.columns @ own.T)
        self.root = inverse_root(matrix, least, scale=scale_of(samples, now, matrix))
        self.matrix, self.least = matrix, least
        pull = np.sum([own @ left for own, left in zip(self.slopes, self.left, strict=bool(now.modes))], axis=0)
        self.promised = float(
            np.sum((self.root.T @ pull) ** 2) if now.modes else 0.0
        )  # the gain that the fit itself may still have

    def by_columns(self, groups: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """The gains by groups of columns, each linear in every channel (columns, samples) (groups,)."""
        if not groups:
            return np.zeros(0)
        # Columns of a trial that grows beyond all bounds gain nothing.
        with np.errstate(over="ignore", invalid="ignore"):
            return np.array(self._gains(groups))

    def _gains(self, groups: Sequence[NDArray[np.float64]]) -> list[float]:
        extra = np.concatenate(groups).astype(self.precision)
        beyond = (
            extra - ((extra @ self.columns.T).astype(float) @ self.now.inverse).astype(self.precision) @ self.columns
        )
        pull = (beyond @ self.left.T).astype(float)
        size = np.einsum("kn,kn->k", extra, extra).astype(float)
        mixed = [self.root.T @ (own @ beyond.T) for own in self.slopes]
        found, place, channels = [], 0, len(self.left)
        for own in groups:
            rows = slice(place, place + len(own))
            place += len(own)
            information = (beyond[rows] @ beyond[rows].T).astype(float)
            left = np.asarray(np.kron(np.eye(channels), information), np.float64)
            if mixed:
                both = np.concatenate([part[:, rows] for part in mixed], axis=1)
                left -= both.T @ both
            found.append(score_gain(pull[rows].T.ravel(), left, self.least, before=np.tile(size[rows], channels)))
        return found

    def by_inputs(
        self, asked: Sequence[tuple[int, float]], inputs: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """The gains by the inputs at a harmonic more that a mode does not have yet: of modes and harmonics (asked,).

        By other inputs if they are given (inputs, samples).
        """
        if not asked:
            return np.zeros(0)
        now, samples, drives = self.now, self.samples, []
        if inputs is not None:
            samples = replace(samples, inputs=inputs)
        many, inner = len(samples.inputs), np.result_type(self.precision, 1j)
        for mode, turn in asked:
            own = now.modes[mode]
            alone = replace(own, reach=np.array([turn]), gains=np.ones((many, 1), complex))
            driven = reached_by(samples, alone)[: (2 if own.real else 1) * many]
            drives.append(driven.astype(self.precision if own.real else inner))
        counts = [len(own) if now.modes[m].real else 2 * len(own) for own, (m, _) in zip(drives, asked, strict=True)]
        ends = np.cumsum([0, *counts])
        places = [slice(a, b) for a, b in pairwise(ends.tolist())]
        information, pull, size = [np.zeros((count, count)) for count in counts], np.zeros(ends[-1]), np.zeros(ends[-1])
        mixed = np.zeros((self.root.shape[1], ends[-1]))
        for channel, (own, along) in enumerate(zip(self.slopes, self.along, strict=True)):
            rows = np.empty((ends[-1], samples.n_samples), self.precision)
            shapes = {
                mode: self.weights[channel]
                * carried(samples, now.shape(mode)[:, channel], now.modes[mode].turns.tolist())
                for mode in {mode for mode, _ in asked}
            }
            for place, part, (mode, _) in zip(places, drives, asked, strict=True):
                moved = shapes[mode].astype(inner) * part
                rows[place] = moved.real if now.modes[mode].real else np.concatenate([moved.real, -moved.imag])
            seen = (rows @ self.columns.T).astype(float)
            size += np.einsum("kn,kn->k", rows, rows)
            for place, block in zip(places, information, strict=True):
                block += rows[place] @ rows[place].T - seen[place] @ now.inverse @ seen[place].T
            mixed += self.root.T @ (own @ rows.T - along @ seen.T)
            pull += rows @ self.left[channel]
        return np.array(
            [
                score_gain(pull[place], block - mixed[:, place].T @ mixed[:, place], self.least, before=size[place])
                for place, block in zip(places, information, strict=True)
            ]
        )

    def by_noise(self, draws: int = DRAWS) -> float:
        """The gain by noise that drives the modes, zero where there is less of what it leaves than white noise has."""
        # The gain of the predictor of a mode is P c(t)ᴴ R⁻¹ to first order in the variance P > 0 of its state. A fit
        # takes some of what is near its modes, whatever the noise: how much, draws of white noise tell. The rest is a
        # sum of white noise by what was before: its spread is the size of these slopes, less what the fit takes of
        # them.
        if not (self.now.heard.any() and self.now.modes):
            return 0.0
        pulls, sizes, beyond = self._by_noise
        generator, drawn = np.random.default_rng(0), np.zeros((4, draws, len(pulls)))
        for draw in range(draws):
            whole = self.samples.kept(generator.standard_normal(self.left.shape, self.precision))
            for place, own in ((0, self.unfitted(whole)), (2, whole)):
                drawn[place, draw], found = self._pulls(own)
                drawn[place + 1, draw] = np.einsum("mcn,mcn->m", found, found) + TINY
        # Of a whole draw the mean is none: less that, what is taken is told three times as well.
        taken = drawn[0] / np.sqrt(drawn[1]) - drawn[2] / np.sqrt(drawn[3].mean(axis=0))
        return max(float(np.sum(pulls / sizes - taken.mean(axis=0)) / (beyond + TINY)), 0.0) ** 2

    @cached_property
    def _by_noise(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """The gradient by noise that drives each mode, the size of its slopes, and that of their sum beside the fit."""
        pulls, slopes = self._pulls(self.left)
        sizes = np.sqrt(np.einsum("mcn,mcn->m", slopes, slopes)) + TINY
        return pulls, sizes, float(np.linalg.norm(self.unfitted(np.tensordot(1.0 / sizes, slopes, 1))))

    @cached_property
    def shapes_heard(self) -> list[tuple[NDArray[np.bool_], NDArray[np.complex128]]]:
        """Mask of the channels heard, and the shape of each mode over the noise in these (channels heard, samples)."""
        heard = self.now.heard
        return [
            (
                heard,
                carried(self.samples, self.now.shape(number).T[heard] * self.weights[heard, None], mode.turns.tolist()),
            )
            for number, mode in enumerate(self.now.modes)
        ]

    def _pulls(self, left: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The gradient by noise that drives each mode, of what is left (channels, samples) (modes,), and its slopes.

        Those are (modes, channels, samples), nothing where what is left is no noise.
        """
        slopes = np.zeros((len(self.now.modes), *left.shape))
        for number, (mode, (heard, shape)) in enumerate(zip(self.now.modes, self.shapes_heard, strict=True)):
            slopes[number, heard] = (
                shape * followed(self.samples, mode, np.sum(shape.conj() * left[heard], axis=0))
            ).real
        return np.einsum("mcn,cn->m", slopes, left), slopes

    def unfitted(self, values: NDArray) -> NDArray:
        """Residual of a response after this fit, to first order, over its noise (channels, samples)."""
        own = (values @ self.columns.T) @ self.now.inverse
        values, step = values - own.astype(self.precision) @ self.columns, np.zeros(self.root.shape[1])
        for slopes, left in zip(self.slopes, values, strict=True):
            step += self.root.T @ (slopes @ left)
        by = (self.root @ step).astype(self.precision)
        taken = [
            by @ slopes - (by @ along).astype(self.precision) @ self.columns
            for slopes, along in zip(self.slopes, self.along, strict=True)
        ]
        return values - np.array(taken)

    @cached_property
    def spread_root(self) -> NDArray[np.float64]:
        """A root of the covariance of the free parameters; of what the record says nothing of it is large."""
        return inverse_root(self.matrix, self.least, floor=True, scale=scale_of(self.samples, self.now, self.matrix))

    @cached_property
    def of_modes(self) -> NDArray[np.float64]:
        """Squared deviations of the shape of each mode from zero, all else moving along (Wald tests) (modes,)."""
        found, now = [], self.now
        root = self.spread_root
        for own, _ in now.slices():
            spread = np.kron(np.eye(len(self.left)), now.inverse[own, own])
            along = np.concatenate([part[:, own] for part in self.along], axis=1).T @ root
            shape = (now.coefficients[own] * self.weights).T.ravel()
            whole = spread + along @ along.T
            found.append(wald_rise(shape, whole, ROUNDING))
        return np.array(found)

    def step_along(self, slopes: NDArray[np.float64]) -> tuple[float, float]:
        """The step of one parameter with these slopes (channels, samples), all others moving along, and its deviation.

        Infinite where nothing is known of it.
        """
        now, own, pull, mixed = self.now, 0.0, 0.0, np.zeros(self.root.shape[1])
        for channel, weight in enumerate(self.weights):
            slope = weight * slopes[channel]
            beyond = slope - (now.columns @ slope) @ now.inverse @ now.columns
            own += float(beyond @ slope)
            pull += float(beyond @ self.left[channel])
            mixed += self.root.T @ (self.slopes[channel] @ beyond)
        information = own - float(mixed @ mixed)
        if not information > ROUNDING * own:
            return 0.0, float(np.inf)
        return pull / information, information**-0.5


def period_step(scores: Scores) -> tuple[float, float]:
    """(Own period - period given)/period given, as the response has it, to first order, and its deviation."""
    omega = scores.samples.fundamental
    step, std = _step(scores, [replace(scores.samples, fundamental=omega * (1.0 + by)) for by in SIDES])
    return -step, std


def phase_step(scores: Scores, number: int) -> tuple[float, float]:
    """The share of a period by which a record is later than its clock says, to first order, and its deviation."""
    samples, period = scores.samples, 2.0 * np.pi / scores.samples.fundamental
    return _step(scores, [samples.later(number, by * period) for by in SIDES])


def _step(scores: Scores, moved: Sequence[Samples]) -> tuple[float, float]:
    """The step of what was moved by half the digits to either side, to first order, and its deviation."""
    now = scores.now
    one, other = (now.coefficients.T @ linearise(own, now.modes, now.direct).columns for own in moved)
    return scores.step_along((one - other) / (2.0 * HALF_DIGITS))


def gain_of(scores: Scores, samples: Samples, modes: Sequence[InputMode]) -> float:
    """The gain by modes that answer to other inputs nearly alike, to first order; zero where the record tells none."""
    # A step of 0 along the difference of both responses is what was fitted, one of 1 is the other.
    now = scores.now
    apart = now.coefficients.T @ (linearise(samples, modes, now.direct).columns - now.columns)
    step, std = scores.step_along(apart)
    return (2.0 * step - 1.0) / std**2


def by_noise_beyond(scores: Scores, limits: Limits, promised: float = 0.0) -> float:
    """The fall of J by noise that drives the modes, as a number more; zero where noise of sensors explains all."""
    # Inputs at any harmonic, and modes at any frequency near, make up for such noise: they must be better than it.
    limit = chi2_limit(1, limits.harmonic_alarm)
    # A few draws do where it is far below, or below what is promised.
    gain = scores.by_noise(FEW)
    return max((gain if gain < FAR * max(limit, promised) else scores.by_noise()) - limit, 0.0)
