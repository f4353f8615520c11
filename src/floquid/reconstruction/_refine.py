"""A(t) with the structure that the user or the data supports, fitted to all of the free model's estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Floats
from floquid._checks import finite, input_error, wrong_value
from floquid.core import Estimates, Form, PeriodicModel
from floquid.errors import IdentificationError
from floquid.findings import Finding
from floquid.reconstruction._coordinates import Coordinates, Part, State, derivative_of
from floquid.reconstruction._harmonic_balance import Mode, NoModeError
from floquid.reconstruction._inference import Hidden, hidden_in, transition_of, variances
from floquid.reconstruction._invariance import Point, Problem, Seen, covariance_of, fitted, found_structure, problem_of
from floquid.reconstruction._modal_matrix import modal_at, shapes_of
from floquid.reconstruction._reconstruct import Refinement, StateModel, coordinates_of, instants_of, reconstruct
from floquid.reconstruction._states import Names
from floquid.reconstruction._structure import AbstractStructure, Basis, structure_of

Array = NDArray[Any]

OF = "refine"

REMEDY = 'Give it more harmonics or less symmetry, let it be found (`structure="auto"`), or use `reconstruct`.'
REFUSED = 1e-5  # the probability of what is left below which a structure is refused
BEYOND = 3  # harmonics of the shapes beyond those of the estimates, in harmonics of the equation of motion
WIDENED = 4  # times that these may be more
SAME = 0.02  # deviations that an exponent may move when the shapes are given more harmonics


def refine(
    model: PeriodicModel,
    states: Names,
    structure: AbstractStructure | str = "auto",
    *,
    times: ArrayLike | int = 50,
    refuse: float = REFUSED,
    again: Callable[[Array], Estimates] | None = None,
    report: Callable[[str], None] = lambda _: None,
) -> Refinement:
    r"""The state matrix itself, with a structure, fitted to everything that the response model was estimated from.

    .. math:: \min_{\theta, q} \; \delta p^T C_p^{-1} \delta p + \sum_{c,h} e_{c,h}^T V_{c,h}^{-1} e_{c,h}, \qquad
          e_{c,h} = g^{-1} \big(\delta B_{c,h} - S_{c,h}\, \delta p\big)

    δp and δB are the differences of exponents and coefficients, as estimated and as A(t; θ) has them, C_p, S, g and V
    their joint covariance (`floquid.core.Estimates`), q the amplitude of each mode in each hit. The coefficients that
    do not rise above the noise take part: that they are small is knowledge too. This is the extended invariance
    principle (Söderström and Stoica 1989), asymptotically as good as the fit of the record itself.

    Raises InputError where the model has no estimates, or states and structure do not belong together;
    IdentificationError where the structure contradicts the data, or the data do not determine it.

    Parameters
    ----------
    model
        The identified response model, with its estimates.
    states
        The channels that are the states, as in `reconstruct`: displacements for a structure of second order, all states
        for one of first order. "all" takes some of the channels as displacements and all others as constant
        combinations of these, whose gains are found too.
    structure
        `SecondOrder` or `FirstOrder`, or their text ("stiffness 2 symmetric; damping 0"); "auto" takes the simplest
        second-order form that the data do not contradict, and all deviations count what the next wider forms could hide
        of the truth; those of a structure that is given are conditional on it (`Refinement.conditional_on`).
    times
        Instants after phase zero [s], or how many equally spaced ones over a period.
    refuse
        The probability of as large a misfit below which the structure is refused; zero refuses none.
    again
        What gives the estimates of the record linearised anew at exponents (modes of the estimates,): one output-error
        step is then made (`floquid.identify(..., output_error=True)` passes it).
    report
        Is told what is being done.
    """
    estimates = model.unselected if model.unselected is not None else model.estimates
    if estimates is None:
        got, remedy = "has none", "Identify with maximum likelihood and `constrained=True`, the defaults."
        raise input_error("model", OF, "have the joint covariance of its coefficients (`estimates`)", got, remedy)
    if not 0.0 <= finite(refuse, "refuse", OF) < 1.0:
        raise input_error("refuse", OF, "be a probability below one", f"is {refuse:g}")
    if isinstance(structure, str):
        structure = structure_of(structure)
    given = isinstance(structure, AbstractStructure)
    if not given and structure != "auto":
        must = 'be "auto", a structure such as SecondOrder(stiffness=Block(harmonics=2)), or its text'
        raise wrong_value("structure", OF, must, structure)
    fit = _Fit.made(model, states, structure.degree if given else 2, estimates)
    if given:
        near, findings = None, ()
    else:
        structure, near, findings = found_structure(fit.at, report)
    report("fitting the structured state matrix")
    try:
        point, basis = near or fit.at(structure)
    except NoModeError:
        raise IdentificationError(
            f"The structure contradicts the data: an equation of motion with {structure.words()} has no modes near "
            f"those of the response. {REMEDY}"
        ) from None
    if again is not None:
        report("one output-error step on the record")
        fit = replace(fit, estimates=again(np.array([mode.exponent for mode in point.modes])))
        point, basis = fit.at(structure, (point, basis))
    if point.p_value < refuse:
        point, basis, wider = _from_wider(fit, structure, point, basis)
        if point.p_value < refuse:
            least = f" Of the next wider structures, {wider[0][1]}." if wider and wider[0][0] > point.p_value else ""
            raise IdentificationError(
                "The structure contradicts the data. It differs from the free model by a chi-square of "
                f"{point.cost:.4g} for {point.degrees} degrees of freedom (p = {point.p_value:.1g}, refused below "
                f"{refuse:g}).{least} {REMEDY}"
            )
    hidden, tests = ((), ()) if given else _hidden(fit, structure, point, basis)
    instants = instants_of(times, model.period, OF)
    found = replace(_refinement(fit, structure, basis, point, instants, hidden), findings=(*findings, *tests))
    return found if model.inputs is None else _with_inputs(found, fit, states)


def _with_inputs(found: Refinement, fit: _Fit, states: Names) -> Refinement:
    """With B, C and D in the same states, as the shapes have them."""
    form: Form = "second-order" if found.structure.degree == 2 else "first-order"
    displacements = fit.coordinates.names[: len(fit.coordinates.states) // found.structure.degree]
    free = reconstruct(fit.model, displacements if states == "all" else states, form=form, times=found.state.times)
    parts = {name: getattr(free, name) for name in ("inputs", "outputs", "direct", "inputs_std")}
    return replace(found, state=replace(found.state, **parts))


@dataclass(frozen=True, slots=True)
class _Fit:
    """The estimates that a structure is fitted to."""

    model: PeriodicModel
    coordinates: Coordinates
    estimates: Estimates
    seen: tuple[Seen, ...]
    shapes: tuple[Array, ...]
    """Shapes of the displacements, one a mode of the estimates (harmonics of the model, displacements)."""
    system: Floats  # A(t) of the free model
    times: Floats
    gains: dict[int, float]  # first values of the gains in `seen` that are unknown

    @staticmethod
    def made(model: PeriodicModel, states: Names, degree: int, estimates: Estimates) -> _Fit:
        """From the names of the states."""
        coordinates = coordinates_of(model, states, "second-order" if degree == 2 else "first-order", None)
        count = len(coordinates.states) // degree
        free = shapes_of(model, coordinates)
        seen, gains = [], {}
        if coordinates.mixing is None:
            seen = _seen(coordinates.states[:count])
        else:
            coordinates, seen, gains = _all_channels(model, coordinates)
        times = np.arange(64) * model.period / 64
        strongest = np.argmax(np.sum(np.abs(model.coefficients) ** 2, axis=(1, 3)), axis=1)
        own = []
        for mode in model.modes_of(estimates):
            # Of one hit, so that the shape of a real multiplier stays its own mirror image.
            whole = model.coefficients[mode, :, strongest[mode]]
            own.append(np.einsum("mic,cm->mi", free.weights[mode][:, :count], whole))
        system = modal_at(free, times).system.real
        return _Fit(model, coordinates, estimates, tuple(seen), tuple(own), system, times, gains)

    def at(self, structure: AbstractStructure, near: tuple[Point, Basis] | None = None) -> tuple[Point, Basis]:
        """The best fit of a structure near A(t) of the free model, or near that of another fit."""
        count = len(self.coordinates.states) // structure.degree
        basis = structure.basis(count)
        whole, slopes = basis.in_time(self.model.fundamental * self.times)
        system, gains = self.system, np.array(list(self.gains.values()))
        if near is not None:
            known, by = near[1].in_time(self.model.fundamental * self.times)
            system = known + np.tensordot(near[0].parameters[: len(by)], by, axes=1)
            gains = near[0].parameters[len(by) :]
        start = np.linalg.lstsq(slopes.reshape(len(slopes), whole.size).T, (system - whole).ravel(), rcond=None)[0]
        start = np.concatenate([start, gains])
        most = int(max(np.abs(self.estimates.harmonics).max(), np.abs(self.model.harmonics).max()))
        step = BEYOND * max(int(basis.harmonics.max()), 1)
        exponents, point = None, None
        for round_ in range(WIDENED):
            width = most + step * (round_ + 1)
            problem = self.problem(basis, width)
            pairs = zip(self.estimates.exponents, problem.anchors, strict=True)
            point = fitted(problem, start, tuple(Mode(complex(lam), u) for lam, u in pairs))
            start, before = point.parameters, exponents
            exponents = np.array([mode.exponent for mode in point.modes])
            std = np.sqrt(np.diag(self.estimates.covariance)[: len(exponents)])
            if before is not None and (np.abs(exponents - before) < SAME * std).all():
                break
            sizes = [np.abs(mode.coefficients) for mode in point.modes]
            if round_ == 0 and max(float(size[[0, -1]].max() / size.max()) for size in sizes) < 1e-9:
                break
        assert point is not None
        return point, basis

    def problem(self, basis: Basis, width: int) -> Problem:
        """The fit of a basis, with the harmonics -width to width of each shape."""
        shapes = []
        for shape in self.shapes:
            whole = np.zeros((2 * width + 1, shape.shape[1]), complex)
            whole[self.model.harmonics + width] = shape
            shapes.append(whole / np.linalg.norm(whole))
        return problem_of(self.estimates, self.seen, basis, shapes, tuple(self.gains))


def _seen(states: Sequence[State]) -> list[Seen]:
    """The displacements in each channel: one in a view of it, in channels of sums by the inverse of the weights."""
    parts = {part.channel: part for state in states for part in state.parts}
    if all(state.noise or len(state.parts) == 1 for state in states):
        pairs = [(place, part) for place, state in enumerate(states) for part in state.parts]
        return [Seen(part.channel, 1.0 / part.gain, -part.power, -part.delay, place) for place, part in pairs]
    if len(parts) != len(states):
        got = f"{len(states)} are sums of {len(parts)} channels"
        raise input_error("states", OF, "be sums of as many channels", got, "Leave the structure out.")
    weights = [[sum(part.gain for part in state.parts if part.channel == row) for row in parts] for state in states]
    inverse = np.linalg.inv(np.array(weights))
    return [
        Seen(row, float(gain), -part.power, -part.delay, place)
        for (row, part), gains in zip(parts.items(), inverse, strict=True)
        for place, gain in enumerate(gains)
        if gain
    ]


def _all_channels(model: PeriodicModel, coordinates: Coordinates) -> tuple[Coordinates, list[Seen], dict[int, float]]:
    """Some channels as displacements, and the others as constant combinations of them, whose gains are unknown."""
    assert coordinates.mixing is not None
    seen, gains = [], {}
    for row, channel in enumerate(model.channels):
        power = derivative_of(channel)
        if row in coordinates.chosen:
            seen.append(Seen(row, power=power, displacement=coordinates.chosen.index(row)))
            continue
        for place, gain in enumerate(coordinates.mixing[row]):
            gains[len(seen)] = float(gain)
            seen.append(Seen(row, power=power, displacement=place))
    names = [model.channels[row].name for row in coordinates.chosen]
    displacements = tuple(
        State(name, (Part(row, 1.0, -derivative_of(model.channels[row])),))
        for name, row in zip(names, coordinates.chosen, strict=True)
    )
    words = f"second-order form from {', '.join(names)}, the other channels being constant combinations of them"
    derived = tuple(state.derivative() for state in displacements)
    return Coordinates((*displacements, *derived), len(model.channels), "second-order", words), seen, gains


def _from_wider(
    fit: _Fit, structure: AbstractStructure, point: Point, basis: Basis
) -> tuple[Point, Basis, list[tuple[float, str]]]:
    """The best fit of a structure from those of the next wider ones, too; and how probable these are, in words."""
    # A mode that is weak leaves the free A(t) so rough that the way from it ends at a point of least cost that is none.
    wider = []
    for words, other in structure.wider():
        try:
            trial, whole = fit.at(other)
            covariance_of(trial)
        except (IdentificationError, np.linalg.LinAlgError):
            continue
        wider.append((trial.p_value, f"{words} leaves {trial.cost:.4g} for {trial.degrees}"))
        if trial.cost < point.cost:
            with suppress(IdentificationError, np.linalg.LinAlgError):
                again, own = fit.at(structure, (trial, whole))
                point, basis = (again, own) if again.cost < point.cost else (point, basis)
    return point, basis, sorted(wider, key=lambda one: -one[0])


def _hidden(
    fit: _Fit, structure: AbstractStructure, point: Point, basis: Basis
) -> tuple[tuple[Hidden, ...], tuple[Finding, ...]]:
    """Addition of each next wider structure to the deviations, and its test."""
    width, count = len(point.modes[0].coefficients) // 2, basis.known.shape[-1]
    found: list[tuple[Hidden | None, Finding]] = []
    for ways in structure.hiding():
        # Of one displacement no matrix is other than symmetric: that is no wider.
        wider = [(name, own) for name, other in ways if len((own := other.basis(count)).names) > len(basis.names)]
        each = [hidden_in(fit.problem(own, width), name, point, basis) for name, own in wider]
        found += [next((one for one in each if one[0] is not None), each[-1])] if each else []
    return tuple(own for own, _ in found if own is not None), tuple(finding for _, finding in found)


def _refinement(
    fit: _Fit, structure: AbstractStructure, basis: Basis, point: Point, times: Floats, hidden: Sequence[Hidden]
) -> Refinement:
    """The result, with every deviation."""
    whole, model = covariance_of(point), fit.model
    known, slopes = basis.in_time(point.fundamental * times)
    system = known + np.tensordot(point.parameters[: len(slopes)], slopes, axes=1)
    transition, condition = transition_of(fit.estimates, basis, point, times)
    parts = [variances(fit.estimates, basis, point, whole, times)]
    parts += [variances(fit.estimates, own.basis, own.point, own.moment, times) for own in hidden]
    system_std, transition_std, by_mode = (np.sqrt(sum(part)) for part in zip(*parts, strict=True))
    count = len(point.parameters)
    covariance = whole[:count, :count] + sum(own.of_parameters for own in hidden)
    exponents, std = np.array(model.exponents), np.zeros(model.order, complex)
    for entry, mode in enumerate(point.modes):
        own = model.modes_of(fit.estimates)[entry]
        deviation = complex(*by_mode[:, entry])
        partners = np.flatnonzero(np.abs(model.exponents - model.exponents[own].conj()) < 1e-9 * model.fundamental)
        if fit.estimates.real[entry]:
            exponents[own], std[own] = complex(mode.exponent.real, model.exponents[own].imag), deviation.real
            continue
        for place, value in ((own, mode.exponent), *((p, np.conj(mode.exponent)) for p in partners)):
            exponents[place], std[place] = value, deviation
    words = f"structured state matrix ({structure.words()}) in {fit.coordinates.words}"
    seen, states = [fit.seen[k] for k in fit.gains], fit.coordinates.names
    gains = [f"{model.channels[one.channel].name} per {states[one.displacement]}" for one in seen]
    state = StateModel(
        times=times,
        transition=transition,
        system=system,
        condition=condition,
        states=fit.coordinates.names,
        coordinates=fit.coordinates.words,
        system_std=system_std,
        transition_std=transition_std,
        provenance=model.provenance.then(words),
    )
    return Refinement(
        state=state,
        structure=structure,
        parameters=point.parameters,
        names=(*basis.names, *gains),
        covariance=covariance,
        exponents=exponents,
        exponent_std=std,
        chi_square=point.cost,
        degrees=point.degrees,
        p_value=point.p_value,
    )
