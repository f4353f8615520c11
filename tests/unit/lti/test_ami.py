"""AMI: the finite sum, the lines, the composites, the one-mode fit, and the modes it isolates, at the edges too."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import linear_sum_assignment

from floquid.lti import AMI, WHITE, MaximumLikelihood, Outcome, TimeResponses, composites
from floquid.lti._poles import NEGATIVE, ON_A_LINE, PAIR, POSITIVE, finite_sum, mode_columns, spectra
from floquid.lti.ami._fit import KNOWN, Coupled, Mode, band_lines, cut, evaluate, fit_pole, real_rows
from floquid.lti.ami._isolation import nearest_outer_product, nothing, peaks, without

IDENTIFIER = AMI()


def ringing(logs, *, outputs=8, inputs=1, samples=200, noise=0.01, seed=0, sizes=None, lengths=None):
    """Logarithms of all multipliers, and decays whose residues are outer products, of `sizes` in turn.

    Noise is a share of the largest response of each output and input; for none it is said to be 1e-11 of it.
    """
    generator = np.random.default_rng(seed)
    full, residues = [], []
    for s, size in zip(np.asarray(logs, complex), np.ones(len(logs)) if sizes is None else sizes, strict=True):
        shape = generator.standard_normal((2, outputs))
        part = generator.uniform(0.5, 1.5, inputs) * np.exp(2j * np.pi * generator.uniform(size=inputs))
        if s.imag in (0.0, np.pi):
            full.append(s)
            residues.append(size * np.outer(shape[0], np.abs(part) * np.sign(part.real)))
        else:
            residue = size * np.outer(shape[0] + 1j * shape[1], part)
            full += [s, s.conjugate()]
            residues += [residue, residue.conj()]
    full = np.array(full)
    values = np.einsum("roi,rk->oik", np.array(residues), np.exp(np.multiply.outer(full, np.arange(samples)))).real
    std = max(noise, 1e-11) * np.abs(values).max(axis=2)
    values = values + (noise > 0) * std[..., None] * generator.standard_normal(values.shape)
    return full, TimeResponses(values=values, dt=1.0, noise=std, lengths=lengths)


def identified(data, order=None, identifier=IDENTIFIER):
    return identifier.extract(identifier.prepare(data), order)


def farthest(found, expected):
    """The largest distance of logarithms, paired so that their sum is least; turns count modulo 2π."""
    found = np.log(found)
    assert len(found) == len(expected), f"{len(found)} poles, but {len(expected)} were expected"
    distance = np.abs(np.expm1(np.subtract.outer(found, expected)))
    return distance[linear_sum_assignment(distance)].max()


def found_within_deviations(model, logs, *, most=5.0, largest=2e-3):
    """Every pole within `most` of its deviations in both parts, none of which is above `largest`."""
    assert model.order == len(logs), f"{model.order} poles, but {len(logs)} were expected"
    distance = np.abs(np.exp(logs)[:, None] - model.multipliers)
    columns = linear_sum_assignment(distance)[1]
    off = np.log(model.multipliers[columns] / np.exp(logs))
    std = np.sqrt(np.diag(model.covariance)).reshape(2, -1)[:, columns]
    assert std.max() < largest
    assert (np.abs(off.real) <= most * std[0]).all()
    assert (np.abs(off.imag) <= most * std[1] + 1e-12).all()


# The finite sum.

POLES = {
    "a decay": lambda n: -0.02 + 1.0j,
    "a fast decay": lambda n: -3.0 + 2.0j,
    "a growing one": lambda n: 0.03 + 2.5j,
    "a growing one that overflows": lambda n: 301.0 / n + 1.0j,
    "on a line": lambda n: 2j * np.pi * (n // 3) / n,
    "on the line at zero": lambda n: 0.0j,
    "on the line at π": lambda n: np.pi * 1j,
    "next to a line, inside the series": lambda n: (-0.3 + 0.4j) * ON_A_LINE / n + 2j * np.pi * (n // 3) / n,
    "next to a line, outside the series": lambda n: (-0.6 + 0.81j) * ON_A_LINE / n + 2j * np.pi * (n // 3) / n,
    "growing next to a line": lambda n: 0.9 * ON_A_LINE / n + 2j * np.pi * (n // 3) / n,
    "below the axis": lambda n: -0.01 - 0.4j,
    "a real one": lambda n: -0.05 + 0.0j,
    "a negative one": lambda n: -0.05 + np.pi * 1j,
}
LENGTHS = [1, 2, 3, 4, 9, 64, 1001]


@pytest.mark.parametrize("samples", LENGTHS)
@pytest.mark.parametrize("pole", POLES.values(), ids=POLES)
def test_the_finite_sum_is_the_transform_and_its_slope_that_of_k_times_the_samples(pole, samples):
    s, k = complex(pole(samples)), np.arange(samples)
    powers = np.exp(s * (k - (samples - 1) * (s.real > 0)))
    lines = 2.0 * np.pi * k[: samples // 2 + 1] / samples
    total, slope = finite_sum(s, lines, samples)
    for found, values in ((total, powers), (slope, k * powers)):
        expected = np.fft.fft(values)[: len(lines)]
        assert_allclose(found, expected, rtol=0.0, atol=1e-11 * max(np.abs(values).sum(), 1.0))


@pytest.mark.parametrize("samples", LENGTHS)
@pytest.mark.parametrize(
    ("kind", "angle"), [(PAIR, 0.03), (PAIR, 1.0), (PAIR, 3.1), (POSITIVE, 0.0), (NEGATIVE, np.pi)]
)
def test_the_columns_of_a_mode_are_the_weighted_lines_of_its_samples(kind, angle, samples):
    s, k = complex(-0.05, angle), np.arange(samples)
    powers = np.exp(s * k)
    parts = np.stack([powers.real, powers.imag] if kind == PAIR else [powers.real])
    for column, values in zip(range(2), (parts, k * parts), strict=True):
        (block,) = spectra(TimeResponses(values=values[:, None], dt=1.0))
        found = mode_columns(s, kind, block.angles, samples, block.weights)[column]
        assert_allclose(found, block.values[:, :, 0], rtol=0.0, atol=1e-11 * max(np.abs(values).max(), 1.0))


# The lines.


@pytest.mark.parametrize("lengths", [(40, 40), (40, 17), (16, 39), (1, 40)])
def test_the_weighted_lines_have_the_energy_of_the_samples_over_their_noise(lengths):
    generator = np.random.default_rng(0)
    data = TimeResponses(
        values=generator.standard_normal((3, 2, 40)),
        dt=1.0,
        noise=generator.uniform(0.1, 10.0, (3, 2)),
        lengths=lengths,
    )
    blocks = spectra(data)
    assert [block.samples for block in blocks] == sorted(set(lengths), reverse=True)
    assert sorted(np.concatenate([block.inputs for block in blocks])) == [0, 1]
    for block in blocks:
        samples = data.values[:, block.inputs, : block.samples] / data.noise[:, block.inputs, None]
        assert_allclose(np.sum(np.abs(block.values) ** 2, axis=0), np.sum(samples**2, axis=2), rtol=1e-12)


def test_white_noise_has_unit_variance_in_both_parts_of_every_weighted_line():
    values = 3.0 * np.random.default_rng(1).standard_normal((4000, 1, 12))
    (block,) = spectra(TimeResponses(values=values, dt=1.0, noise=np.full((4000, 1), 3.0)))
    rows = real_rows(block.values[:, :, 0])
    ends = [0, 6]
    expected = np.ones(14)
    expected[np.add(ends, 7)] = 0.0
    assert_allclose(np.mean(rows**2, axis=1), expected, atol=5.0 * np.sqrt(2.0 / 4000))


# Composites.


def slow_composites(data, model):
    """Sum by sum from the definition; an input that ends early is followed by zeros."""
    outputs, inputs, samples = data.values.shape
    k, curves = np.arange(samples), np.zeros((3, samples // 2 + 1))
    for line in range(samples // 2 + 1):
        turn = np.exp(-2j * np.pi * line * k / samples)
        for o in range(outputs):
            for i in range(inputs):
                length = data.lengths[i]
                modelled = (model.residues[:, o, i] @ model.multipliers[:, None] ** k).real
                parts = np.array([data.values[o, i], modelled, data.values[o, i] - modelled])
                sums = np.abs(parts[:, :length] @ turn[:length])
                curves[:, line] += sums / (data.noise[o, i] * np.sqrt(length))
    return curves / (outputs * inputs)


@pytest.mark.slow
@pytest.mark.parametrize("lengths", [(30, 30), (30, 21), (12, 29)])
def test_composites_are_the_mean_magnitudes_of_data_model_and_difference(lengths):
    _, data = ringing([-0.05 + 1.0j, -0.1], outputs=3, inputs=2, samples=30, lengths=lengths)
    model = identified(data)
    found = composites(data, model)
    assert_allclose(found.angles, 2.0 * np.pi * np.arange(16) / 30, rtol=1e-15)
    assert_allclose([found.data, found.model, found.difference], slow_composites(data, model), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("samples", [200, 201])
def test_the_model_carries_its_composites_and_what_is_left_is_white(samples):
    full, data = ringing([-0.02 + 1.0j, -0.03 + 2.0j], outputs=40, samples=samples)
    model = identified(data)
    own, again = model.composites, composites(data, model)
    for name in ("angles", "data", "model", "difference"):
        curve = getattr(own, name)
        assert curve.shape == (samples // 2 + 1,)
        assert_array_equal(curve, getattr(again, name))
    assert own.data.max() > 100.0 * WHITE
    peak = own.angles[np.argmax(own.data)]
    assert np.abs(peak - np.abs(full.imag)).min() < 2.0 * np.pi / samples
    assert_allclose(own.model, own.data, atol=6.0 * WHITE)
    inner = own.difference[1:-1]
    assert np.abs(inner - WHITE).max() < 5.0 * np.sqrt((1.0 - np.pi / 4.0) / 40)
    assert inner.mean() == pytest.approx(WHITE, abs=0.02)


def test_of_no_mode_the_difference_is_the_data():
    data = TimeResponses(values=np.random.default_rng(0).standard_normal((20, 2, 50)), dt=1.0)
    own = identified(data).composites
    assert_array_equal(own.model, 0.0)
    assert_array_equal(own.difference, own.data)


# One mode.

KINDS = {
    "a pair": (PAIR, -0.05 + 1.0j),
    "a real one": (POSITIVE, -0.05 + 0.0j),
    "a negative one": (NEGATIVE, -0.05 + np.pi * 1j),
}
EVERY_KIND = pytest.mark.parametrize(("kind", "s"), KINDS.values(), ids=KINDS)


def plain_cost(s, kind, data, near):
    """What is left on the lines `near` when each response is fitted by least squares, from transformed samples."""
    total = 0.0
    for length in sorted(set(data.lengths), reverse=True):
        powers = np.exp(s * np.arange(length))
        parts = [powers.real, powers.imag] if kind == PAIR else [powers.real]
        weights = np.where(np.isin(np.arange(length // 2 + 1), [0, length / 2]), 1.0, np.sqrt(2.0)) / np.sqrt(length)

        def lines(values, weights=weights, length=length):
            found = (np.fft.rfft(values) * weights)[near[length]]
            return np.concatenate([found.real, found.imag])

        columns = np.stack([lines(part) for part in parts], axis=1)
        for i in np.flatnonzero(data.lengths == length):
            for o in range(data.n_outputs):
                y = lines(data.values[o, i, :length] / data.noise[o, i])
                total += np.sum((y - columns @ np.linalg.lstsq(columns, y, rcond=1e-12)[0]) ** 2)
    return total


def bands_near(s, data, widths=4.0):
    blocks = spectra(data)
    near = {block.samples: band_lines(s, block, widths) for block in blocks}
    return [cut(block, block.values, near[block.samples]) for block in blocks], near


@EVERY_KIND
def test_cost_and_gradient_of_a_mode_are_those_of_plain_least_squares(kind, s):
    """Away from the best pole, by central differences of a cost that shares no code; inputs of unequal length."""
    _, data = ringing([s], inputs=2, samples=60, noise=0.05, lengths=[60, 41])
    bands, near = bands_near(s, data)
    here = s + complex(0.01, 0.013 if kind == PAIR else 0.0)
    found = evaluate(here, kind, bands)
    assert found.cost == pytest.approx(plain_cost(here, kind, data, near), rel=1e-10)
    for part, turn in zip(found.gradient, (1.0, 1j), strict=False):
        ahead, behind = (plain_cost(here + sign * 1e-5 * turn, kind, data, near) for sign in (1.0, -1.0))
        assert -2.0 * part == pytest.approx((ahead - behind) / 2e-5, rel=1e-4)


@EVERY_KIND
def test_where_the_fit_is_exact_the_information_of_a_mode_is_half_the_hessian(kind, s):
    _, data = ringing([s], inputs=2, samples=60, noise=0.0, lengths=[60, 41])
    bands, near = bands_near(s, data)
    found, turns, step = evaluate(s, kind, bands).information, (1.0, 1j)[: 2 if kind == PAIR else 1], 1e-4
    for i, one in enumerate(turns):
        for j, other in enumerate(turns):
            corners = [
                a * b * plain_cost(s + step * (a * one + b * other), kind, data, near)
                for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))
            ]
            half = sum(corners) / (8.0 * step**2)
            assert found[i, j] == pytest.approx(half, rel=1e-3, abs=1e-3 * found.max())


@EVERY_KIND
@pytest.mark.parametrize("outputs", [2, 2000])
def test_the_fit_of_one_mode_finds_its_pole(kind, s, outputs):
    """With so many responses that they are condensed, too."""
    _, data = ringing([s], outputs=outputs, samples=60, noise=0.0)
    bands, _ = bands_near(s, data)
    found, cost, _ = fit_pole(s + complex(0.02, 0.02 if kind == PAIR else 0.0), kind, bands)
    assert abs(found - s) < 1e-12
    assert cost < 1e-6 * outputs * 60


def test_the_fit_of_one_mode_says_how_it_errs():
    s, pulls = -0.05 + 1.0j, []
    for seed in range(100):
        _, data = ringing([s], samples=100, noise=0.02, seed=seed)
        found, _, deviation = fit_pole(s, PAIR, bands_near(s, data, 16.0)[0])
        pulls += [(found - s).real / deviation, (found - s).imag / deviation]
    assert np.mean(np.square(pulls)) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 200))


def test_a_pole_without_residues_may_be_anywhere():
    data = TimeResponses(values=np.zeros((3, 1, 20)), dt=1.0)
    _, cost, deviation = fit_pole(-0.1 + 1.0j, PAIR, bands_near(-0.1 + 1.0j, data)[0])
    assert (cost, deviation) == (0.0, np.pi)


def test_the_clearest_peak_is_that_of_the_mode_and_noise_has_none_far_above_its_level():
    full, data = ringing([-0.02 + 1.0j, -0.03 + 2.0j], sizes=[1.0, 0.05])
    blocks = spectra(data)
    found = peaks(nothing(blocks), blocks)
    assert abs(2.0 * np.pi * found[0].line / 200 - 1.0) < 2.0 * np.pi / 200
    assert any(abs(2.0 * np.pi * peak.line / 200 - full[2].imag) < 4.0 * np.pi / 200 for peak in found)
    noise = spectra(TimeResponses(values=np.random.default_rng(0).standard_normal((20, 1, 200)), dt=1.0))
    assert all(peak.clarity < 5.0 for peak in peaks(nothing(noise), noise))
    assert peaks(nothing(noise), noise, clear=-np.inf)


def test_a_mode_taken_away_gives_its_lines_back():
    _, data = ringing([-0.02 + 1.0j])
    blocks = spectra(data)
    mode = Mode(-0.02 + 1.0j, PAIR, (np.random.default_rng(0).standard_normal((2, 8, 1)),))
    now = nothing(blocks)
    bare = without(type(now)((mode,), (now.left[0] - mode.lines(0, blocks[0]),), 0.0), 0, blocks)
    assert bare.modes == ()
    assert bare.cost == pytest.approx(now.cost, rel=1e-12)


def test_the_nearest_outer_product():
    """Itself where it is one; with equal noise the leading singular pair; with unequal noise no neighbour is nearer."""
    generator = np.random.default_rng(0)

    def drawn(*size):
        return generator.standard_normal(size) + 1j * generator.standard_normal(size)

    left, right, matrix = drawn(7), drawn(3), drawn(7, 3)
    noise = 10.0 ** generator.uniform(-2, 2, (7, 3))
    assert_allclose(nearest_outer_product(np.outer(left, right), noise), np.outer(left, right), rtol=1e-9)
    u, s, v = np.linalg.svd(matrix)
    assert_allclose(nearest_outer_product(matrix, np.full((7, 3), 0.3)), s[0] * np.outer(u[:, 0], v[0]), atol=1e-9)
    noise = generator.uniform(0.5, 2.0, (7, 3))
    best = nearest_outer_product(matrix, noise)
    u, s, v = np.linalg.svd(best)
    assert s[1] < 1e-12 * s[0]

    def distance(shape, part):
        return np.sum(np.abs(matrix - np.outer(shape, part)) ** 2 / noise**2)

    for _ in range(20):
        moved = distance(s[0] * u[:, 0] + 1e-3 * drawn(7), v[0] + 1e-3 * drawn(3))
        assert moved > distance(s[0] * u[:, 0], v[0])


# The modes that it isolates.

SYSTEMS = {
    "a pair": [-0.02 + 1.0j],
    "three pairs": [-0.02 + 0.5j, -0.03 + 1.3j, -0.015 + 2.4j],
    "a real pole": [-0.03],
    "a negative one": [-0.03 + np.pi * 1j],
    "a pair and both real kinds": [-0.02 + 1.0j, -0.03, -0.05 + np.pi * 1j],
    "a pair beside its conjugate at zero": [-0.02 + 0.01j],
    "a pair beside its conjugate at π": [-0.02 + 3.13j],
    "pairs beside their conjugates at both ends": [-0.02 + 0.01j, -0.03 + 3.12j],
    "a growing pair": [0.01 + 2.0j, -0.03 + 0.5j],
    "a growing negative one": [0.01 + np.pi * 1j, -0.03 + 0.5j],
    "one frequency, two decays": [-0.02 + 1.0j, -0.05 + 1.0j],
    "a half-power width apart": [-0.02 + 1.0j, -0.02 + 1.04j],
}


@pytest.mark.first(4)
@pytest.mark.parametrize("logs", SYSTEMS.values(), ids=SYSTEMS)
def test_every_kind_of_mode_is_found(logs):
    full, data = ringing(logs)
    model = identified(data)
    assert model.outcome is Outcome.SUCCESS
    found_within_deviations(model, full)
    assert np.count_nonzero(model.multipliers.imag == 0.0) == np.count_nonzero(np.isin(full.imag, [0.0, np.pi]))


def test_one_output_is_enough():
    full, data = ringing(SYSTEMS["three pairs"], outputs=1)
    found_within_deviations(identified(data), full, largest=0.004)


@pytest.mark.parametrize("samples", [6, 12])
def test_few_samples(samples):
    full, data = ringing([-0.1 + 1.0j], outputs=20, samples=samples)
    found_within_deviations(identified(data), full)


def test_inputs_of_unequal_length():
    full, data = ringing([-0.02 + 1.0j, -0.03 + 2.0j], inputs=3, lengths=[200, 101, 40])
    model = identified(data)
    found_within_deviations(model, full)
    assert_allclose(model.residual_std, data.noise, rtol=0.4)


@pytest.mark.parametrize("inputs", [1, 2])
def test_two_modes_of_equal_poles_are_two_where_two_inputs_tell_their_shapes_apart(inputs):
    """With one input their sum is a mode like any other."""
    full, data = ringing([-0.02 + 1.0j, -0.02 + 1.0j], inputs=inputs)
    expected = full[: 2 * inputs]
    assert farthest(identified(data).multipliers, expected) < 1e-3
    anyhow = identified(data, identifier=AMI(rank_one=False))
    assert farthest(anyhow.multipliers, full[:2]) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("lengths", [None, [200, 90, 150]])
def test_residues_of_several_inputs_are_outer_products(lengths):
    _, data = ringing(SYSTEMS["a pair and both real kinds"], inputs=3, lengths=lengths)
    model, free = identified(data), identified(data, identifier=AMI(rank_one=False))
    values = np.linalg.svd(model.residues, compute_uv=False)
    assert model.order == free.order == 4
    assert (values[:, 1] < 1e-12 * values[:, 0]).all()
    loose = np.linalg.svd(free.residues, compute_uv=False)
    assert (loose[:, 1] > 1e-6 * loose[:, 0]).all()


@pytest.mark.parametrize("weaker", [1e-5, 1e-8, 1e-10])
def test_a_mode_far_below_another(weaker):
    full, data = ringing([-0.02 + 1.0j, -0.03 + 2.0j], noise=0.0, sizes=[1.0, weaker])
    assert farthest(identified(data).multipliers, full) < 1e-12 / weaker


@pytest.mark.slow
def test_modes_of_many_strengths():
    logs = [-0.02 + 0.5j, -0.03 + 1.0j, -0.02 + 1.5j, -0.01 + 2.0j, -0.03 + 2.5j]
    full, data = ringing(logs, noise=1e-7, sizes=10.0 ** -np.arange(5))
    found_within_deviations(identified(data), full)


@pytest.mark.parametrize(("outputs", "inputs", "samples"), [(1, 1, 200), (50, 1, 200), (200, 1, 60), (10, 3, 101)])
def test_noise_alone_holds_no_mode(outputs, inputs, samples):
    for seed in range(4):
        values = np.random.default_rng(seed).standard_normal((outputs, inputs, samples))
        model = identified(TimeResponses(values=values, dt=1.0))
        assert (model.order, model.outcome) == (0, Outcome.NO_MODE)
        assert model.residues.shape == (0, outputs, inputs)


@pytest.mark.parametrize("order", [None, 2])
def test_nothing_at_all_holds_no_mode(order):
    model = identified(TimeResponses(values=np.zeros((3, 1, 20)), dt=1.0), order)
    assert model.order == 0
    assert model.outcome is (Outcome.NO_MODE if order is None else Outcome.ORDER_UNREACHED)


@pytest.mark.first(6)
@pytest.mark.parametrize("samples", [1, 2, 3, 4, 5, 8])
@pytest.mark.parametrize("outputs", [1, 2, 8])
def test_the_smallest_sizes_end_in_an_outcome_and_never_in_a_wrong_success(outputs, samples):
    for noise in (0.0, 0.02):
        full, data = ringing([-0.1 + 1.0j], outputs=outputs, samples=samples, noise=noise)
        model = identified(data)
        assert model.residues.shape == (model.order, outputs, 1)
        if model.outcome is Outcome.SUCCESS:
            assert samples >= 4
            if model.order == 2:
                assert farthest(model.multipliers, full) < (1e-9 if noise == 0.0 else 0.3)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_fewer_samples_than_the_modes_need_are_an_outcome(noise):
    logs = -0.05 + 1j * np.linspace(0.3, 2.8, 3)
    _, data = ringing(logs, outputs=100, samples=8, noise=noise, seed=1)
    assert identified(data).outcome is Outcome.TOO_FEW_SAMPLES


def test_more_modes_than_are_allowed_are_an_outcome():
    _, data = ringing(SYSTEMS["three pairs"])
    assert identified(data, identifier=AMI(most=4)).outcome is Outcome.NOT_WHITE


# A fixed order.


@pytest.mark.slow
def test_fewer_poles_than_there_are():
    """The strongest stay."""
    full, data = ringing([-0.02 + 1.0j, -0.03 + 2.0j, -0.1], sizes=[1.0, 0.3, 0.2])
    for order, expected in ((2, full[:2]), (4, full[:4])):
        model = identified(data, order)
        assert (model.order, model.outcome) == (order, Outcome.SUCCESS)
        assert farthest(model.multipliers, expected) < 0.02
    alone = identified(ringing([-0.02 + 1.0j])[1], 1)
    assert (alone.order, alone.outcome) == (2, Outcome.ORDER_UNREACHED), "a clear pair cannot be halved"


@pytest.mark.slow
@pytest.mark.parametrize("order", [4, 5, 6])
def test_more_poles_than_there_are_leave_the_true_ones_where_they_were(order):
    full, data = ringing([-0.02 + 1.0j, -0.03], sizes=[1.0, 0.5])
    model = identified(data, order)
    assert (model.order, model.outcome) == (order, Outcome.SUCCESS)
    distance = np.abs(np.subtract.outer(np.exp(full), model.multipliers)).min(axis=1)
    assert distance.max() < 2e-3
    assert model.stats["cost"] < identified(data).stats["cost"]


def test_an_order_may_be_asked_of_noise():
    model = identified(TimeResponses(values=np.random.default_rng(0).standard_normal((10, 1, 60)), dt=1.0), 2)
    assert (model.order, model.outcome) == (2, Outcome.SUCCESS)


# What it hands over.


def test_refining_goes_round_from_another_models_poles_on_other_noise():
    full, data = ringing(SYSTEMS["a pair and both real kinds"], inputs=2)
    rough = identified(data, identifier=MaximumLikelihood())
    scale = np.linspace(0.5, 2.0, 8)[:, None]
    state = IDENTIFIER.prepare(TimeResponses(values=data.values, dt=1.0, noise=data.noise * scale))
    refined, again = IDENTIFIER.refine(state, rough), IDENTIFIER.extract(state)
    assert refined.order == again.order == 4
    assert farthest(refined.multipliers, np.log(again.multipliers)) < 1e-6
    assert_allclose(refined.stats["cost"], again.stats["cost"], rtol=1e-6)
    found_within_deviations(refined, full)


def test_refining_keeps_the_outcome_and_the_order_zero():
    state = IDENTIFIER.prepare(TimeResponses(values=np.random.default_rng(0).standard_normal((3, 1, 50)), dt=1.0))
    refined = IDENTIFIER.refine(state, IDENTIFIER.extract(state))
    assert (refined.order, refined.outcome) == (0, Outcome.NO_MODE)


@pytest.mark.first(1)
@pytest.mark.parametrize("name", ["three pairs", "a pair and both real kinds", "a half-power width apart"])
@pytest.mark.parametrize("inputs", [1, 2])
def test_the_finish_of_maximum_likelihood_has_its_own_poles(name, inputs):
    _, data = ringing(SYSTEMS[name], inputs=inputs)
    alone, finished = (identified(data, identifier=MaximumLikelihood(initial=x)) for x in (None, AMI()))
    assert farthest(finished.multipliers, np.log(alone.multipliers)) < 1e-7
    position = np.abs(np.subtract.outer(alone.multipliers, finished.multipliers)).argmin(axis=1)
    std = np.sqrt(np.diag(finished.covariance)).reshape(2, -1)[:, position]
    assert_allclose(std, np.sqrt(np.diag(alone.covariance)).reshape(2, -1), rtol=1e-4)
    assert finished.stats["cost"] <= identified(data).stats["cost"] * (1.0 + 1e-9)


def test_the_finish_takes_the_order_and_the_outcome_of_the_wrapped_identifier():
    _, data = ringing(SYSTEMS["three pairs"])
    both = MaximumLikelihood(initial=AMI(most=4))
    assert identified(data, identifier=both).outcome is Outcome.NOT_WHITE
    assert identified(data, 4, identifier=MaximumLikelihood(initial=AMI())).order == 4
    noise = TimeResponses(values=np.random.default_rng(0).standard_normal((3, 1, 50)), dt=1.0)
    assert identified(noise, identifier=both).outcome is Outcome.NO_MODE


def test_where_two_poles_are_one_there_are_no_deviations():
    """A millionth apart, with one input: how they share their residues is for rounding to say."""
    _, data = ringing([-0.02 + 1.0j])
    model = identified(data)
    twice = type(model)(
        multipliers=np.concatenate([model.multipliers, model.multipliers * np.exp(1e-6)]),
        residues=np.concatenate([model.residues, model.residues]),
        dt=1.0,
    )
    refined = IDENTIFIER.refine(IDENTIFIER.prepare(data), twice)
    assert refined.order == 4
    assert farthest(refined.multipliers, np.log(twice.multipliers)) < 1e-4
    assert refined.covariance is refined.residue_spread is refined.residue_slope is None
    assert model.covariance is not None


@pytest.mark.parametrize("apart", [1e-5, 1e-4, 1e-2])
def test_the_slopes_of_two_poles_hardly_apart_are_not_those_of_rounding(apart):
    """Over all lines they are sums of what a projection leaves, which orthogonal columns tell to many more digits."""
    _, data = ringing([-0.02 + 1.0j])
    (block,) = spectra(data)
    modes = [Mode(-0.02 + 1.0j + step, PAIR) for step in (0.0, apart)]
    coupled = Coupled.of(modes, block, [slice(0, len(block.values))] * 2, KNOWN)
    pairs = [mode_columns(mode.s, PAIR, block.angles, block.samples, block.weights) for mode in modes]
    columns, moved = (np.concatenate([real_rows(pair[i]) for pair in pairs], axis=1) for i in range(2))
    # Of the first residue of each mode alone: by the real part of its pole, and by the imaginary one.
    orthogonal, slopes = np.linalg.qr(columns)[0], moved * [1.0, -1.0, 1.0, -1.0]
    left = slopes - orthogonal @ (orthogonal.T @ slopes)
    strength = np.zeros((4, 4))
    strength[::2, ::2] = 1.0
    assert_allclose(coupled.slope_of_equations(strength), left.T @ left, atol=1e-3 * np.min(np.sum(left**2, axis=0)))


def test_the_search_reports_each_mode_and_says_how_it_ended():
    said: list[str] = []
    _, data = ringing(SYSTEMS["three pairs"], outputs=40)
    model = IDENTIFIER.extract(IDENTIFIER.prepare(data), report=said.append)
    assert said == ["2 poles isolated", "4 poles isolated", "6 poles isolated"]
    assert model.stats["rest"] < IDENTIFIER.tolerance
    free = 40 * (200 - 6) - 6
    assert model.stats["cost"] == pytest.approx(free, abs=5.0 * np.sqrt(2.0 * free))
    assert np.sqrt(np.mean((model.residual_std / data.noise) ** 2)) == pytest.approx(1.0, rel=0.03)
