"""Modes chosen and residues fitted on all samples or on the lines of a band, free or in proportions of the inputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import BLOCK, Complexes, Floats, Mask
from floquid.lti._exponentials import complex_residues, powers, real_basis, real_powers
from floquid.lti._poles import PoleSet
from floquid.lti._significance import Removal, weakest
from floquid.lti._types import ModalModel, Outcome, TimeResponses
from floquid.lti.rational._denominator import Band, Basis, stacked

SMOOTH = 8  # the degree up to which a polynomial in 1/z stands for the skirts of modes far outside a band


@dataclass(frozen=True, slots=True)
class Modes:
    """Poles and how much of each is in each input: `shares` (k, inputs), or None where inputs are independent."""

    poles: PoleSet
    shares: Complexes | None = None

    @staticmethod
    def of(multipliers: Complexes, shares: Complexes | None) -> Modes:
        """Select the upper half of the roots, a real one's shares made real."""
        upper = multipliers.imag >= -1e-9 * np.abs(multipliers)
        poles = PoleSet.from_multipliers(multipliers[upper])
        if shares is None:
            return Modes(poles)
        return Modes(poles, poles.normalised(shares[upper])[0])

    def keep(self, mask: Mask) -> Modes:
        """The entries where `mask` holds."""
        return Modes(self.poles.keep(mask), None if self.shares is None else self.shares[mask])

    def of_input(self, i: int) -> Complexes:
        """The share of input `i` in each pole (order,), conjugates conjugated."""
        if self.shares is None:
            return np.ones(self.poles.order, complex)
        return self.poles.with_conjugates(self.shares[:, i])


@dataclass(frozen=True, slots=True)
class Rows:
    """Data of a response: its samples, or the lines of a band less what lies outside."""

    band: Band
    outside: Floats

    @staticmethod
    def of(band: Band, others: PoleSet) -> Rows:
        """The rows of a band, less the modes beside it and what is smooth on it."""
        if band.whole or not band.size:
            return Rows(band, np.zeros((band.samples if band.whole else 0, 0)))
        degree = min(SMOOTH, band.size // 4)
        smooth = band.weights[:, None] * Basis.on(band, degree).at(band.x)
        beside = stacked(band.spectrum(real_powers(others, band.samples).T))
        both = np.concatenate([stacked(smooth.T), beside]).T
        left, values, _ = np.linalg.svd(both / np.linalg.norm(both, axis=0), full_matrices=False)
        return Rows(band, left[:, values > 1e-12 * values[0]])

    def __call__(self, values: Floats) -> Floats:
        """The rows (…, rows) of responses (…, samples)."""
        values = values[..., : self.band.samples]
        if self.band.whole:
            return values
        seen = stacked(self.band.spectrum(values))
        return seen - (seen @ self.outside) @ self.outside.T


@dataclass(frozen=True, slots=True)
class Fitting:
    """Least squares for residues of some inputs together: their columns and pseudo-inverses, one of each an input."""

    modes: Modes
    inputs: list[int]
    longest: int
    columns: list[Floats]
    inverse: list[Floats]

    @staticmethod
    def of(modes: Modes, inputs: list[int], rows: Sequence[Rows]) -> Fitting:
        """For these inputs."""
        longest = max(rows[i].band.samples for i in inputs)
        terms = powers(modes.poles.full(), longest)
        columns = [rows[i](real_basis(modes.poles, terms * modes.of_input(i)).T).T for i in inputs]
        q, r = np.linalg.qr(np.concatenate(columns))
        whole = np.linalg.pinv(r, rcond=1e-14) @ q.T
        inverse = np.split(whole, np.cumsum([len(part) for part in columns])[:-1], axis=1)
        return Fitting(modes, inputs, longest, columns, inverse)

    def residues(self, seen: Sequence[Floats]) -> Floats:
        """The real residues (order, outputs) of the rows (outputs, rows) of each input."""
        return np.sum([one @ y.T for one, y in zip(self.inverse, seen, strict=True)], axis=0)


def chosen(modes: Modes, data: TimeResponses, scale: Floats, rows: Sequence[Rows], order: int) -> Modes:
    """The modes that take most out of the responses over `scale`, at most `order` poles; the weakest leave in turn."""
    spread, moments = [], []
    for fitting in _fittings(modes, rows):
        moment = np.zeros((modes.poles.order,) * 2)
        for _, seen in _looked_at(data, scale, rows, fitting.inputs):
            residues = fitting.residues(seen)
            moment += residues @ residues.T
        spread.append(np.sum([one @ one.T for one in fitting.inverse], axis=0))
        moments.append(moment)
    now, left = Removal(modes.poles, tuple(spread), tuple(moments)), np.arange(len(modes.poles))
    while (worst := weakest(now.poles, now.rises(), order)) is not None:
        now, left = now.without(worst), np.delete(left, worst)
    return modes.keep(np.isin(np.arange(len(modes.poles)), left))


def model_on(modes: Modes, data: TimeResponses, scale: Floats, rows: Sequence[Rows], outcome: Outcome) -> ModalModel:
    """The model of the modes, residues fitted on the rows of the responses over `scale`."""
    poles, n = modes.poles, modes.poles.order
    residues = np.zeros((n, data.n_outputs, data.n_inputs), complex)
    left = np.zeros((data.n_outputs, data.n_inputs))
    for fitting in _fittings(modes, rows):
        # The columns were scaled so that a growing mode cannot overflow; residues belong to sample zero.
        s = poles.full()
        start = np.exp(-np.where(s.real > 0, fitting.longest - 1, 0) * s)
        for part, seen in _looked_at(data, scale, rows, fitting.inputs):
            real = fitting.residues(seen)
            for i, y, columns in zip(fitting.inputs, seen, fitting.columns, strict=True):
                here = (start * modes.of_input(i))[:, None] * complex_residues(poles, real)
                residues[:, part, i] = here * scale[part, i]
                free = max(rows[i].band.size - rows[i].outside.shape[1] - n, 1)
                rest = np.sqrt(np.sum((y - (columns @ real).T) ** 2, axis=1) / free)
                left[part, i] = rest * scale[part, i]
    return ModalModel(
        multipliers=poles.multipliers(), residues=residues, dt=data.dt, residual_std=left, outcome=outcome
    )


def _fittings(modes: Modes, rows: Sequence[Rows]) -> list[Fitting]:
    """Inputs that are fitted together: all of them where they share participations, and otherwise each alone."""
    every = list(range(len(rows)))
    return [Fitting.of(modes, group, rows) for group in ([[i] for i in every] if modes.shares is None else [every])]


def _looked_at(
    data: TimeResponses, scale: Floats, rows: Sequence[Rows], inputs: Sequence[int]
) -> Iterator[tuple[slice, list[Floats]]]:
    """The rows (outputs, rows) of each of the inputs, responses over `scale`, some outputs at a time."""
    step = max(1, BLOCK // (data.values.shape[2] * len(inputs)))
    for start in range(0, data.n_outputs, step):
        part = slice(start, start + step)
        yield part, [rows[i](data.values[part, i] / scale[part, i, None]) for i in inputs]
