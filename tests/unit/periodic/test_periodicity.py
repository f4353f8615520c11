"""Is the system periodic at all: the test, its parts, what it could have missed, and where the result goes."""

import json

import numpy as np
import pytest
from scipy.special import chdtrc, chdtri, chndtr

from floquid import Record, identify, load, save
from floquid.cli.output.printed import print_analysis
from floquid.core import ConstantPeriod, Estimates, PeriodicModel
from floquid.errors import InputError
from floquid.exports import summary
from floquid.periodic import periodicity, select_bands
from floquid.periodic.significance._wald import holm
from floquid.systems import JeffcottRotor

PERIOD = 6.0
OMEGA = 2 * np.pi / PERIOD


def random_estimates(seed=0, *, size=1.0, near=False):
    """Two pairs and a real exponent in two channels and three hits, every factor of the covariance at random."""
    generator = np.random.default_rng(seed)
    exponents = np.array([-0.02 + 1.3j * OMEGA, -0.03 + (0.503 if near else 2.4) * 1j * OMEGA, -0.05])
    modes = np.repeat([0, 1, 2], [7, 7, 4])
    harmonics = np.concatenate([np.arange(-3, 4), np.arange(-3, 4), np.arange(4)])
    n, shape, parts = 18, (18, 2, 3), 7
    still = (modes == 2) & (harmonics == 0)

    def draws(*size):
        return generator.standard_normal(size) + 1j * generator.standard_normal(size)

    spread = np.zeros((2, 2 * n, 2 * n))
    for block in spread:
        root = generator.standard_normal((2 * n, 4 * n)) / 10
        block[:] = root @ root.T
        block[n:][still] = 0.0
        block[:, n:][:, still] = 0.0
    root = generator.standard_normal((parts, parts)) * 1e-2
    root[5] = 0.0  # the real exponent's imaginary part is no parameter
    values = size * draws(*shape)
    values[harmonics == 0] *= 30.0
    slopes, scales = draws(*shape, parts), draws(*shape)
    values[still], slopes[still], scales[still] = values[still].real, slopes[still].real, scales[still].real
    return Estimates(
        exponents=exponents,
        real=np.array([False, False, True]),
        fundamental=OMEGA,
        modes=modes,
        harmonics=harmonics,
        coefficients=values,
        covariance=root @ root.T,
        slopes=slopes,
        spread=spread,
        blocks=np.array([[0, 1, 0], [1, 1, 0]]),
        scales=scales,
    )


def model_with(unselected):
    upper = unselected.exponents[:2]
    return PeriodicModel(
        exponents=[upper[0], upper[0].conj(), upper[1], upper[1].conj(), unselected.exponents[2]],
        coefficients=np.ones((5, 2, 3, 1)),
        harmonics=[0],
        period=PERIOD,
        channels=["a", "b"],
        coefficient_std=np.ones((5, 2, 3, 1)),
        unselected=unselected,
    )


def dense(own, terms, rows):
    """The coefficients of terms in rows as one real vector, and its covariance as one matrix."""
    n, values, moved, noise = len(own.modes), [], [], []
    for row in rows:
        both = np.concatenate([terms, terms + n])
        values.append(np.concatenate([own.coefficients[terms, *row].real, own.coefficients[terms, *row].imag]))
        moved.append(np.concatenate([own.slopes[terms, *row].real, own.slopes[terms, *row].imag]))
        noise.append(own.noise_covariance(*row)[np.ix_(both, both)])
    whole = np.concatenate(moved)
    covariance = whole @ own.covariance @ whole.T
    for k, block in enumerate(noise):
        place = slice(k * len(block), (k + 1) * len(block))
        covariance[place, place] += block
    return np.concatenate(values), covariance


def test_the_statistic_is_that_of_the_dense_joint_covariance():
    own = random_estimates()
    found = periodicity(model_with(own))
    rows = list(np.ndindex(2, 3))
    tested = np.flatnonzero(np.isin(np.abs(own.harmonics), (1, 2)))
    for terms, which, part in [
        (tested, rows, (found.statistic, found.degrees)),
        (tested[np.abs(own.harmonics[tested]) == 2], rows, (found.by_harmonic.statistics[1], 60)),
        (tested[own.modes[tested] == 2], rows, (found.by_mode.statistics[2], 24)),
        (tested, rows[3:], (found.by_channel.statistics[1], 60)),
    ]:
        values, covariance = dense(own, terms, which)
        assert part == (pytest.approx(values @ np.linalg.solve(covariance, values), rel=1e-9), len(values))
    assert found.p_value == pytest.approx(chdtrc(120, found.statistic), rel=1e-12)


def test_what_does_not_turn_has_one_degree_of_freedom():
    """A real multiplier at a whole fundamental: its harmonic -1 stands still, and 0 turns once a period."""
    own = random_estimates()
    lam = own.exponents.copy()
    lam[2] += 1j * OMEGA
    fields = {name: getattr(own, name) for name in Estimates.__dataclass_fields__}
    harmonics = own.harmonics - (own.modes == 2)
    turned = Estimates(**(fields | {"exponents": lam, "harmonics": harmonics}))
    found = periodicity(model_with(turned), harmonics=[1])
    assert found.by_mode.degrees.tolist() == [24, 24, 6 + 12]


def test_a_limit_is_seen_with_its_power_whatever_the_shape():
    own = random_estimates()
    found = periodicity(model_with(own), level=0.01, power=0.9)
    generator, rows = np.random.default_rng(1), list(np.ndindex(2, 3))
    tested = np.flatnonzero(np.isin(np.abs(own.harmonics), (1, 2)))
    _, covariance = dense(own, tested, rows)
    unit = np.abs(own.scales)
    for mode, order in np.ndindex(2, 2):
        zeroth = own.term(mode, 0)
        reference = np.sqrt(np.sum(np.abs(own.coefficients[zeroth] / unit[zeroth]) ** 2))
        mask = (own.modes[tested] == mode) & (np.abs(own.harmonics[tested]) == order + 1)
        shift = np.zeros((50, len(rows), 2, len(tested)))
        for k, row in enumerate(rows):
            shift[:, k, :, mask] = unit[zeroth][row] * generator.standard_normal((int(mask.sum()), 50, 2))
        size = np.sqrt(
            sum(np.sum(shift[:, k] ** 2, axis=(1, 2)) / unit[zeroth][row] ** 2 for k, row in enumerate(rows))
        )
        shift = (shift / size[:, None, None, None] * found.limits[mode, order] * reference).reshape(50, -1)
        strength = np.einsum("qi,ij,qj->q", shift, np.linalg.inv(covariance), shift)
        power = 1.0 - chndtr(chdtri(found.degrees, 0.01), found.degrees, strength)
        assert power.min() >= 0.9


def test_a_limit_is_exact_where_all_shapes_are_seen_alike():
    """Unit noise on every part and exponents known: a size s is seen as well as its square over the variance says."""
    own = random_estimates()
    fields = {name: getattr(own, name) for name in Estimates.__dataclass_fields__}
    plain = {"spread": np.broadcast_to(0.04 * np.eye(36), (2, 36, 36)), "covariance": np.zeros((7, 7))}
    even = Estimates(**(fields | plain | {"scales": np.ones(own.scales.shape)}))
    found = periodicity(model_with(even))
    for mode in (0, 1):
        shift = found.limits[mode] * np.sqrt(np.sum(np.abs(own.coefficients[own.term(mode, 0)]) ** 2))
        power = 1.0 - chndtr(chdtri(found.degrees, 0.05), found.degrees, shift**2 / 0.04)
        assert power == pytest.approx(0.95, abs=1e-6)


def test_probabilities_are_corrected_by_holm():
    assert holm(np.array([0.01, 0.04, 0.03, 0.005])) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm(np.array([0.6, 0.7])).tolist() == [1.0, 1.0]


def test_a_harmonic_on_a_mode_or_beyond_the_sampling_is_named_and_not_tested():
    own = random_estimates(near=True)
    fewer = own.picked(terms=~((own.modes == 0) & (own.harmonics == 2)))
    found = periodicity(model_with(fewer))
    assert found.untested.tolist() == [[0, 2], [1, -1]]
    assert "m = 2 of mode 1, -1 of mode 2." in found.sentences[-1]
    assert np.isfinite(found.limits).all()
    assert found.degrees == 96


def test_nothing_left_to_test_is_no_error():
    own = random_estimates()
    found = periodicity(model_with(own.picked(terms=own.harmonics == 0)))
    assert (found.degrees, found.p_value, found.periodic) == (0, 1.0, False)
    assert "was not tested" in found.sentences[0]
    assert np.isnan(found.limits).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"harmonics": (0, 1)}, r"`harmonics` of `periodicity` must be different whole numbers from 1 on"),
        ({"harmonics": (1, 1)}, r"`harmonics` of `periodicity` must be different"),
        ({"harmonics": ()}, r"`harmonics` of `periodicity`"),
        ({"level": 1.0}, r"`level` of `periodicity` must lie between 0 and 1"),
        ({"power": 0.0}, r"`power` of `periodicity` must lie between 0 and 1"),
    ],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        periodicity(model_with(random_estimates()), **options)


def test_a_model_without_unselected_estimates_is_refused_with_what_to_do():
    model = PeriodicModel(exponents=[-1.0], coefficients=[[[[1.0]]]], harmonics=[0], period=1.0, channels=["a"])
    with pytest.raises(InputError, match=r"(?s)`unselected`.*constrained=True"):
        periodicity(model)


@pytest.fixture(scope="module")
def rotor():
    return identify(JeffcottRotor().simulate(n_periods=200, seed=61), validate=False)


def test_the_papers_rotor_is_periodic_and_a_round_shaft_is_not(rotor):
    assert rotor.periodicity.periodic is True
    assert rotor.periodicity.p_value < 1e-300
    assert "p < 1e-300, strongest at 1 per period" in rotor.periodicity.sentences[0]
    # 0.0245 of 0.389 in Y, more in the turntable
    assert rotor.periodicity.sizes[:, 0] == pytest.approx([0.088, 0.093], abs=0.01)
    round_shaft = identify(JeffcottRotor(rotor_y=1.0).simulate(n_periods=200, seed=61), validate=False).periodicity
    assert round_shaft.periodic is False
    assert round_shaft.p_value > 0.01
    assert round_shaft.limits.max() < 0.01
    assert "Nothing periodic is seen" in round_shaft.sentences[0]
    assert "95 times in 100" in round_shaft.sentences[0]


def constant(turns, decays, sizes, *, noise, seed, cycles=100, phases=16):
    """Modes of a constant system at these turns a period, in two channels."""
    generator = np.random.default_rng(seed)
    exponents = -np.asarray(decays) + 1j * OMEGA * np.asarray(turns)
    shapes = (generator.standard_normal((2, len(turns))) + 1j * generator.standard_normal((2, len(turns)))) * sizes
    t = np.arange(phases * cycles) * PERIOD / phases
    values = (shapes @ np.exp(np.multiply.outer(exponents, t))).real
    values += noise * np.abs(values).max(axis=1, keepdims=True) * generator.standard_normal(values.shape)
    channels, clock = ["a", "b"], ConstantPeriod(period=PERIOD)
    return Record(values=values, sample_rate=phases / PERIOD, channels=channels, clock=clock)


def test_constant_modes_that_were_merged_are_not_called_periodic():
    """The first folds next to the second, an eightieth of the fundamental away, and is taken for its harmonic."""
    record = constant([1.78, 3.768], [0.02, 0.025], [0.3, 1.0], noise=0.05, seed=3)
    analysis = identify(record, order=2, harmonics=2, trust_period=True, validate=False)
    found = analysis.periodicity
    assert analysis.model.order == 2
    assert found.p_value < 1e-6
    assert found.periodic is None
    assert found.spacing_p < 0.01
    assert "is undecided" in found.sentences[0]
    # It is the look at where harmonics are that makes the difference.
    assert periodicity(analysis.model).periodic is True


def test_harmonics_of_a_periodic_system_are_where_they_are(rotor):
    assert rotor.periodicity.spacing_p > 0.01


def test_the_result_goes_to_the_summary_the_file_and_the_terminal(rotor, tmp_path, capsys):
    save(rotor, tmp_path / "result.h5")
    again = load(tmp_path / "result.h5").periodicity
    assert again.sentences == rotor.periodicity.sentences
    assert np.array_equal(again.limits, rotor.periodicity.limits)
    content = json.loads(json.dumps(summary(rotor), allow_nan=False))["periodicity"]
    assert content["periodic"] is True
    assert content["limits"] == rotor.periodicity.limits.tolist()
    assert content["by_channel"]["degrees"] == [16, 16, 16, 16]
    print_analysis(rotor, verbose=True)
    assert "The response is periodic: p < 1e-300" in capsys.readouterr().out


@pytest.mark.parametrize("n_modes", [1, 8])
def test_noise_passes_for_a_harmonic_anywhere_as_often_as_promised(n_modes):
    """1000 draws of noise at 20 %: at a level of 20 % for each harmonic, 83 and 100 % of them would have one."""
    generator, harmonics, false = np.random.default_rng(5), np.arange(-6, 7), 0
    seeds, std = np.zeros((n_modes, 2), np.int64), np.full((n_modes, 2, 1, 13), 1.0 + 1.0j)
    for _ in range(1000):
        noise = generator.standard_normal(std.shape) + 1j * generator.standard_normal(std.shape)
        false += bool(select_bands(noise, std, harmonics, seeds, false_alarm=0.2).sum() > n_modes)
    assert 160 < false < 240  # three deviations


def test_conjugates_that_are_listed_too_count_once():
    """One of two degrees of freedom at 2.9: noise has that once in 67, between what 8 and 16 tests allow."""
    coefficients = np.zeros((2, 1, 1, 3), complex)
    coefficients[0, ..., 2] = coefficients[1, ..., 0] = 3.3
    std, seeds = np.full(coefficients.shape, 1.0 + 1.0j), np.zeros((2, 2), np.int64)
    for n_modes, kept in ((1, 2), (None, 1)):
        found = select_bands(coefficients, std, np.arange(-1, 2), seeds, false_alarm=0.05, n_modes=n_modes)
        assert found.sum(axis=1).tolist() == [kept, kept]


@pytest.mark.slow
def test_where_harmonics_are_is_as_likely_as_it_is_said_to_be():
    """Of a periodic system all probabilities are alike: the mean of ten has a deviation of 0.09."""
    records = [
        JeffcottRotor().simulate(n_periods=80, samples_per_period=12, noise=0.02, seed=seed) for seed in range(10)
    ]
    told = [identify(record, validate=False).periodicity.spacing_p for record in records]
    assert 0.2 < np.mean(told) < 0.8
