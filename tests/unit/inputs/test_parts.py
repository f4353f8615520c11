"""Sums over parts of the samples are those over all at once, and all slopes are never held."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.inputs.test_states import OMEGA, STEP, block, mode

from floquid.inputs import linearise, samples_of, slopes_in_parts, slopes_of
from floquid.inputs._solver import columns_of, normal_equations
from floquid.inputs._start import bare_mode, fitted_together
from floquid.inputs.search import Scores, passed

MODES = {
    "a pair": mode(),
    "a real multiplier": mode(real=True),
    "a mode that grows": mode(rate=2.5),
    "a block": block(-1e-2),
}


def samples(hold="first"):
    generator = np.random.default_rng(2)
    parts = [generator.standard_normal((2, 2, n)) for n in (60, 43)]
    parts[0][1, :, 30:33] = np.nan
    outputs, inputs = [own[1] for own in parts], [own[0] for own in parts]
    return samples_of(outputs, inputs, [0.4, 1.1], step=STEP, fundamental=OMEGA, hold=hold, turns=(1,))


def with_two_records(own):
    return replace(own, initial=np.repeat(own.initial.reshape(own.states, -1), 2, axis=1).ravel())


def sums(own, wanted):
    at = linearise(own, [wanted, replace(with_two_records(mode()), exponent=-0.1 + 0.3j)], (0.0, 1.0))
    scores, equations = Scores(own, at, rough=False), normal_equations(own, at)
    further = replace(at.modes[0], turns=at.modes[0].turns[-1:] + 1.0)
    draws = np.random.default_rng(5).standard_normal((3, *at.left.shape))
    found = {
        "the residual": at.left,
        "the normal equations": np.concatenate([np.ravel(part) for part in equations]),
        "the response": at.columns.response(at.coefficients, slice(2)),
        "the residual of draws": scores.unfitted(draws),
        "a step": scores.step_along(draws[0]),
        "gains by columns": scores.by_columns([lambda part, here: columns_of(part, further, at.states[0][..., here])]),
        "products": fitted_together(own, own.values, [bare_mode(own, -0.2 + 0.5j, np.arange(3.0), np.arange(2.0))])[0],
    }
    if wanted.square is None:
        found["gains by inputs"] = scores.by_inputs([(0, float(at.modes[0].reach[-1]) + 1.0), (1, 3.0)])
        found["noise that drives"] = [scores.by_noise(2)]
        for number, both in enumerate(passed(scores, equations, [0, 1])):
            found[f"noise through mode {number}"] = np.concatenate(
                [np.ravel(both.of_parameters), *map(np.ravel, both.of_columns)]
            )
    return found


@pytest.mark.parametrize("name", MODES)
def test_parts_of_the_samples_add_up_to_all(name, monkeypatch):
    wanted = with_two_records(MODES[name])
    whole = sums(samples(), wanted)
    monkeypatch.setattr("floquid.inputs._samples.BLOCK", 1)
    monkeypatch.setattr("floquid.inputs._samples.CHUNK", 29)
    for what, found in sums(samples(), wanted).items():
        size = np.abs(whole[what]).max()
        assert np.abs(np.asarray(found) - whole[what]).max() < 1e-9 * max(size, 1e-12), what


def peak_of(of, data):
    """The most memory that a function takes, over that of the data."""
    tracemalloc.start()
    of()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / data


@pytest.mark.slow
def test_memory_does_not_grow_with_the_parameters(monkeypatch):
    """The slopes of one channel by all parameters, or of all states, would each take 15 times the data."""
    monkeypatch.setattr("floquid.inputs._samples.BLOCK", 2**16)
    monkeypatch.setattr("floquid.inputs._samples.CHUNK", 256)
    monkeypatch.setattr("floquid.inputs.search._scores.MOST_KEPT", 0)
    outputs, inputs = np.random.default_rng(3).standard_normal((2, 2, 9000))
    own, turns = samples_of([outputs], [inputs], [0.0], step=STEP, fundamental=OMEGA), np.arange(-3.0, 4.0)
    modes = [bare_mode(own, exponent, turns, turns) for exponent in (-0.1 + 0.5j, -0.2 + 0.2j)]

    def everything():
        fitted_together(own, own.values, [bare_mode(own, -0.3 + 0.1j, turns[2:5], turns[2:5])])
        at = linearise(own, modes)
        scores = Scores(own, at)
        scores.by_inputs([(0, 5.0), (1, 5.0)])
        scores.by_noise(5)
        passed(scores, normal_equations(own, at), [0, 1])

    assert peak_of(everything, outputs.nbytes + inputs.nbytes) < 16.0


def test_rounding_of_the_period_adds_no_harmonic():
    """Of 14 samples in 0.3 s a seventh harmonic was taken for another one than its own conjugate."""
    none = np.zeros((0, 28))
    of = samples_of([np.ones((1, 28))], [none], [0.0], step=1.0 / (14.0 / 0.3), fundamental=2.0 * np.pi / 0.3)
    assert of.highest == 6


@pytest.mark.parametrize("channels", [1, 5, 9])  # of two modes those above four are summed without slopes
@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize("name", MODES)
def test_normal_equations_are_those_of_the_slopes_of_each_channel(name, rough, channels):
    own = samples()
    mixed = np.random.default_rng(3).standard_normal((channels, len(own.values))) @ own.values
    own = replace(own, values=mixed)
    modes = [MODES[name], replace(mode(), exponent=-0.1 + 0.3j)]
    at = linearise(own, [with_two_records(each) for each in modes], (0.0,))
    found = normal_equations(own, at, rough=rough)
    matrix, gradient, along = 0.0, 0.0, 0.0
    for part in slopes_in_parts(own, at.modes, at.states, 1):
        here, columns = part.alone, at.columns.of(part.alone.samples, part.own)
        each = np.stack([slopes_of(here.samples, at, c, here.rows, 1.0 / noise) for c, noise in enumerate(at.noise)])
        along = along + each @ columns.T
        matrix = matrix + np.einsum("cpt,cqt->pq", each, each)
        gradient = gradient + np.einsum("cpt,ct,c->p", each, at.left[:, part.own], 1.0 / at.noise)
    size = np.sqrt(np.diag(matrix))
    matrix = matrix - np.einsum("cpk,kl,cql->pq", along, at.inverse, along)
    close = 1e-4 if rough else 1e-11
    np.testing.assert_allclose(found.matrix / np.outer(size, size), matrix / np.outer(size, size), atol=close)
    np.testing.assert_allclose(found.gradient / size, gradient / size, atol=close * np.abs(gradient / size).max())
    np.testing.assert_allclose(found.along, along, atol=close * np.abs(along).max())
