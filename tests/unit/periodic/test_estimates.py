"""`Estimates` against dense matrices, its makers against the Fisher information of the samples, and what a model says.

The dense side is written out here, parameter by parameter, and shares nothing with the factors that it judges.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from floquid import identify
from floquid.core import ConstantPeriod, Estimates, Record
from floquid.errors import InputError
from floquid.lifting import lift
from floquid.periodic import assemble
from floquid.periodic.least_squares import LiftedBlock, ModeParameters, RecordBlock, estimates_of, linearise, solve
from floquid.sync import segment


@pytest.fixture(scope="module")
def known(oracle):
    """A pair and two real multipliers, three channels, two hits, the period estimated too."""
    sensors = oracle.displacements(2, (0, 1))[:3]
    return oracle.known(oracle.systems["pair and real"], sensors, hits=2, width=2, free_period=True)


@pytest.fixture(scope="module")
def locked(oracle):
    """Two negative multipliers."""
    return oracle.known(oracle.systems["locked"], oracle.displacements(1), width=2, free_period=True)


def dense(own: Estimates) -> np.ndarray:
    """The covariance of (p, Re B, Im B), B raveled (terms, channels, hits)."""
    count, parts = own.coefficients.size, len(own.covariance)
    slopes = own.slopes.reshape(count, parts)
    whole = np.concatenate([np.eye(parts), slopes.real, slopes.imag])
    total = whole @ own.covariance @ whole.T
    places = np.arange(count).reshape(own.coefficients.shape)
    for channel, hit in np.ndindex(*own.blocks.shape):
        rows = parts + np.concatenate([places[:, channel, hit], count + places[:, channel, hit]])
        g = own.scales[:, channel, hit]
        spread = own.spread[own.blocks[channel, hit]]
        real, imag = np.split(np.eye(2 * len(g)), 2)
        turned = np.concatenate([g.real[:, None] * real - g.imag[:, None] * imag,
                                 g.imag[:, None] * real + g.real[:, None] * imag])  # fmt: skip
        total[np.ix_(rows, rows)] += turned @ spread @ turned.T
    return total


def test_deviations_are_those_of_the_dense_covariance(known):
    own = known.estimates
    std = np.sqrt(np.diag(dense(own)))[len(own.covariance) :].reshape(2, *own.coefficients.shape)
    assert_allclose(own.std(), std[0] + 1j * std[1], rtol=1e-10)


def test_the_noise_of_a_row_is_its_dense_block_at_known_exponents(known):
    own = known.estimates
    still = replace(own, covariance=np.zeros_like(own.covariance))
    whole, parts, count = dense(still), len(own.covariance), own.coefficients.size
    places = np.arange(count).reshape(own.coefficients.shape)
    for row in np.ndindex(*own.blocks.shape):
        rows = parts + np.concatenate([places[(slice(None), *row)], count + places[(slice(None), *row)]])
        block = own.noise_covariance(*row)
        assert_allclose(block, whole[np.ix_(rows, rows)], rtol=1e-10, atol=1e-14 * block.max())


@pytest.mark.parametrize("kind", ["pair and real", "locked"])
def test_variances_are_those_of_the_dense_covariance(known, locked, kind):
    """Every kind of slope, all at once and each alone; rates and exponents moved by differences of themselves."""
    known = locked if kind == "locked" else known
    own, generator = known.estimates, np.random.default_rng(0)
    n, parts, count = 5, len(own.covariance), len(own.exponents)

    def drawn(*shape):
        return generator.standard_normal((n, *shape)) + 1j * generator.standard_normal((n, *shape))

    whole = {
        "by_coefficients": drawn(*own.coefficients.shape),
        "by_rates": drawn(len(own.modes)) * 1e3,
        "by_exponents": drawn(count) * 1e3,
    }
    by_part = {
        "by_rates": np.zeros((len(own.modes), parts), complex),
        "by_exponents": np.zeros((count, parts), complex),
    }
    for part in known.free:
        off = np.zeros(parts)
        off[part] = 1e-4
        up, down = (known.moved(sign * off, 0.0).estimates for sign in (1.0, -1.0))
        by_part["by_rates"][:, part] = (up.rates - down.rates) / 2e-4
        by_part["by_exponents"][:, part] = (up.exponents - down.exponents) / 2e-4
    matrix = dense(own)
    for chosen in ("by_rates", "by_exponents", None):
        used = {k: v for k, v in whole.items() if chosen in (None, k) or k == "by_coefficients"}
        flat = used["by_coefficients"].reshape(n, -1)
        gradient = np.concatenate([np.zeros((n, parts)), flat.real, -flat.imag], axis=1)
        for name, slope in by_part.items():
            if name in used:
                gradient[:, :parts] += (used[name] @ slope).real
        assert_allclose(own.variance(**used), np.einsum("qi,ij,qj->q", gradient, matrix, gradient), rtol=1e-8)


def test_rate_slopes_are_differences_of_the_rates(known, locked):
    for one in (known, locked):
        for part in one.free:
            off = np.zeros(len(one.estimates.covariance))
            off[part] = 1e-4
            up, down = (one.moved(sign * off, 0.0).estimates.rates for sign in (1.0, -1.0))
            assert_allclose(one.estimates.rate_slopes[:, part], (up - down) / 2e-4, atol=1e-9)
        no_parameters = np.setdiff1d(np.arange(len(one.estimates.covariance)), one.free)
        assert len(no_parameters) == one.estimates.real.sum()
        assert_array_equal(one.estimates.rate_slopes[:, no_parameters], 0.0)


def test_what_turns(known, locked):
    own = known.estimates
    assert own.real.tolist() == [True, True, False]
    assert own.half_turns.tolist() == [0, 0, 0]
    still = own.real[own.modes] & (own.harmonics == 0)
    assert still.sum() == 2
    assert_array_equal(own.turning, ~still)
    assert_array_equal(own.multiplicity, np.where(still, 1.0, 2.0))
    # Half a fundamental: harmonics m and -1 - m are images, and all turn.
    assert locked.estimates.half_turns.tolist() == [1, 1]
    assert locked.estimates.turning.all()


def test_a_locked_mode_on_another_branch_has_other_half_turns(oracle):
    one = oracle.known(oracle.systems["locked"], oracle.displacements(1), width=2, turns=(1, -2))
    assert one.estimates.half_turns.tolist() == [3, -3]
    assert one.estimates.turning.all()


@pytest.mark.parametrize("modes", [None, [2, 0], [1]], ids=str)
@pytest.mark.parametrize("some", [False, True], ids=["all terms", "some terms"])
def test_picked_estimates_have_the_covariance_of_what_is_left(known, modes, some):
    """With the exponents of the other modes known, since their part of these coefficients' errors goes with them."""
    own = known.estimates
    kept = list(range(3)) if modes is None else modes
    out = np.setdiff1d(np.arange(3), kept)
    covariance = own.covariance.copy()
    covariance[np.concatenate([out, out + 3])] = 0.0
    covariance[:, np.concatenate([out, out + 3])] = 0.0
    own = replace(own, covariance=covariance)
    terms = (own.harmonics >= 0) if some else None
    found = own.picked(modes=modes, terms=terms)
    mask = np.ones(len(own.modes), bool) if terms is None else terms
    rows = [k for mode in kept for k in np.flatnonzero((own.modes == mode) & mask)]
    assert_array_equal(found.exponents, own.exponents[kept])
    assert_array_equal(found.rates, own.rates[rows])
    assert_array_equal(found.coefficients, own.coefficients[rows])
    parts = len(own.covariance)
    place = np.arange(own.coefficients.size).reshape(own.coefficients.shape)[rows].ravel()
    index = np.concatenate([
        kept, np.add(kept, 3), [6], parts + place, parts + own.coefficients.size + place
    ]).astype(int)  # fmt: skip
    whole = dense(own)[np.ix_(index, index)]
    assert_allclose(dense(found), whole, rtol=1e-10, atol=1e-14 * whole.max())


def test_a_term_is_found_by_mode_and_harmonic(known):
    own = known.estimates
    for k, (mode, harmonic) in enumerate(zip(own.modes, own.harmonics, strict=True)):
        assert own.term(int(mode), int(harmonic)) == k
    assert own.term(0, 99) is None


def test_the_deviation_of_the_period(known):
    found = known.variances(lambda model: np.array([model.period]))
    assert_allclose(known.estimates.period_std(), np.sqrt(found[0]), rtol=1e-6)
    given = replace(known.estimates, covariance=np.zeros_like(known.estimates.covariance))
    assert given.period_std() == 0.0


@pytest.mark.parametrize(
    ("field", "wrong", "said"),
    [
        ("modes", lambda own: own.modes + 1, "must name modes of `exponents`"),
        ("modes", lambda own: own.modes - 1, "must name modes of `exponents`"),
        ("blocks", lambda own: own.blocks + 2, "must name blocks of `spread`"),
        ("blocks", lambda own: own.blocks - 2, "must name blocks of `spread`"),
        ("real", lambda own: own.real[:2], "must name modes of `exponents`"),
        ("spread", lambda own: own.spread[:, :-1], "must have shape"),
        ("covariance", lambda own: own.covariance[:-1, :-1], "must have shape"),
        ("slopes", lambda own: own.slopes[..., :-1], "must have shape"),
        ("fundamental", lambda own: 0.0, "must be positive"),
    ],
)
def test_what_does_not_belong_together_is_refused(known, field, wrong, said):
    with pytest.raises(InputError, match=said) as error:
        replace(known.estimates, **{field: wrong(known.estimates)})
    assert "of `Estimates`" in str(error.value)


def test_estimates_are_read_only(known):
    for name in ("exponents", "real", "modes", "coefficients", "covariance", "slopes", "spread", "scales"):
        assert not getattr(known.estimates, name).flags.writeable


# What a model says of itself.


@pytest.fixture(scope="module", params=["pairs", "pair and real", "locked", "growing"])
def said(request, oracle):
    """Models with their period estimated: sensors of two hits."""
    system = oracle.systems[request.param]
    return oracle.known(system, oracle.displacements(system.half), hits=2, width=2, free_period=True)


@pytest.mark.first(6)
@pytest.mark.parametrize(
    ("value", "std"),
    [
        ("exponents", "exponent_std"),
        ("multipliers", "multiplier_std"),
        ("frequencies_hz", "frequency_std_hz"),
        ("damping_ratios", "damping_ratio_std"),
    ],
)
def test_deviations_of_a_model_are_those_of_its_numbers(said, value, std):
    """Also what an estimated period does to a multiplier."""
    whole = said.variances(lambda m: np.array([np.real(getattr(m, value)), np.imag(getattr(m, value))]))
    found = getattr(said.model, std)
    size = np.sqrt(whole).max()
    assert_allclose(np.real(found), np.sqrt(whole[0]), rtol=1e-5, atol=1e-7 * size)
    if np.iscomplexobj(found):
        assert_allclose(np.imag(found), np.sqrt(whole[1]), rtol=1e-5, atol=1e-7 * size)


def test_deviations_of_multipliers_at_a_known_period(oracle):
    one = oracle.known(oracle.systems["pairs"], oracle.displacements(2), width=1)
    whole = one.variances(lambda m: np.array([m.multipliers.real, m.multipliers.imag]))
    assert_allclose(one.model.multiplier_std, np.sqrt(whole[0]) + 1j * np.sqrt(whole[1]), rtol=1e-5)


def test_deviations_of_shapes_are_those_of_the_shapes(said):
    """At phases of the period; what other modes' exponents do to a shape counts too."""
    phases = np.array([0.0, 0.31, 0.77])
    whole = said.variances(lambda m: np.array([m.shapes(phases * m.period).real, m.shapes(phases * m.period).imag]))
    found = said.model.shape_std(phases * said.model.period)
    size = np.sqrt(whole).max()
    assert_allclose(found.real, np.sqrt(whole[0]), rtol=1e-5, atol=1e-7 * size)
    assert_allclose(found.imag, np.sqrt(whole[1]), rtol=1e-5, atol=1e-7 * size)


def test_a_shape_of_one_harmonic_deviates_as_its_coefficient(said):
    alone = said.model.coefficients * (said.model.harmonics == 0)
    model = replace(said.model, coefficients=alone)
    at_zero = model.shape_std([0.0])[..., 0]
    upper = ~np.isin(np.arange(model.order), model.modes_of(said.estimates)[said.estimates.real])
    expected = model.coefficient_std[..., model.harmonics == 0][..., 0]
    assert_allclose(at_zero[upper], expected[upper], rtol=1e-10)


def test_estimates_of_another_model_are_refused(known):
    other = replace(known.estimates, exponents=known.estimates.exponents + 1e-3)
    with pytest.raises(InputError, match="`estimates` of `PeriodicModel` must belong to the model"):
        replace(known.model, estimates=other)
    fewer = replace(known.model, channels=known.model.channels[:2], coefficients=known.model.coefficients[:, :2],
                    coefficient_std=None, estimates=None)  # fmt: skip
    with pytest.raises(InputError, match="must belong to the model"):
        replace(fewer, coefficient_std=np.zeros_like(fewer.coefficients), estimates=known.estimates)


def test_a_model_without_deviations_keeps_no_estimates(known):
    bare = replace(known.model, coefficient_std=None)
    assert bare.estimates is None
    assert bare.shape_std([0.0]) is None


# The makers, against the Fisher information of all samples.


class Filtered(LiftedBlock):
    """Samples that went through a filter: e^{st} comes out multiplied by 1/(s + 2)."""

    def gain(self, rates, *, slope=False):
        value = -1.0 / (rates + 2.0) ** 2 if slope else 1.0 / (rates + 2.0)
        return np.tile(value, (len(self.rows), 1))


@dataclass(frozen=True)
class Case:
    """Modes with bands, and how they are sampled."""

    exponents: tuple[complex, ...]
    real: tuple[bool, ...]
    offsets: tuple[float, ...]
    bands: tuple[tuple[int, int], ...]
    hits: int = 1
    free_period: bool = False
    kind: str = "lifted"


CASES = {
    "a pair": Case((-0.06 + 1.7j,), (False,), (0.0,), ((-1, 2),)),
    "close pairs, two hits": Case((-0.06 + 1.7j, -0.05 + 1.8j), (False,) * 2, (0.0,) * 2, ((-1, 1), (0, 1)), hits=2),
    "real": Case((-0.05, -0.2), (True, True), (0.0, 0.0), ((-1, 1), (0, 2))),
    "locked": Case((-0.05, -0.2), (True, True), (0.5, -0.5), ((-2, 1), (-1, 2)), free_period=True),
    "growing beside a pair": Case((0.02 + 0.9j, -0.2 + 2.0j), (False,) * 2, (0.0,) * 2, ((-1, 1), (0, 1))),
    "period estimated": Case((-0.06 + 1.7j, -0.05), (False, True), (0.0, 0.0), ((-1, 1), (0, 1)), free_period=True),
    "as sampled": Case((-0.06 + 1.7j, 0.01 + 0.8j), (False,) * 2, (0.0,) * 2, ((-1, 1), (0, 1)), kind="record",
                       free_period=True),
    "filtered": Case((-0.06 + 1.7j, -0.05), (False, True), (0.0, 0.0), ((-1, 1), (0, 1)), kind="filtered"),
}  # fmt: skip
N_CYCLES, N_PHASES, CHANNELS = 14, 9, 2


def fisher(case: Case, seed: int = 0):
    """The fit of a noise-free response, and the covariance of (p, Re B, Im B) by a dense Jacobian.

    Every coefficient is one of (terms, channels, hits); what does not turn has no imaginary part.
    """
    period, generator = 2.3, np.random.default_rng(seed)
    omega = 2.0 * np.pi / period
    entries = ModeParameters.made(
        np.where(case.real, np.real(case.exponents), case.exponents),
        np.array(case.bands),
        omega,
        real=case.real,
        offsets=case.offsets,
    )
    entries = replace(entries, free_period=case.free_period)
    columns, sines = entries.columns(), entries.sines()
    rates, turns = columns.rates, columns.turns
    n = len(rates)
    values = generator.standard_normal((n, CHANNELS, case.hits)) + 1j * generator.standard_normal(
        (n, CHANNELS, case.hits)
    )
    values[~sines] = values[~sines].real
    step = period / N_PHASES
    whole = step * np.arange(N_CYCLES * N_PHASES)
    if case.kind == "record":
        whole = np.sort(np.random.default_rng(9).random(130)) * 30.0
    # The second hit is shorter: its sums are its own.
    lengths = [len(whole), len(whole) - 4 * N_PHASES][: case.hits]
    gain = 1.0 / (rates + 2.0) if case.kind == "filtered" else np.ones(n)
    twice = np.where(sines, 2.0, 1.0)
    waves = np.exp(np.multiply.outer(whole, rates)) * gain * twice
    data = [np.einsum("tk,kc->ct", waves[:length], values[:, :, hit]).real for hit, length in enumerate(lengths)]
    noise = 1e-6 * (1.0 + np.arange(CHANNELS * case.hits).reshape(CHANNELS, case.hits))
    rows = np.arange(CHANNELS)
    if case.kind == "record":
        blocks = [RecordBlock(whole[: len(one.T)], one, h, rows, noise[:, h]) for h, one in enumerate(data)]
    else:
        clock = ConstantPeriod(period=period)
        records = [Record(values=one, sample_rate=1.0 / step, channels=["a", "b"], clock=clock) for one in data]
        lifted = lift(segment(records)).with_noise(noise)
        kind = Filtered if case.kind == "filtered" else LiftedBlock
        blocks = [kind(lifted, h, rows, noise[:, h]) for h in range(case.hits)]
    count = len(case.exponents)
    own = columns.modes[:, None] == np.arange(count)
    moves = np.concatenate([own, 1j * own, 1j * turns[:, None]], axis=1)  # of each rate by each part
    slopes = waves * (whole[:, None] + (-1.0 / (rates + 2.0) if case.kind == "filtered" else 0.0))
    free = np.concatenate(
        [np.arange(count), count + np.flatnonzero(~np.array(case.real)), [2 * count] * case.free_period]
    )
    free = free.astype(int)
    size = values.size
    places = np.arange(size).reshape(values.shape)
    information = np.zeros((2 * count + 1 + 2 * size,) * 2)
    for channel, hit in np.ndindex(CHANNELS, case.hits):
        jacobian = np.zeros((lengths[hit], len(information)))
        by_rate = slopes[: lengths[hit]] * values[:, channel, hit]
        jacobian[:, : 2 * count + 1] = (by_rate @ moves).real
        at = 2 * count + 1 + places[:, channel, hit]
        own_waves = waves[: lengths[hit]]
        jacobian[:, at], jacobian[:, at + size] = own_waves.real, -own_waves.imag
        information += jacobian.T @ jacobian / noise[channel, hit] ** 2
    still = np.flatnonzero(~np.broadcast_to(sines[:, None, None], values.shape).ravel())
    used = np.setdiff1d(np.arange(len(information)), np.concatenate([
        np.setdiff1d(np.arange(2 * count + 1), free), 2 * count + 1 + size + still
    ]))  # fmt: skip
    covariance = np.zeros_like(information)
    covariance[np.ix_(used, used)] = np.linalg.inv(information[np.ix_(used, used)])
    return blocks, entries, values, covariance


@pytest.mark.parametrize("name", CASES)
def test_estimates_of_a_fit_have_the_inverse_of_the_fisher_information(name):
    blocks, entries, values, covariance = fisher(CASES[name])
    own = estimates_of(blocks, solve(blocks, entries))
    assert_allclose(own.coefficients, values, atol=1e-7 * np.abs(values).max())
    found, size = dense(own), np.sqrt(np.diag(covariance))
    scale = np.where(size > 0, size, 1.0)
    # The noise of the coefficients is taken off the information (Kaufman): a share of 1e-6 squared here.
    assert_allclose(found / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=2e-5)


def test_estimates_say_where_they_were_made_also_beside_the_best(oracle):
    """Slopes at exponents that are not the best are those of the coefficients' own fit there, by differences."""
    blocks, entries, _, _ = fisher(CASES["close pairs, two hits"])
    own = estimates_of(blocks, linearise(blocks, entries))
    for part, move in ((0, 1.0), (1, 1.0), (2, 1j), (3, 1j)):
        shift = np.zeros(2, complex)
        shift[part % 2] = 1e-5 * move
        both = [
            estimates_of(blocks, linearise(blocks, replace(entries, exponents=entries.exponents + sign * shift)))
            for sign in (1.0, -1.0)
        ]
        by = (both[0].coefficients - both[1].coefficients) / 2e-5
        assert_allclose(own.slopes[..., part], by, rtol=1e-4, atol=1e-4 * np.abs(by).max())


def free_fisher(records, model, noise):
    """The covariance of (λ of the upper mode, B of the estimates) with a free residue at each phase, dense."""
    own, period = model.estimates, model.period
    (cycles,) = segment(records)
    channels, phases, n = cycles.values.shape
    lam, tau = own.exponents[0], period * np.arange(phases) / phases
    powers = np.exp(lam * period * np.arange(n))
    slope = np.arange(n) * period * powers
    harmonics = own.harmonics
    values = []
    information = np.zeros((2 + 2 * channels * phases,) * 2)
    for row, (channel, phase) in enumerate(np.ndindex(channels, phases)):
        basis = np.stack([2.0 * powers.real, -2.0 * powers.imag], axis=1)
        a, b = np.linalg.lstsq(basis, cycles.values[channel, phase], rcond=None)[0]
        values.append(a + 1j * b)
        jacobian = np.zeros((n, len(information)))
        by = 2.0 * slope * (a + 1j * b)
        jacobian[:, 0], jacobian[:, 1] = by.real, -by.imag
        jacobian[:, 2 + 2 * row : 4 + 2 * row] = basis
        information += jacobian.T @ jacobian / noise[channel] ** 2
    covariance, residues = np.linalg.inv(information), np.reshape(values, (channels, phases))
    kernel = np.exp(-np.multiply.outer(lam + 2j * np.pi / period * harmonics, tau)) / phases
    coefficients = np.einsum("kp,cp->kc", kernel, residues)
    total = np.zeros((2 * coefficients.size, len(information)))
    for k, channel in np.ndindex(*coefficients.shape):
        by = np.zeros(len(information), complex)
        moved = -(kernel[k] * tau) @ residues[channel]
        by[0], by[1] = moved, 1j * moved
        at = 2 + 2 * (channel * phases + np.arange(phases))
        by[at], by[at + 1] = kernel[k], 1j * kernel[k]
        place = k * channels + channel
        total[place], total[coefficients.size + place] = by.real, by.imag
    return coefficients, total @ covariance @ total.T, covariance[:2, :2]


def test_free_residues_have_the_inverse_of_their_fisher_information(oracle):
    one = oracle.known(oracle.systems["one"], oracle.displacements(1, (0, 1)), width=2)
    times = one.model.period / 7.0 * np.arange(20 * 7)
    clean = one.model.response(times)[:, 0]
    noise = 1e-5 * np.abs(clean).max(axis=1)
    values = clean + noise[:, None] * np.random.default_rng(0).standard_normal(clean.shape)
    record = Record(values=values, sample_rate=7.0 / one.model.period, channels=one.model.channels,
                    clock=ConstantPeriod(period=one.model.period))  # fmt: skip
    analysis = identify(record, order=2, constrained=False, validate=False)
    lifted = lift(segment([record])).with_noise(noise[:, None])
    free = assemble(analysis.modal, lifted)
    own = free.estimates
    expected, covariance, of_exponent = free_fisher([record], free, noise)
    assert_allclose(own.coefficients[..., 0], expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())
    assert_allclose(own.covariance[:2, :2], of_exponent, rtol=0.25, atol=0.02 * of_exponent.max())
    found = dense(replace(own, covariance=np.pad(of_exponent, (0, 1))))[3:, 3:]
    scale = np.sqrt(np.diag(covariance))
    assert_allclose(found / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=2e-3)


@pytest.mark.parametrize("name", CASES)
def test_slopes_at_other_coefficients_are_those_of_a_response_that_has_them(name):
    """The factors that the slopes follow from are of the exponents and the sampling alone."""
    blocks, entries, _, _ = fisher(CASES[name])
    own = estimates_of(blocks, solve(blocks, entries))
    blocks, entries, values, _ = fisher(CASES[name], seed=1)
    other = estimates_of(blocks, solve(blocks, entries))
    parts = np.flatnonzero(np.diag(own.covariance) > 0)
    size = np.abs(other.slopes).max()
    for row in np.ndindex(*own.blocks.shape):
        here = own.slopes_at(own.coefficients[(slice(None), *row)], *row)
        assert_allclose(here[:, parts], own.slopes[(slice(None), *row)][:, parts], atol=1e-6 * size)
        there = own.slopes_at(values[(slice(None), *row)], *row)
        assert_allclose(there[:, parts], other.slopes[(slice(None), *row)][:, parts], atol=1e-6 * size)


def test_slopes_without_their_factors_are_those_estimated(known):
    own = known.estimates
    assert own.drift is None
    assert_array_equal(own.slopes_at(2.0 * own.coefficients[:, 1, 0], 1, 0), own.slopes[:, 1, 0])
