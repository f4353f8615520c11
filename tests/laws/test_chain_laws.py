"""Identities of the chain: exact inverses, phase origins and branches, and Φ(t, t0) of a model.

Equation numbers are those of Allen (2009).
"""

import numpy as np
from hypothesis import given, reject
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from floquid.core import ConstantPeriod, Cycles, PeriodicModel, Record
from floquid.errors import IdentificationError
from floquid.lifting import lift, unlift
from floquid.lti import ModalModel
from floquid.periodic import assemble
from floquid.reconstruction import reconstruct
from floquid.sync import rejoin, segment

SEEDS = st.integers(0, 2**32 - 1)


@st.composite
def hits(draw, *, at_most=3):
    """Cycles of several hits, alike but for their numbers of cycles."""
    channels, phases = draw(st.integers(1, 4)), draw(st.integers(1, 9))
    period, first_phase = draw(st.floats(1e-3, 1e3)), draw(st.integers(0, 7)) / 8.0
    generator = np.random.default_rng(draw(SEEDS))
    return tuple(
        Cycles(
            values=generator.standard_normal((channels, phases, n_cycles)),
            periods=np.full(n_cycles, period),
            first_phase=first_phase,
            channels=[f"c{i}" for i in range(channels)],
        )
        for n_cycles in draw(st.lists(st.integers(2, 8), min_size=1, max_size=at_most))
    )


@given(hits())
def test_unlift_is_the_inverse_of_lift(several):
    back = unlift(lift(several))
    assert len(back) == len(several)
    for mine, given_ in zip(back, several, strict=True):
        assert_array_equal(mine.values, given_.values)
        assert_allclose(mine.periods, given_.periods, rtol=1e-14)
        assert mine.first_phase == given_.first_phase
        assert mine.channels == given_.channels


@given(hits(at_most=1))
def test_lift_of_unlift_changes_nothing(several):
    once = lift(several)
    twice = lift(unlift(once))
    assert_array_equal(twice.responses.values, once.responses.values)
    assert_array_equal(twice.responses.noise, once.responses.noise)


@given(hits(at_most=1))
def test_segment_is_the_inverse_of_rejoin(several):
    (cycles,) = several
    (back,) = segment(rejoin(cycles))
    assert_array_equal(back.values, cycles.values)
    assert_allclose(back.periods, cycles.periods, rtol=1e-12)
    assert abs(back.first_phase - cycles.first_phase) < 1e-9


@given(
    st.integers(1, 3),
    st.integers(1, 12),
    st.integers(1, 6),
    st.integers(0, 11),
    st.floats(1e-3, 1e3),
    st.floats(-10.0, 10.0),
    SEEDS,
)
def test_rejoin_is_the_inverse_of_segment_for_whole_periods(channels, phases, n_cycles, ahead, rate, origin, seed):
    record = Record(
        values=np.random.default_rng(seed).standard_normal((channels, phases * n_cycles)),
        sample_rate=rate,
        channels=[f"c{i}" for i in range(channels)],
        clock=ConstantPeriod(period=phases / rate, origin=origin),
        start=origin + (ahead % phases) / rate,
    )
    (cycles,) = segment(record)
    assert np.shares_memory(cycles.values, record.values)
    back = rejoin(cycles)
    assert_array_equal(back.values, record.values)
    assert_allclose(back.sample_rate, record.sample_rate, rtol=1e-12)
    turns = back.clock.phase(back.start) - record.clock.phase(record.start)
    assert abs(turns - round(turns)) < 1e-6


@given(st.integers(1, 10), st.lists(st.tuples(st.integers(-40, 40), st.integers(0, 60)), min_size=1, max_size=4))
def test_hits_that_start_anywhere_are_cut_to_one_phase(phases, starts):
    """Values count samples from phase zero, so that modulo the samples a period they name the phase."""
    records = [
        Record(
            values=(first + np.arange(2 * phases + more))[None, :].astype(float),
            sample_rate=float(phases),
            channels=["count"],
            clock=ConstantPeriod(period=1.0),
            start=first / phases,
        )
        for first, more in starts
    ]
    several = segment(records)
    wanted = (starts[0][0] + np.arange(phases)) % phases
    for cycles, record in zip(several, records, strict=True):
        assert_array_equal(cycles.values[0] % phases, np.repeat(wanted[:, None], cycles.n_cycles, axis=1))
        assert abs(cycles.first_phase * phases - wanted[0]) < 1e-6
        left_out = record.n_samples - phases * cycles.n_cycles
        assert 0 <= left_out < 2 * phases


@st.composite
def models(draw, *, n_pairs=None, channels=None, hits=None):
    """Pairs whose multipliers are apart, with a dominant zeroth harmonic so that the branch is not in doubt."""
    n_pairs = n_pairs or draw(st.integers(1, 3))
    channels, hits = channels or draw(st.integers(1, 3)), hits or draw(st.integers(1, 2))
    width, period = draw(st.integers(0, 3)), draw(st.floats(0.1, 10.0))
    generator = np.random.default_rng(draw(SEEDS))
    angles = np.pi * (np.arange(n_pairs) + generator.uniform(0.2, 0.8, n_pairs)) / n_pairs
    turns = generator.integers(-2, 3, n_pairs)
    upper = (generator.uniform(-0.2, 0.05, n_pairs) + 1j * (angles + 2.0 * np.pi * turns)) / period
    size = (n_pairs, channels, hits, 2 * width + 1)
    shapes = (generator.standard_normal(size) + 1j * generator.standard_normal(size)) * 0.3
    shapes[..., width] += 2.0 * np.exp(2j * np.pi * generator.uniform(size=size[:-1]))
    shapes *= 0.5 ** np.abs(np.arange(-width, width + 1))
    return PeriodicModel(
        exponents=np.stack([upper, upper.conj()], axis=1).ravel(),
        coefficients=np.stack([shapes, shapes[..., ::-1].conj()], axis=1).reshape(2 * n_pairs, *size[1:]),
        harmonics=np.arange(-width, width + 1),
        period=period,
        channels=[f"c{i}" for i in range(channels)],
    )


def identified(model, *, first, origin=0, n_phases=12, n_cycles=14, harmonics):
    """The model assembled from its own response, exactly lifted: `first` and `origin` in samples from t = 0."""
    step = model.period / n_phases
    values = model.response(step * (first + np.arange(n_phases * n_cycles)))
    clock = ConstantPeriod(period=model.period, origin=step * origin)
    lifted = lift(
        segment(
            [
                Record(
                    values=values[:, hit],
                    sample_rate=n_phases / model.period,
                    channels=model.channels,
                    clock=clock,
                    start=step * first,
                )
                for hit in range(model.n_hits)
            ]
        )
    )
    powers = model.multipliers ** np.arange(n_cycles)[:, None]
    flat = lifted.responses.values.reshape(-1, n_cycles).T.astype(complex)
    residues = np.linalg.lstsq(powers, flat, rcond=None)[0].reshape(model.order, -1, model.n_hits)
    modal = ModalModel(multipliers=model.multipliers, residues=residues, dt=lifted.period)
    return assemble(modal, lifted, harmonics=harmonics)


def in_order_of(model, found):
    """The position in `found` of each mode of `model`, exponents compared on their branches."""
    off = np.abs(np.subtract.outer(model.exponents, found.exponents))
    assert off.min(axis=1).max() < 1e-6 * (1.0 + np.abs(model.exponents).max())
    return np.argmin(off, axis=1)


@given(models(), st.integers(0, 11))
def test_the_delay_of_the_first_sample_is_taken_off(model, first):
    """Eq. (9): whichever phase the record starts at, within the first period the coefficients are the same."""
    width = int(model.harmonics[-1])
    found = identified(model, first=first, harmonics=width)
    order = in_order_of(model, found)
    assert_array_equal(found.harmonics, model.harmonics)
    assert_allclose(found.coefficients[order], model.coefficients, atol=1e-8)


@given(models(), st.integers(0, 11), st.integers(-15, 25))
def test_moving_the_phase_origin_turns_each_harmonic_of_a_residue(model, first, origin):
    """By e^{(λ + imω)τ}, with τ from the old t = 0 to the new one: phase zero at or before the first sample."""
    found = identified(model, first=first, origin=origin, harmonics=int(model.harmonics[-1]))
    ahead = (first - origin) % 12
    tau = model.period / 12 * (first - ahead)
    rates = model.exponents[:, None] + 1j * model.fundamental * model.harmonics
    turned = model.coefficients * np.exp(rates * tau)[:, None, None, :]
    order = in_order_of(model, found)
    assert_allclose(found.coefficients[order], turned, rtol=1e-7, atol=1e-8 * np.abs(turned).max())


@given(models(), st.lists(st.integers(-2, 2), min_size=3, max_size=3))
def test_the_branch_that_comes_in_does_not_matter(model, turns):
    """A harmonic's index moved by k and the exponent by -k iω: the same response, and the same model identified."""
    width = int(model.harmonics[-1])
    wide = np.arange(-width - 2, width + 3)
    coefficients = np.pad(model.coefficients, [(0, 0)] * 3 + [(2, 2)])
    exponents = np.array(model.exponents)
    for pair, k in zip(range(model.order // 2), turns, strict=False):
        for mode, sign in ((2 * pair, 1), (2 * pair + 1, -1)):
            coefficients[mode] = np.roll(coefficients[mode], sign * k, axis=-1)
            exponents[mode] -= 1j * sign * k * model.fundamental
    other = PeriodicModel(
        exponents=exponents,
        coefficients=coefficients,
        harmonics=wide,
        period=model.period,
        channels=model.channels,
    )
    found = identified(other, first=0, harmonics=width)
    order = in_order_of(model, found)
    assert_allclose(found.coefficients[order], model.coefficients, atol=1e-8)


@st.composite
def square_models(draw):
    """Models that `reconstruct` takes: as many channels as pairs of modes, their shapes well apart."""
    n_pairs = draw(st.integers(1, 3))
    model = draw(models(n_pairs=n_pairs, channels=n_pairs, hits=1))
    coefficients = np.array(model.coefficients)
    own = np.repeat(np.arange(n_pairs), 2)
    coefficients *= np.where(own[:, None] == np.arange(n_pairs), 1.0, 0.2)[:, :, None, None]
    return PeriodicModel(
        exponents=model.exponents,
        coefficients=coefficients,
        harmonics=model.harmonics,
        period=model.period,
        channels=model.channels,
    )


@given(square_models(), SEEDS)
def test_phi_carries_the_models_own_response(model, seed):
    """x(t) = Φ(t, t0) x(t0) for the states of the response itself, over more than a period, with Φ(t0, t0) = I."""
    generator = np.random.default_rng(seed)
    times = np.sort(generator.uniform(0.0, 2.5 * model.period, 9))
    names = [c.name for c in model.channels]
    try:
        state = reconstruct(model, names, times=times)
    except IdentificationError:  # shapes that happen to be linearly dependent
        reject()
    step = 1e-5 * model.period
    shapes = np.concatenate([model.shapes(times)[:, :, 0], _rates(model, times)], axis=1)
    states = np.einsum("rst,rt->ts", shapes, np.exp(np.multiply.outer(model.exponents, times))).real
    scale = np.abs(states).max(axis=0)
    assert_allclose(state.transition[0], np.eye(len(scale)), atol=1e-9 * state.condition.max())
    carried = np.einsum("tij,j->ti", state.transition, states[0])
    assert (np.abs(carried - states) / scale).max() < 1e-9 * state.condition.max()
    # The displacements' own rates, by central differences of the response.
    rates = (model.response(times + step) - model.response(times - step))[:, 0].T / (2.0 * step)
    assert_allclose(states[:, len(names) :], rates, atol=1e-5 * np.abs(rates).max())


def _rates(model, times):
    """The shapes of the velocities (modes, channels, times): each coefficient times λ + imω."""
    rates = model.exponents[:, None] + 1j * model.fundamental * model.harmonics
    phases = np.exp(1j * model.fundamental * np.multiply.outer(model.harmonics, times))
    return np.einsum("rcm,rm,mt->rct", model.coefficients[:, :, 0], rates, phases)
