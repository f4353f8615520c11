"""A pair near an axis as a block: every gradient is a difference, and readings hold the truth through the edge."""

from dataclasses import replace

import numpy as np
import pytest

from floquid.core import Channel, Provenance, readings
from floquid.inputs import InputMode, _modes, _slopes, samples_of
from floquid.inputs import linearise as linearise_driven
from floquid.inputs._solver import normal_equations
from floquid.lifting import Lifted
from floquid.lti import TimeResponses
from floquid.periodic.least_squares import (
    EVEN,
    ODD,
    GappyBlock,
    LiftedBlock,
    ModeParameters,
    RecordBlock,
    linearise,
)
from floquid.periodic.search._tests import equality

PERIOD, PHASES, CYCLES = 1.3, 12, 90
OMEGA = 2.0 * np.pi / PERIOD
TIMES = np.arange(PHASES * CYCLES) * PERIOD / PHASES
VALUES = np.random.default_rng(0).standard_normal((2, len(TIMES))) + 5.0 * np.exp(-0.02 * TIMES) * np.cos(1.9 * TIMES)
SQUARES = (-1e-2, -1e-9, 0.0, 1e-9, 1e-3)


def blocks(kind):
    """The same samples as each kind of block has them."""
    record = RecordBlock(times=TIMES, values=VALUES, hit=0, rows=np.arange(2), noise=np.ones(2))
    cut = VALUES.reshape(2, CYCLES, PHASES).transpose(0, 2, 1).reshape(2 * PHASES, 1, CYCLES).copy()
    lifted = Lifted(
        responses=TimeResponses(values=cut, dt=PERIOD),
        channels=(Channel(name="a"), Channel(name="b")),
        n_phases=PHASES,
        first_phase=0.0,
        provenance=Provenance(),
    )
    constant = np.linalg.qr(np.ones((CYCLES, 1)))[0]
    there = np.abs(np.arange(len(TIMES)) - 230) > 30
    few = {"times": TIMES[:900], "values": VALUES[:, :900]}
    return {
        "lifted": LiftedBlock.all_of(lifted),
        "lifted, a constant off": LiftedBlock.all_of(lifted, [constant]),
        "even": (record,),
        "few": (replace(record, **few),),
        "by angle": (replace(record, angles=OMEGA * TIMES),),
        "gaps": (GappyBlock.of(record, there),),
    }[kind]


def entries(square, half, decay, odd=(0, 2)):
    """A pair away from any axis, and one near it."""
    found = ModeParameters.made([-0.02 + 1.9j], [(-1, 1)], OMEGA)
    for factor, band in ((EVEN, (0, 2)), (ODD, odd)):
        one = ModeParameters.made([decay], [band], OMEGA, real=True, offsets=0.5 * half, factor=factor)
        found = found.joined(replace(one, squares=np.array([square])))
    return found


KINDS = ("lifted", "lifted, a constant off", "even", "few", "by angle", "gaps")


PAIRS = [*((square, -0.03, (0, 2)) for square in SQUARES), (-1e-9, 0.01, (0, 1)), (1e-3, 0.01, (0, 1))]
"""Pairs on either side of the edge, near and far: what decays, and what grows."""


def gradient_cells():
    """Every kind of block with every pair: of lifted responses each day, of the others one on either side."""
    for kind in KINDS:
        for half in (1, 0):
            for pair in PAIRS:
                daily = kind == "lifted" or (half == 1 and pair in (PAIRS[1], PAIRS[-1]))
                yield pytest.param(kind, half, pair, marks=[] if daily else [pytest.mark.slow])


@pytest.mark.parametrize(("kind", "half", "pair"), list(gradient_cells()))
def test_the_gradient_is_a_difference_through_the_edge(kind, half, pair):
    own = blocks(kind)
    square, decay, odd = pair
    at = entries(square, half, decay, odd)
    found = linearise(own, at)
    for place, analytic in enumerate(found.gradient):
        step = np.zeros(len(found.gradient))
        size = 1e-8 if place == len(step) - 1 else 1e-6  # of q, in which the response bends far sooner
        step[place] = size
        ends = [linearise(own, at.moved(sign * step)).cost for sign in (1.0, -1.0)]
        assert -(ends[0] - ends[1]) / (4.0 * size) == pytest.approx(analytic, abs=1e-5 * np.abs(found.gradient).max())


def driven(square, half, hold):
    """A pair away from any axis, and one near it, driven by two inputs from a state at the begin of either record."""
    generator, inputs = np.random.default_rng(1), np.random.default_rng(2).standard_normal((2, 700))
    parts = [slice(0, 400), slice(400, 700)]
    values, forces = ([own[:, part] for part in parts] for own in (VALUES, inputs))
    samples = samples_of(values, forces, [0.0, 0.4], step=PERIOD / PHASES, fundamental=OMEGA, hold=hold)
    modes, low = [], 0.5 * (half % 2)
    for real, band in ((False, np.arange(-1.0, 2.0)), (True, np.arange(low, low + 1.5))):
        gains = generator.standard_normal((2, 4 if real else 2, len(band)))
        initial = generator.standard_normal(4 if real else 2) + 0j
        one = {"reach": band, "turns": band, "gains": gains[0] + 1j * gains[1], "initial": initial, "sizes": np.ones(2)}
        exponent = -0.03 + 0j if real else -0.02 + 1.9j
        modes.append(InputMode(exponent=exponent, real=real, square=square if real else None, **one).scaled())
    return samples, modes


def misfit_of_gradients(square, half, hold):
    """The largest difference of a gradient from its difference, over the largest gradient, of measured inputs."""
    samples, modes = driven(square, half, hold)
    at, off, place = linearise_driven(samples, modes), [], 0
    _, gradient, _ = normal_equations(samples, at)
    for number, mode in enumerate(modes):
        for index in np.flatnonzero(mode.free):
            step = np.zeros(len(mode.free))
            step[index] = size = 1e-7 if index == len(step) - 1 and mode.real else 1e-6
            costs = []
            for sign in (1.0, -1.0):
                moved = [own.moved(sign * step) if k == number else own for k, own in enumerate(modes)]
                costs.append(np.sum((linearise_driven(samples, moved).left / at.noise[:, None]) ** 2))
            off.append(abs(-(costs[0] - costs[1]) / (4.0 * size) - gradient[place]))
            place += 1
    assert place == len(gradient)
    return max(off) / np.abs(gradient).max()


OFTEN = {(-1e-9, "zero"), (-1e-9, "none"), (1e-3, "first")}
"""Squares and holds that are not slow: on either side of the edge, and each hold once."""


@pytest.mark.parametrize(
    ("square", "hold", "half"),
    [
        pytest.param(square, hold, half, marks=[pytest.mark.slow] * ((square, hold) not in OFTEN))
        for square in (-1e-3, -1e-9, 0.0, 1e-9, 1e-3)
        for hold, half in (("zero", 0), ("zero", 1), ("first", 1), ("none", 1))
    ],
)
def test_the_gradient_with_inputs_is_a_difference_through_the_edge(square, hold, half):
    assert misfit_of_gradients(square, half, hold) < 1e-5


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("slopes_along_square", lambda *args: 1.01 * RIGHT["slopes_along_square"](*args)),
        ("by_root", lambda values, square: RIGHT["by_root"](values, abs(square))),
        ("parts_of", lambda of, square, decay: RIGHT["parts_of"](of, square, 1e-6)),
    ],
    ids=["a slope along q", "the product with j", "no interpolation"],
)
def test_a_wrong_derivative_with_inputs_is_found(name, wrong, monkeypatch):
    monkeypatch.setattr(USED[name], name, wrong)
    assert any(not misfit_of_gradients(square, 1, "zero") < 1e-5 for square in (-1e-3, 1e-16))


USED = {"slopes_along_square": _slopes, "by_root": _slopes, "parts_of": _modes}
RIGHT = {name: getattr(room, name) for name, room in USED.items()}


@pytest.mark.parametrize("square", [-1e-2, 1e-2])
def test_away_from_the_edge_it_is_a_pair_or_two_real_multipliers(square):
    (own,) = blocks("lifted")
    root = np.sqrt(abs(square))
    block = linearise([own], entries(square, 1, -0.03).picked([1, 2]))
    if square > 0:
        plain = ModeParameters.made([-0.03 + root, -0.03 - root], [(0, 2)] * 2, OMEGA, real=True, offsets=0.5)
    else:
        plain = ModeParameters.made([-0.03 + 1j * (root + 0.5 * OMEGA)], [(-3, 2)], OMEGA)
    assert block.cost == pytest.approx(linearise([own], plain).cost, rel=1e-9)


def test_the_cost_is_smooth_through_the_edge():
    (own,) = blocks("lifted")
    costs = [linearise([own], entries(1e-6 * k, 0, -0.03)).cost for k in range(-3, 4)]
    assert np.abs(np.diff(costs, 4)).max() < 1e-3 * np.abs(np.diff(costs)).max()


def test_harmonics_of_a_mode_beside_it_are_compared_as_beside_an_ordinary_pair():
    (own,) = blocks("lifted")
    near = entries(-1e-2, 1, -0.03)
    pair = ModeParameters.made([-0.03 + 1j * (0.1 + 0.5 * OMEGA)], [(-3, 2)], OMEGA)
    found = []
    for at in (near, near.picked([0]).joined(pair)):
        solution = linearise([own], replace(at, squares=at.squares if at is near else None))
        found.append(equality(solution, 0, np.ones(len(at.columns().modes), bool)))
    assert found[0][1] == found[1][1] == 4
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-6)


@pytest.mark.parametrize("correlation", [pytest.param(-0.8, marks=pytest.mark.slow), 0.8])
@pytest.mark.parametrize("true", [-4.0, -1.0, -0.1, 0.0, 0.1, 1.0, 4.0, 30.0, -30.0])
def test_readings_hold_the_truth_on_either_side(true, correlation):
    """The square root has no slope at zero: q in units of its own deviation, from one side of the edge to the other."""
    generator, sigma = np.random.default_rng(0), 0.3
    exact = np.sqrt(complex(true)) * np.array([1.0, -1.0])
    covariance = np.array([[sigma**2, correlation * sigma], [correlation * sigma, 1.0]])
    root = np.linalg.cholesky(covariance)
    held, worst = [], 0.0
    for _ in range(600):
        mean, square = np.array([0.0, true]) + root @ generator.standard_normal(2)
        exponents, std = readings(mean, square, covariance, 0, 1.0)
        errors = min((exponents - exact, exponents - exact[::-1]), key=lambda own: np.abs(own).sum())
        pulls = np.concatenate([np.abs(errors.real) / std.real, np.abs(errors.imag) / np.maximum(std.imag, 1e-300)])
        pulls[np.concatenate([errors.real, errors.imag]) == 0.0] = 0.0
        held.append(pulls < 1.96)
        worst = max(worst, pulls.max())
    assert np.mean(held) > 0.94
    assert worst < 4.5


def test_one_that_is_seen_well_beside_one_that_is_not_keeps_its_deviation():
    turn = np.array([[0.5, 0.5], [0.1, -0.1]])  # σ and q of -0.005 and -0.015 by errors of both
    covariance = turn @ np.diag([1e-10, 1e-6]) @ turn.T
    exponents, std = readings(-0.01, 0.005**2, covariance * np.outer([1.0, 0.05], [1.0, 0.05]), 1, OMEGA)
    assert exponents == pytest.approx([-0.005 + 0.5j * OMEGA, -0.015 + 0.5j * OMEGA])
    assert std.real == pytest.approx([1e-5, 1e-3], rel=1e-6)
