"""αβ, dq and sequences against what they are by hand, and impedances against those of a circuit that is known."""

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import transfer_functions

from floquid import Channel, InputError, floquet
from floquid.core import ConstantPeriod, Record
from floquid.exports import from_periodic_system
from floquid.inputs import TransferFunctions
from floquid.views import impedance, to_alpha_beta, to_dq, to_sequence

L, R, C, LOAD, M = 2e-3, 0.4, 1.2e-3, 20.0, 0.45
PERIOD = 0.02
OMEGA = 2 * np.pi / PERIOD
A_THIRD = np.exp(2j * np.pi / 3)


def converter(n_phases=64):
    """A converter of an average model in αβ: with a dc link it couples sidebands, and is constant in dq."""
    return from_periodic_system(equations(), n_phases=n_phases)


def response(injected, phases):
    """Its response in the steady state to voltages that are held from sample to sample, some a period."""
    before = np.random.default_rng(9).standard_normal((2, 20 * phases))
    times = PERIOD / phases * np.arange(before.shape[1] + injected.shape[1])
    both = np.concatenate([before, injected], axis=1)
    return floquet.simulate(equations(), both, times, between="held")[:, before.shape[1] :]


def equations():
    mean = np.diag([-R / L, -R / L, -1 / (LOAD * C)])
    cosine, sine = np.zeros((2, 3, 3, 1))
    cosine[0, 2], cosine[2, 0] = -M / L, 1.5 * M / C
    sine[1, 2], sine[2, 1] = -M / L, 1.5 * M / C
    return floquet.PeriodicSystem(
        A=floquet.HarmonicMatrix.from_cosines(mean, cosine, sine, period=PERIOD), B=np.eye(3, 2) / L,
        inputs=["u_a", "u_b"], outputs=["i_a", "i_b", "v_dc"],
    )  # fmt: skip


def exactly(hertz):
    """The admittance in dq, frequency by frequency."""
    constant = np.array([[-R / L, OMEGA, -M / L], [-OMEGA, -R / L, 0.0], [1.5 * M / C, 0.0, -1 / (LOAD * C)]])
    return np.array([np.linalg.inv(2j * np.pi * f * np.eye(3) - constant)[:2, :2] / L for f in hertz])


@pytest.fixture(scope="module")
def lines():
    """G at lines every 10 Hz: sidebands 50 Hz away are among them, and beyond zero by conjugates."""
    return transfer_functions(converter(), np.arange(5.0, 500.0, 10.0), range(-4, 5))


def phases(values, extra=()):
    channels = [Channel(name=f"i_{phase}", unit="A") for phase in "abc"] + [c for c, _ in extra]
    rows = [*values, *(row for _, row in extra)]
    return Record(values=rows, sample_rate=1000.0, channels=channels, clock=ConstantPeriod(period=PERIOD, origin=0.003))


def three(hertz, size=1.0, sign=1, n=2000):
    """Three phases of a positive or a negative sequence."""
    times = np.arange(n) / 1000.0
    return np.array([size * np.cos(2 * np.pi * hertz * times - sign * k * 2 * np.pi / 3) for k in range(3)]), times


def test_balanced_phases_keep_their_amplitude_in_alpha_beta():
    values, times = three(50.0, 3.0)
    found = to_alpha_beta(phases(values + 0.5, [(Channel(name="v", unit="V"), times)]), ["i_a", "i_b", "i_c"])
    assert [channel.name for channel in found.channels] == ["i_alpha", "i_beta", "i_zero", "v"]
    np.testing.assert_allclose(found.values[0], 3.0 * np.cos(2 * np.pi * 50.0 * times), atol=1e-12)
    np.testing.assert_allclose(found.values[1], 3.0 * np.sin(2 * np.pi * 50.0 * times), atol=1e-12)
    np.testing.assert_allclose(found.values[2], 0.5, atol=1e-12)
    np.testing.assert_array_equal(found.values[3], times)
    assert "alpha, beta, zero" in found.provenance.steps[-1]


def test_the_grid_stands_still_in_dq_by_the_phase_of_the_clock():
    values, _ = three(50.0, 3.0)
    found = to_dq(phases(values), ["i_a", "i_b", "i_c"])
    phase = 2 * np.pi * 50.0 * 0.003  # of the grid where the clock is at phase zero
    np.testing.assert_allclose(found.values[0], 3.0 * np.cos(phase), atol=1e-9)
    np.testing.assert_allclose(found.values[1], 3.0 * np.sin(phase), atol=1e-9)
    two = to_alpha_beta(phases(values), ["i_a", "i_b", "i_c"])
    again = to_dq(two, ["i_alpha", "i_beta"])
    assert [channel.name for channel in again.channels] == ["i_d", "i_q", "i_zero"]
    np.testing.assert_allclose(again.values[:2], found.values[:2], atol=1e-9)


def test_missing_samples_stay_missing():
    values, _ = three(50.0)
    values[1, 7] = np.nan
    found = to_dq(phases(values), ["i_a", "i_b", "i_c"])
    assert np.argwhere(np.isnan(found.values)).tolist() == [[0, 7], [1, 7], [2, 7]]
    with pytest.raises(InputError, match="must have every sample"):
        to_sequence(phases(values), ["i_a", "i_b", "i_c"])


def test_sequences_of_a_record_are_those_of_phase_a():
    values = three(50.0, 3.0)[0] + three(50.0, 0.5, -1)[0] + 0.2
    found = to_sequence(phases(values), ["i_a", "i_b", "i_c"])
    _, times = three(50.0)
    np.testing.assert_allclose(found.values[0], 3.0 * np.cos(2 * np.pi * 50.0 * times), atol=1e-9)
    np.testing.assert_allclose(found.values[1], 0.5 * np.cos(2 * np.pi * 50.0 * times), atol=1e-9)
    np.testing.assert_allclose(found.values[2], 0.2, atol=1e-9)


def test_a_converter_is_constant_in_dq(lines):
    found = to_dq(lines, ["i_a", "i_b"], ["u_a", "u_b"], period=PERIOD, harmonics=[-2, -1, 0, 1, 2])
    assert [channel.name for channel in found.outputs] == ["i_d", "i_q", "v_dc"]
    assert [channel.name for channel in found.inputs] == ["u_d", "u_q"]
    assert found.unit(0, 0) == lines.unit(0, 0)
    middle = found.values[found.harmonics == 0][0, :2]
    assert found.frequencies_hz.max() == lines.frequencies_hz.max() - 50.0
    np.testing.assert_allclose(np.moveaxis(middle, 2, 0), exactly(found.frequencies_hz), atol=1e-9 * abs(middle).max())
    assert np.abs(found.values[found.harmonics != 0]).max() < 1e-9 * np.abs(middle).max()


def test_the_impedance_of_a_periodic_admittance_is_that_of_dq_inverted(lines):
    dq = to_dq(lines, ["i_a", "i_b"], ["u_a", "u_b"], period=PERIOD)
    found = impedance(dq, ["i_d", "i_q"], ["u_d", "u_q"])
    truth = np.linalg.inv(exactly(found.frequencies_hz))
    np.testing.assert_allclose(np.moveaxis(found.values[0], 2, 0), truth, rtol=1e-8)
    assert [channel.name for channel in found.inputs] == ["i_d", "i_q"]
    # With sidebands, in αβ: six harmonics need lines up to 300 Hz away.
    many = transfer_functions(converter(), np.arange(5.0, 1000.0, 10.0), range(-12, 13))
    stationary = impedance(many, ["i_a", "i_b"], ["u_a", "u_b"], period=PERIOD, harmonics=range(-4, 5))
    back = to_dq(stationary, ["u_a", "u_b"], ["i_a", "i_b"], period=PERIOD)
    truth = np.linalg.inv(exactly(back.frequencies_hz))
    np.testing.assert_allclose(np.moveaxis(back.values[0], 2, 0), truth, rtol=1e-6, atol=1e-6 * abs(truth).max())


def test_three_phases_are_alpha_beta_by_a_change_of_base(lines):
    clarke = np.array([[2, -1, -1], [0, 3**0.5, -(3**0.5)], [1, 1, 1]]) / 3.0
    back = np.linalg.inv(clarke)[:, :2]  # without a zero sequence
    outputs = [*(Channel(name=f"i{k}", unit="A") for k in "abc"), lines.outputs[2]]
    inputs = [Channel(name=f"u{k}", unit="V") for k in "abc"]
    values = np.zeros((len(lines.harmonics), 4, 3, len(lines.frequencies_hz)), complex)
    values[:, :3] = np.einsum("ai,mijf,jb->mabf", back, lines.values[:, :2], np.linalg.pinv(back))
    own = replace(lines, values=values, outputs=tuple(outputs), inputs=tuple(inputs))
    found = to_alpha_beta(own, ["ia", "ib", "ic"], ["ua", "ub", "uc"])
    assert [channel.name for channel in found.outputs] == ["i_alpha", "i_beta", "i_zero", "v_dc"]
    np.testing.assert_allclose(found.values[:, :2, :2], lines.values[:, :2], atol=1e-12)
    np.testing.assert_allclose(found.values[:, 2], 0.0, atol=1e-12)


def test_sequences_of_transfer_functions_couple_two_fundamentals_apart(lines):
    found = to_sequence(lines, ["i_a", "i_b"], ["u_a", "u_b"])
    assert [channel.name for channel in found.inputs] == ["u_positive", "u_negative"]
    own = {m: found.values[place] for place, m in enumerate(found.harmonics.tolist())}
    scale = np.abs(own[0]).max()
    assert np.abs(own[0][0, 1]).max() < 1e-9 * scale  # none between sequences at one frequency
    assert np.abs(own[-2][1, 0]).max() > 1e-2 * scale  # from positive at Ω to negative at Ω - 2ω
    assert np.abs(own[2][1, 0]).max() < 1e-9 * scale
    # A positive sequence alone is u_β = -i u_α.
    alpha, beta = (lines.values[lines.harmonics == 0][0, :2, k] for k in (0, 1))
    together = alpha - 1j * beta
    np.testing.assert_allclose(own[0][0, 0], 0.5 * (together[0] + 1j * together[1]), atol=1e-12)


@pytest.mark.slow
def test_deviations_are_those_of_many_draws(lines):
    generator = np.random.default_rng(0)
    std = (
        1e-3 * np.abs(lines.values).max() * (generator.uniform(1, 2, lines.values.shape) + 1j * generator.uniform(1, 2))
    )
    own = replace(lines, std=std)

    def changed(found):
        dq = to_dq(found, ["i_a", "i_b"], ["u_a", "u_b"], period=PERIOD)
        return dq, impedance(dq, ["i_d", "i_q"], ["u_d", "u_q"])

    draws = [[], []]
    for _ in range(200):
        noise = std.real * generator.standard_normal(std.shape) + 1j * std.imag * generator.standard_normal(std.shape)
        for kept, one in zip(draws, changed(replace(own, values=own.values + noise)), strict=True):
            kept.append(one.values)
    for kept, one in zip(draws, changed(own), strict=True):
        told, seen = one.std, np.array(kept)
        ratio = np.concatenate(
            [(seen.real.std(axis=0) / told.real).ravel(), (seen.imag.std(axis=0) / told.imag).ravel()]
        )
        # A line below 50 Hz is the conjugate of another, and is no independent one.
        assert np.median(ratio) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda g: to_dq(g, ["i_a", "i_b"]), "`period` of `to_dq` must be given with transfer functions"),
        (lambda g: to_dq(g, ["i_a", "nobody"], period=PERIOD), "nobody"),
        (lambda g: to_dq(g, ["i_a"], period=PERIOD), "each name three phases, or alpha and beta"),
        (lambda g: to_alpha_beta(g, ["i_a", "i_b"]), "each name three phases"),
        (lambda g: to_alpha_beta(g, "i_a"), "be lists of names"),
        (lambda g: to_dq(g, ["i_a", "v_dc"], period=PERIOD), "be of one unit each"),
        (lambda g: to_dq(g, ["i_a", "i_b"], ["u_a", "u_b"], period=0.0213), "have the harmonics and sidebands"),
        (lambda g: impedance(g, ["i_a"], ["u_a", "u_b"], period=PERIOD), "be as many as the voltages"),
        (lambda g: to_dq(3, ["a", "b"]), "be a Record, TransferFunctions or an Analysis"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(lines, call, words):
    outputs = [Channel(name=name, unit=unit) for name, unit in (("i_a", "A"), ("i_b", "A"), ("v_dc", "V"))]
    lines = replace(lines, outputs=tuple(outputs))
    with pytest.raises(InputError, match=words):
        call(lines)


def test_harmonics_that_were_not_measured_are_not_taken_for_zero(lines):
    few = TransferFunctions(
        frequencies_hz=lines.frequencies_hz, harmonics=[-1, 0, 1], values=lines.values[3:6], std=None,
        outputs=lines.outputs, inputs=lines.inputs,
    )  # fmt: skip
    with pytest.raises(InputError, match="have the harmonics and sidebands that are needed"):
        to_dq(few, ["i_a", "i_b"], ["u_a", "u_b"], period=PERIOD)


def test_a_record_needs_a_clock_for_dq():
    with pytest.raises(InputError, match="must have a clock"):
        to_dq(replace(phases(three(50.0)[0]), clock=None), ["i_a", "i_b", "i_c"])


def test_positive_sequence_is_the_phasor_of_phase_a():
    values, _ = three(50.0, 2.0)
    phasor = np.array([1.0, A_THIRD**-1, A_THIRD**-2])  # a, b, c of a positive sequence
    np.testing.assert_allclose(np.fft.rfft(values)[:, 100] / 1000.0, 2.0 * phasor, atol=1e-9)
