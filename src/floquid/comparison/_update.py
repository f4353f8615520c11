"""Parameters of a user's model fitted to the exponents of results, widened first, and what they do not determine."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Mask
from floquid._checks import counted, input_error, wrong_value
from floquid.comparison._compare import Match, chi_square, in_model, joint_parts, parts_of, set_against
from floquid.comparison._parameters import Direction, Misfit, Parameter, Updated
from floquid.comparison._sides import side_of
from floquid.core import Channel, PeriodicModel
from floquid.errors import IdentificationError
from floquid.fit import scaled_inverse
from floquid.floquet import AbstractPeriodicMatrix
from floquid.surveys import KNOWN, Point, Survey, known_exponents, known_modes, point_of

OF = "update"
WIDEST = 0.03  # of ω: what is added to the deviations at first, or the first step would fail from a few percent off
LONGEST = 0.1  # of a value: the longest step of a parameter
MOST = 12  # steps of one width, at most
SMALL = 0.02  # deviations: a step below it is the last
DIFFERENCE = 1e-3  # of the limit of a parameter: the step of central differences
SEEN = 0.1  # of the largest weight: parameters that are named in a direction
ROUNDING = 1e-9  # of ω, or of an information of one: what is nothing


def update(
    model: Callable[[dict[str, float]], Any],
    results: Any,
    parameters: Mapping[str, Parameter | float],
    outputs: AbstractPeriodicMatrix | ArrayLike | Callable[[dict[str, float]], Any] | None = None,
    *,
    channels: Sequence[Channel | str] | None = None,
) -> Updated:
    r"""Fit named parameters of a model to the exponents of results.

    .. math:: \min_\theta \sum_{points} d^T (\Sigma + \tau^2 I)^{-1} d, \qquad d = \hat\lambda - \lambda(\theta)

    by Gauss-Newton steps of at most 10 % of each parameter. τ falls from 3 % of ω over decades to zero: from a few
    percent off the valley of χ² is far narrower than the start is away. Modes are paired again by exponents and shapes
    at each step, as `compare` does. Slopes are central differences of μ = (λ_a + λ_b)/2 and q = ((λ_a - λ_b)/2)², which
    are smooth where a pair turns into two real multipliers. Weak modes and results that fail are not used.

    A direction whose deviation exceeds the limit of a parameter (30 % of the value, or half the prior) is not
    determined by the results: it stays where it began, and is told. Deviations are not scaled by the misfit.

    Parameters
    ----------
    model
        Takes the parameters by name, the operating point of a result (`speed_rpm`, ...) and its `period`, in one
        dictionary, and gives a known system as `survey` takes it: (A, period), a matrix, a system with outputs, modes.
    results
        What `identify` found, one or several, a survey, or files of these. Each point is a set of data of its own.
    parameters
        A `Parameter`, or the value to start from, by name.
    outputs
        C in place of the model's own: a matrix, or a function of what `model` takes. Modes are then paired by their
        shapes too.
    channels
        The rows of `outputs`; those of the results by default.

    Returns
    -------
    Updated
        Values with their covariance, χ², and what is not determined.

    Raises
    ------
    InputError
        An argument is none of these, no result has deviations, or the period of the model is another.
    IdentificationError
        No mode of the model fits one of the results.
    """
    if not callable(model):
        remedy = "Pass a function of a dictionary, as lambda v: (A(v), v['period'])."
        raise wrong_value("model", OF, "be a function of the parameters", model, remedy)
    start = _parameters(parameters)
    points = _points(results)
    taken = {name for point in points for name in (*point.values, "period")} & set(start)
    if taken:
        must = "have names that no operating point has"
        raise input_error("parameters", OF, must, f"has {', '.join(sorted(taken))}", "Rename the parameter.")
    return _fitted(_Problem(model, points, start, outputs, channels))


def _parameters(given: Mapping[str, Parameter | float]) -> dict[str, Parameter]:
    if not isinstance(given, Mapping) or not given:
        must = "be parameters by name"
        raise wrong_value("parameters", OF, must, given, 'Such as {"stiffness": Parameter(value=2.0)}.')
    return {name: one if isinstance(one, Parameter) else Parameter(value=one) for name, one in given.items()}


def _points(results: Any) -> list[Point]:
    """The points with deviations that may be used."""
    alone = isinstance(results, (str, os.PathLike, Survey, *KNOWN)) or not isinstance(results, Iterable)
    sides = [side_of(one, "results", OF) for one in ([results] if alone else results)]
    points = [point for side in sides for point in side.points if point.model is not None and point.reason is None]
    points = [point for point in points if point.model is not None and point.model.covariance is not None]
    if not points:
        must = "hold results with deviations that do not fail"
        raise input_error("results", OF, must, f"holds none of {counted(len(sides), 'result')}")
    return points


@dataclass(frozen=True, slots=True)
class _Problem:
    """The model, the data and the start."""

    model: Callable[[dict[str, float]], Any]
    points: Sequence[Point]
    start: Mapping[str, Parameter]
    outputs: Any
    channels: Sequence[Channel | str] | None

    @property
    def limits(self) -> Floats:
        """The deviation of each parameter from which on it is not determined (parameters,)."""
        return np.array([one.limit for one in self.start.values()])

    def arguments(self, point: Point, theta: Floats) -> dict[str, float]:
        """The dictionary that the model is called with."""
        assert point.model is not None
        return {**point.values, "period": point.model.period, **dict(zip(self.start, theta.tolist(), strict=True))}

    def modes(self, point: Point, theta: Floats) -> Point:
        """The modes of the model at a point."""
        values = self.arguments(point, theta)
        outputs, names = self.outputs, self.channels
        if callable(outputs) and not isinstance(outputs, AbstractPeriodicMatrix):
            outputs = outputs(values)
        if outputs is not None and names is None:
            assert point.model is not None
            names = point.model.channels
            rows = np.shape(outputs)[0]
            if rows != len(names):
                must = f"name the {rows} rows of `outputs`"
                got = f"are not given, and a result has {counted(len(names), 'channel')}"
                raise input_error("channels", OF, must, got, 'Such as channels=["X", "Y"].')
        return point_of(known_modes(self.model(values), outputs=outputs, channels=names))

    def exponents(self, point: Point, theta: Floats) -> Complexes:
        """The exponents of the model at a point."""
        return known_exponents(self.model(self.arguments(point, theta)))


@dataclass(frozen=True, slots=True)
class _Data:
    """Differences at one point, their covariance and the slopes of the model by the parameters."""

    pairs: list[Match]
    values: Floats  # (parts,)
    covariance: Floats  # (parts, parts)
    widened: Floats  # what τ adds to the variances, over τ² (parts,)
    slopes: Floats  # (parts, parameters)
    left: list[int]  # modes of the result without a partner
    each: list[float]  # differences over deviations, a pair each


def _data(problem: _Problem, point: Point, theta: Floats) -> _Data:
    """The data of one point at parameters θ."""
    known = problem.modes(point, theta)
    assert point.model is not None
    assert known.model is not None
    first, _, found = set_against(point, known, of=OF)
    pairs = [pair for pair in found.matches if not pair.first.weak]
    values, covariance = joint_parts(pairs, point.model, known.model)
    slopes, widened = np.zeros((0, len(theta))), np.zeros(0)
    if pairs:
        parts = [parts_of(pair) for pair in pairs]
        by = np.concatenate(
            [
                in_model(own.by_second, at.second.modes, known.model.order, mirrored=at.mirrored)
                for own, at in zip(parts, pairs, strict=True)
            ]
        )
        slopes = by @ _exponent_slopes(problem, point, known.model, theta)
        widened = np.sum(by**2, axis=1)
    used = {pair.a for pair in pairs}
    left = [mode for k, thing in enumerate(first) if k not in used and not thing.weak for mode in thing.modes]
    each = [float(np.sqrt(chi_square(*joint_parts([pair], point.model, known.model))[0])) for pair in pairs]
    return _Data(pairs, values, covariance, widened, slopes, left, each)


def _exponent_slopes(problem: _Problem, point: Point, model: PeriodicModel, theta: Floats) -> Floats:
    r"""Derivatives of the real, then the imaginary parts of the exponents of a model by θ (2 modes, parameters).

    .. math:: \delta\lambda_a = \delta\mu + \frac{\delta q}{\lambda_a - \lambda_b}

    of two exponents that may meet, a pair about the nearest axis or a couple: μ and q are smooth, whatever they are on
    either side, and are differenced.
    """
    out = np.zeros((model.order, len(theta)), complex)
    modes = np.array(model.upper_modes, int)
    # The mode that each may meet: the conjugate of a pair, the other of a couple; of a single multiplier itself
    of = {mode: other for a, b in model.couples for mode, other in ((a, b), (b, a))}
    mirror = np.abs(np.subtract.outer(model.exponents, model.exponents.conj())).argmin(axis=1)
    partners = np.array([of.get(mode, mode) if model.real[mode] else mirror[mode] for mode in modes.tolist()], int)
    lam, fundamental = model.exponents, model.fundamental
    turns = 1j * fundamental * np.rint((lam[modes] - lam[partners]).imag / fundamental)
    apart = lam[modes] - lam[partners] - turns
    alone = partners == modes
    apart[np.abs(apart) < ROUNDING * fundamental] = ROUNDING * fundamental
    for column, limit in enumerate(problem.limits):
        step = DIFFERENCE * limit
        means, squares = [], []
        for sign in (1.0, -1.0):
            moved = np.array(theta)
            moved[column] += sign * step
            near = _beside(model, problem.exponents(point, moved))
            means.append(0.5 * (near[modes] + near[partners] + turns))
            squares.append(0.25 * (near[modes] - near[partners] - turns) ** 2)
        mean, square = ((ends[0] - ends[1]) / (2.0 * step) for ends in (means, squares))
        out[modes, column] = mean + np.where(alone, 0.0, square / apart)
    return np.concatenate([out.real, out.imag])


def _beside(model: PeriodicModel, exponents: Complexes) -> Complexes:
    """Exponents of a system nearby in the order of a model and on its branches (modes,)."""
    from scipy.optimize import linear_sum_assignment

    off = np.subtract.outer(model.exponents, exponents)
    off -= 1j * model.fundamental * np.rint(off.imag / model.fundamental)
    rows, columns = linear_sum_assignment(np.abs(off))
    return model.exponents[rows] - off[rows, columns]


@dataclass(slots=True)
class _Search:
    """The place of the search."""

    theta: Floats
    steps: int = 0
    is_converged: bool = False


def _fitted(problem: _Problem) -> Updated:
    """The parameters at the end of the search, with what is known of them."""
    known = [point.model for point in problem.points if point.model is not None]
    stds = [np.sqrt(np.diag(model.covariance)) for model in known if model.covariance is not None]
    least = min(float(std[std > 0.0].min(initial=np.inf)) for std in stds)
    search = _Search(np.array([one.value for one in problem.start.values()]))
    width = WIDEST * max(model.fundamental for model in known)
    while width > least:
        _descend(problem, search, width, 2)
        width /= 10.0
    search.is_converged = _descend(problem, search, 0.0, MOST)
    return _told(problem, search)


def _descend(problem: _Problem, search: _Search, width: float, most: int) -> bool:
    """Take steps at one width; true where the last one is small beside the deviations."""
    for _ in range(most):
        data = [_data(problem, point, search.theta) for point in problem.points]
        values, vectors, gradient = _normal(problem, search.theta, data, width)
        known = _moved(problem, values, vectors) | (width > 0.0)
        along = vectors[:, known].T @ gradient
        step = vectors[:, known] @ (along / (values[known] + (width > 0.0)))
        size = np.array([max(abs(value), limit) for value, limit in zip(search.theta, problem.limits, strict=True)])
        cap = float(np.min(LONGEST * size / np.maximum(np.abs(step * problem.limits), 1e-300), initial=1.0))
        bounds = np.array([one.bounds for one in problem.start.values()]).T
        search.theta = np.clip(search.theta + cap * step * problem.limits, *bounds)
        search.steps += 1
        if cap == 1.0 and float(np.sum(along**2 / values[known])) < SMALL**2:
            return True
    return False


def _normal(problem: _Problem, theta: Floats, data: Sequence[_Data], width: float) -> tuple[Floats, Floats, Floats]:
    """Eigenvalues and vectors of the information in units of the limits, and the gradient in them."""
    limits = problem.limits
    information, gradient = np.diag(_known_before(problem)), np.zeros(len(theta))
    for own in data:
        if len(own.values):
            slopes = own.slopes * limits
            weights = scaled_inverse(own.covariance + np.diag(width**2 * own.widened + width**4))
            information += slopes.T @ weights @ slopes
            gradient += slopes.T @ weights @ own.values
    start = np.array([one.value for one in problem.start.values()])
    gradient += _known_before(problem) * (start - theta) / limits
    values, vectors = np.linalg.eigh(information)
    return np.maximum(values, np.finfo(float).tiny), vectors, gradient


def _known_before(problem: _Problem) -> Floats:
    """The information of the priors in units of the limits (parameters,)."""
    stds = np.array([np.inf if one.prior_std is None else one.prior_std for one in problem.start.values()])
    return (problem.limits / stds) ** 2


def _moved(problem: _Problem, values: Floats, vectors: Floats) -> Mask:
    """Mask of the directions along which parameters move: those that are determined, or that priors hold."""
    return (values > 1.0) | (_known_before(problem) @ vectors**2 > 0.5 * values)


def _told(problem: _Problem, search: _Search) -> Updated:
    """The result at the end of a search."""
    from scipy.stats import chi2 as law

    data = [_data(problem, point, search.theta) for point in problem.points]
    if not any(own.pairs for own in data):
        raise IdentificationError(
            "No mode of the model is like one of the results, by exponent and shape.\n"
            "  Compare both first: floquid.compare(result, model at the start)."
        )
    values, vectors, _ = _normal(problem, search.theta, data, 0.0)
    known, names, limits = values > 1.0, list(problem.start), problem.limits
    moved = _moved(problem, values, vectors)
    determined = np.sum(vectors**2 / values, axis=1) <= 1.0
    root = limits[:, None] * vectors / np.sqrt(values)
    covariance = np.where(np.outer(determined, determined), root @ root.T, np.nan)
    joint = [chi_square(own.values, own.covariance) for own in data if len(own.values)]
    pulls = [
        ((theta - one.value) / one.prior_std) ** 2
        for theta, one in zip(search.theta.tolist(), problem.start.values(), strict=True)
        if one.prior_std is not None
    ]
    chi2 = float(sum(value for value, _ in joint) + sum(pulls))
    dof = sum(count for _, count in joint) + len(pulls) - int(moved.sum())
    p = float(law.sf(chi2, dof)) if dof > 0 else None
    used = dict(zip(names, search.theta.tolist(), strict=True))
    return Updated(
        values={name: used[name] if ok else float("nan") for name, ok in zip(names, determined, strict=True)},
        start={name: one.value for name, one in problem.start.items()},
        covariance=covariance,
        chi2=chi2,
        dof=dof,
        p=p,
        unidentifiable=tuple(_direction(names, vectors[:, k], float(values[k])) for k in np.flatnonzero(~known)),
        steps=search.steps,
        is_converged=search.is_converged,
        used=used,
        misfits=tuple(
            Misfit(point=number, mode=pair.first.modes[0], frequency_hz=abs(pair.first.exponent) / (2.0 * np.pi), z=z)
            for number, own in enumerate(data)
            for pair, z in zip(own.pairs, own.each, strict=True)
        ),
        warnings=tuple(_warnings(problem, search, data)),
    )


def _direction(names: Sequence[str], vector: Floats, value: float) -> Direction:
    """A direction that is not determined, its largest weight positive."""
    vector = vector * np.sign(vector[np.abs(vector).argmax()])
    kept = np.abs(vector) >= SEEN * np.abs(vector).max()
    std = float(1.0 / np.sqrt(value)) if value > ROUNDING else np.inf
    return Direction(weights={name: float(w) for name, w, ok in zip(names, vector, kept, strict=True) if ok}, std=std)


def _warnings(problem: _Problem, search: _Search, data: Sequence[_Data]) -> list[str]:
    """Sentences on a search that a reader must know."""
    words = []
    if not search.is_converged:
        words.append(f"The search did not settle in {search.steps} steps: begin elsewhere, or fit fewer parameters.")
    left = [(number, mode) for number, own in enumerate(data) for mode in own.left]
    if left:
        number, mode = left[0]
        model = problem.points[number].model
        assert model is not None
        hertz = abs(model.exponents[mode]) / (2.0 * np.pi)
        words.append(
            f"{counted(len(left), 'mode')} of the results have no partner in the model, first at {hertz:.4g} Hz."
        )
    bounds = [one.bounds for one in problem.start.values()]
    at = [name for name, value, ends in zip(problem.start, search.theta, bounds, strict=True) if value in ends]
    if at:
        words.append(f"At its bound: {', '.join(at)}. The deviations of all parameters are those without bounds.")
    return words
