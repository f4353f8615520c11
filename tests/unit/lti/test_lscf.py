"""LSCF and poly-reference LSCF: normal matrices against plain sums, bands, growth, equal poles, noise taken off.

Two broken estimators are kept: `test_without_numerators_…` mirrors the poles, and in `test_with_the_noise_taken_off_…`
least squares is left as it stands.
"""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linear_sum_assignment

from floquid.errors import InputError
from floquid.lti import MaximumLikelihood, Outcome, TimeResponses
from floquid.lti._era import hankel_covariance
from floquid.lti._factor import factors
from floquid.lti.rational import LSCF, PolyLSCF
from floquid.lti.rational import _denominator as denominator
from floquid.lti.rational import _denominator as lines_module
from floquid.lti.rational import _lscf as rational
from floquid.lti.rational._denominator import Band, Basis, Equations
from floquid.lti.rational._lscf import common, hankel

BOTH = pytest.mark.parametrize("kind", [LSCF, PolyLSCF])
FOUR = np.array([-0.02 + 0.2j, -0.03 + 0.7j, -0.02 + 1.5j, -0.01 + 2.9j])
BANDS = {"from zero": (0.0, 0.35), "inside": (0.35, 0.6), "to the end": (0.8, 1.0), "all": (0.0, 1.0), "none": None}


def ringing(multipliers, *, outputs=6, inputs=2, samples=300, noise=0.0, seed=0, lengths=None):
    """Responses whose residues are outer products (modes, outputs, inputs), and those residues."""
    generator = np.random.default_rng(0)
    values, residues = np.zeros((outputs, inputs, samples)), []
    for mu in np.asarray(multipliers, complex):
        parts = [generator.standard_normal((2, size)) for size in (outputs, inputs)]
        left, right = (part[0] + 1j * part[1] * bool(mu.imag) for part in parts)
        residues.append(np.outer(left, right) / (2.0 if mu.imag else 1.0))
        values += ((2.0 if mu.imag else 1.0) * residues[-1][..., None] * mu ** np.arange(samples)).real
    largest = np.abs(values).max(axis=2)
    values = values + noise * largest[..., None] * np.random.default_rng(seed).standard_normal(values.shape)
    data = TimeResponses(values=values, dt=1.0, noise=max(noise, 1e-10) * largest, lengths=lengths)
    return data, np.array(residues)


def identified(identifier, data, order):
    return identifier.extract(identifier.prepare(data), order)


def full(multipliers):
    return np.concatenate([[mu, np.conj(mu)] if np.imag(mu) else [mu] for mu in multipliers]).astype(complex)


def farthest(found, expected):
    assert len(found) == len(expected), f"{len(found)} poles, but {len(expected)} were expected"
    distance = np.abs(np.subtract.outer(found, expected))
    return distance[linear_sum_assignment(distance)].max()


def upper(model):
    """Logarithms of the multipliers of positive imaginary part, by frequency."""
    logs = np.log(model.multipliers[model.multipliers.imag > 0])
    return logs[np.argsort(logs.imag)]


# The matrices


@pytest.mark.parametrize("edges", [(0.0, 1.0), (0.0, 0.2), (0.3, 0.6), (0.7, 1.0)])
@pytest.mark.parametrize("samples", [100, 101])
def test_the_basis_is_orthonormal_on_its_lines_and_a_basis_of_polynomials(edges, samples):
    band = Band(samples, *edges)
    basis = Basis.on(band, 9)
    rows = denominator.stacked((band.weights[:, None] * basis.at(band.x)).T)
    assert_allclose(rows @ rows.T, np.eye(10), atol=1e-12)
    points = np.exp(-0.1 - 1j * np.linspace(0.0, 3.0, 7))
    for k, (low, high) in enumerate(pairwise(basis.at(points).T)):
        h = basis.hessenberg[: k + 2, k]
        assert_allclose(basis.at(points)[:, : k + 2] @ h, points * low, rtol=1e-9, atol=1e-9 * np.abs(high).max())


@pytest.mark.parametrize("edges", [(0.0, 1.0), (0.0, 0.4), (0.3, 0.6), (0.6, 1.0)])
@pytest.mark.parametrize("samples", [60, 61])
def test_the_part_of_white_noise_is_the_sum_over_single_samples(edges, samples):
    """The covariance of white noise is the sum of the outer products of unit vectors: so is what it adds to M."""
    band = Band(samples, *edges)
    basis = Basis.on(band, 5)
    equations = Equations.of(basis, band)
    root = equations.triangle([band.spectrum(np.eye(samples))[:, None]])
    assert_allclose(equations.noise(), root.T @ root, atol=1e-10 * np.abs(root).max() ** 2)


def plain_normal(values, degree):
    """M by its definition (powers and inputs, powers and inputs), from responses (outputs, inputs, samples)."""
    outputs, inputs, samples = values.shape
    rows = [values[o, :, t - degree : t + 1][:, ::-1].T.ravel() for o in range(outputs) for t in range(degree, samples)]
    assert rows[0].shape == ((degree + 1) * inputs,)
    return np.array(rows).T @ np.array(rows)


@pytest.mark.parametrize(("outputs", "inputs"), [(1, 1), (5, 1), (5, 3), (90, 2)])
def test_the_normal_matrix_is_that_of_the_plain_sums(outputs, inputs, monkeypatch):
    """By correlations, and by orthogonal steps on the lines, one output and many at a time."""
    values = np.random.default_rng(1).standard_normal((outputs, inputs, 40))
    data = TimeResponses(values=values, dt=1.0)
    expected = plain_normal(values, 7)
    monkeypatch.setattr(rational, "BLOCK", 400)
    scale = np.ones((outputs, inputs))
    assert_allclose(hankel(rational._blocks(data, scale, 40), inputs, 40, 7), expected, atol=1e-10)
    band = Band(40)
    root = Equations.of(Basis.powers(7), band).triangle(rational._spectra(data, scale, band))
    assert_allclose(root.T @ root, expected, atol=1e-10)
    if inputs == 1:
        assert_allclose(hankel_covariance(factors(data), 8)[::-1, ::-1], expected, atol=1e-10)


@BOTH
def test_squared_or_not_the_denominators_are_the_same(kind, monkeypatch):
    """At 0.1 % noise the matrix may be squared; orthogonal steps are then another way to the same values."""
    data, _ = ringing(np.exp(FOUR), noise=0.001)
    squared = kind(degree=20).prepare(data).denominators
    monkeypatch.setattr("floquid.lti.rational._lscf.is_safe", lambda *_: False)
    other = kind(degree=20).prepare(data).denominators
    assert (squared.rounding, other.rounding) == (denominator.ROUNDING, denominator.ROUNDING**2)
    assert_allclose(squared.values, other.values, rtol=1e-6)


def test_responses_of_another_length_add_their_own_equations():
    data, _ = ringing(np.exp(FOUR), lengths=[300, 201])
    blocks = factors(data)
    found = common(blocks, [Band(300, 0.1, 0.7), Band(201, 0.1, 0.7)], 30)
    both = found.roots(found.rank())[0]
    for mu in np.exp(FOUR[1:3]):
        assert np.abs(both - mu).min() < 1e-10


# Bands


@pytest.mark.first(7)
@BOTH
@pytest.mark.parametrize("band", BANDS.values(), ids=BANDS)
@pytest.mark.parametrize("samples", [300, 301])
def test_a_band_keeps_sign_and_size_of_the_damping(kind, band, samples):
    """From zero frequency, to the end, and inside: the poles are exact, and so are their residues."""
    data, residues = ringing(np.exp(FOUR), samples=samples)
    low, high = band or (0.0, 1.0)
    inside = (low * np.pi < FOUR.imag) & (high * np.pi > FOUR.imag)
    found = identified(kind(band=band), data, 2 * inside.sum())
    assert found.outcome is Outcome.SUCCESS
    assert_allclose(upper(found), FOUR[inside], atol=1e-10)
    order = np.argsort(np.where(found.multipliers.imag > 0, np.angle(found.multipliers), np.inf))[: inside.sum()]
    assert_allclose(found.residues[order], residues[inside], atol=1e-7)


@BOTH
@pytest.mark.parametrize("band", BANDS.values(), ids=BANDS)
def test_growing_modes_grow_on_every_band(kind, band):
    growing = FOUR.real * [-0.3, 1.0, -0.2, -0.3] + 1j * FOUR.imag
    low, high = band or (0.0, 1.0)
    inside = (low * np.pi < growing.imag) & (high * np.pi > growing.imag)
    data, _ = ringing(np.exp(growing))
    found = identified(kind(band=band), data, 2 * inside.sum())
    logs = upper(found)
    assert_allclose(logs, growing[inside], atol=1e-9)


@BOTH
def test_a_band_holds_up_beside_noise(kind):
    for seed in range(5):
        data, _ = ringing(np.exp(FOUR), noise=0.02, seed=seed, outputs=20)
        logs = upper(identified(kind(band=(0.0, 0.35)), data, 4))
        assert_allclose(logs.real, FOUR[:2].real, rtol=0.15)
        assert_allclose(logs.imag, FOUR[:2].imag, atol=0.005)


def least_squares_roots(found):
    """The roots of the common denominator of least squares, its highest coefficient one and no noise taken off."""
    highest = np.eye(found.basis.degree + 1)[:, -1:]
    weighted = found.directions / np.maximum(found.values, 1e-20 * found.values[0])
    return found._roots(weighted @ (found.directions.T @ highest), highest=True)[0]


def test_without_numerators_the_damping_changes_its_sign(monkeypatch):
    """The error that the tests of bands are there for: M is a Toeplitz matrix then, and its roots are mirrored."""
    data, _ = ringing(np.exp(FOUR[1:2]), noise=0.001)
    monkeypatch.setattr("floquid.lti.rational._lscf.is_safe", lambda *_: False)
    right = Equations.of
    for numerators, damping in ((1.0, -0.03), (0.0, 0.03)):

        def changed(basis, band, numerators=numerators):
            equations = right(basis, band)
            return Equations(band, equations.values, numerators * equations.numerators)

        monkeypatch.setattr(Equations, "of", staticmethod(changed))
        logs = np.log(least_squares_roots(LSCF(degree=40).prepare(data).denominators))
        nearest = logs[np.argmin(np.abs(logs - (damping + 0.7j)))]
        assert_allclose(nearest, damping + 0.7j, atol=0.003)
        inside = np.abs(logs.imag - 0.7) < 0.01
        assert_allclose(logs[inside].real, damping, atol=0.003)


# Modes


KINDS = {
    "two growing, one not": [np.exp(0.01 + 2.0j), 1.02, np.exp(-0.03 + 0.5j)],
    "a growing negative one": [-1.01],
    "a constant beside a pair": [np.exp(-0.02 + 1.0j), 1.0],
    "undamped": [np.exp(1.0j)],
    "both real kinds": [0.95, -0.9],
    "one frequency, two decays": [np.exp(-0.02 + 1.0j), np.exp(-0.05 + 1.0j)],
    "next to the positive axis": [np.exp(-0.02 + 0.01j)],
}


@BOTH
@pytest.mark.parametrize("multipliers", KINDS.values(), ids=KINDS)
def test_every_kind_of_pole_is_exact_without_noise(kind, multipliers):
    data, residues = ringing(multipliers, outputs=6, inputs=2, samples=120)
    expected = full(multipliers)
    found = identified(kind(), data, len(expected))
    assert found.outcome is Outcome.SUCCESS
    assert farthest(found.multipliers, expected) < 1e-9
    assert np.count_nonzero(found.multipliers.imag == 0) == sum(not np.imag(mu) for mu in multipliers)
    for mu, residue in zip(multipliers, residues, strict=True):
        position = np.argmin(np.abs(found.multipliers - mu))
        assert_allclose(found.residues[position], residue, atol=1e-6)


@BOTH
def test_strong_modes_far_outside_a_band_leave_nothing_in_it(kind):
    """Their skirts are smooth on the band; the few roots found outside do not follow them."""
    far = [np.exp(-0.02 + 0.3j), np.exp(-0.02 + 2.8j)]
    data, _ = ringing([far[0], far[1], np.exp(-0.03 + 1.45j)], outputs=10, noise=5e-4)
    for seed in range(3):
        values = data.values + 4e-4 * np.random.default_rng(seed).standard_normal(data.values.shape)
        noisy = TimeResponses(values=values, dt=1.0, noise=np.hypot(data.noise, 4e-4))
        found = identified(kind(band=(0.3, 0.6)), noisy, 2)
        assert (found.residual_std / noisy.noise).mean() < 1.3
        assert np.abs(found.multipliers[0] - np.exp(-0.03 + 1.45j)) < 1e-3


@BOTH
def test_growing_and_decaying_modes_beside_noise(kind):
    for seed in range(2):
        data, _ = ringing(KINDS["two growing, one not"], noise=0.01, samples=200, seed=seed)
        found = identified(kind(), data, 5)
        assert found.outcome is Outcome.SUCCESS
        for mu, within in zip(KINDS["two growing, one not"], (3e-4, 3e-4, 5e-3), strict=True):
            assert np.abs(found.multipliers - mu).min() < within


@BOTH
def test_poles_that_are_not_there_are_not_made_up(kind):
    data, _ = ringing(np.exp(FOUR[:1]))
    found = identified(kind(), data, 6)
    assert (found.outcome, found.order) == (Outcome.ORDER_UNREACHED, 2)


@BOTH
@pytest.mark.parametrize("samples", [1, 2, 3])
def test_nothing_at_all_has_no_poles(kind, samples):
    data = TimeResponses(values=np.zeros((2, 2, samples)), dt=1.0)
    state = kind().prepare(data)
    if samples > 1:
        found = kind().extract(state, 1)
        assert (found.order, found.outcome) == (0, Outcome.ORDER_UNREACHED)
        assert kind().refine(state, found) is found


@BOTH
def test_a_band_without_lines_has_no_poles(kind):
    data, _ = ringing(np.exp(FOUR), samples=30)
    found = identified(kind(band=(0.01, 0.05)), data, 2)
    assert (found.order, found.outcome) == (0, Outcome.ORDER_UNREACHED)


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_two_modes_of_equal_poles_are_two_with_two_inputs(noise):
    """The matrix denominator has two participations there; a common one has a single root."""
    mu = np.exp(-0.02 + 1.0j)
    data, residues = ringing([mu, mu], outputs=20, noise=noise)
    found = identified(PolyLSCF(), data, 4)
    assert (found.order, found.outcome) == (4, Outcome.SUCCESS)
    assert np.abs(found.multipliers[[0, 2]] - mu).max() < max(20 * noise * 1e-3, 1e-10)
    assert_allclose(found.residues[1::2], found.residues[::2].conj(), rtol=1e-12)
    both = found.residues[found.multipliers.imag > 0]
    assert_allclose(both.sum(axis=0), residues.sum(axis=0), atol=max(5 * noise, 1e-7))
    for residue in both:
        values = np.linalg.svd(residue, compute_uv=False)
        assert values[1] < 1e-10 * values[0]
    single = identified(LSCF(), data, 4)
    assert np.sum(np.abs(single.multipliers - mu) < 0.01) == 1
    if not noise:
        assert single.outcome is Outcome.ORDER_UNREACHED


@pytest.mark.slow
def test_participations_make_residues_better():
    """Of rank one, residues have fewer parameters: over seeds their error is less than that of free ones."""
    errors = np.zeros(2)
    for seed in range(10):
        data, residues = ringing(np.exp(FOUR[:3]), outputs=10, noise=0.02, seed=seed)
        for position, rank_one in enumerate((True, False)):
            found = identified(PolyLSCF(rank_one=rank_one), data, 6)
            at = [np.argmin(np.abs(found.multipliers - mu)) for mu in np.exp(FOUR[:3])]
            errors[position] += np.sum(np.abs((found.residues[at] - residues) / data.noise) ** 2)
    assert errors[0] < 0.8 * errors[1]


def test_inputs_of_unequal_length_and_outputs_of_unequal_noise():
    """Noise that is no outer product is taken off all the same; each input's own samples give its residues."""
    data, _ = ringing(np.exp(FOUR), outputs=12, inputs=3)
    largest = np.abs(data.values).max(axis=2)
    for seed in range(2):
        generator = np.random.default_rng(seed)
        std = 0.02 * largest * generator.uniform(0.2, 2.0, largest.shape)
        values = data.values + std[..., None] * generator.standard_normal(data.values.shape)
        values[:, 1, 200:] = 1e4 * generator.standard_normal((12, 100))
        values[:, 2, 250:] = 1e4 * generator.standard_normal((12, 50))
        noisy = TimeResponses(values=values, dt=1.0, noise=std, lengths=[300, 200, 250])
        found = identified(PolyLSCF(), noisy, 8)
        assert_allclose(upper(found).real, FOUR.real, rtol=0.1)
        assert 0.9 < (found.residual_std / std).mean() < 1.1


@BOTH
def test_outputs_in_blocks_are_outputs_all_at_once(kind, monkeypatch):
    data, _ = ringing(np.exp(FOUR), outputs=40, noise=0.02)
    band = (0.05, 0.6)
    whole = identified(kind(band=band), data, 6)
    monkeypatch.setattr(lines_module, "BLOCK", 2000)
    monkeypatch.setattr(rational, "BLOCK", 2000)
    parts = identified(kind(band=band), data, 6)
    assert farthest(whole.multipliers, parts.multipliers) < 1e-9
    assert_allclose(whole.residual_std, parts.residual_std, rtol=1e-6)


# Noise


@BOTH
@pytest.mark.parametrize("band", [None, (0.0, 0.5), (0.3, 0.8)])
@pytest.mark.parametrize("lengths", [[200, 200], [200, 120], [200, 20]])
def test_the_eigenvalues_of_noise_alone_are_one(kind, band, lengths):
    """On average over directions: whatever the band, the lengths and the noise of each response."""
    generator = np.random.default_rng(3)
    std = 10.0 ** generator.uniform(-0.3, 0.3, (60, 2))
    values = std[..., None] * generator.standard_normal((60, 2, 200))
    data = TimeResponses(values=values, dt=1.0, noise=std, lengths=lengths)
    if kind is PolyLSCF and lengths[1] == 20:
        pytest.skip("twenty samples have too few lines for an average")
    found = kind(band=band, degree=60 if lengths[1] == 20 else 24).prepare(data).denominators
    assert_allclose(found.values.mean(), 1.0, rtol=0.06)


@BOTH
@pytest.mark.parametrize("factor", [1.0, 1e4])
def test_the_directions_above_the_noise_are_those_of_the_modes(kind, factor):
    """Even if the noise is overstated; weak modes count, too. What is asked for beyond is taken from the noise."""
    data, _ = ringing(np.exp(FOUR), outputs=40, noise=0.25)
    found = kind(degree=24).prepare(TimeResponses(values=data.values, dt=1.0, noise=factor * data.noise)).denominators
    assert found.values[7] < 100.0 / factor**2
    assert 8 <= found.rank() <= 10
    assert found.rank(4) == found.rank()
    assert found.rank(15) == 15


@pytest.mark.slow
@BOTH
def test_an_undamped_mode_is_one_root(kind):
    """Both denominators are asked at the unit circle, and what they answer is one mode."""
    for seed in range(10):
        data, _ = ringing([np.exp(1.0j)], noise=0.001, seed=seed)
        near = np.abs(kind().prepare(data).modes.poles.s - 1.0j) < 1e-3
        assert near.sum() == 1


def pulls(logs, bound):
    """Errors of decays and frequencies over the deviations of maximum likelihood."""
    off = logs - FOUR
    return np.concatenate([off.real / bound.real, off.imag / bound.imag])


@pytest.mark.slow
def test_with_the_noise_taken_off_the_error_is_near_the_bound():
    """Forty outputs, 2 %: under 1.25 deviations of the best there is; least squares as it stands is far over."""
    ours, plain = [], []
    for seed in range(20):
        data, _ = ringing(np.exp(FOUR), outputs=40, inputs=1, noise=0.02, seed=seed)
        best = MaximumLikelihood().extract(MaximumLikelihood().prepare(data), 8)
        order = np.argsort(np.where(best.multipliers.imag > 0, np.angle(best.multipliers), np.inf))[:4]
        deviations = np.sqrt(np.diag(best.covariance))
        bound = deviations[:8][order] + 1j * deviations[8:][order]
        state = LSCF(degree=48).prepare(data)
        ours.append(pulls(upper(LSCF().extract(state, 8)), bound))
        roots = np.log(least_squares_roots(state.denominators))
        nearest = roots[np.argmin(np.abs(roots[:, None] - FOUR), axis=0)]
        plain.append(pulls(nearest, bound))
    ours, plain = (np.sqrt(np.mean(np.square(p))) for p in (ours, plain))
    assert ours < 1.25
    assert plain > 2.0


@pytest.mark.first(3)
@BOTH
@pytest.mark.parametrize("factor", [1e-6, 0.5, 2.0, 1e6])
def test_noise_that_is_misstated_by_a_factor_does_no_harm(kind, factor):
    data, _ = ringing(np.exp(FOUR), outputs=12, noise=0.02)
    wrong = TimeResponses(values=data.values, dt=1.0, noise=data.noise * factor)
    right = identified(kind(), data, 8)
    assert farthest(identified(kind(), wrong, 8).multipliers, right.multipliers) < 5e-4


@BOTH
def test_a_degree_as_low_as_the_order_is_enough_without_noise(kind):
    data, _ = ringing(np.exp(FOUR), inputs=1)
    found = identified(kind(degree=8), data, 8)
    assert farthest(found.multipliers, full(np.exp(FOUR))) < 1e-9
    assert identified(kind(degree=4), data, 8).outcome is Outcome.ORDER_UNREACHED


# Options


@BOTH
@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"degree": 0}, "degree"),
        ({"degree": 2.5}, "degree"),
        ({"band": (0.5, 0.5)}, "band"),
        ({"band": (0.5, 1.5)}, "band"),
        ({"band": (-0.1, 0.5)}, "band"),
        ({"band": (0.1, 0.2, 0.3)}, "band"),
        ({"band": 0.5}, "band"),
        ({"band": (0.1, float("nan"))}, "band"),
    ],
)
def test_options_that_make_no_sense_are_refused(kind, options, argument):
    with pytest.raises(InputError, match=rf"^Argument `{argument}` of `{kind.__name__}` must .+, but is "):
        kind(**options)
