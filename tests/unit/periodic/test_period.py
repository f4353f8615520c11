"""The period from the response alone: told, not told, and why."""

from functools import cache

import numpy as np
import pytest

from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.errors import IdentificationError, InputError
from floquid.periodic import estimate_period
from floquid.systems import JeffcottRotor


def record_of(lines, *, width=0, damping=None, cycles=100, phases=24, noise=0.01, seed=0, empty=()):
    """Modes of period 1 s with random shapes; harmonics in `empty` are not there."""
    generator, upper = np.random.default_rng(seed), np.asarray(lines, complex)
    if damping is not None:
        upper = -damping + 1j * upper.imag
    size = (len(upper), 3, 1, 2 * width + 1)
    shapes = generator.standard_normal(size) + 1j * generator.standard_normal(size)
    harmonics = np.arange(-width, width + 1)
    shapes = shapes * 0.5 ** np.abs(harmonics) * ~np.isin(harmonics, empty)
    model = PeriodicModel(
        exponents=np.concatenate([upper, upper.conj()]),
        coefficients=np.concatenate([shapes, shapes[..., ::-1].conj()]),
        harmonics=harmonics,
        period=1.0,
        channels=["a", "b", "c"],
    )
    values = model.response(np.arange(cycles * phases) / phases)[:, 0]
    values = values + noise * np.abs(values).max(axis=1, keepdims=True) * generator.standard_normal(values.shape)
    return Record(values=values, sample_rate=float(phases), channels=model.channels)


def added(record, values):
    return Record(values=record.values + values, sample_rate=record.sample_rate, channels=record.channels)


THREE = [-0.02 + 1.1j, -0.03 + 2.4j, -0.015 + 7.9j]


@cache
def of_three():
    """Three modes with harmonics to one, and what is found in them alone: several tests look at that."""
    record = record_of(THREE, width=1)
    return record, estimate_period([record])


class TestTold:
    @pytest.mark.slow
    def test_three_modes_with_harmonics_to_two(self):
        found = estimate_period([record_of(THREE, width=2)])
        assert found.told
        assert abs(found.period - 1.0) < 5.0 * found.period_std
        assert found.period_std < 1e-4
        assert found.model.order == 6
        assert found.model.period == found.period

    @pytest.mark.slow
    @pytest.mark.parametrize("unit", [1e-3, 1e3])
    def test_the_unit_of_time_does_not_matter(self, unit):
        record, one = of_three()
        other = Record(values=record.values, sample_rate=record.sample_rate / unit, channels=record.channels)
        scaled = estimate_period([other])
        assert (scaled.told, [own.code for own in scaled.findings]) == (one.told, [own.code for own in one.findings])
        assert scaled.told
        assert scaled.period == pytest.approx(unit * one.period, rel=1e-9)

    @pytest.mark.slow
    def test_the_declared_period_is_not_looked_at(self):
        record, one = of_three()
        found = estimate_period([record.with_clock(ConstantPeriod(period=0.8))])
        assert found.told
        assert abs(found.period - 1.0) < 5.0 * found.period_std
        assert found.period == one.period

    @pytest.mark.slow
    def test_the_half_revolution_of_a_shaft_with_two_equal_halves(self):
        # Counted by a revolution of 2 s, only even harmonics are there: the largest fundamental is the one.
        twofold = record_of(THREE, width=2)
        found = estimate_period([twofold], longest=3.0)
        assert found.period == pytest.approx(1.0, abs=1e-3)
        assert found.candidates[1].period == pytest.approx(2.0, abs=1e-3)
        assert found.candidates[0].evidence > found.candidates[1].evidence

    @pytest.mark.slow
    def test_every_second_harmonic_missing_doubles_the_fundamental(self):
        found = estimate_period([record_of(THREE, width=2, empty=(-1, 1))])
        assert found.told
        assert found.period == pytest.approx(0.5, abs=1e-3)

    def test_a_spacing_seen_only_as_two_and_three_is_one(self):
        # Lines at -2, 0 and 1 of one mode: no line says ω but their difference to 0 and 1 together.
        found = estimate_period([record_of([-0.02 + 14.0j, -0.03 + 17.1j], width=3, empty=(-3, -1, 1, 2))])
        assert found.told
        assert found.period == pytest.approx(1.0, abs=1e-3)

    @pytest.mark.slow
    def test_several_hits_add(self):
        one, alone = of_three()
        both = estimate_period([one, record_of(THREE, width=1, seed=2)])
        assert both.told
        assert abs(both.period - 1.0) < 5.0 * both.period_std
        assert both.period_std < alone.period_std
        assert both.model.n_hits == 2

    def test_the_interval(self):
        _, found = of_three()
        low, high = found.interval()
        assert (high - low) / found.period_std == pytest.approx(2 * 1.959964, rel=1e-6)
        assert found.interval(0.5)[1] - found.interval(0.5)[0] < high - low
        with pytest.raises(InputError, match="`level`"):
            found.interval(1.0)

    @pytest.mark.slow
    def test_bounds_leave_out_what_is_outside(self):
        found = estimate_period([record_of(THREE, width=2)], shortest=1.5, longest=2.5)
        assert found.period == pytest.approx(2.0, abs=1e-3)


class TestForced:
    @pytest.mark.slow
    def test_tones_are_told_apart_and_do_no_harm(self):
        record = record_of(THREE, width=1)
        tones = 4.0 + 5.0 * np.cos(np.pi * record.times + 0.3) + np.cos(2 * np.pi * record.times)
        found = estimate_period([added(record, tones)])
        assert found.told
        assert abs(found.period - 1.0) < 5.0 * found.period_std
        assert np.sort(found.undamped.imag) == pytest.approx([np.pi, 2 * np.pi], abs=1e-3)
        assert found.candidates[0].tones == 2
        assert found.model.order == 6
        assert "steady response" in found.reasons[0]

    def test_a_tone_decides_where_one_spacing_does_not(self):
        record = record_of([-0.02 + 2.5j], width=1, empty=(-1,))
        assert not estimate_period([record]).told
        helped = estimate_period([added(record, np.cos(np.pi * record.times))])
        assert helped.told
        assert abs(helped.period - 1.0) < 5.0 * helped.period_std

    def test_tones_alone_tell_no_period(self):
        generator = np.random.default_rng(0)
        times = np.arange(4000) / 24.0
        values = np.cos(2 * np.pi * times) + 0.1 * generator.standard_normal((2, len(times)))
        found = estimate_period([Record(values=values, sample_rate=24.0, channels=["a", "b"])])
        assert not found.told
        assert len(found.undamped) == 1
        assert "no line that decays" in found.reasons[-1]


class TestNotTold:
    def check(self, found, words):
        assert not found.told
        assert found.period is None
        assert found.period_std is None
        assert found.model is None
        assert words in found.reasons[-1]
        with pytest.raises(IdentificationError, match="does not tell the period"):
            found.interval()

    def test_noise(self):
        noise = np.random.default_rng(0).standard_normal((2, 4000))
        found = estimate_period([Record(values=noise, sample_rate=1.0, channels=["a", "b"])])
        self.check(found, "no line that decays")

    def test_a_constant_system(self):
        self.check(estimate_period([record_of(THREE)]), "no two lines have the same decay")

    def test_a_constant_rotor_whose_modes_have_one_damping(self):
        rotor = JeffcottRotor(rotor_y=1.0).simulate(n_periods=300)
        self.check(estimate_period([rotor]), "only one spacing")

    @pytest.mark.first(1)
    @pytest.mark.parametrize("seed", range(5))
    def test_a_constant_system_of_five_modes_of_one_damping(self, seed):
        turns = np.sort(np.random.default_rng(seed).uniform(0.5, 30.0, 5))
        found = estimate_period([record_of(1j * turns, damping=0.02, seed=seed)])
        self.check(found, "No period found")

    def test_one_mode_with_one_spacing(self):
        self.check(estimate_period([record_of([-0.02 + 2.5j], width=1, empty=(-1,))]), "only one spacing")

    def test_two_fundamentals_that_explain_the_lines_alike(self):
        # λ, λ + iω and those moved by the distance of the modes: a parallelogram, whose other side would do as well.
        record = record_of([-0.02 + 10.0j, -0.02 + 15.3j], width=1, empty=(-1,))
        self.check(estimate_period([record]), "explain the lines as well")


@pytest.mark.parametrize(
    ("bounds", "argument"), [({"longest": -1.0}, "longest"), ({"shortest": 5.0, "longest": 4.0}, "longest")]
)
def test_impossible_bounds(bounds, argument):
    with pytest.raises(InputError, match=f"Argument `{argument}` of `estimate_period`"):
        estimate_period([record_of(THREE)], **bounds)
    with pytest.raises(InputError, match="Argument `records` of `estimate_period`"):
        estimate_period([])


@pytest.mark.slow
def test_paper_record_over_twenty_seeds_of_a_shorter_record():
    scores = []
    for seed in range(20):
        found = estimate_period([JeffcottRotor().simulate(n_periods=200, seed=seed)])
        assert found.told, found.reasons
        scores.append((found.period - 2 * np.pi) / found.period_std)
    assert np.abs(scores).max() < 5.0
    # 20 times the mean square is a chi-square of 20 degrees: 5.9 to 45 with probability 0.998.
    assert 5.9 < np.sum(np.square(scores)) < 45.3
