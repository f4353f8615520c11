"""One shape for all hits: least squares by brute force, the Cramér-Rao bound, and hits that disagree."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.paper._residues import identified_residue
from tests.several_hits import Hits

from floquid import identify
from floquid.checks._left_out import _of_hits
from floquid.periodic import refit
from floquid.periodic.least_squares import ModeParameters, OneShape, eliminated, forced_entries, record_blocks
from floquid.periodic.least_squares._estimates import estimates_of_shapes
from floquid.periodic.search._one_shape import narrowed
from floquid.pipeline.free._starts import lasting
from floquid.testing import pair_exponents

PAIRS = [-0.2 + 2.1j, -0.35 + 4.0j]


def blocks_of(hits, seed=0):
    records = hits.records(seed)
    blocks, fundamental, _ = record_blocks(records, [record.clock for record in records], 1.0)
    return [block.with_noise(np.full(len(block.rows), hits.noise)) for block in blocks], fundamental


def entries_of(hits, fundamental, width=1):
    lam = hits.exponents
    pairs = ModeParameters.made(lam[lam.imag != 0], (-width, width), fundamental)
    return pairs.joined(ModeParameters.made(lam[lam.imag == 0], (-width, width), fundamental, real=True))


def one_of(hits, *, forced=(), seed=0):
    blocks, fundamental = blocks_of(hits, seed)
    entries = forced_entries(forced, fundamental).joined(entries_of(hits, fundamental))
    return OneShape.at(blocks, entries, eliminated(blocks, entries))


CASES = {
    "pairs": (PAIRS, ()),
    "beside a real multiplier": ([-0.2 + 2.1j, -0.5], ()),
    "beside a growing mode": ([0.05 + 2.1j, -0.5], ()),
    "beside an offset and a forced response": (PAIRS, (0.0, 1.0)),
}


@pytest.fixture(params=CASES, scope="module")
def one(request):
    exponents, forced = CASES[request.param]
    return one_of(Hits.drawn(exponents, 3, 6), forced=forced)


def test_the_cost_is_that_of_least_squares_by_all_samples(one):
    """Shapes and forced responses by one linear system, of samples and no sums."""
    columns, cost = one.entries.columns(), 0.0
    beside = np.setdiff1d(np.arange(len(columns.modes)), one.own)
    for channel in range(one.n_channels):
        rows, target = [], []
        for hit, block in enumerate(one.blocks):
            nothing = np.zeros((len(columns.modes), len(block.rows)), complex)
            _, samples = block.residual(columns, nothing)
            design = []
            for column in range(len(columns.modes)):
                for unit in (0.5, 0.5j):
                    values = nothing.copy()
                    values[column] = unit
                    design.append(samples[0] - block.residual(columns, values)[1][0])
            parts = np.array(design).T.reshape(len(samples[0]), -1, 2)
            # 2 Re B z = Re (a c z): by Re c, then by Im c.
            turned = one.states[one.modes, hit] * (parts[:, one.own, 0] - 1j * parts[:, one.own, 1])
            shared = np.concatenate([turned.real, -turned.imag], axis=1)
            apart = np.zeros((len(samples[0]), len(one.blocks), 2 * len(beside)))
            apart[:, hit] = parts[:, beside].reshape(len(samples[0]), -1)
            rows.append(np.concatenate([shared, apart.reshape(len(samples[0]), -1)], axis=1))
            target.append(samples[channel])
        design, values = np.concatenate(rows), np.concatenate(target)
        left = values - design @ np.linalg.lstsq(design, values, rcond=1e-11)[0]
        cost += float(left @ left) / one.blocks[0].noise[channel] ** 2
    assert one.cost == pytest.approx(cost, rel=1e-8)


def test_the_gradient_is_that_of_the_cost(one):
    size = len(one.parameters)
    steps = 1e-5 * np.eye(size)
    slopes = np.array([one.moved(step).cost - one.moved(-step).cost for step in steps]) / 2e-5
    assert -0.5 * slopes == pytest.approx(one.normal.gradient, rel=1e-4, abs=1e-3 * np.sqrt(one.cost))


def test_the_residual_has_the_cost(one):
    columns = one.entries.columns()
    for block, values, left in zip(one.blocks, one.coefficients, one.left, strict=True):
        _, residual = block.residual(columns, 0.5 * values)
        assert np.sum(residual**2, axis=1) == pytest.approx(left, rel=1e-8)


@pytest.mark.slow
def test_brief_hits_reach_the_truth_where_residues_of_their_own_are_not_determined():
    """Twelve hits of two periods, five numbers a channel and mode: each hit alone determines nothing."""
    hits = Hits.drawn([-1.2 + 2.1j, -0.9 + 4.0j], 12, 2, width=2, noise=0.01)
    blocks, fundamental = blocks_of(hits)
    entries = entries_of(hits, fundamental, width=2)
    found = OneShape.at(blocks, entries, eliminated(blocks, entries)).solved()
    numbers = found.n_numbers + found.n_rates
    samples = sum(block.n_samples * len(block.rows) for block in blocks)
    assert found.cost == pytest.approx(samples - numbers, abs=5.0 * np.sqrt(2.0 * samples))
    std = np.sqrt(np.diag(found.covariance)[:2]), np.sqrt(np.diag(found.covariance)[2:4])
    off = found.entries.exponents - hits.exponents
    assert (np.abs(off.real) < 4.0 * std[0]).all()
    assert (np.abs(off.imag) < 4.0 * std[1]).all()


def test_numbers_used_add_up(one):
    found = one.solved()
    beside = 2 * (len(found.entries.sines()) - len(found.own)) * sum(len(block.rows) for block in found.blocks)
    free = len(found.free) + int(np.where(found.entries.real, 1, 2)[~found.entries.fixed].sum())
    assert sum(each.sum() for each in found.used) == pytest.approx(
        len(found.kept) * found.n_channels + free + found.n_rates + beside
    )


def test_harmonics_of_noise_are_left_out_and_others_stay():
    hits = Hits.drawn(PAIRS, 4, 12)
    blocks, fundamental = blocks_of(hits)
    entries = entries_of(hits, fundamental, width=3)
    found = OneShape.at(blocks, entries, eliminated(blocks, entries)).solved()
    assert narrowed(found, 1e-6).tolist() == [[-1, 1], [-1, 1]]
    assert (narrowed(found, 0.9)[:, 1] - narrowed(found, 0.9)[:, 0] > 2).any()


@pytest.fixture(scope="module")
def hits():
    return Hits.drawn(PAIRS, 3, 30)


@pytest.fixture(scope="module")
def analysis(hits):
    return identify(hits.records(0))


def test_deviations_are_the_least_that_there_are(hits):
    blocks, fundamental = blocks_of(replace(hits, noise=1e-6))
    blocks = [block.with_noise(np.full(len(block.rows), hits.noise)) for block in blocks]
    entries = entries_of(hits, fundamental)
    estimates = estimates_of_shapes(OneShape.at(blocks, entries, eliminated(blocks, entries)))
    exponents, coefficients = hits.bound()
    std = np.sqrt(np.diag(estimates.covariance))
    assert std[:2] == pytest.approx(exponents.real, rel=1e-4)
    assert std[2:4] == pytest.approx(exponents.imag, rel=1e-4)
    own = np.moveaxis(estimates.std().reshape(2, 3, *coefficients.shape[1:3]), 1, -1)
    assert own.real == pytest.approx(coefficients.real, rel=1e-4)
    assert own.imag == pytest.approx(coefficients.imag, rel=1e-4)
    # Of all hits together, as a shape for A(t) is built of them.
    whole = estimates.variance(by_coefficients=np.ones((1, *estimates.coefficients.shape), complex))
    assert whole == pytest.approx([hits.bound_of_sum() ** 2], rel=1e-4)


def test_coefficients_are_a_shape_times_a_state(analysis):
    model = analysis.model
    assert model.one_shape
    for mode in range(model.order):
        values = np.linalg.svd(np.moveaxis(model.coefficients[mode], 1, -1).reshape(-1, model.n_hits))[1]
        assert values[1] < 1e-12 * values[0]
    assert "one_shape" in [finding.code for finding in analysis.fit.findings]
    assert analysis.passed


def test_hits_that_disagree_are_told_and_keep_shapes_of_their_own(hits, analysis):
    states = hits.states.copy()
    states[:, -1] = 1.5, 1.0j
    hits, other = replace(hits, states=states), hits.shapes.copy()
    other[0, 0, 1] *= 1.3
    found = identify(hits.records(0, other=other), validate=False)
    (warned,) = (finding for finding in found.findings if finding.code == "hits_disagree")
    assert warned.numbers["frequency"] == pytest.approx(2.1 / (2.0 * np.pi), rel=1e-2)
    # Two modes of one multiplier would be in all hits.
    assert found.fit.constrained
    assert found.model.order == 4
    assert not found.model.one_shape
    assert "The hits disagree on the shape of the mode at 0.3339 Hz by 5.5 %" in str(warned)
    assert "Hits 1, 2 share one shape, and hit 3 another." in str(warned)
    assert "may be two of one multiplier" in " ".join(found.choice.doubts)
    assert "hits_disagree" not in [finding.code for finding in analysis.findings]


def test_hits_of_unlike_decay_are_told_and_the_deviation_covers_them(hits, analysis):
    """The mode passed eight of its deviations from either, and another one was blamed for its shape."""
    hits = replace(hits, states=np.array([[1.5, 1.0, 1.5j], [1.0, 1.2j, 1.0j]]), noise=0.01)
    slower = replace(hits, exponents=hits.exponents + np.array([0.008, 0.0]))
    found = identify([*hits.records(0)[:2], slower.records(0)[2]], validate=False)
    (warned,) = (finding for finding in found.findings if finding.code == "hits_unlike")
    assert warned.numbers["frequency"] == pytest.approx(2.1 / (2.0 * np.pi), rel=1e-2)
    assert warned.numbers["hits"][1] == 3
    assert warned.numbers["decays"] == pytest.approx([0.2, 0.192], abs=1e-3)
    place = int(np.argmin(np.abs(found.model.exponents - (-0.2 + 2.1j))))
    off = np.abs(found.model.exponents[place].real + np.array([0.2, 0.192]))
    assert (off < 4.0 * found.model.exponent_std[place].real).all()
    assert "hits_unlike" not in [finding.code for finding in analysis.findings]


def test_as_many_poles_as_a_hit_has_periods():
    """Eight hits of six periods determine three modes: residues of one hit alone were asked for, and refused."""
    hits = Hits.drawn([-0.25 + 1.0j, -0.5 + 2.1j, -0.7 + 4.0j], 8, 6, noise=0.03)
    found = identify(hits.records(0))
    assert found.passed
    assert found.model.order == 6
    assert found.model.one_shape
    pairing = pair_exponents(found.model.exponents, [*hits.exponents, *hits.exponents.conj()], 1.0)
    assert (np.abs(pairing.differences) < 4.0 * np.abs(found.model.exponent_std[pairing.permutation])).all()
    # The residues at each phase are those of the shapes.
    own = identified_residue(found, 0, 0, 3)
    phases = found.lifted.phase_times
    assert own == pytest.approx(found.model.shapes(phases)[0, 0, 3], rel=1e-9)


def test_a_mode_next_to_a_copy_of_itself_is_not_determined():
    """The direction between them was left out of the inverse, as if both were known to all digits."""
    hits = Hits.drawn(PAIRS, 3, 6)
    blocks, fundamental = blocks_of(hits)
    entries = entries_of(hits, fundamental)
    copy = replace(entries.picked([0]), exponents=entries.exponents[:1] + 1e-7)
    entries = entries.joined(copy)
    one = OneShape.at(blocks, entries, eliminated(blocks, entries))
    std = np.sqrt(np.diag(one.of_rates()))
    assert (std[[0, 2]] > 0.2).all()
    assert std[1] < 0.05


def test_hits_that_agree_are_not_told_to_disagree_where_one_shape_moves_a_mode(hits, monkeypatch):
    """A weak mode that ran away was told as hits that disagree, by chance 1."""
    monkeypatch.setattr("floquid.periodic.search._one_shape.FARTHEST", 0.0)
    found = identify(hits.records(0), validate=False)
    assert not found.model.one_shape
    assert "hits_disagree" not in [finding.code for finding in found.findings]


def test_deviations_of_a_shape_at_an_instant_are_those_of_its_coefficients(analysis):
    model = analysis.model
    whole = model.shape_std([0.0])[..., 0]
    assert (whole.real > 0.0).all()
    alone = model.coefficient_std[..., list(model.harmonics).index(0)]
    assert (np.abs(whole) < 10.0 * np.abs(alone)).all()


def test_a_refit_keeps_one_shape(hits, analysis):
    found = refit(analysis.model, analysis.fit.free, analysis.clocks, noise=analysis.noise, one_shape=True)
    assert found.one_shape
    assert np.abs(found.exponents - analysis.model.exponents) == pytest.approx(
        0.0, abs=3.0 * np.abs(found.exponent_std).max()
    )
    free = refit(analysis.model, analysis.fit.free, analysis.clocks, noise=analysis.noise)
    assert not free.one_shape
    assert (free.exponent_std.real > found.exponent_std.real).all()


def test_one_hit_says_nothing_of_shapes(hits):
    found = identify(hits.records(0)[0], validate=False)
    assert not found.model.one_shape
    assert not {"one_shape", "hits_disagree"} & {finding.code for finding in found.fit.findings}


@pytest.mark.slow
def test_brief_hits_pass():
    """Four periods of twelve hits hold four poles that die in two: each hit alone would be too short."""
    brief = Hits.drawn([-2.0 + 1.6j, -1.0 + 0.9j], 12, 4, phases=16, noise=0.01)
    found = identify(brief.records(0))
    assert found.fit.constrained
    assert found.model.one_shape
    assert found.passed, found.reasons
    own = [int(np.argmin(np.abs(found.model.exponents - value))) for value in brief.exponents]
    off, std = found.model.exponents[own] - brief.exponents, found.model.exponent_std[own]
    assert (np.abs(off.real) < 4.0 * std.real).all()
    assert (np.abs(off.imag) < 4.0 * std.imag).all()
    assert (std.real < 0.01).all()


def test_a_mode_that_is_gone_after_its_first_period_has_no_exponent():
    found = identify(Hits.drawn([-2.0 + 1.6j], 8, 4, phases=16, noise=0.01).records(0), validate=False).fit
    assert lasting(found)
    model = found.model
    assert not lasting(replace(found, model=replace(model, exponents=model.exponents - 8.0, estimates=None)))


@pytest.mark.parametrize("hits", [2, 3, 12])
def test_each_part_of_brief_hits_is_left_out_once(hits):
    cycles = [np.repeat([0, 1, -1], [16, 16, 8])] * hits
    folds = _of_hits(cycles, 2)
    whole = np.sum([list(fold) for fold in folds.masks], axis=0)
    assert (whole == (np.array(cycles) >= 0)).all()
    for fold in folds.masks:
        assert not np.all([mask.any() for mask in fold])
        # What is left of each hit tells its states.
        assert all((~mask & (own == 0)).sum() >= 8 for mask, own in zip(fold, cycles, strict=True))
