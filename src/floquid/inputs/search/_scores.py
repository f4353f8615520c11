"""Gains of a fit by more of its harmonics, to first order, and their limits: one linearisation for all tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import BLOCK, Complexes, Floats, Mask
from floquid.fit import HALF_DIGITS, ROUNDING, chi2_limit, inverse_root, score_gain, wald_rise
from floquid.inputs._carried import carried
from floquid.inputs._modes import InputMode, followed
from floquid.inputs._samples import Samples
from floquid.inputs._slopes import slopes_in_parts
from floquid.inputs._solver import Linearisation, columns_at, normal_equations, numbers_of, scale_of, slopes_of
from floquid.inputs.search._structure import Limits

Group = Callable[[Samples, slice], Floats]
"""Columns in a part of the samples, by that part and its place among all (columns, samples)."""

MOST_KEPT = 2 * BLOCK  # numbers up to which the derivatives of the states are kept from one test to the next
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
        self.weights = 1.0 / now.noise
        self.left = (now.left * self.weights[:, None]).astype(self.precision)
        matrix, pull, along = normal_equations(samples, now, rough=rough)
        self.along = along @ now.inverse
        self.root = inverse_root(matrix, least, scale=scale_of(samples, now, matrix))
        self.matrix, self.least = matrix, least
        self.promised = float(np.sum((self.root.T @ pull) ** 2))  # the gain that the fit itself may still have

    def by_columns(self, groups: Sequence[Group]) -> Floats:
        """The gains by groups of columns, each linear in every channel (groups,)."""
        if not groups:
            return np.zeros(0)
        # Columns of a trial that grows beyond all bounds gain nothing.
        with np.errstate(over="ignore", invalid="ignore"):
            return np.array(self._gains(groups))

    def _gains(self, groups: Sequence[Group]) -> list[float]:
        now, channels, taken, each = self.now, len(self.left), 0.0, []
        for own, part in self.samples.in_parts(numbers_of(now)):
            each = [of(part, own) for of in groups]
            extra = np.concatenate(each).astype(self.precision)
            taken = taken + (extra @ now.columns.of(part, own).astype(self.precision).T).astype(float)
        taken = (taken @ now.inverse).astype(self.precision)
        count = len(taken)
        pull, size, both = np.zeros((count, channels)), np.zeros(count), np.zeros((count, count))
        mixed = np.zeros((channels, len(self.root), count))
        for own, part, columns, states in self._parts():
            extra = np.concatenate([of(part, own) for of in groups]).astype(self.precision)
            size += np.einsum("kn,kn->k", extra, extra)
            beyond = extra - taken @ columns
            pull += beyond @ self.left[:, own].T
            both += beyond @ beyond.T
            for channel, found in enumerate(mixed if now.modes else ()):
                found += slopes_of(part, now, channel, states, self.weights[channel]) @ beyond.T
        mixed, gains = self.root.T @ mixed, []
        for rows in np.split(np.arange(count), np.cumsum([len(own) for own in each])[:-1]):
            left = np.asarray(np.kron(np.eye(channels), both[np.ix_(rows, rows)]), np.float64)
            through = np.concatenate(list(mixed[:, :, rows]), axis=1)
            left -= through.T @ through
            gains.append(score_gain(pull[rows].T.ravel(), left, self.least, before=np.tile(size[rows], channels)))
        return gains

    def _parts(self) -> Iterable[tuple[slice, Samples, NDArray, list[NDArray]]]:
        """Parts of the samples with the columns and the derivatives of the states there, kept where these are few."""
        few = numbers_of(self.now) * self.samples.n_samples < MOST_KEPT
        return self._kept if few else self._formed()

    @cached_property
    def _kept(self) -> list[tuple[slice, Samples, NDArray, list[NDArray]]]:
        return list(self._formed())

    def _formed(self) -> Iterator[tuple[slice, Samples, NDArray, list[NDArray]]]:
        now, inner = self.now, np.result_type(self.precision, 1j)
        for part in slopes_in_parts(self.samples, now.modes, now.states, numbers_of(now)):
            here = part.alone
            states = [own.astype(inner if np.iscomplexobj(own) else self.precision) for own in here.rows]
            yield part.own, here.samples, now.columns.of(here.samples, part.own).astype(self.precision), states

    def by_inputs(self, asked: Sequence[tuple[int, float]], inputs: Floats | None = None) -> Floats:
        """The gains by the inputs at a harmonic more that a mode does not have yet: of modes and harmonics (asked,)."""
        if not asked:
            return np.zeros(0)
        now, samples, alone = self.now, self.samples, []
        if inputs is not None:
            samples = replace(samples, inputs=inputs)
        many, inner = len(samples.inputs), np.result_type(self.precision, 1j)
        for mode, turn in asked:
            own = now.modes[mode]
            alone.append(replace(own, reach=np.array([turn]), gains=np.ones((many, 1), complex)))
        ends = np.cumsum([0, *[2 * many] * len(asked)])
        places = [slice(a, b) for a, b in pairwise(ends.tolist())]
        information, pull, size = np.zeros((len(asked), 2 * many, 2 * many)), np.zeros(ends[-1]), np.zeros(ends[-1])
        mixed, channels = np.zeros((len(self.root), ends[-1])), range(len(self.weights))
        seen = np.zeros((len(channels), ends[-1], now.columns.count))
        driven = slopes_in_parts(samples, alone, [None] * len(asked), numbers_of(now))
        for (own, part, columns, states), other in zip(self._parts(), driven, strict=True):
            drives = [
                rows[: (2 if mode.real else 1) * many].astype(self.precision if mode.real else inner)
                for mode, rows in zip(alone, other.alone.rows, strict=True)
            ]
            for channel, taken in zip(channels, seen, strict=True):
                rows, shapes = np.empty((ends[-1], part.n_samples), self.precision), {}
                for place, drive, (mode, _) in zip(places, drives, asked, strict=True):
                    if mode not in shapes:
                        shape = self.weights[channel] * now.shape(mode)[:, channel]
                        shapes[mode] = carried(part, shape, now.modes[mode].turns.tolist()).astype(inner)
                    moved = shapes[mode] * drive
                    rows[place] = moved.real if now.modes[mode].real else np.concatenate([moved.real, -moved.imag])
                taken += rows @ columns.T
                size += np.einsum("kn,kn->k", rows, rows)
                for place, block in zip(places, information, strict=True):
                    block += rows[place] @ rows[place].T
                mixed += slopes_of(part, now, channel, states, self.weights[channel]) @ rows.T
                pull += rows @ self.left[channel, own]
        for along, taken in zip(self.along, seen, strict=True):
            mixed -= along @ taken.T
            for place, block in zip(places, information, strict=True):
                block -= taken[place] @ now.inverse @ taken[place].T
        mixed = self.root.T @ mixed
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
        pulls, sizes, beyond, generator, each = self._by_noise
        while len(each) < draws:
            each += self._drawn(generator)[0]
        drawn = np.moveaxis(np.array(each[:draws]), 0, 1)
        # Of a whole draw the mean is none: less that, what is taken is told three times as well.
        taken = drawn[0] / np.sqrt(drawn[1]) - drawn[2] / np.sqrt(drawn[3].mean(axis=0))
        return max(float(np.sum(pulls / sizes - taken.mean(axis=0)) / (beyond + TINY)), 0.0) ** 2

    @cached_property
    def _by_noise(self) -> tuple[Floats, Floats, float, np.random.Generator, list[Floats]]:
        """The gradient by noise that drives each mode, the size of its slopes, and that of their sum beside the fit."""
        pulls, squares = self._pulls(self.left[None])[:, 0]
        sizes, total = np.sqrt(squares) + TINY, np.zeros(self.left.shape, self.precision)
        for number, size in enumerate(sizes):
            heard, shape = self.shape_heard(self.samples, number)
            total[heard] += self._by_noise_of(number, shape, self.left[heard]) / size
        generator = np.random.default_rng(0)
        drawn, beside = self._drawn(generator, total)
        return pulls, sizes, float(np.linalg.norm(beside[-1])), generator, drawn

    def _drawn(self, generator: np.random.Generator, *beside: NDArray) -> tuple[list[Floats], NDArray]:
        """Gradients and squares of a few draws of noise as `_pulls` has them, after the fit and before (4, modes)."""
        whole = np.empty((FEW + len(beside), *self.left.shape), self.precision)
        for own in whole[:FEW]:
            own[:] = self.samples.kept(np.asarray(generator.standard_normal(own.shape, self.precision)))
        for row, own in enumerate(beside, FEW):
            whole[row] = own
        before, after = self._pulls(whole[:FEW]), self.unfitted(whole)
        drawn = np.concatenate([self._pulls(after[:FEW]), before])
        drawn[1::2] += TINY
        return list(np.moveaxis(drawn, 1, 0)), after

    def shape_heard(self, samples: Samples, number: int) -> tuple[Mask, Complexes]:
        """Mask of the channels heard, and the shape of a mode over the noise in these (channels heard, samples)."""
        heard = self.now.heard
        shape = self.now.shape(number).T[heard] * self.weights[heard, None]
        return heard, carried(samples, shape, self.now.modes[number].turns.tolist())

    def _by_noise_of(self, number: int, shape: Complexes, left: NDArray) -> Floats:
        """Slopes by noise that drives a mode, of what is left in the channels heard (channels heard, samples)."""
        drive = np.einsum("cn,cn->n", shape.conj(), left)
        return (shape * followed(self.samples, self.now.modes[number], drive)).real

    def _pulls(self, lefts: NDArray) -> Floats:
        """Gradients by noise that drives each mode, of what is left, and squares of the slopes (2, draws, modes)."""
        found = np.empty((2, len(lefts), len(self.now.modes)))
        for number in range(len(self.now.modes)):
            heard, shape = self.shape_heard(self.samples, number)
            for draw, left in enumerate(lefts):
                slopes = self._by_noise_of(number, shape, left[heard])
                found[0, draw, number] = np.einsum("cn,cn->", slopes, left[heard])
                found[1, draw, number] = np.einsum("cn,cn->", slopes, slopes)
        return found

    def unfitted(self, draws: NDArray) -> NDArray:
        """Residuals of responses after this fit, to first order, in their place (draws, channels, samples)."""
        now, count = self.now, len(draws) * len(self.weights)
        taken, pull = np.zeros((count, now.columns.count)), np.zeros((len(self.root), len(draws)))
        for own, part, columns, states in self._parts():
            taken += draws[..., own].reshape(count, -1) @ columns.T
            pull += self._pulled(part, states, draws[..., own])
        taken = taken.reshape(*draws.shape[:2], -1)
        pull -= np.einsum("cpk,dck->pd", self.along, taken, optimize=True)
        by = (self.root @ (self.root.T @ pull)).T
        beside = taken @ now.inverse - np.einsum("dp,cpk->dck", by, self.along, optimize=True)
        beside = beside.reshape(count, -1).astype(self.precision)
        for own, part, columns, states in self._parts():
            response = (beside @ columns).reshape(*draws.shape[:2], -1)
            draws[..., own] -= response + self._moved(part, states, by)
        return draws

    def _pulled(self, samples: Samples, states: Sequence[NDArray], signals: NDArray) -> Floats:
        """Products of the slopes with signals (draws, channels, samples), summed over both (parameters, draws)."""
        # Channels are summed first: a derivative of the response is the shape times that of the state.
        found = [np.zeros((0, len(signals)))]
        for number, (mode, rows) in enumerate(zip(self.now.modes, states, strict=True)):
            driven = np.einsum("csn,dcn->dsn", self._shape(samples, number), signals)
            product = rows.reshape(len(rows), -1) @ driven.reshape(len(signals), -1).T
            both = product.real if mode.real else np.concatenate([product.real, -product.imag])
            found.append(both[mode.free])
        return np.concatenate(found)

    def _moved(self, samples: Samples, states: Sequence[NDArray], by: Floats) -> NDArray:
        """The response to steps of the parameters (draws, parameters), over the noise (draws, channels, samples)."""
        found, place = np.zeros((len(by), len(self.weights), samples.n_samples), self.precision), 0
        for number, (mode, rows) in enumerate(zip(self.now.modes, states, strict=True)):
            step = np.zeros((len(by), len(mode.free)))
            step[:, mode.free] = by[:, place : place + int(mode.free.sum())]
            place += int(mode.free.sum())
            along = step if mode.real else step[:, : len(rows)] + 1j * step[:, len(rows) :]
            moved = (along.astype(rows.dtype) @ rows.reshape(len(rows), -1)).reshape(len(by), mode.states, -1)
            found += np.einsum("csn,dsn->dcn", self._shape(samples, number), moved).real
        return found

    def _shape(self, samples: Samples, number: int) -> NDArray:
        """The shape of a mode over the noise in a part of the samples (channels, states, samples)."""
        mode = self.now.modes[number]
        shape = (self.now.shape(number) * self.weights).T.reshape(len(self.weights), mode.states, -1)
        return carried(samples, shape, mode.turns.tolist()).astype(np.result_type(self.precision, 1j))

    @cached_property
    def spread_root(self) -> Floats:
        """A root of the covariance of the free parameters; of what the record says nothing of it is large."""
        return inverse_root(self.matrix, self.least, floor=True, scale=scale_of(self.samples, self.now, self.matrix))

    @cached_property
    def of_modes(self) -> Floats:
        """Squared deviations of the shape of each mode from zero, all else moving along (Wald tests) (modes,)."""
        found, now = [], self.now
        root = self.spread_root
        for own, _ in now.slices():
            spread = np.kron(np.eye(len(self.left)), now.inverse[own, own])
            along = np.concatenate([part[:, own] for part in self.along], axis=1).T @ root
            shape = (now.coefficients[own] * self.weights).T.ravel()
            whole = spread + along @ along.T
            found.append(wald_rise(shape, whole))
        return np.array(found)

    def step_along(self, slopes: Floats) -> tuple[float, float]:
        """The step of one parameter with these slopes (channels, samples), others moving along, and its deviation."""
        now, size, pull, mixed = self.now, 0.0, 0.0, np.zeros(len(self.root))
        slopes = self.weights[:, None] * slopes
        taken = sum(columns @ slopes[:, own].T for own, columns in now.columns)
        taken = (now.inverse @ taken).T
        for own, part, _, states in self._parts():
            beyond = slopes[:, own] - taken @ now.columns.of(part, own)
            size += float(np.einsum("cn,cn->", beyond, slopes[:, own]))
            pull += float(np.einsum("cn,cn->", beyond, self.left[:, own]))
            mixed += self._pulled(part, states, beyond[None])[:, 0]
        mixed = self.root.T @ mixed
        information = size - float(mixed @ mixed)
        if not information > ROUNDING * size:
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
    one, other = (columns_at(own, now.modes, now.direct).response(now.coefficients) for own in moved)
    return scores.step_along((one - other) / (2.0 * HALF_DIGITS))


def gain_of(scores: Scores, samples: Samples, modes: Sequence[InputMode]) -> float:
    """The gain by modes that answer to other inputs nearly alike, to first order; zero where the record tells none."""
    # A step of 0 along the difference of both responses is what was fitted, one of 1 is the other.
    now = scores.now
    other, own = columns_at(samples, modes, now.direct), now.columns
    apart = other.response(now.coefficients) - own.response(now.coefficients)
    step, std = scores.step_along(apart)
    return (2.0 * step - 1.0) / std**2


def by_noise_beyond(scores: Scores, limits: Limits, promised: float = 0.0) -> float:
    """The fall of J by noise that drives the modes, as a number more; zero where noise of sensors explains all."""
    # Inputs at any harmonic, and modes at any frequency near, make up for such noise: they must be better than it.
    limit = chi2_limit(1, limits.harmonic_alarm)
    # A few draws do where it is far below, or below what is promised.
    gain = scores.by_noise(FEW)
    return max((gain if gain < FAR * max(limit, promised) else scores.by_noise()) - limit, 0.0)
