"""Names and leaks of the modes of identified rotors of three blades, equal and with a softer one."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.shapes.test_blades import OMEGA, modelled, rotor

import floquid as fq
from floquid.shapes import read_shapes

pytestmark = pytest.mark.slow

FIXED = ["fa", "tilt", "yaw"]
CHANNELS = ["flap1", "flap2", "flap3", *FIXED]
SEEDS, PERIODS, PHASES, NOISE = range(4), 40, 24, 0.01


def known(soft):
    """Flap of three blades on a tower that moves, tilts and yaws; no two modes of one multiplier."""
    stiffness = np.diag([2.9**2, 2.9**2 - OMEGA**2, 2.9**2 - OMEGA**2, 1.9**2, 4.6**2, 5.2**2])
    damping = np.diag([0.08, 0.08, 0.08, 0.05, 0.12, 0.12])
    damping[1, 2], damping[2, 1] = 2.0 * OMEGA, -2.0 * OMEGA
    stiffness[1, 2], stiffness[2, 1] = 0.08 * OMEGA, -0.08 * OMEGA
    for one, other, size in ((0, 3, 1.5), (1, 4, 3.0), (2, 5, 3.5)):
        stiffness[one, other] = stiffness[other, one] = size
    return modelled(rotor(stiffness, damping, groups=(0,), soft=soft * 2.9**2), CHANNELS)


def struck(model, generator):
    """A free response of the model after a blow that moves all modes, with noise."""
    states = generator.standard_normal(model.order) + 1j * generator.standard_normal(model.order)
    partner = np.abs(np.subtract.outer(model.exponents, model.exponents.conj())).argmin(axis=1)
    states = np.where(model.exponents.imag > 0.0, states, states[partner].conj())
    moved = replace(model, coefficients=model.coefficients * states[:, None, None, None])
    values = moved.response(np.arange(PERIODS * PHASES) * model.period / PHASES)[:, 0]
    values += NOISE * np.abs(values).max(axis=1, keepdims=True) * generator.standard_normal(values.shape)
    clock = fq.ConstantPeriod(period=model.period)
    channels = [fq.Channel(name=name, unit="m") for name in CHANNELS]
    return fq.Record(values=values, sample_rate=PHASES / model.period, channels=channels, clock=clock)


def apart(one, other):
    """How far two exponents are apart, neither of a conjugate pair nor a branch preferred [1/s]."""
    offs = [one - other, one - other.conjugate()]
    return min(abs(off - 1j * OMEGA * round(off.imag / OMEGA)) for off in offs)


@pytest.mark.parametrize(("soft", "named"), [(0.0, 23), (0.1, 18)])
def test_names_and_leaks_of_identified_modes(soft, named):
    """At most one of 24 names is wrong or wanting with equal blades; leaks are within two of their deviations."""
    model = known(soft)
    truth = read_shapes(model, fixed=FIXED).modes
    right, scores = 0, []
    for seed in SEEDS:
        generator = np.random.default_rng(seed)
        found = fq.identify([struck(model, generator) for _ in range(2)], validate=False)
        for one in read_shapes(found, fixed=FIXED).modes:
            own = min(truth, key=lambda own: apart(one.exponent, own.exponent))
            right += one.name == own.name and abs(one.frequency - own.frequency) < 0.02
            scores.append((one.blades.leak - own.blades.leak) / one.blades.leak_std)
    assert right >= named
    assert np.mean(np.abs(scores) < 2.0) > 0.94
