"""Records that none of us made: a lab rotor with eight degrees of freedom, run in a general physics engine.

The truth comes from the map that made them (finite differences of the engine's own step), and which modes must be
found at 1 % noise from the Cramér-Rao bound: see the README beside the records. A forced two-mass Duffing chain rings
down to its large periodic orbit, of which nothing is told to the chain.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from floquid import Record, identify, read
from floquid.testing import assert_exponents_close, pair_exponents

HERE = Path(__file__).resolve()
FOLDERS = [HERE.parents[1] / "data", HERE.parents[3] / "shared" / "data"]
CONFIDENT = 2e-3
"""Both parts of the exponent have a deviation below this share of ω."""

MUST_BE_FOUND = {
    "rotor_1900rpm": [0.2581, 0.2861, 0.2886, 0.3690, 0.3717, 0.4011, 0.4326, 0.4913],
    # 0.0021 by held residues alone: lifted, it lies next to its own conjugate.
    "rotor_650rpm": [0.0564, 0.0715, 0.2603, 0.3075, 0.0021],
}
EVERY_ROTOR = pytest.mark.parametrize("name", MUST_BE_FOUND)


def folder_of(name: str) -> Path:
    """Where the record is; skips where it is in neither place."""
    for folder in FOLDERS:
        if (folder / f"{name}.truth.json").exists():
            return folder
    pytest.skip(f"the record {name} is neither in tests/data nor in ../shared/data")


def truth_of(name):
    """The period, and every true exponent."""
    truth = json.loads((folder_of(name) / f"{name}.truth.json").read_text(encoding="utf-8"))
    return truth["period"], np.array([complex(*mode["exponent"]) for mode in truth["modes"]])


def hits_of(name, *, noise, seed) -> list[Record]:
    """Both hits, with noise of a share of each channel's largest free response."""
    period, _ = truth_of(name)
    generator = np.random.default_rng(seed)
    hits = []
    for hit in (1, 2):
        record = read(folder_of(name) / f"{name}_hit{hit}.npz", period=period)
        sigma = noise * np.abs(record.values).max(axis=1, keepdims=True)
        values = record.values + sigma * generator.standard_normal(record.values.shape)
        hits.append(Record(values=values, sample_rate=record.sample_rate, channels=record.channels, clock=record.clock))
    return hits


def check(name, seed):
    """Every mode that must be found is, confidently, within four deviations; no confident exponent is a false one."""
    period, truth = truth_of(name)
    fundamental = 2.0 * np.pi / period
    model = identify(hits_of(name, noise=0.01, seed=seed)).model
    std = model.exponent_std
    confident = np.maximum(std.real, std.imag) < CONFIDENT * fundamental
    assert confident.sum() <= len(truth)
    # Differences are truth less estimate; each estimate has one true exponent to itself.
    pairing = pair_exponents(truth, model.exponents[confident], period)
    off, std = pairing.differences, std[confident]
    pulls = np.maximum(np.abs(off.real) / std.real, np.abs(off.imag) / std.imag)
    position = np.round(np.abs(truth[pairing.permutation].imag) / fundamental, 4)
    for wanted in MUST_BE_FOUND[name]:
        named = np.abs(position - wanted) < 1e-9
        assert named.sum() == 2, f"{wanted} was not found with its conjugate: {position[::2]}"
        assert pulls[named].max() < 4.0, f"{wanted} is {pulls[named].max():.2f} deviations off"
    assert pulls.max() < 5.0, f"a false exponent passes for a sure one: {position[np.argmax(pulls)]}"
    return model


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rotor_1900rpm", pytest.param("rotor_650rpm", marks=pytest.mark.slow)])
def test_every_mode_that_can_be_seen_is_found_and_no_confident_one_is_false(name):
    check(name, 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 11))
@EVERY_ROTOR
def test_the_same_with_other_noise(name, seed):
    if (name, seed) == ("rotor_650rpm", 9):
        pytest.xfail("the pair next to zero comes out twice, in doubt and with deviations of a third of its decay")
    if (name, seed) == ("rotor_650rpm", 6):
        pytest.xfail("beside a weak mode on its lines the pair next to zero has a deviation of 0.42, and 0.27 is asked")
    check(name, seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rotor_1900rpm"])
def test_the_model_gives_the_record_back(name):
    """The residual is the noise that was put in, channel by channel and hit by hit."""
    hits = hits_of(name, noise=0.01, seed=0)
    analysis = identify(hits)
    clean = hits_of(name, noise=0.0, seed=0)
    for number, (noisy, quiet) in enumerate(zip(hits, clean, strict=True)):
        sigma = 0.01 * np.abs(quiet.values).max(axis=1)
        np.testing.assert_allclose(analysis.lifted.noise[:, number], sigma, rtol=0.03)
        used = analysis.cycles[number].n_cycles * analysis.cycles[number].n_phases
        ring = analysis.model.response(noisy.times[:used])[:, number]
        left = np.sqrt(np.mean((noisy.values[:, :used] - ring) ** 2, axis=1))
        np.testing.assert_allclose(left, sigma, rtol=0.03)
        # Nearer to the clean record than the noisy one is: there are far fewer coefficients than samples.
        assert (np.sqrt(np.mean((quiet.values[:, :used] - ring) ** 2, axis=1)) < 0.25 * sigma).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rotor_1900rpm"])
def test_without_noise_all_eight_modes_are_found(name):
    """Known from the map to 1e-9 of a thousand: about as good as its finite differences."""
    period, truth = truth_of(name)
    model = identify(hits_of(name, noise=0.0, seed=0)).model
    assert_exponents_close(model.exponents, truth, period, atol=1e-5)


def duffing(noise=0.002, **changes):
    """The record of the forced chain, its decay about a large orbit, with noise of a share of the decay."""
    period, truth = truth_of("duffing_orbit")
    record = read(folder_of("duffing_orbit") / "duffing_orbit.npz", period=period)
    decay = record.values - np.tile(record.orbit, record.n_samples // 64)
    level = noise * np.abs(decay).max(axis=1, keepdims=True)
    values = record.values + level * np.random.default_rng(0).standard_normal(record.values.shape)
    return replace(record, values=values, **changes), truth


def test_ringing_about_a_large_orbit():
    """The orbit, five hundred times the decay, is fitted beside the modes: odd harmonics alone, by its symmetry."""
    record, truth = duffing(orbit=None)
    analysis = identify(record, validate=False)
    assert analysis.fit.forced.harmonics[:4].tolist() == [1, 3, 5, 7]
    # The response is not quite linear: half a percent of it, which leaves the product of a mode with its conjugate as a
    # weak real exponent, and something in the others.
    model = analysis.model
    sure = np.maximum(model.exponent_std.real, model.exponent_std.imag) < CONFIDENT * model.fundamental
    assert_exponents_close(model.exponents[sure], truth, record.clock.period, atol=5e-5)


def test_an_orbit_that_the_file_holds_is_subtracted():
    record, truth = duffing()
    analysis = identify(record, validate=False)
    assert "subtracted" in analysis.synchronisation[0]
    model = analysis.model
    upper = model.exponents[~model.real & (model.exponents.imag > 0.1)]
    assert_exponents_close([*upper, *np.conj(upper)], truth, record.clock.period, atol=5e-5)


@pytest.mark.slow
def test_without_noise_the_nonlinearity_is_named():
    record, truth = duffing(noise=0.0)
    analysis = identify(record)
    assert any("nonlinearity" in sentence for sentence in analysis.synchronisation)
    omega = 2.0 * np.pi / record.clock.period
    assert " ".join(analysis.warnings).count("most likely no mode") >= 3
    for value in truth:
        gap = analysis.model.exponents - value
        assert np.abs(gap.real + 1j * (gap.imag - omega * np.rint(gap.imag / omega))).min() < 2e-3 * omega


@pytest.mark.slow
def test_everything_at_once():
    """Out of step, half a revolution a period, a tachometer, imbalance three times the free response."""
    period, truth = truth_of("rotor_650rpm")
    record = read(folder_of("rotor_650rpm") / "rotor_650rpm_tach.npz")
    analysis = identify(record, tach="tach", periods_per_revolution=2)
    model = analysis.model
    assert model.period == pytest.approx(period, rel=1e-6)
    assert analysis.fit.forced.harmonics.tolist() == [1, 2]
    gaps = np.subtract.outer(model.exponents, truth)
    gaps = gaps.real + 1j * (gaps.imag - model.fundamental * np.rint(gaps.imag / model.fundamental))
    nearest = np.argmin(np.abs(gaps), axis=1)
    for r, k in enumerate(nearest):
        std = model.exponent_std[r]
        assert abs(gaps[r, k].real) < 4.0 * std.real
        assert abs(gaps[r, k].imag) < 4.0 * std.imag
    seen = np.abs(np.imag(truth[np.unique(nearest)])) / model.fundamental
    for share in (0.0564, 0.0715, 0.2603, 0.3075, 0.0021):
        assert np.abs(seen - share).min() < 1e-4
