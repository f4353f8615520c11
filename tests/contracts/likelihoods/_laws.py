"""Ten laws that every likelihood obeys: `LAWS` names them, `EXEMPT` says where one does not apply, and why."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from tests.contracts.likelihoods._point import Data, Mode, Point
from tests.contracts.likelihoods._records import OMEGA, PHASES, STEP, Case

DRAWS = 2
"""Draws of the noise over which a curvature that is one on average alone is averaged."""

SLACK = {"decays": 0.02, "lines": 0.02, "driven": 0.1, "innovations": 0.2}
"""Share to which a prediction to first order holds: of noise that is profiled χ² is a logarithm, and innovations are no
linear function of shapes."""


def gradient(case: Case) -> None:
    """The gradient is the central difference of L, for every parameter, some deviations off the truth."""
    sizes = np.sqrt(np.diag(case.truth.normal().matrix))
    point = case.truth.moved(3.0 * np.random.default_rng(0).choice([-1.0, 1.0], len(sizes)) / sizes)
    normal = point.normal()
    assert len(normal.names) == len(normal.gradient) == len(normal.matrix)
    for row, size in enumerate(np.sqrt(np.diag(normal.matrix))):
        step = np.zeros(len(normal.gradient))
        step[row] = 1e-3 / size
        up, down = (point.moved(sign * step).log_likelihood for sign in (1.0, -1.0))
        assert abs((up - down) / 4e-3 - normal.gradient[row] / size) < 1e-6, normal.names[row]


def curvature(case: Case) -> None:
    """The Gauss-Newton matrix is the curvature of L: without noise, or on average where there must be noise."""
    if case.likelihood == "innovations":
        return averaged_curvature(case)
    point = case.at(case.data_of(None), case.modes)
    normal = point.normal()
    scale = 1.0 / np.sqrt(np.diag(normal.matrix))
    for row in range(len(scale)):
        step = 1e-4 * scale * (np.arange(len(scale)) == row)
        up, down = (point.moved(sign * step).normal().gradient for sign in (1.0, -1.0))
        assert np.abs(scale * (down - up) / 2e-4 - scale * scale[row] * normal.matrix[row]).max() < 1e-3
    return None


def averaged_curvature(case: Case) -> None:
    """The same along every parameter and along some sums of all, over draws of the noise."""
    found, expected = [], []
    for seed in range(DRAWS):
        point = case.at(case.data_of(seed), case.modes)
        normal, some = point.normal(), np.random.default_rng(0)
        many = len(normal.gradient)
        for way in np.vstack([np.eye(many), some.choice([-1.0, 1.0], (6, many))]):
            step = way / np.sqrt(np.diag(normal.matrix)) * (0.05 / np.sum(way**2) ** 0.5)
            both = [point.moved(sign * step).log_likelihood for sign in (1.0, -1.0)]
            found.append(2.0 * point.log_likelihood - sum(both))
            expected.append(2.0 * step @ normal.matrix @ step)
    ratios = np.sum(np.reshape(found, (DRAWS, -1)), axis=0) / np.sum(np.reshape(expected, (DRAWS, -1)), axis=0)
    assert np.abs(ratios - 1.0).max() < 0.15, ratios


def score(case: Case) -> None:
    """The gain of a fit by a weak harmonic more is, to first order, what the score test says."""
    for number, side, harmonic in case.weak:
        less = changed(case.fit, number, lambda mode, own=(side, harmonic): mode.without(*own)).refit()
        expected, gained = less.score((number, side, harmonic)), case.fit.log_likelihood - less.log_likelihood
        assert gained > 5.0
        assert abs(expected - gained) < SLACK[case.likelihood] * gained, (side, harmonic, expected, gained)
    for number, side, harmonic in case.absent:
        more = changed(case.fit, number, lambda mode, own=(side, harmonic): mode.having(*own)).refit()
        expected, gained = case.fit.score((number, side, harmonic)), more.log_likelihood - case.fit.log_likelihood
        assert abs(expected - gained) < SLACK[case.likelihood] * gained, (side, harmonic, expected, gained)


def wald(case: Case) -> None:
    """The loss of a fit by a weak harmonic less is, to first order, what the Wald test says."""
    for number, side, harmonic in case.weak:
        less = changed(case.fit, number, lambda mode, own=(side, harmonic): mode.without(*own)).refit()
        expected, lost = case.fit.wald((number, side, harmonic)), case.fit.log_likelihood - less.log_likelihood
        assert abs(expected - lost) < SLACK[case.likelihood] * lost, (side, harmonic, expected, lost)


def conditioning(case: Case) -> None:
    """A parameter held a deviation off, all others fitted again, costs one."""
    names, covariance = case.fit.normal().names, case.fit.covariance
    # Of innovations each row takes long: those of the exponents, and the first one of each kind.
    kinds = [name[1] for name in names]
    few = {row for row, kind in enumerate(kinds) if kind in ("decay", "frequency") or kinds.index(kind) == row}
    for row in sorted(few) if case.likelihood == "innovations" else range(len(names)):
        lost = []
        for sign in (1.0, -1.0):
            point = case.fit.moved(sign * covariance[row] / np.sqrt(covariance[row, row]))
            point = point.moved(point.normal().step(fixed=[row]))
            lost.append(case.fit.log_likelihood - point.log_likelihood)
        assert abs(np.mean(lost) - 1.0) < SLACK[case.likelihood], (names[row], lost)


def branch(case: Case) -> None:
    """λ + inω with its harmonics renamed is the same mode."""
    delay = STEP if case.likelihood == "innovations" else 0.0
    for by in (1, -2):
        other = case.truth.with_modes([mode.renamed(by, OMEGA, case.data.starts, delay) for mode in case.modes])
        assert_same(case, other)


def units(case: Case) -> None:
    """Other units of channels and inputs change L by their logarithm alone, and nothing else but scales."""
    outputs = np.array([1e6, 1e-5])
    inputs = np.array([1e-6, 1e6, 1e3])[: n_inputs(case)]
    drives = np.concatenate([inputs, outputs]) if case.likelihood == "innovations" else inputs
    other = case.at(case.data.scaled(outputs, inputs), [mode.scaled(outputs, drives) for mode in case.modes])
    count = case.truth.residual.shape[1] if case.likelihood in ("driven", "innovations") else 0
    constant = -2.0 * count * float(np.sum(np.log(outputs)))
    assert_same(case, other, constant=constant)
    deviations = exponent_deviations(case.fit)[:, 0]
    for mode, before, deviation in zip(other.refit().modes, case.fit.modes, deviations, strict=True):
        assert abs(mode.exponent - before.exponent) < (0.02 if case.likelihood == "innovations" else 1e-3) * deviation


def order(case: Case) -> None:
    """The order of the channels and of the modes says nothing."""
    inputs = n_inputs(case) if case.likelihood == "innovations" else None
    channels = [1, 0]
    modes = [replace(mode, shape=mode.shape[channels]) for mode in case.modes]
    if inputs is not None:
        modes = [replace(m, gains=np.vstack([m.gains[:inputs], m.gains[inputs:][channels]])) for m in modes]
    assert_same(case, case.at(case.data.ordered(channels), modes), channels=channels)
    assert_same(case, case.truth.with_modes(case.modes[::-1]), modes=slice(None, None, -1))


def conjugate(case: Case) -> None:
    """The other exponent of a pair is the same mode, and with another time zero only shapes and gains turn."""
    assert_same(case, case.truth.with_modes([mode.conjugated() for mode in case.modes]))
    for later in (STEP, PHASES * STEP):
        other = case.at(case.data.later(later), [mode.rotated(later, OMEGA) for mode in case.modes])
        assert_same(case, other)
        for mode, before in zip(other.modes, case.truth.modes, strict=True):
            turned = before.rotated(later, OMEGA).shape
            assert np.abs(mode.shape - turned).max() < 1e-6 * np.abs(turned).max()


def split(case: Case) -> None:
    """A record in two gains what the states that are free then say, and an input that is silent nothing."""
    if case.likelihood != "decays":
        modes = [replace(mode, gains=silent(mode.gains, n_inputs(case))) for mode in case.modes]
        assert_same(case, case.at(case.data.with_silence(), modes), numbers=None)
        starts = len(case.data.starts) and case.likelihood != "lines"
        cut = [with_state(case, mode, CUT) if starts else mode for mode in case.modes]
        parts = case.at(case.data.split(CUT), cut)
        assert abs(parts.log_likelihood - case.truth.log_likelihood) < 1e-6 * abs(case.truth.log_likelihood)
        states = sum(1 if mode.real else 2 for mode in case.modes)
        assert parts.n_parameters - case.truth.n_parameters == (states if starts else 0)
        return
    parts = case.at(case.data.split(CUT), case.modes)
    gained = parts.log_likelihood - case.truth.log_likelihood
    assert abs(gained - gained_by_parts(case.data, case.modes)) < 1e-5 * gained
    assert gained > 1.0


LAWS: dict[str, Callable[[Case], None]] = {
    law.__name__: law
    for law in (gradient, curvature, score, wald, conditioning, branch, units, order, conjugate, split)
}

CUT = 13 * PHASES
"""The sample at which a record is split."""

PAST = "A filter reaches back, so that the second part of a record begins with samples that have no past and drop out."

EXEMPT: dict[tuple[str, str], str] = {
    ("decays: lifted, after a filter", "split"): PAST,
    ("decays: with gaps, after a filter", "split"): PAST,
}
"""Why a law cannot apply to a record, by the name of the record and the law."""


def changed(point: Point, number: int, change: Callable[[Mode], Mode]) -> Point:
    """The point with one of its modes changed."""
    modes = list(point.modes)
    modes[number] = change(modes[number])
    return point.with_modes(modes)


def n_inputs(case: Case) -> int:
    return len(case.data.inputs[0]) if isinstance(case.data, Data) else case.data.lines.values.shape[2]


def silent(gains: np.ndarray, place: int) -> np.ndarray:
    """Gains with those of an input that is silent, whatever they are."""
    return np.insert(gains, place, 0.1 * gains[:1], axis=0)


def with_state(case: Case, mode: Mode, sample: int) -> Mode:
    """A mode whose first states have that at a sample of the first record, as the second one's."""
    alone = case.truth.with_modes([mode])
    states = alone.now.states[0] if case.likelihood == "driven" else None
    if states is None:
        number = [m.exponent for m in case.modes].index(mode.exponent)
        row = sum(1 if own.real else 2 for own in case.modes[:number])
        states = case.truth.now.states[:, row] + (0j if mode.real else 1j * case.truth.now.states[:, row + 1])
    return replace(mode, initial=np.insert(mode.initial, 1, states[sample]))


def gained_by_parts(data: Data, modes: Sequence[Mode]) -> float:
    """The fall of χ² where the first record has amplitudes of its own from `CUT` on, by dense least squares."""
    found = 0.0
    times = data.starts[0] + data.step * np.arange(data.values[0].shape[1])
    since = [times - (times[-1] if mode.exponent.real > 0.0 else 0.0) for mode in modes]
    rates = [mode.exponent + 1j * data.omega * mode.seen for mode in modes]
    rows = np.exp(np.concatenate([np.outer(*own) for own in zip(rates, since, strict=True)]))
    columns = np.concatenate([rows.real, rows.imag[rows.imag.any(axis=1)]])
    for values, noise in zip(data.values[0], data.noise, strict=True):
        left = []
        for part in (slice(None), slice(CUT), slice(CUT, None)):
            there = np.isfinite(values[part])
            own, target = columns[:, part][:, there].T, values[part][there]
            own = own / np.linalg.norm(own, axis=0)
            rest = target - own @ np.linalg.lstsq(own, target, rcond=None)[0]
            left.append(float(rest @ rest) / noise**2)
        found += left[0] - left[1] - left[2]
    return found


def assert_same(
    case: Case,
    other: Point,
    *,
    constant: float = 0.0,
    channels: Sequence[int] = (0, 1),
    modes: slice = slice(None),
    numbers: int | None = 0,
) -> None:
    """L but for a constant, the residual, the exponents' deviations and the count of numbers are what they were."""
    point = case.truth
    assert abs(other.log_likelihood - point.log_likelihood - constant) < 1e-6 * abs(point.log_likelihood)
    assert numbers is None or other.n_parameters == point.n_parameters + numbers
    before, after = (sizes(case, own.residual) for own in (point, other))
    before = before if len(before) == 1 else before[list(channels)]
    assert after.shape == before.shape
    assert np.nanmax(np.abs(after - before)) < 1e-6
    deviations = [exponent_deviations(own) for own in (point, other)]
    assert np.allclose(deviations[1], deviations[0][modes], rtol=1e-4)


def sizes(case: Case, residual: np.ndarray) -> np.ndarray:
    """Sizes of the residual: over the channels that Cholesky's root mixes, of lines over both parts, which may turn."""
    if case.likelihood == "innovations":
        return np.linalg.norm(residual, axis=0, keepdims=True)
    if case.likelihood == "lines":
        return np.linalg.norm(residual.reshape(len(residual), 2, -1), axis=1)
    return residual


def exponent_deviations(point: Point) -> np.ndarray:
    """Those of the decay and the frequency of each mode, 0 of a frequency that is none (modes, 2)."""
    found, spread = np.zeros((len(point.modes), 2)), np.sqrt(np.diag(point.covariance))
    for name, value in zip(point.normal().names, spread, strict=True):
        if name[1] in ("decay", "frequency"):
            found[name[0], int(name[1] == "frequency")] = value
    return found
