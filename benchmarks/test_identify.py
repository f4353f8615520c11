"""How long the stages take. `make bench` times them; in the ordinary run each is done once, as a test."""

import numpy as np
import pytest

from floquid import identify, reconstruct
from floquid.lifting import lift
from floquid.lti import MaximumLikelihood, TimeResponses
from floquid.periodic import assemble, synchrony
from floquid.sync import segment
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor()


@pytest.fixture(scope="module")
def record():
    """The paper's experiment: four channels, 51 200 samples."""
    return ROTOR.simulate()


@pytest.fixture(scope="module")
def analysis(record):
    return identify(record, constrained=False, validate=False)


def test_simulate(benchmark):
    assert benchmark(ROTOR.simulate).n_samples == 51200


def test_segment_and_lift(benchmark, record):
    lifted = benchmark(lambda: lift(segment(record)))
    assert lifted.responses.values.shape == (200, 1, 1024)


def test_prepare(benchmark, analysis):
    assert benchmark(MaximumLikelihood().prepare, analysis.lifted.responses).factors


def test_extract(benchmark, analysis):
    identifier = MaximumLikelihood()
    state = identifier.prepare(analysis.lifted.responses)
    assert benchmark(identifier.extract, state).order == 4


def test_assemble(benchmark, analysis):
    assert benchmark(assemble, analysis.modal, analysis.lifted).order == 4


def test_synchrony(benchmark, analysis):
    assert not benchmark(synchrony, analysis.model, analysis.lifted).broken


def test_reconstruct(benchmark, analysis):
    assert benchmark(reconstruct, analysis.model, ["X", "Y"]).system.shape == (50, 4, 4)


def test_identify_the_papers_rotor(benchmark, record):
    assert benchmark(identify, record, states=["X", "Y"]).model.order == 4


@pytest.mark.parametrize("modes", [2, 10])
def test_extract_by_modes(benchmark, modes):
    """Random decays of two or ten pairs in 40 responses of 200 samples, 2 % noise."""
    generator = np.random.default_rng(0)
    logs = -0.03 + 1j * np.linspace(0.2, 2.9, modes)
    residues = generator.standard_normal((40, modes)) + 1j * generator.standard_normal((40, modes))
    values = (residues @ np.exp(np.multiply.outer(logs, np.arange(200)))).real
    sigma = 0.02 * np.abs(values).max(axis=1)
    values = values + sigma[:, None] * generator.standard_normal(values.shape)
    identifier = MaximumLikelihood()
    state = identifier.prepare(TimeResponses(values=values[:, None], dt=1.0, noise=sigma[:, None]))
    assert benchmark(identifier.extract, state).order == 2 * modes
