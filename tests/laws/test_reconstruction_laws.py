"""Identities of reconstruction: what no choice of amplitude, unit or name may change, and what any structure keeps."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from floquid import floquet
from floquid.core import Estimates, PeriodicModel
from floquid.floquet import FunctionMatrix
from floquid.reconstruction import Block, FirstOrder, SecondOrder, reconstruct, refine

SEEDS = st.integers(0, 2**32 - 1)
SYMMETRIES = st.sampled_from(["none", "symmetric", "diagonal"])


def covariance(generator, n, size=1.0):
    root = np.eye(n) + 0.3 * generator.standard_normal((n, n)) / np.sqrt(n)
    return size**2 * root @ root.T


def estimates_of(exponents, harmonics, shapes, period, generator, size=1e-6) -> Estimates:
    """Pairs with their coefficients (modes, channels, hits, harmonics), and any covariance."""
    count, channels, hits, width = shapes.shape
    modes = np.repeat(np.arange(count), width)
    coefficients = np.moveaxis(shapes, 3, 1).reshape(-1, channels, hits)
    parts, n = 2 * count + 1, len(modes)
    whole = np.zeros((parts, parts))
    whole[:-1, :-1] = covariance(generator, parts - 1, size)
    largest = np.abs(coefficients).max(axis=0)
    slopes = generator.standard_normal((*coefficients.shape, parts)) * largest[..., None] + 0j
    slopes[..., -1] = 0.0
    return Estimates(
        exponents=exponents,
        real=np.zeros(count, bool),
        fundamental=2.0 * np.pi / period,
        modes=modes,
        harmonics=np.tile(harmonics, count),
        coefficients=coefficients,
        covariance=whole,
        slopes=slopes,
        spread=covariance(generator, 2 * n)[None],
        blocks=np.zeros((channels, hits), int),
        scales=np.broadcast_to(size * largest, coefficients.shape) + 0j,
    )


def model_of(estimates: Estimates) -> PeriodicModel:
    width = int(np.abs(estimates.harmonics).max())
    count, shape = len(estimates.exponents), estimates.blocks.shape
    values = np.zeros((2 * count, *shape, 2 * width + 1), complex)
    for k, (mode, m) in enumerate(zip(estimates.modes, estimates.harmonics, strict=True)):
        values[2 * mode, ..., m + width] = estimates.coefficients[k]
        values[2 * mode + 1, ..., width - m] = estimates.coefficients[k].conj()
    # The same deviation for every coefficient of a channel: the weights of channels follow its units.
    largest = np.abs(estimates.scales).max(axis=(0, 2))
    return PeriodicModel(
        exponents=np.stack([estimates.exponents, estimates.exponents.conj()], axis=1).ravel(),
        coefficients=values,
        harmonics=np.arange(-width, width + 1),
        period=2.0 * np.pi / estimates.fundamental,
        channels=[f"c{i}" for i in range(shape[0])],
        coefficient_std=np.broadcast_to(largest[:, None, None] * (1 + 1j), values.shape),
        estimates=estimates,
    )


@st.composite
def drawn(draw, *, hits=1):
    """Two pairs well apart in two channels."""
    generator = np.random.default_rng(draw(SEEDS))
    harmonics = np.arange(-2, 3)
    shapes = generator.standard_normal((2, 2, 1, 5)) + 1j * generator.standard_normal((2, 2, 1, 5))
    shapes *= 0.3 ** np.abs(harmonics)
    # Shapes of two modes that are near right angles to one another: the modal matrix is well conditioned.
    shapes[..., 2] = np.array([[1.0, 0.3j], [-0.3j, 1.0]])[:, :, None]
    amplitudes = generator.uniform(0.5, 2.0, (2, 1, hits, 1)) * np.exp(2j * np.pi * generator.random((2, 1, hits, 1)))
    exponents = np.array([-0.05 + 1.7j, -0.08 + 3.1j]) + 0.1 * generator.standard_normal(2)
    return estimates_of(exponents, harmonics, shapes * amplitudes, 2.3, generator)


def replaced(own: Estimates, **changes) -> Estimates:
    names = ("exponents", "real", "fundamental", "modes", "harmonics", "coefficients", "covariance", "slopes",
             "spread", "blocks", "scales")  # fmt: skip
    return Estimates(**({name: getattr(own, name) for name in names} | changes))


@settings(max_examples=12)
@given(drawn(hits=2), SEEDS)
def test_amplitudes_of_modes_and_hits_change_nothing(own, seed):
    """With the errors scaled alike, A(t), Φ and their deviations stay."""
    generator = np.random.default_rng(seed)
    factor = generator.uniform(0.1, 10.0, (2, 2)) * np.exp(2j * np.pi * generator.random((2, 2)))
    each = factor[own.modes][:, None, :]
    other = replaced(
        own,
        coefficients=own.coefficients * each,
        slopes=own.slopes * each[..., None],
        scales=own.scales * each,
    )
    # One hit is taken, so that how hits are weighted against one another does not enter.
    for hit in (0, 1):
        alone = [
            replaced(one, coefficients=one.coefficients[:, :, [hit]], slopes=one.slopes[:, :, [hit]],
                     scales=one.scales[:, :, [hit]], blocks=one.blocks[:, [hit]])
            for one in (own, other)
        ]  # fmt: skip
        first, second = (reconstruct(model_of(one), ["c0", "c1"], harmonics=5, times=3) for one in alone)
        for name in ("system", "transition", "system_std", "transition_std"):
            size = np.abs(getattr(first, name)).max()
            assert_allclose(getattr(second, name), getattr(first, name), rtol=1e-6, atol=1e-8 * size)


@given(drawn(), st.floats(1e-6, 1e6), st.floats(1e-3, 1e3))
def test_deviations_grow_with_the_errors_and_values_do_not(own, unit, factor):
    """Of all errors `factor` times as large; and in other units of a channel A(t) is transformed."""
    louder = replaced(own, covariance=factor**2 * own.covariance, scales=factor * own.scales)
    first, second = (reconstruct(model_of(one), ["c0", "c1"], harmonics=5, times=3) for one in (own, louder))
    assert_allclose(second.system, first.system, rtol=1e-9, atol=1e-9)
    assert_allclose(second.system_std, factor * first.system_std, rtol=1e-6)
    units = np.array([unit, 1.0])[:, None]
    scaled = replaced(
        own, coefficients=own.coefficients * units, slopes=own.slopes * units[..., None], scales=own.scales * units
    )
    third, both = reconstruct(model_of(scaled), ["c0", "c1"], harmonics=5, times=3), np.tile(units[:, 0], 2)
    for name in ("system", "system_std", "transition", "transition_std"):
        expected = getattr(first, name)
        back = getattr(third, name) * both / both[:, None]
        assert_allclose(back, expected, rtol=1e-5, atol=1e-7 * np.abs(expected).max())


@settings(max_examples=12)
@given(drawn(), st.permutations(range(10)))
def test_the_order_of_modes_and_terms_changes_nothing(own, order):
    """Terms in any order, the second mode first."""
    order = np.array(order)
    both = np.concatenate([order, order + 10])
    parts = [1, 0, 3, 2, 4]
    other = replaced(
        own,
        exponents=own.exponents[::-1],
        modes=1 - own.modes[order],
        harmonics=own.harmonics[order],
        coefficients=own.coefficients[order],
        covariance=own.covariance[np.ix_(parts, parts)],
        slopes=own.slopes[order][..., parts],
        spread=own.spread[:, both][:, :, both],
        scales=own.scales[order],
    )
    for choice in (1, 5):
        first, second = (reconstruct(model_of(one), ["c0", "c1"], harmonics=choice, times=2) for one in (own, other))
        assert_allclose(second.system, first.system, rtol=1e-8, atol=1e-8)
        assert_allclose(second.system_std, first.system_std, rtol=1e-6, atol=1e-14)
        assert_allclose(second.transition_std, first.transition_std, rtol=1e-5, atol=1e-10)


@given(drawn(), st.floats(-30.0, 30.0), st.floats(0.1, 2.0), st.floats(0.1, 2.0))
def test_transitions_compose_and_come_back(own, start, first, second):
    r"""Φ(t₂, t₀) = Φ(t₂, t₁) Φ(t₁, t₀), and Liouville: det Φ over a period is e^{Σλ T}."""
    model = model_of(own)
    times = start + np.array([0.0, first, first + second, model.period])
    whole = reconstruct(model, ["c0", "c1"], harmonics=5, times=times).transition
    later = reconstruct(model, ["c0", "c1"], harmonics=5, times=times[1:3]).transition
    assert_allclose(whole[2], later[1] @ whole[1], rtol=1e-6, atol=1e-8)
    assert_allclose(np.linalg.det(whole[3]), np.exp(model.exponents.sum().real * model.period), rtol=1e-6)


@given(SEEDS, st.integers(1, 3), SYMMETRIES, st.integers(0, 2), SYMMETRIES, st.integers(0, 2))
def test_blocks_keep_their_symmetry_at_every_instant(seed, n, stiffness, waves, damping, others):
    structure = SecondOrder(
        stiffness=Block(harmonics=waves, symmetry=stiffness), damping=Block(harmonics=others, symmetry=damping)
    )
    basis, generator = structure.basis(n), np.random.default_rng(seed)
    known, slopes = basis.in_time(generator.uniform(-10.0, 10.0, 4))
    whole = known + np.tensordot(generator.standard_normal(len(basis.names)), slopes, 1)
    for symmetry, block in ((stiffness, whole[:, n:, :n]), (damping, whole[:, n:, n:])):
        if symmetry != "none":
            assert_allclose(block, block.swapaxes(1, 2), atol=1e-14)
        if symmetry == "diagonal":
            assert_allclose(block * (1.0 - np.eye(n)), 0.0, atol=1e-14)
    assert np.linalg.matrix_rank(slopes.reshape(len(slopes), -1)) <= len(slopes)
    free = {"none": n * n, "symmetric": n * (n + 1) // 2, "diagonal": n}
    assert len(basis.names) == free[stiffness] * (2 * waves + 1) + free[damping] * (2 * others + 1)


@settings(max_examples=8)
@given(SEEDS, st.booleans())
def test_any_system_of_its_structure_is_refined_exactly(seed, first_order):
    """Exponents, A(t) and Φ of a random system, from its own modes by `floquet.modes`."""
    generator, period = np.random.default_rng(seed), 1.7
    n, omega = 2, 2.0 * np.pi / 1.7
    waves = 0.4 * generator.standard_normal((2, 4, 4))
    whole = np.zeros((3, 4, 4))
    whole[0, :2, 2:] = np.eye(2)
    mix = 0.5 * generator.standard_normal()
    whole[0, 2:, :2] = -np.array([[9.0, mix], [mix, 22.0]])
    whole[0, 2:, 2:] = -np.diag(generator.uniform(0.05, 0.3, 2))
    whole[1:, 2:, :2] = waves[:, 2:, :2]
    if first_order:
        whole[1:] = 0.3 * waves
        whole[0, :2, :2] = 0.1 * generator.standard_normal((2, 2))
        whole[0] -= 0.15 * np.eye(4)

    def matrix(times):
        angle = omega * np.asarray(times, float)
        waves = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)
        return np.tensordot(waves, whole, 1)

    known = FunctionMatrix(function=matrix, period=period, vectorised=True)
    found = floquet.modes(known)
    upper, inner = np.flatnonzero(found.exponents.imag > 0), np.abs(found.harmonics) <= 2
    rows = 4 if first_order else n
    shapes = found.coefficients[upper][:, :rows, None][..., inner]
    own = estimates_of(found.exponents[upper], found.harmonics[inner], shapes, period, generator)
    structure = FirstOrder(system=Block(harmonics=1)) if first_order else SecondOrder(stiffness=Block(harmonics=1))
    result = refine(model_of(own), [f"c{i}" for i in range(rows)], structure, times=4)
    assert_allclose(result.state.system, matrix(result.state.times), atol=1e-7)
    assert_allclose(result.state.transition, floquet.transition(known, period, result.state.times), atol=1e-7)
    assert result.chi_square < 1e-3
