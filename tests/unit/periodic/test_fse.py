"""The Fourier series expansion as an identification: lines, families, averages and what belongs to none."""

import numpy as np
import pytest

from floquid.core import PeriodicModel, Record
from floquid.errors import IdentificationError, InputError
from floquid.lti import ERA, MaximumLikelihood
from floquid.periodic import fse
from floquid.systems import JeffcottRotor


def system(exponents, *, width=2, hits=1, channels=3, seed=0, fade=0.5):
    """A model of period 0.02 s with random shapes; `exponents` are those over a period."""
    generator, upper = np.random.default_rng(seed), np.asarray(exponents) / 0.02
    size = (len(upper), channels, hits, 2 * width + 1)
    shapes = generator.standard_normal(size) + 1j * generator.standard_normal(size)
    shapes *= fade ** np.abs(np.arange(-width, width + 1))
    return PeriodicModel(
        exponents=np.concatenate([upper, upper.conj()]),
        coefficients=np.concatenate([shapes, shapes[..., ::-1].conj()]),
        harmonics=np.arange(-width, width + 1),
        period=0.02,
        channels=[f"c{k}" for k in range(channels)],
    )


def records_of(model, *, cycles=100, phases=24, noise=0.01, seed=0):
    generator = np.random.default_rng([seed, 1])
    times = model.period / phases * np.arange(cycles * phases)
    values = model.response(times)
    values = values + noise * np.abs(values).max(axis=2, keepdims=True) * generator.standard_normal(values.shape)
    return [
        Record(values=values[:, hit], sample_rate=phases / model.period, channels=model.channels)
        for hit in range(model.n_hits)
    ]


def pulls(found, truth):
    """Errors over deviations of the upper modes, compared modulo the fundamental (modes, 2)."""
    out = []
    for value, std in zip(found.exponents, found.exponent_std, strict=True):
        off = value - truth
        off = off - 1j * found.fundamental * np.rint(off.imag / found.fundamental)
        off = off[np.argmin(np.abs(off))]
        if value.imag > 0:
            out.append((off.real / std.real, off.imag / std.imag))
    return np.array(out)


@pytest.fixture(scope="module")
def rotor():
    return JeffcottRotor().simulate(n_periods=400, noise=0.02, seed=4)


class TestRotor:
    def test_exponents_within_five_deviations(self, rotor):
        found = fse([rotor], period=2 * np.pi)
        assert found.model.order == 4
        assert np.abs(pulls(found.model, JeffcottRotor().exponents())).max() < 5.0
        assert [sorted(family.harmonics.tolist()) for family in found.families] == [[-1, 0, 1]] * 2
        assert not len(found.alone)
        assert not len(found.undamped)

    def test_the_average_is_better_than_each_line(self, rotor):
        for family in fse([rotor], period=2 * np.pi).families:
            assert family.exponent_std.real < family.line_std.real.min()
            assert family.exponent_std.imag < family.line_std.imag.min()

    @pytest.mark.slow
    def test_the_families_agree_with_the_spacing(self, rotor):
        right = fse([rotor], period=2 * np.pi)
        assert right.degrees == 8
        assert right.misfit < 30.0
        # With a period that is not the system's the lines are no families.
        wrong = fse([rotor], period=2 * np.pi * 1.01)
        assert max(len(family.lines) for family in wrong.families) < 3

    def test_another_routine_gives_the_same_families(self, rotor):
        own, other = fse([rotor], period=2 * np.pi), fse([rotor], period=2 * np.pi, identifier=ERA(), order=12)
        assert other.model.order == own.model.order
        off = np.abs(other.model.exponents - own.model.exponents)
        assert off.max() < 0.1 * np.abs(own.model.exponent_std).min()


def test_a_routine_with_its_own_covariance():
    truth = system([-0.02 + 1.7j, -0.03 + 0.9j], width=1, seed=6)
    found = fse(records_of(truth, seed=6), period=truth.period, identifier=MaximumLikelihood())
    assert found.model.order == 4
    assert sorted(len(family.lines) for family in found.families) == [3, 3]
    assert np.abs(pulls(found.model, truth.exponents)).max() < 5.0


class TestDeviations:
    @pytest.mark.slow
    def test_errors_are_those_the_deviations_say(self):
        scores = []
        for seed in range(12):
            generator = np.random.default_rng(seed + 100)
            upper = -generator.uniform(0.01, 0.05, 2) + 1j * np.sort(generator.uniform(0.3, 8.0, 2))
            truth = system(upper, seed=seed)
            found = fse(records_of(truth, seed=seed), period=truth.period)
            assert found.model.order == 4
            scores.append(pulls(found.model, truth.exponents))
        scores = np.concatenate(scores)
        assert np.abs(scores).max() < 5.0
        assert 0.8 < np.sqrt(np.mean(scores**2)) < 1.25

    def test_coefficients_within_their_deviations(self):
        truth = system([-0.02 + 1.1j, -0.03 + 2.4j], width=1, seed=3)
        found = fse(records_of(truth, seed=3), period=truth.period).model
        squares = []
        for value, shape in zip(truth.exponents[:2], truth.coefficients[:2], strict=True):
            turns = np.rint((found.exponents - value).imag / found.fundamental).astype(int)
            mode = int(np.argmin(np.abs(found.exponents - value - 1j * turns * found.fundamental)))
            for m, true in zip(truth.harmonics, np.moveaxis(shape, -1, 0), strict=True):
                # On a branch that is higher by so many turns a harmonic has a number that is lower.
                place = found.harmonics.tolist().index(m - turns[mode])
                off, std = (part[mode, ..., place] for part in (found.coefficients, found.coefficient_std))
                squares += [((off - true).real / std.real) ** 2, ((off - true).imag / std.imag) ** 2]
        # 36 numbers: the mean square lies between 0.4 and 1.9 with probability 0.999.
        assert np.size(squares) == 36
        assert 0.4 < np.mean(squares) < 1.9


class TestKinds:
    def test_a_real_negative_multiplier_is_one_mode_of_its_own(self):
        truth = system([-0.02 + 1j * np.pi, -0.03 + 1.0j], seed=6)
        found = fse(records_of(truth, seed=6), period=truth.period).model
        assert found.order == 3
        half = found.exponents[np.argmin(np.abs(np.abs(found.exponents.imag) - 0.5 * found.fundamental))]
        assert half.imag == pytest.approx(0.5 * found.fundamental, rel=1e-12)

    def test_several_hits(self):
        truth = system([-0.02 + 1.7j, -0.03 + 0.9j], hits=2, seed=6)
        found = fse(records_of(truth, seed=6), period=truth.period).model
        assert found.n_hits == 2
        assert np.abs(pulls(found, truth.exponents)).max() < 5.0

    def test_missing_samples(self):
        truth = system([-0.02 + 1.7j, -0.03 + 0.9j], seed=6)
        record = records_of(truth, seed=6)[0]
        values = record.values.copy()
        values[:, 500:560] = np.nan
        values[0, 900:910] = np.nan
        gappy = Record(values=values, sample_rate=record.sample_rate, channels=record.channels)
        found = fse([gappy], period=truth.period).model
        assert np.abs(pulls(found, truth.exponents)).max() < 5.0
        with pytest.raises(InputError, match="Argument `records` of `fse` must have all samples"):
            fse([gappy], period=truth.period, identifier=ERA(), order=16)

    def test_tones_and_offset_are_no_modes(self):
        truth = system([-0.02 + 1.7j, -0.03 + 0.9j], seed=6)
        record = records_of(truth, seed=6)[0]
        tone = 3.0 + 2.0 * np.cos(0.5 * truth.fundamental * record.times + 0.4)
        forced = Record(values=record.values + tone, sample_rate=record.sample_rate, channels=record.channels)
        found = fse([forced], period=truth.period)
        assert found.model.order == 4
        assert np.abs(found.undamped.imag) == pytest.approx([0.5 * truth.fundamental], rel=1e-4)
        assert np.abs(pulls(found.model, truth.exponents)).max() < 5.0

    def test_lines_alone_are_left_out_where_families_must_have_more(self):
        truth = system([-0.02 + 1.7j, -0.03 + 0.9j], width=1, seed=6)
        coefficients = truth.coefficients.copy()
        coefficients[[1, 3]] *= truth.harmonics == 0
        truth = PeriodicModel(
            exponents=truth.exponents,
            coefficients=coefficients,
            harmonics=truth.harmonics,
            period=truth.period,
            channels=truth.channels,
        )
        records = records_of(truth, seed=6)
        assert fse(records, period=truth.period).model.order == 4
        strict = fse(records, period=truth.period, least=2)
        assert strict.model.order == 2
        assert strict.alone == pytest.approx([truth.exponents[1]], rel=1e-2)


def test_nothing_but_noise_is_no_result():
    noise = np.random.default_rng(0).standard_normal((2, 2000))
    with pytest.raises(IdentificationError, match="no family of lines"):
        fse([Record(values=noise, sample_rate=1.0, channels=["a", "b"])], period=20.0)


@pytest.mark.parametrize("period", [-1.0, np.nan, 1.0])
def test_impossible_periods(period):
    record = Record(values=np.ones((1, 100)), sample_rate=1.0, channels=["a"])
    with pytest.raises(InputError, match="Argument `period` of `fse`"):
        fse([record], period=period)
