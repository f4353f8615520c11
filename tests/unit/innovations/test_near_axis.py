"""The block of a pair near an axis, and of two real multipliers of one sign."""

from dataclasses import replace

import numpy as np
import pytest

from floquid.innovations._derivatives import gradient, slopes
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import matrices, predicted
from floquid.innovations._solve import moved, normal_of, solve
from floquid.innovations.search._bands import anchored
from floquid.innovations.search._near_axis import (
    block_of_pair,
    block_of_reals,
    ordinary,
    read_near_axis,
    with_near_blocks,
)
from floquid.inputs import Limits, samples_of

OMEGA, STEP, COUNT = 1.3, 0.2, 600


def some_mode(generator, exponent, half=None):
    """A pair, or a real multiplier on an axis, of two channels and one input."""
    real = half is not None
    turns, reach = (
        (np.arange(half, 2.0), np.arange(half, 3.0)) if real else (np.arange(-1.0, 2.0), np.arange(-1.0, 3.0))
    )
    shape, gains = (
        0.08 * (generator.standard_normal((rows, len(band))) + 1j * generator.standard_normal((rows, len(band))))
        for rows, band in ((2, turns), (3, reach))
    )
    return Mode(exponent=complex(exponent), real=real, turns=turns, shape=shape, reach=reach, gains=gains)


def blocks(half, kind):
    """Ordinary modes of a kind near an axis, their predictor, and that of their block."""
    generator = np.random.default_rng(5)
    samples = samples_of(
        [generator.standard_normal((2, COUNT)) for _ in range(2)],
        [generator.standard_normal((1, COUNT)) for _ in range(2)],
        [0.4, 7.1],
        step=STEP,
        fundamental=OMEGA,
        hold="none",
    )
    states = generator.standard_normal((2, 2))
    if kind == "pair":
        modes = [some_mode(generator, -0.3 + 1j * (half * OMEGA + 0.08))]
        block, begun = block_of_pair(samples, modes[0], states)
    else:
        modes = [some_mode(generator, decay, half) for decay in (-0.2, -0.5)]
        block, begun = block_of_reals(modes, [states[:, :1], states[:, 1:]], OMEGA)
    columns = np.zeros((2, 2))
    return samples, predicted(samples, modes, columns, states), predicted(samples, [block], columns, begun)


KINDS = pytest.mark.parametrize(("half", "kind"), [(h, k) for h in (0.0, 0.5) for k in ("pair", "reals")])


@KINDS
def test_a_block_predicts_what_the_modes_do_that_it_stands_for(half, kind):
    samples, at, block = blocks(half, kind)
    assert np.abs(block.innovations - at.innovations).max() < 1e-10
    modes, states = ordinary(samples, block.modes[0], block.initial)
    again = predicted(samples, modes, block.columns, states)
    assert [mode.real for mode in modes] == [mode.real for mode in at.modes]
    assert np.allclose([mode.exponent for mode in modes], [mode.exponent for mode in at.modes])
    assert np.abs(again.innovations - at.innovations).max() < 1e-10


@pytest.mark.parametrize("half", [0.0, 0.5])
def test_a_block_has_no_harmonics_that_are_one_at_the_samples(half):
    """Of four samples a period a pair near -1 had those at 1.5 and at 2.5, which are conjugates."""
    generator = np.random.default_rng(5)
    drawn = [generator.standard_normal((rows, COUNT)) for rows in (2, 1)]
    step = 0.5 * np.pi / OMEGA
    samples = samples_of(drawn[:1], drawn[1:], [0.4], step=step, fundamental=OMEGA, hold="none")
    mode, states = some_mode(generator, -0.3 + 1j * (half * OMEGA + 0.08)), generator.standard_normal((1, 2))
    shape, gains = (np.tile(values[:, :2], 2) for values in (mode.shape, 0.5 * mode.gains))
    mode = replace(mode, turns=np.arange(-1.0, 3.0), shape=shape, reach=np.arange(-2.0, 2.0), gains=gains)
    block, begun = block_of_pair(samples, mode, states)
    assert max(block.turns[-1], block.reach[-1]) == 2.0 - half
    own, other = (predicted(samples, [one], np.zeros((2, 1)), two) for one, two in ((mode, states), (block, begun)))
    assert np.abs(own.innovations - other.innovations).max() < 1e-10


@KINDS
@pytest.mark.parametrize("which", [1, 2], ids=["modes", "block"])
def test_what_is_anchored_is_what_has_no_information(half, kind, which):
    """A block has two numbers for a scale: with one of them free, harmonics that are needed went."""
    samples, at = blocks(half, kind)[0], blocks(half, kind)[which]
    matrix, free = normal_of(samples, at).matrix, anchored(at)
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(size, size)
    rank = np.count_nonzero(np.linalg.eigvalsh(scaled) > 1e-10)
    assert np.count_nonzero(free) == rank
    assert np.linalg.eigvalsh(scaled[np.ix_(free, free)]).min() > 1e-10


@KINDS
@pytest.mark.parametrize("square", [None, 0.0, 1e-9])
def test_derivatives_of_a_block_are_those_of_differences_through_zero(half, kind, square):
    samples, _, at = blocks(half, kind)
    mode = at.modes[0]
    mode = mode if square is None else replace(mode, square=square)
    at = predicted(samples, [mode], at.columns, at.initial)
    whole = np.concatenate([part for _, part in slopes(samples, at, at.root)])
    generator = np.random.default_rng(2)
    for rows in (slice(0, 1), slice(1, 2), slice(2, None)):
        step = np.zeros(whole.shape[2])
        step[rows] = 1e-6 * generator.standard_normal(len(step[rows]))
        up, down = (at.white(moved(samples, at, sign * step, 1e-9).innovations) for sign in (1.0, -1.0))
        assert np.abs((up - down) / 2.0 - (whole @ step).T).max() < 1e-5 * np.abs(up - down).max()
    signals = generator.standard_normal(at.innovations.shape)
    expected = -np.einsum("kcp,ck->p", whole, at.white(signals))
    assert np.abs(gradient(samples, at, signals) - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("far", "open_kind"), [(0.02, True), (0.3, False), (None, True)], ids=["near", "far", "two real multipliers"]
)
def test_exponents_near_an_axis_are_read_for_both_kinds(far, open_kind):
    """A pair that is clear of the axis stays what it is; nearer, both kinds are within the deviations."""
    generator, times, turns = np.random.default_rng(0), STEP * np.arange(2000), np.arange(-1.0, 2.0)
    noise = generator.standard_normal((1, 2000))
    samples = samples_of([noise], [noise[:0]], [0.0], step=STEP, fundamental=OMEGA, hold="none")
    shape, gains = np.array([[0.3j, 1.0, 0.2]]), np.array([[0.09, 0.3 + 0.15j, 0.12j]])
    exponent = -0.1 + 1j * (0.5 * OMEGA + (far or 0.02))
    pair = Mode(exponent=exponent, real=False, turns=turns, shape=shape, reach=turns, gains=gains)
    block, begun = block_of_pair(samples, pair, np.zeros((1, 2)))
    modes = [pair] if far else ordinary(samples, replace(block, square=0.02**2), begun)[0]
    # What has these innovations: sample by sample, from a predictor of nothing.
    values, state = np.zeros((1, 2000)), np.zeros(2)
    system, driven, seen, _ = matrices(samples, modes)
    for number in range(len(times)):
        values[:, number] = seen[number] @ state + noise[:, number]
        state = system @ state + driven[number] @ noise[:, number]
    samples = samples_of([values], [noise[:0]], [0.0], step=STEP, fundamental=OMEGA, hold="none")
    start = solve(samples, predicted(samples, modes, np.zeros((1, 1)), np.zeros((1, 2))))
    assert far is None or with_near_blocks(samples, start, Limits(), pairs=False) is start
    near = read_near_axis(samples, with_near_blocks(samples, start, Limits()))
    assert [told.code for told in near.findings] == ["kind_open"] * open_kind
    assert near.at.log_likelihood > start.log_likelihood - 0.1
    truth = np.array([-0.1 + 1j * (far or 0.0), -0.1 - 1j * (far or 0.0)]) + (0.0 if far else np.array([0.02, -0.02]))
    for number, std in near.as_read.items():
        mode = near.at.modes[number]
        value = mode.exponent - (0.0 if mode.real else 0.5j * OMEGA)
        gap = truth[np.argmin(np.abs(truth - value))] - value
        assert abs(gap.real) < 3.0 * std.real
        assert abs(gap.imag) < 3.0 * std.imag
    assert bool(near.as_read) == open_kind
