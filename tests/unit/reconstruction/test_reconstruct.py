"""A(t) and Φ(t, t0) from a model: exact on the paper's rotor, for any motion, and refused where states cannot be had.

The truth is JeffcottRotor's own A(t) and the transition matrix integrated from it, which share no code with the chain.
"""

import dataclasses
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2

from floquid import floquet, identify
from floquid.core import Channel, PeriodicModel
from floquid.errors import IdentificationError, InputError
from floquid.fit import chi2_limit
from floquid.reconstruction import StateModel, reconstruct
from floquid.reconstruction._bands import FALSE_ALARM, scores, sizes_left_out, spread_of
from floquid.reconstruction._modal_matrix import by_system, modal_at, shapes_of, terms_of
from floquid.reconstruction._reconstruct import coordinates_of
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor()


@pytest.fixture(scope="module")
def model() -> PeriodicModel:
    """The rotor's response, identified without noise from two hits at two phases of the shaft."""
    records = [
        ROTOR.simulate(n_periods=400, noise=0.0, impulse_deg=45.0),
        ROTOR.simulate(n_periods=400, noise=0.0, impulse_deg=-20.0, first_phase=0.3),
    ]
    return identify(records, validate=False).model


def changed(model, **fields) -> PeriodicModel:
    return dataclasses.replace(model, **fields)


def measured_as(model, quantities) -> PeriodicModel:
    """The same motion seen by other sensors: coefficients times (λ + imω)^p, exactly."""
    powers = {"displacement": 0, "velocity": 1, "acceleration": 2}
    rates = model.exponents[:, None] + 1j * model.harmonics * model.fundamental
    p = np.array([powers[q] for q in quantities])
    coefficients = model.coefficients * (rates[:, None, :] ** p[:, None])[:, :, None, :]
    channels = [Channel(name=c.name, quantity=q) for c, q in zip(model.channels, quantities, strict=True)]
    return changed(model, coefficients=coefficients, coefficient_std=None, channels=channels)


STATES = {"mass": (["X", "Y"], ROTOR.system), "turntable": (["X_tt", "Y_tt"], ROTOR.turntable_system)}
EVERY_STATES = pytest.mark.parametrize(("states", "truth"), STATES.values(), ids=STATES)


@pytest.mark.first(3)
@EVERY_STATES
@pytest.mark.parametrize("times", [50, 7, np.array([0.3, 5.0, 40.0, -2.0])], ids=["50", "7", "any"])
def test_the_state_matrix_is_exact_without_noise(model, states, truth, times):
    state = reconstruct(model, states, times=times)
    assert_allclose(state.system, truth(state.times), atol=1e-6)
    assert state.states == (*states, f"d/dt {states[0]}", f"d/dt {states[1]}")
    assert state.system_std is not None
    assert state.system_std.max() < 1e-6


@EVERY_STATES
def test_the_transition_matrix_is_exact_without_noise(model, states, truth):
    times = np.array([0.7, 1.0, 3.0, 6.0, 25.0])
    state = reconstruct(model, states, times=times)
    assert_allclose(state.transition, floquet.transition(truth, ROTOR.period, times, start=times[0]), atol=1e-7)
    assert_allclose(state.transition[0], np.eye(4), atol=1e-12)


def test_phi_solves_its_own_equation(model):
    """Φ' = A Φ with the A that comes with it, by central differences."""
    step, t = 1e-3, 1.9
    state = reconstruct(model, ["X", "Y"], times=[0.4, t - step, t, t + step])
    rate = (state.transition[3] - state.transition[1]) / (2.0 * step)
    assert_allclose(rate, state.system[2] @ state.transition[2], atol=1e-6)


def test_times_by_number_are_the_instants_of_one_period(model):
    state = reconstruct(model, ["X", "Y"], times=8)
    assert_allclose(state.times, np.arange(8) * model.period / 8.0)
    assert reconstruct(model, ["X", "Y"]).times.shape == (50,)


@pytest.mark.parametrize(
    "quantities",
    [
        ("velocity",) * 4,
        ("acceleration",) * 4,
        ("acceleration", "displacement", "velocity", "displacement"),
    ],
    ids=["velocity", "acceleration", "mixed"],
)
@EVERY_STATES
def test_any_motion_gives_the_same_state_matrix(model, quantities, states, truth):
    """The states are the displacements behind the sensors, whatever these measure."""
    state = reconstruct(measured_as(model, quantities), states)
    assert_allclose(state.system, truth(state.times), atol=1e-6)


def test_the_order_of_the_states_is_that_asked_for(model):
    straight, turned = (reconstruct(model, names, times=5).system for names in (["X", "Y"], ["Y", "X"]))
    swap = [1, 0, 3, 2]
    assert_allclose(turned, straight[:, swap][:, :, swap], atol=1e-12)
    mixed = reconstruct(model, ["X", "Y_tt"], times=5)
    assert mixed.states == ("X", "Y_tt", "d/dt X", "d/dt Y_tt")
    assert np.isfinite(mixed.system).all()


def test_the_size_and_phase_of_a_hit_do_not_matter(model):
    """A mode's shape is known up to a factor a hit and mode; any such factors leave Φ and A as they are."""
    expected = reconstruct(model, ["X", "Y"], times=9)
    generator = np.random.default_rng(0)
    for hits in ([0], [1], [0, 1], [1, 0, 1]):
        factors = generator.uniform(0.1, 30.0, (2, len(hits))) * np.exp(2j * np.pi * generator.random((2, len(hits))))
        # A conjugate's shape is the conjugate: its factor too.
        factors = np.stack([factors, factors.conj()], axis=1).reshape(4, 1, len(hits), 1)
        other = changed(model, coefficients=model.coefficients[:, :, hits] * factors, coefficient_std=None)
        found = reconstruct(other, ["X", "Y"], times=9)
        assert_allclose(found.system, expected.system, atol=1e-8)
        assert_allclose(found.transition, expected.transition, atol=1e-8)


def test_hits_of_opposite_phase_do_not_cancel(model):
    """Factors 1 and i: their squares add up to zero, their sizes do not."""
    factors = np.array([[1.0, 1j], [1.0, -1j], [1.0, 1j], [1.0, -1j]])[:, None, :, None]
    other = changed(model, coefficients=model.coefficients[:, :, [0, 0]] * factors, coefficient_std=None)
    expected = reconstruct(model, ["X", "Y"], times=9).system
    assert_allclose(reconstruct(other, ["X", "Y"], times=9).system, expected, atol=1e-8)


def test_hits_are_combined_by_their_strength():
    """A mode that hit 2 does not excite is taken from hit 1, where it is clear, and not averaged with noise."""
    generator = np.random.default_rng(0)
    shape = np.array([1.0, 0.5j]).reshape(1, 2, 1, 1)
    coefficients = np.concatenate([shape, 1e-6 * generator.standard_normal((1, 2, 1, 1))], axis=2)
    other = np.array([0.3j, 1.0]).reshape(1, 2, 1, 1) * np.ones((1, 1, 2, 1))
    pairs = np.concatenate([coefficients, coefficients.conj(), other, other.conj()])
    exponents = np.array([-0.1 + 1j, -0.1 - 1j, -0.2 + 2.5j, -0.2 - 2.5j])
    both, one = (
        PeriodicModel(
            exponents=exponents,
            coefficients=pairs[:, :, chosen],
            harmonics=[0],
            period=1.0,
            channels=["a", "b"],
        )
        for chosen in ([0, 1], [0])
    )
    first, second = (reconstruct(m, ["a", "b"], times=3).system for m in (both, one))
    assert_allclose(first, second, atol=1e-5)


def test_the_branch_of_an_exponent_does_not_matter(model):
    k = 3
    exponents = model.exponents + 1j * k * model.fundamental * np.array([1, -1, 0, 0])
    width = np.pad(model.coefficients, [(0, 0)] * 3 + [(k, k)])
    width[0], width[1] = np.roll(width[0], -k, axis=-1), np.roll(width[1], k, axis=-1)
    harmonics = np.arange(model.harmonics[0] - k, model.harmonics[-1] + k + 1)
    other = changed(model, exponents=exponents, coefficients=width, harmonics=harmonics, coefficient_std=None)
    assert_allclose(
        reconstruct(other, ["X", "Y"], times=9).system, reconstruct(model, ["X", "Y"], times=9).system, atol=1e-8
    )


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "noise"), [(1, 0.02), (2, 0.1), (3, 0.1)])
def test_units_of_the_channels_do_not_matter_to_the_harmonics_of_a(seed, noise):
    record = JeffcottRotor(damping=0.02).simulate(n_periods=40, samples_per_period=12, noise=noise, seed=seed)
    units = np.ones(len(record.values))
    units[0] = 1e4
    other = dataclasses.replace(record, values=record.values * units[:, None])
    models = (identify(own, order=4, validate=False).model for own in (record, other))
    one, scaled = (reconstruct(model, ["X", "Y"]).system for model in models)
    scale = units[[0, 1, 0, 1]]
    assert_allclose(scaled / scale[:, None] * scale, one, atol=1e-9)


def test_units_of_the_states_do_not_matter_to_the_condition(model):
    """X in micrometres: A is transformed, and the equilibrated condition number is the same."""
    factor = np.array([1e6, 1.0, 1.0, 1.0])[:, None, None]
    other = changed(model, coefficients=model.coefficients * factor, coefficient_std=None)
    here, there = reconstruct(model, ["X", "Y"], times=5), reconstruct(other, ["X", "Y"], times=5)
    assert_allclose(there.condition, here.condition, rtol=1e-6)
    scale = np.array([1e6, 1.0, 1e6, 1.0])
    assert_allclose(there.system * scale / scale[:, None], here.system, atol=1e-7)


def refused(model, states, **options):
    with pytest.raises(InputError) as error:
        reconstruct(model, states, **options)
    assert str(error.value).startswith("Argument `")
    return str(error.value)


def test_an_unknown_channel_is_refused(model):
    message = refused(model, ["X", "Z"])
    assert "`states` of `reconstruct` must name channels of the record, but has 'Z'" in message
    assert "X, Y, X_tt, Y_tt" in message


def test_a_channel_given_twice_is_refused(model):
    assert "must name each channel once, but has 'X' twice" in refused(model, ["X", "X"])


def test_a_name_in_place_of_a_list_is_refused(model):
    assert "must be a list of channel names, but is 'X'" in refused(model, "X")


@pytest.mark.parametrize("states", [[], ["X"], ["X", "Y", "X_tt"]])
def test_a_wrong_number_of_states_is_refused(model, states):
    message = refused(model, states)
    assert "must name 2 channels: 4 modes" in message
    assert f"but names {len(states)}" in message


def test_too_few_channels_for_the_modes_are_told(model):
    one = changed(model, coefficients=model.coefficients[:, :1], coefficient_std=None, channels=[model.channels[0]])
    assert 'There are too few of them to span these modes: pass `form="delayed"`' in refused(one, ["X"])


def test_an_odd_number_of_modes_is_refused():
    odd = PeriodicModel(
        exponents=[-0.1], coefficients=np.ones((1, 2, 1, 1)), harmonics=[0], period=1.0, channels=["a", "b"]
    )
    assert "`model` of `reconstruct` must have an even number of modes" in refused(odd, ["a"])


@pytest.mark.parametrize("quantity", ["force", "strain", "angle", "pulse", "other"])
def test_what_is_no_motion_is_refused(model, quantity):
    channels = [Channel(name="X", quantity=quantity), *model.channels[1:]]
    message = refused(changed(model, channels=channels), ["X", "Y"])
    assert "must name channels of displacement, velocity or acceleration" in message
    assert f"channel 'X' measures {quantity}" in message


def test_no_instants_are_refused(model):
    assert "`times` of `reconstruct` must hold at least one instant" in refused(model, ["X", "Y"], times=0)
    assert "`times` of `reconstruct` must" in refused(model, ["X", "Y"], times=[])
    assert "`times` of `reconstruct` must be finite" in refused(model, ["X", "Y"], times=[0.0, np.nan])


def doubled(model, factor):
    """X measured twice, the second time `factor` times X with 1e-12 of Y."""
    coefficients = np.array(model.coefficients)
    coefficients[:, 1] = factor * coefficients[:, 0] + 1e-12 * coefficients[:, 1]
    return changed(model, coefficients=coefficients, coefficient_std=None)


@pytest.mark.parametrize("factor", [1.0, -250.0])
def test_linearly_dependent_channels_are_refused(model, factor):
    with pytest.raises(IdentificationError, match=r"shapes in X, Y are linearly dependent \(condition number") as error:
        reconstruct(doubled(model, factor), ["X", "Y"])
    condition = float(re.search(r"condition number ([\d.e+]+) ", str(error.value))[1])
    assert condition > 1e8


def test_a_channel_without_a_part_in_any_mode_is_refused(model):
    coefficients = np.array(model.coefficients)
    coefficients[:, 1] = 0.0
    with pytest.raises(IdentificationError, match="no part in any mode"):
        reconstruct(changed(model, coefficients=coefficients, coefficient_std=None), ["X", "Y"])


def test_a_displacement_that_is_not_in_a_velocity_record_is_refused():
    """A harmonic at zero frequency without decay: its displacement is a constant that no velocity shows."""
    still = PeriodicModel(
        exponents=[0.0, -0.1],
        coefficients=np.ones((2, 1, 1, 1)),
        harmonics=[0],
        period=1.0,
        channels=[Channel(name="v", quantity="velocity")],
    )
    with pytest.raises(IdentificationError, match="its displacement is not in the record"):
        reconstruct(still, ["v"])


def test_a_constant_system_has_a_constant_state_matrix():
    """Two real exponents in one channel: x'' + 3x' + 2x = 0."""
    still = PeriodicModel(
        exponents=[-1.0, -2.0], coefficients=np.ones((2, 1, 1, 1)), harmonics=[0], period=1.0, channels=["x"]
    )
    state = reconstruct(still, ["x"], times=4)
    assert_allclose(state.system, np.broadcast_to([[0.0, 1.0], [-2.0, -3.0]], (4, 2, 2)), atol=1e-12)


def test_the_result_is_read_only_and_says_where_it_is_from(model):
    state = reconstruct(model, ["X", "Y"])
    for name in ("times", "transition", "system", "condition"):
        assert not getattr(state, name).flags.writeable
    assert state.provenance.steps[-1] == "state matrix in second-order form from X, Y"
    assert (state.condition >= 1.0).all()


@pytest.mark.parametrize(
    ("field", "wrong"),
    [("system", np.zeros((3, 4, 4))), ("transition", np.zeros((2, 4, 3))), ("condition", np.zeros(3))],
)
def test_a_state_model_of_wrong_shape_is_refused(field, wrong):
    valid = {
        "times": np.zeros(2),
        "transition": np.zeros((2, 4, 4)),
        "system": np.zeros((2, 4, 4)),
        "condition": np.ones(2),
        "states": ("X", "Y", "d/dt X", "d/dt Y"),
    }
    assert_array_equal(StateModel(**valid).times, valid["times"])
    with pytest.raises(InputError, match=f"^Argument `{field}` of `StateModel` must have shape"):
        StateModel(**(valid | {field: wrong}))


# Which harmonics, and what those that are left out may do.


def cut(model, most) -> PeriodicModel:
    """The harmonics up to `most` alone, by hand."""
    return changed(model, coefficients=model.coefficients * (np.abs(model.harmonics) <= most), coefficient_std=None)


@pytest.fixture(scope="module")
def wide(oracle):
    """Two pairs with harmonics to ±6, of which those far out are below the noise."""
    return oracle.known(oracle.systems["pairs"], oracle.displacements(2), width=6, size=3e-5)


@pytest.mark.parametrize("most", [1, 2, 3])
def test_harmonics_by_number_are_those_of_a_model_cut_by_hand(wide, most):
    found = reconstruct(wide.model, ["c0", "c1"], harmonics=most, times=5)
    expected = reconstruct(cut(wide.model, most), ["c0", "c1"], times=5)
    assert_allclose(found.system, expected.system, rtol=1e-9, atol=1e-9)
    assert_allclose(found.transition, expected.transition, atol=1e-9)
    assert expected.system_std is None


def test_harmonics_of_the_model_are_those_it_keeps(wide):
    """A model whose coefficients were set to zero by hand, its estimates kept."""
    kept = changed(wide.model, coefficients=wide.model.coefficients * (np.abs(wide.model.harmonics) <= 2))
    found = reconstruct(kept, ["c0", "c1"], harmonics="model", times=5)
    assert_allclose(found.system, reconstruct(cut(wide.model, 2), ["c0", "c1"], times=5).system, rtol=1e-9, atol=1e-9)


def test_harmonics_of_a_real_multiplier_come_with_their_images(oracle):
    """Multipliers locked at half the fundamental: harmonics m ≥ 0 of the estimates, and -1 - m beside them."""
    known = oracle.known(oracle.systems["locked"], oracle.displacements(1), width=4)
    found = reconstruct(known.model, ["c0"], harmonics=1, times=5)
    both = np.isin(known.model.harmonics, [-2, -1, 0, 1])
    expected = changed(known.model, coefficients=known.model.coefficients * both, coefficient_std=None)
    assert_allclose(found.system, reconstruct(expected, ["c0"], times=5).system, rtol=1e-9, atol=1e-9)


def test_a_number_of_harmonics_without_estimates_is_refused(model):
    bare = changed(model, coefficient_std=None)
    assert '`harmonics` of `reconstruct` must be "auto" or "model" for a model without estimates' in refused(
        bare, ["X", "Y"], harmonics=2
    )


def errors(known, drawn, harmonics):
    state = reconstruct(drawn, ["c0", "c1"], harmonics=harmonics, times=16)
    return np.abs(state.system - known.system.at(state.times)).max(), state


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-6, 1e-4, 2e-3])
def test_the_automatic_harmonics_are_nearly_the_best_fixed_ones(oracle, size):
    """In the median over draws, at noise that shows many harmonics and at noise that shows few."""
    known = oracle.known(oracle.systems["pairs"], oracle.displacements(2), width=6, size=size)
    generator, found = np.random.default_rng(4), []
    for _ in range(9):
        drawn = known.drawn(generator)
        fixed = [errors(known, drawn, most)[0] for most in range(7)]
        found.append([errors(known, drawn, "auto")[0], *fixed])
    automatic, *fixed = np.median(found, axis=0)
    assert automatic < 1.2 * min(fixed)


def test_a_harmonic_that_is_left_out_makes_the_deviation_larger(oracle):
    """Cut off at one harmonic A(t) is wrong by what is left out, hardly by noise, and says so."""
    known = oracle.known(oracle.systems["pairs"], oracle.displacements(2), width=6, size=1e-9)
    full = reconstruct(known.model, ["c0", "c1"], harmonics=6, times=16)
    for most in (1, 2):
        off, state = errors(known, known.model, most)
        error = np.abs(state.system - known.system.at(state.times))[:, 2:]
        assert off > 1e-3
        said = np.sqrt(np.mean(state.system_std[:, 2:] ** 2))
        assert 0.4 < np.sqrt(np.mean(error**2)) / said < 2.5
        assert state.system_std[:, 2:].max() > 30.0 * full.system_std[:, 2:].max()


def test_sizes_of_what_is_left_out(wide):
    """The root mean square of harmonics drawn as the law has them, weighed by what was seen of all on their side."""
    own, rows = wide.estimates, np.array([True, True])
    band = np.abs(own.harmonics) <= 2
    sizes, generator = sizes_left_out(own, band, rows), np.random.default_rng(1)
    seen, noise = own.coefficients[..., 0], np.abs(own.std()[..., 0])
    first, ratio = np.exp(generator.uniform(np.log([0.01, 0.01]), np.log([10.0, 0.9]), (40_000, 2))).T
    for mode, side in [(mode, side) for mode in range(len(own.exponents)) for side in (-1, 1)]:
        inside = np.flatnonzero(band & (own.modes == mode))
        strongest = inside[np.argmax(np.sum(np.abs(seen[inside] / noise[inside]) ** 2, axis=1))]
        steps = side * (own.harmonics - own.harmonics[strongest])
        part = np.flatnonzero((own.modes == mode) & (steps > 0))
        weight, squares = np.ones(len(first)), []
        for term in part:
            large = np.abs(seen[strongest]) * (first * ratio ** steps[term])[:, None]
            both = np.hypot(large, noise[term])
            weight = weight * np.prod(np.exp(-((np.abs(seen[term]) / both) ** 2)) / both**2, axis=1)
            mean, spread = (large / both) ** 2 * np.abs(seen[term]), large * noise[term] / both
            squares.append(mean**2 + spread**2)
        for term, square in zip(part, squares, strict=True):
            expected = np.sqrt(np.average(square, axis=0, weights=weight)) if not band[term] else 0.0
            assert_allclose(sizes[term, :, 0], expected, rtol=0.05)  # a grid against draws
    assert_array_equal(sizes[band], 0.0)
    assert_array_equal(sizes_left_out(own, np.ones(len(own.modes), bool), rows), 0.0)


@pytest.mark.parametrize(("ratio", "least", "most"), [(0.03, 0.0, 0.4), (0.6, 0.8, 1.3)], ids=["fast", "slow"])
def test_a_shape_that_falls_fast_hides_little(oracle, ratio, least, most):
    """Beyond a band that falls fast less than the noise is hidden, beyond one that goes on what is seen."""
    own = oracle.known(oracle.systems["one"], oracle.displacements(1), width=6, size=1e-3).model.estimates
    noise, steps = np.abs(own.std()), np.abs(own.harmonics)[:, None, None]
    own = dataclasses.replace(own, coefficients=1e3 * noise.max() * ratio**steps + 0j)
    sizes = sizes_left_out(own, np.abs(own.harmonics) <= 1, np.array([True]))
    outer = np.abs(own.harmonics) == 3
    limit = np.maximum(np.abs(own.coefficients), noise)[outer]
    assert (least * limit <= sizes[outer]).all()
    assert (sizes[outer] <= most * limit).all()


@pytest.mark.slow
def test_what_sizes_of_any_phase_do(oracle):
    """Against changes along the axes of coefficients that are correlated as their estimates, through `reconstruct`."""
    known = oracle.known(oracle.systems["one"], oracle.displacements(1), width=2)
    own, coordinates = known.estimates, coordinates_of(known.model, ["c0"], "second-order", None)
    shapes, terms = shapes_of(known.model, coordinates, own), terms_of(known.model, own)
    times, sizes = np.array([0.3, 1.1]), 1e-6 * np.arange(5.0).reshape(5, 1, 1)
    modal = modal_at(shapes, times)
    found = spread_of(sizes, by_system(shapes, modal, times, slice(1, 2), terms), own)[0]
    covariance = own.row_covariance(0, 0)
    std = np.sqrt(np.diag(covariance))
    values, axes = np.linalg.eigh(covariance / np.outer(std, std))
    assert values.min() > -1e-12
    assert values.max() > 1.5  # correlated: phases of each term alone would not do
    total = 0.0
    for value, axis in zip(values.clip(0.0), axes.T, strict=True):
        real, imag = np.sqrt(0.5 * value) * np.tile(sizes[:, 0, 0], 2).reshape(2, 5) * axis.reshape(2, 5)
        shift = (real + 1j * imag).reshape(own.coefficients.shape)
        for sign in (1.0, -1.0):
            other = reconstruct(known.moved(np.zeros(3), sign * shift), ["c0"], harmonics=2, times=times)
            total = total + (other.system[1] - modal.system[1].real) ** 2 / 2
    assert_allclose(found[1], total[1], rtol=1e-4)


@pytest.mark.slow
def test_scores_of_noise_are_chi_squares(oracle):
    """Of two degrees of freedom a row, one for what does not turn, over their limit."""
    known = oracle.known(oracle.systems["overdamped"], oracle.displacements(1, (0, 1, 2)), hits=2, width=3)
    own = known.estimates
    nothing = changed(known.model, coefficients=0.0 * known.model.coefficients, estimates=replace_values(own))
    noise = dataclasses.replace(known, model=nothing)
    generator = np.random.default_rng(1)
    rows = np.array([True, False, True])
    found = np.array([scores(noise.drawn(generator).estimates, rows) for _ in range(80)])
    expected = np.where(own.turning, 2.0, 1.0) * 4 / chi2_limit(8, FALSE_ALARM / (2 * len(own.exponents)))
    assert_allclose(found.mean(axis=0), expected, rtol=0.25)


def replace_values(own):
    return dataclasses.replace(own, coefficients=0.0 * own.coefficients, slopes=0.0 * own.slopes)


@pytest.mark.first(1)
@pytest.mark.parametrize("name", ["pairs", "pair and real", "locked"])
def test_errors_and_their_deviations_agree_over_draws(oracle, name):
    """Of A(t) and Φ at every element and instant: mean squares of error over deviation."""
    system, generator = oracle.systems[name], np.random.default_rng(8)
    known = oracle.known(system, oracle.displacements(system.half), hits=2, width=8, size=1e-7)
    states, pulls = [c.name for c in known.model.channels], []
    for _ in range(24):
        found = reconstruct(known.drawn(generator), states, harmonics=20, times=3)
        phi = floquet.transition(system.oracle(), system.period, found.times)
        pulls.append(np.concatenate([
            ((found.system - system.at(found.times)) / np.where(found.system_std > 0, found.system_std, 1.0)).ravel(),
            ((found.transition - phi)[1:] / found.transition_std[1:]).ravel(),
        ]))  # fmt: skip
    squares = np.sum(np.square(pulls), axis=0)
    squares = squares[squares > 1e-6]
    low, high = chi2.ppf([1e-3 / (2 * squares.size), 1.0 - 1e-3 / (2 * squares.size)], 24)
    assert low < squares.min()
    assert squares.max() < high


@pytest.mark.parametrize("states", [[], ["a"], "all"], ids=str)
@pytest.mark.parametrize("form", ["second-order", "first-order", "delayed"])
def test_no_mode_at_all_has_no_state_matrix(states, form):
    empty = PeriodicModel(
        exponents=np.zeros(0), coefficients=np.zeros((0, 2, 1, 1)), harmonics=[0], period=1.0, channels=["a", "b"]
    )
    assert "`model` of `reconstruct` must have modes, but has none" in refused(empty, states, form=form)


def test_a_mode_cut_away_by_hand_leaves_too_little_for_the_states(wide):
    gone = changed(wide.model, coefficients=wide.model.coefficients * np.array([1, 1, 0, 0])[:, None, None, None])
    with pytest.raises(IdentificationError, match="linearly dependent"):
        reconstruct(gone, ["c0", "c1"], harmonics="model")


def test_instants_need_not_lie_in_one_period(wide):
    """Φ starts at the first of them, wherever that is and in any order."""
    times = np.array([3.3, 1.1, 7.9])
    found = reconstruct(wide.model, ["c0", "c1"], harmonics=6, times=times)
    inside = reconstruct(wide.model, ["c0", "c1"], harmonics=6, times=times % wide.system.period)
    assert_allclose(found.system, inside.system, atol=1e-9)
    assert_allclose(found.system_std, inside.system_std, rtol=1e-6, atol=1e-12)
    assert_allclose(found.transition[0], np.eye(4), atol=1e-12)
