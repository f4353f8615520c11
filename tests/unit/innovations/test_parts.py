"""Sums over parts of outputs alone are those over all at once, and nothing is held of every sample and parameter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.innovations.test_predictor import OMEGA, STEP, modes_of
from tests.unit.inputs.test_parts import peak_of

from floquid.innovations import first_innovations, repetition
from floquid.innovations._covariance import reweighed
from floquid.innovations._cyclic import left_over, turned_records
from floquid.innovations._derivatives import gradient
from floquid.innovations._predictor import predicted, responding
from floquid.innovations._solve import normal_of
from floquid.inputs import samples_of


def samples(lengths):
    generator = np.random.default_rng(1)
    outputs = [generator.standard_normal((2, length)) for length in lengths]
    outputs[0][:, 200:204] = np.nan
    inputs = [generator.standard_normal((1, length)) for length in lengths]
    return samples_of(outputs, inputs, [0.1 * k for k in range(len(lengths))], step=STEP, fundamental=OMEGA, turns=(1,))


def at_start(own):
    modes = [replace(mode, gains=0.1 * mode.gains) for mode in modes_of(np.random.default_rng(4))]
    at = predicted(own, modes, np.zeros((2, len(own.known))), np.ones((len(own.records), 3)))
    assert at is not None
    return reweighed(own, at)


def sums(own):
    at = at_start(own)
    normal, found = normal_of(own, at), repetition(own)
    return {
        "the innovations": at.innovations,
        "the states": at.states,
        "the whitening": at.whitening[:],
        "the gradient of other signals": gradient(own, at, own.values),
        "the response": responding(own, at, at.innovations),
        "the matrix": normal.matrix,
        "the gradient": normal.gradient,
        "first innovations": first_innovations(own),
        "scores of the period": [found.own, found.given, found.even, found.other],
        "records half a period off": [*turned_records(own), left_over(own, at.innovations, 0.4 * OMEGA)],
    }


def test_parts_of_the_samples_add_up_to_all(monkeypatch):
    lengths = (500, 400)
    whole = sums(samples(lengths))
    for room in ("inputs._samples", "innovations._predictor", "innovations._covariance"):
        monkeypatch.setattr(f"floquid.{room}.BLOCK", 1)
    monkeypatch.setattr("floquid.inputs._samples.CHUNK", 37)
    monkeypatch.setattr("floquid.innovations._covariance.CHUNK", 37)
    for what, found in sums(samples(lengths)).items():
        size = np.abs(whole[what]).max(initial=1e-12)
        assert np.abs(np.asarray(found, float) - whole[what]).max(initial=0.0) < 1e-8 * size, what


@pytest.mark.first(1)
@pytest.mark.parametrize("of", [first_innovations, repetition, lambda own: normal_of(own, at_start(own))])
def test_memory_does_not_grow_with_the_parameters(of, monkeypatch):
    """Regressors of all lags would take over 100 times the data, slopes by all parameters, too, matrices 20 times."""
    for room in ("inputs._samples", "innovations._predictor", "innovations._covariance"):
        monkeypatch.setattr(f"floquid.{room}.BLOCK", 2**14)
    own = samples((10000,))
    assert peak_of(lambda: of(own), own.values.nbytes + own.inputs.nbytes) < 16.0
