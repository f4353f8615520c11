"""The state of a mode between its inputs' samples, against integration; its slopes against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg
from scipy.integrate import solve_ivp

from floquid.core import Provenance
from floquid.inputs import InputMode, Uncertainty, columns_at, linearise, samples_of, slopes_in_parts, slopes_of
from floquid.inputs._modes import directed, runs_away, state_of
from floquid.inputs._slopes import reached_by
from floquid.inputs.search._search import block_of_pair, block_of_reals, ordinary

STEP, OMEGA = 0.17, 1.3


def samples(hold, values=None):
    generator = np.random.default_rng(2)
    inputs = generator.standard_normal((2, 60))
    outputs = generator.standard_normal((2, 60)) if values is None else values
    return samples_of([outputs], [inputs], [0.4], step=STEP, fundamental=OMEGA, hold=hold, turns=(1,))


def mode(*, real=False, rate=-0.3):
    generator = np.random.default_rng(7)
    reach = np.array([0.5, 1.5]) if real else np.array([-1.0, 0.0, 1.0])
    gains = generator.standard_normal((2, len(reach))) + 1j * generator.standard_normal((2, len(reach)))
    return InputMode(
        exponent=rate + (0.0 if real else 0.8j),
        real=real,
        reach=reach,
        gains=gains,
        turns=reach,
        initial=np.array([0.7 + (0.0 if real else 0.2j)]),
        sizes=np.ones(2),
        backwards=runs_away(samples("zero"), rate),
    )


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("real", [False, True])
def test_the_state_is_that_of_the_equation(hold, real):
    own, wanted = samples(hold), mode(real=real)
    state = wanted.initial[0] + 0j
    found = [state]
    for number in range(20):
        begin, now, then = own.times[number], own.inputs[:, number], own.inputs[:, number + 1]

        def rate(t, z, begin=begin, now=now, then=then):
            share = (t - begin) / STEP if hold == "first" else 0.0
            u = now + share * (then - now)
            driven = sum(
                wanted.gains[i, k] * np.exp(1j * turn * OMEGA * t) * u[i]
                for i in range(2)
                for k, turn in enumerate(wanted.reach)
            )
            return wanted.exponent * z + (driven.real if real else driven)

        state = solve_ivp(rate, (begin, begin + STEP), [state], rtol=1e-10, atol=1e-12).y[0, -1]
        found.append(state)
    assert np.abs(state_of(own, wanted)[:21] - np.array(found)).max() < 1e-8


@pytest.mark.parametrize("real", [False, True])
def test_a_mode_that_a_feedback_holds_ends_where_it_is_said(real):
    """By itself it would grow by 25 nepers: run forwards from where it began it follows the same equation."""
    own, wanted = samples("zero"), mode(real=real, rate=2.5)
    state = state_of(own, wanted)
    assert np.isclose(state[-1], wanted.initial[0])
    assert np.abs(state).max() < 20.0
    at = replace(wanted, initial=np.array([state[0] + 0j]), backwards=False)
    first = samples_of([own.values[:, :6]], [own.inputs[:, :6]], [0.4], step=STEP, fundamental=OMEGA, hold="zero")
    assert np.allclose(state_of(first, at), state[:6], atol=1e-9)


@pytest.mark.parametrize("real", [False, True])
def test_slopes_of_a_mode_that_a_feedback_holds_are_those_of_the_response(real):
    own, wanted = samples("zero"), mode(real=real, rate=2.5)
    at = linearise(own, [wanted])
    (part,) = slopes_in_parts(own, at.modes, at.states, 1)
    slopes = slopes_of(own, at, 1, part.rows)
    free = np.flatnonzero(wanted.free)
    for row, index in enumerate(free):
        step = np.zeros(len(wanted.free))
        step[index] = 1e-5
        moved = [columns_at(own, [wanted.moved(sign * step)], ()).response(at.coefficients) for sign in (1.0, -1.0)]
        slope = (moved[0] - moved[1])[1] / 2e-5
        assert np.abs(slopes[row] - slope).max() < 1e-6 * max(np.abs(slope).max(), 1.0), index


def test_a_hold_that_is_forgotten_is_another_response():
    one, other = samples("zero"), samples("none")
    assert np.abs(state_of(one, mode()) - state_of(other, mode())).max() > 0.01


def test_records_begin_anew():
    generator = np.random.default_rng(0)
    parts = [generator.standard_normal((2, n)) for n in (40, 30)]
    both = samples_of(parts, parts, [0.0, 0.9], step=STEP, fundamental=OMEGA)
    alone = samples_of(parts[1:], parts[1:], [0.9], step=STEP, fundamental=OMEGA)
    started = replace(mode(), initial=np.array([0.3, -0.4 + 1j]))
    second = replace(mode(), initial=np.array([-0.4 + 1j]))
    assert np.allclose(state_of(both, started)[40:], state_of(alone, second))


def block(square, lowest=0.5):
    """A block of a decay of 0.3, so that q in units of the decay squared is `square`."""
    generator = np.random.default_rng(7)
    reach = np.array([lowest, lowest + 1.0])
    gains = generator.standard_normal((4, 2)) + 1j * generator.standard_normal((4, 2))
    return InputMode(
        exponent=-0.3 + 0j,
        real=True,
        reach=reach,
        gains=gains,
        turns=reach,
        initial=np.array([0.7 + 0j, 0.3 + 0j]),
        sizes=np.ones(2),
        square=0.3**2 * square,
    )


SQUARES = [-4.0, -1e-2, -1e-8, 0.0, 1e-8, 1e-2, 0.5]


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("square", SQUARES)
def test_the_states_of_a_block_are_those_of_the_equation(square, hold):
    own, wanted = samples(hold), block(square)
    state = wanted.initial.real
    found = [state]
    for number in range(20):
        begin, now, then = own.times[number], own.inputs[:, number], own.inputs[:, number + 1]

        def rate(t, z, begin=begin, now=now, then=then):
            share = (t - begin) / STEP if hold == "first" else 0.0
            turned = np.exp(1j * OMEGA * t * wanted.reach)
            driven = (wanted.gains @ turned).real.reshape(2, 2) @ (now + share * (then - now))
            return np.array([[-0.3, wanted.square], [1.0, -0.3]]) @ z + driven

        state = solve_ivp(rate, (begin, begin + STEP), state, rtol=1e-10, atol=1e-12).y[:, -1]
        found.append(state)
    assert np.abs(state_of(own, wanted)[:, :21] - np.array(found).T).max() < 1e-8


@pytest.mark.parametrize("square", SQUARES)
def test_the_scale_of_a_block_changes_no_response(square):
    own, wanted = samples("zero"), block(square)
    left = linearise(own, [wanted]).left
    scaled = wanted.scaled()
    elements, largest = scaled._elements
    assert elements[:, largest] == pytest.approx([1.0, 0.0], abs=1e-12)
    assert np.abs(linearise(own, [scaled]).left - left).max() < 1e-10
    assert np.abs(linearise(own, [wanted._divided(0.4, 1.1)]).left - left).max() < 1e-10


@pytest.mark.parametrize("half", [0, 1, 2, 3])
def test_a_block_is_the_pair_that_it_was_made_of(half):
    """About either axis, with harmonics as far on either side of it."""
    own, generator = samples("zero"), np.random.default_rng(3)
    turns = np.arange(-2.0, 3.0 if half % 2 == 0 else 2.0) - half // 2
    gains = generator.standard_normal((2, len(turns), 2)) @ np.array([1.0, 1j])
    pair = replace(
        mode(), exponent=-0.3 + 1j * (0.5 * half * OMEGA + 0.1), turns=turns, reach=-turns[::-1], gains=gains
    )
    at = linearise(own, [pair])
    other = linearise(own, [block_of_pair(own, pair)])
    assert np.abs(other.left - at.left).max() < 1e-9
    assert other.n_parameters == at.n_parameters
    again = linearise(own, ordinary(own, other.modes[0]))
    assert np.abs(again.left - at.left).max() < 1e-9


def test_a_block_is_the_two_real_multipliers_that_it_was_made_of():
    own, slow = samples("zero"), mode(real=True)
    fast = replace(slow, exponent=-0.5 + 0j, gains=slow.gains[::-1], initial=-slow.initial)
    at = linearise(own, [slow, fast])
    other = linearise(own, [block_of_reals([fast, slow], OMEGA)])
    assert np.abs(other.left - at.left).max() < 1e-9
    assert other.n_parameters == at.n_parameters
    again = linearise(own, ordinary(own, other.modes[0]))
    assert np.abs(again.left - at.left).max() < 1e-9


@pytest.mark.parametrize(("rate", "real"), [(-0.3, False), (-0.3, True), (3.0, False)])
def test_a_mode_that_no_input_reaches_asks_nothing_of_lapack(rate, real, monkeypatch):
    """A solver that is given no right-hand side writes beyond it: the program ends, sooner or later."""
    honest = linalg.get_lapack_funcs

    def checked(names, arrays):
        (solve,) = honest(names, arrays)

        def solved(band, right, **options):
            assert right.size
            return solve(band, right, **options)

        return (solved,)

    monkeypatch.setattr(linalg, "get_lapack_funcs", checked)
    own, driven = samples("zero"), mode(real=real, rate=rate)
    still = replace(driven, reach=driven.reach[:0], gains=driven.gains[:, :0])
    nothing = replace(own, inputs=own.inputs[:0])
    for at, unreached in ((own, still), (nothing, replace(driven, gains=driven.gains[:0], sizes=np.ones(0)))):
        free = state_of(at, unreached)
        parts = reached_by(at, unreached)
        assert parts.shape == (1, at.n_samples)
        assert np.abs(free - unreached.initial[0] * parts[0]).max() < 1e-12


@pytest.mark.parametrize("rate", [0.05, 0.5])
def test_first_states_of_a_model_are_those_at_the_first_samples(rate):
    """Of a mode that grows by 5 nepers the fit has the last one."""
    own = samples("zero")
    at = linearise(own, [mode(real=False, rate=rate)])
    model = Uncertainty(own, at).model(["a", "b"], [f"u{k}" for k in range(len(own.inputs))], Provenance())
    assert np.allclose(model.inputs.initial[0], at.states[0][[record.start for record in own.records]])


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("real", [False, True])
def test_a_mode_is_the_same_followed_from_either_end(real, backwards):
    own = samples("first")
    other = replace(mode(real=real, rate=0.3 if backwards else 0.05), backwards=not backwards)
    turned = directed(own, other)
    assert turned.backwards == runs_away(own, other.exponent)
    assert np.allclose(state_of(own, turned), state_of(own, other))
