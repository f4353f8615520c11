"""Sidebands and their joint covariance against draws, amounts against what was put in, templates."""

from dataclasses import replace

import numpy as np
import pytest

from floquid import floquet, identify
from floquid.errors import InputError
from floquid.shapes import Sidebands, sidebands_of
from floquid.systems import JeffcottRotor


def rotor(crack):
    return JeffcottRotor(rotor_x=1.0, rotor_y=1.0 - crack)


def known(crack):
    own = rotor(crack)
    matrix, outputs = (
        floquet.FunctionMatrix(function=function, period=own.period, vectorised=True)
        for function in (own.system, own.outputs)
    )
    return floquet.modes(matrix, outputs=outputs, channels=[channel.name for channel in own.channels])


@pytest.fixture(scope="module")
def model():
    hits = [
        rotor(0.05).simulate(n_periods=40, samples_per_period=12, noise=0.01, seed=seed, impulse_deg=angle)
        for seed, angle in ((0, 30.0), (1, 80.0))
    ]
    return identify(hits, order=4, validate=False).model


def made(values, covariance):
    """Sidebands of one mode in one channel, and of another, with given values (2, 1, 2) and their covariance."""
    return Sidebands(
        modes=np.array([0, 2]), shapes=np.ones((2, 1), complex), values=values, covariance=covariance,
        shares=np.array([0.75, 0.25]), noise=np.ones(1), channels=("a",),
    )  # fmt: skip


def errors(seed, scale=0.01):
    parts = np.random.default_rng(seed).standard_normal((8, 8))
    return scale**2 * (parts @ parts.T / 8.0 + 0.2 * np.eye(8))


@pytest.mark.slow
def test_the_covariance_is_that_of_draws(model):
    """Exponents and coefficients are drawn from the estimates, and the sidebands of each draw are read anew."""
    found, whole = sidebands_of(model), model.unselected
    generator, drawn = np.random.default_rng(0), []
    root = np.linalg.cholesky(whole.covariance + 1e-14 * np.eye(len(whole.covariance)) * np.trace(whole.covariance))
    for _ in range(1500):
        moved = whole.moved(1e-2 * root @ generator.standard_normal(len(root)))
        lines = moved.coefficients.copy()
        for channel, hit in np.ndindex(*whole.blocks.shape):
            if whole.shared and hit:
                continue
            spread = whole.spread[whole.blocks[channel, hit]]
            values, vectors = np.linalg.eigh(spread)
            e = 1e-2 * (vectors * np.sqrt(np.maximum(values, 0.0))) @ generator.standard_normal(len(spread))
            e = e[: len(e) // 2] + 1j * e[len(e) // 2 :]
            rows = slice(None) if whole.shared else slice(hit, hit + 1)
            lines[:, channel, rows] += whole.scales[:, channel, rows] * e[:, None]
        drawn.append(sidebands_of(replace(model, unselected=replace(whole, coefficients=lines))).vector)
    seen = np.cov(np.array(drawn).T) / 1e-4
    scale = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(seen / np.outer(scale, scale), found.covariance / np.outer(scale, scale), atol=0.15)


def test_the_size_of_hits_does_not_matter(model):
    found = sidebands_of(model)
    whole = model.unselected
    by = np.array([3.0 - 1.0j, 0.5])
    scaled = replace(
        whole, coefficients=whole.coefficients * by, slopes=whole.slopes * by[:, None], scales=whole.scales * by
    )
    again = sidebands_of(replace(model, unselected=scaled))
    turn = again.on(found, np.arange(len(found.modes)))
    np.testing.assert_allclose(turn.values, found.values, atol=2e-3 * np.abs(found.values).max())


def test_a_known_system_is_exact():
    healthy, cracked = sidebands_of(known(0.0)), sidebands_of(known(0.02))
    assert not healthy.covariance.any()
    assert np.abs(healthy.values).max() < 1e-9
    own = cracked.on(healthy, np.array([0, 1]))
    assert 0.001 < np.sqrt(own.weights @ own.vector**2) < 0.01


def test_estimates_are_near_the_system(model):
    found, true = sidebands_of(model), sidebands_of(known(0.05))
    here = true.on(found, np.array([np.argmin(np.linalg.norm(true.shapes - u, axis=1)) for u in found.shapes]))
    off = found.vector - here.vector
    assert off @ np.linalg.solve(found.covariance, off) < 60.0  # of 32 degrees of freedom: once in 500


@pytest.mark.slow
def test_an_amount_has_no_bias_and_its_interval_holds_it():
    for size in (0.0, 0.01, 0.05):
        held, energies = 0, []
        truth = size * np.array([1.0, 0.0, -1.0, 1j]).reshape(2, 1, 2)
        covariance = errors(1)
        root, generator = np.linalg.cholesky(covariance), np.random.default_rng(2)
        for _ in range(70):
            noise = root @ generator.standard_normal(8)
            own = made(truth + (noise[:4] + 1j * noise[4:]).reshape(2, 1, 2), covariance)
            found = own.amount()
            true = float(np.sqrt(own.weights @ made(truth, covariance).vector ** 2))
            held += found.interval[0] <= true <= found.interval[1]
            energies.append(found.energy - true**2)
        assert abs(np.mean(energies)) < 4.0 * np.std(energies) / np.sqrt(70)
        assert held >= 63
        assert found.energy_std == pytest.approx(np.std(energies), rel=0.5)


def test_the_mode_and_line_with_most_are_named():
    values = np.array([0.001, 0.0, 0.0, 0.3]).reshape(2, 1, 2).astype(complex)
    found = made(values, errors(0)).amount()
    assert (found.mode, found.harmonic) == (2, 1)
    assert found.p_value < 1e-6
    assert made(0.0 * values, errors(0)).amount().p_value == 1.0


def test_along_a_template_by_the_joint_covariance():
    covariance, template = errors(3), np.array([1.0, 0.5j, -1.0, 0.2]).reshape(2, 1, 2)
    root, generator, seen = np.linalg.cholesky(covariance), np.random.default_rng(0), []
    for _ in range(400):
        noise = root @ generator.standard_normal(8)
        own = made(0.02 * template + (noise[:4] + 1j * noise[4:]).reshape(2, 1, 2), covariance)
        delta, std = own.along(template)
        seen.append((delta - 0.02) / std)
    assert np.std(seen) == pytest.approx(1.0, abs=0.12)
    assert abs(np.mean(seen)) < 0.2


def test_a_measured_template_does_not_make_the_amount_small():
    covariance, template = errors(3), 0.05 * np.array([1.0, 0.5j, -1.0, 0.2]).reshape(2, 1, 2)
    root, generator, seen = np.linalg.cholesky(covariance), np.random.default_rng(0), []
    for _ in range(400):
        noise = root @ generator.standard_normal((8, 2))
        measured, again = ((own[:4] + 1j * own[4:]).reshape(2, 1, 2) for own in noise.T)
        seen.append(made(template + again, covariance).along(template + measured, spread=covariance)[0])
    assert np.mean(seen) == pytest.approx(1.0, abs=0.05)
    assert np.isnan(made(template, covariance).along(0.01 * template, spread=covariance)[0])
    with pytest.raises(InputError, match=r"template.*have the shape \(2, 1, 2\)"):
        made(template, covariance).along(template[:1])


def test_without_estimates_there_are_none(model):
    assert sidebands_of(replace(model, unselected=None)) is None
