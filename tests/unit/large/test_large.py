"""Records larger than memory: the same exponents, deviations, noise and residues as of the record in memory."""

import errno
from dataclasses import replace
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import floquid as fq
from floquid.core import ConstantPeriod, LazyRecord, Record
from floquid.errors import IdentificationError, InputError
from floquid.large import _identify, _part, _result
from floquid.large._modes import Plan
from floquid.lti import fit_residues

PHASES = 12
MODES = np.array([-0.002 + 1.3j, -0.0015 + 2.5j, -0.004 + 0.4j])


def decay(exponents=MODES, *, channels=5, cycles=900, noise=0.3, seed=0, draw=0):
    """A decay of modes with five harmonics each about an offset, at a period of a second."""
    generator, times = np.random.default_rng(seed), np.arange(PHASES * cycles) / PHASES
    turns, values = np.arange(-2, 3), np.full((channels, len(times)), 0.7)
    for exponent in exponents:
        shape = generator.standard_normal((channels, 5, 2)) @ np.array([1.0, 1j]) * 0.5 ** np.abs(turns)
        values += 2.0 * (np.exp(exponent * times) * (shape @ np.exp(2j * np.pi * np.outer(turns, times)))).real
    values += noise * np.random.default_rng(1000 + draw).standard_normal(values.shape)
    names = [f"x{row}" for row in range(channels)]
    return Record(values=values, sample_rate=PHASES, channels=names, clock=ConstantPeriod(period=1.0))


def lazy(record, **changes):
    """The same record, its array in place of a file."""
    kept = {"array": record.values, "channels": record.channels, "clock": record.clock, "sample_rate": PHASES}
    return LazyRecord(**{**kept, **changes})


def pulls(found, exponents, std):
    """Differences of exponents over deviations, modulo the fundamental (modes, 2)."""
    gaps = np.subtract.outer(found, exponents)
    gaps = gaps.real + 1j * (np.mod(gaps.imag + np.pi, 2.0 * np.pi) - np.pi)
    near = np.abs(gaps).argmin(axis=1)
    gap = gaps[np.arange(len(found)), near]
    return np.stack([gap.real / std.real, gap.imag / np.where(std.imag > 0, std.imag, np.inf)], axis=1)


@pytest.fixture(autouse=True)
def unchecked(monkeypatch):
    """Leave no room for the checks of a part, where these are not asked for."""
    monkeypatch.setattr(_identify, "COPIES", 1e12)


@pytest.fixture
def small_part(monkeypatch):
    monkeypatch.setattr(_identify, "COPIES", 80.0)
    monkeypatch.setattr(_part, "CHANNELS", 6)
    monkeypatch.setattr(_part, "SAMPLES", 6 * 300 * PHASES)


@pytest.mark.first(1)
@pytest.mark.parametrize("constrained", [False, True])
def test_it_agrees_with_the_fit_in_memory(constrained, tmp_path):
    record = decay()
    found = fq.identify_large(lazy(record), tmp_path / "r.h5")
    whole = fq.identify(record, constrained=constrained, validate=False)
    upper = list(whole.model.upper_modes)
    exponents, std = whole.model.exponents[upper], whole.model.exponent_std[upper]
    assert len(found.exponents) == len(upper) == 3
    assert np.abs(pulls(found.exponents, exponents, found.exponent_std)).max() < 0.05
    order = [np.argsort(value.real) for value in (found.exponents, exponents)]
    assert_allclose(found.exponent_std[order[0]], std[order[1]], rtol=0.01)
    assert_allclose(found.noise, whole.noise[:, 0], rtol=0.005)


def test_constants_leave_no_mode(tmp_path):
    """At this level of noise the constants of the sketch are off by more than it, in most draws."""
    found = fq.identify_large(lazy(decay(noise=0.05)), tmp_path / "r.h5")
    assert len(found.exponents) == 3
    assert found.failed is False


def test_a_growing_mode_and_real_multipliers(tmp_path):
    record = decay([0.001 + 1.3j, -0.006 + 0j, -0.01 + 1j * np.pi], noise=0.05)
    found = fq.identify_large(lazy(record), tmp_path / "r.h5")
    assert sorted(found.real.tolist()) == [False, True, True]
    truth = np.array([0.001 + 1.3j, 0.001 - 1.3j, -0.006, -0.01 + 1j * np.pi])
    assert np.abs(pulls(found.exponents, truth, found.exponent_std)).max() < 4.5


def test_residues_are_those_of_least_squares(tmp_path):
    record = decay()
    found = fq.identify_large(lazy(record), tmp_path / "r.h5")
    about = record.values.reshape(5, -1, PHASES) - record.values.reshape(5, -1, PHASES).mean(axis=1, keepdims=True)
    lifted = about.transpose(0, 2, 1).reshape(5 * PHASES, 1, -1)
    multipliers = np.concatenate([found.multipliers, found.multipliers.conj()])
    modal = fit_residues(multipliers, fq.lti.TimeResponses(values=lifted, dt=1.0))
    own = found.residues()
    for mode, multiplier in enumerate(found.multipliers):
        place = int(np.abs(modal.multipliers - multiplier).argmin())
        assert_allclose(own[:, mode].ravel(), modal.residues[place, :, 0], atol=0.01)
    assert_array_equal(found.residues(slice(1, 3)), own[1:3])


def test_a_search_without_time_goes_on_with_what_it_has_and_fails(tmp_path):
    """After a second blow there is no end to modes: 5 min were over without a result."""
    record = decay(noise=0.05)
    values, blow = record.values.copy(), 450 * PHASES
    values[:, blow:] += decay(noise=0.0, seed=5).values[:, :-blow]
    found = fq.identify_large(lazy(record, array=values), tmp_path / "r.h5", seconds=0.3)
    assert found.failed
    assert len(found.exponents) > 0
    assert "second blow" in found.reasons[0]


SHIFTED = ConstantPeriod(period=1.0, origin=-0.3)


@pytest.mark.slow
def test_the_model_is_that_of_the_record_in_memory(tmp_path):
    record = decay([-0.003 + 4.98j, -0.003 + 4.99j, -0.01 + 1j * np.pi], cycles=300, noise=0.05).with_clock(SHIFTED)
    found = fq.identify_large(lazy(record, clock=SHIFTED), tmp_path / "r.h5")
    assert (found.exponents.imag > 0.0).all()
    model = found.model
    whole = fq.identify(record, constrained=False, validate=False).model
    assert_array_equal(model.harmonics, whole.harmonics)
    assert_allclose(model.exponents, whole.exponents, atol=1e-7)
    assert_allclose(model.covariance, whole.covariance, rtol=0.02, atol=1e-3 * np.abs(whole.covariance).max())
    assert (np.abs(model.coefficients - whole.coefficients) <= 0.01 * np.abs(whole.coefficient_std)).all()
    assert_allclose(model.coefficient_std, whole.coefficient_std, rtol=0.01, atol=1e-9)
    slopes = whole.estimates.slopes
    assert_allclose(model.estimates.slopes, slopes, atol=1e-3 * np.abs(slopes).max())
    assert model.point == whole.point


def test_the_model_makes_the_response(tmp_path):
    """Phase zero is 0.3 s before the first sample: a wrong sign of the phase or of a conjugate is far off."""
    record = decay([-0.003 + 1.3j, -0.006 + 0j, -0.01 + 1j * np.pi], noise=0.05).with_clock(SHIFTED)
    found = fq.identify_large(lazy(record, clock=SHIFTED), tmp_path / "r.h5")
    rest = record.values - found.model.response(np.arange(record.n_samples) / PHASES + 0.3)[:, 0]
    assert_allclose(rest.std(axis=1), found.noise, rtol=0.01)
    part = found.model_of(slice(1, 3))
    assert [channel.name for channel in part.channels] == ["x1", "x2"]
    assert_allclose(part.response([0.4, 20.2]), found.model.response([0.4, 20.2])[1:3], atol=0.05)


@pytest.mark.slow
def test_deviations_of_coefficients_hold_over_draws(tmp_path):
    models = [
        fq.identify_large(lazy(decay(MODES[:1], cycles=300, draw=draw)), tmp_path / "r.h5").model for draw in range(60)
    ]
    places = [np.searchsorted(model.harmonics, np.arange(-2, 3)) for model in models]
    values = np.array([model.coefficients[..., own] for model, own in zip(models, places, strict=True)])
    std = models[0].coefficient_std[..., places[0]]
    for spread, told in ((values.real.std(axis=0), std.real), (values.imag.std(axis=0), std.imag)):
        assert 0.9 < np.sqrt(np.mean((spread / told) ** 2)) < 1.1


def test_a_model_that_has_no_room_is_refused(tmp_path, monkeypatch):
    found = fq.identify_large(lazy(decay(cycles=300)), tmp_path / "r.h5")
    monkeypatch.setattr(_result, "LARGEST", 4e4)
    with pytest.raises(InputError, match=r"model_of\(slice\(0, 2\)\)"):
        _ = found.model
    assert len(found.model_of(slice(0, 2)).channels) == 2


@pytest.mark.slow
@pytest.mark.usefixtures("small_part")
def test_results_are_loaded_compared_and_followed(tmp_path):
    path = tmp_path / "r.h5"
    fq.identify_large(lazy(decay(cycles=400)), path)
    found = fq.load(path)
    assert isinstance(found, fq.LargeResult)
    pairs = fq.compare(found, fq.identify(decay(cycles=400), validate=False)).pairs
    assert len(pairs) == 3
    assert all(pair.mac > 0.999 for pair in pairs)
    slower = [replace(found, period=period, exponents=found.exponents / period) for period in (1.05, 1.1)]
    followed = fq.survey([path, *slower])
    assert [len(track.points) for track in followed.tracks] == [3, 3, 3]
    assert all(point.passed for point in followed.points)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match="damaged or not whole"):
        fq.load(path)


def checked(record, tmp_path, *, period=1.0, order=None):
    """The result of a record."""
    return fq.identify_large(lazy(record, clock=ConstantPeriod(period=period)), tmp_path / "r.h5", order=order)


@pytest.mark.slow
@pytest.mark.usefixtures("small_part")
def test_modes_in_no_single_channel_and_loud_noise_pass(tmp_path):
    """A slow decay in loud noise is random to whoever looks at a part of it; a mode that it hides is no reason."""
    record = decay(channels=40, cycles=600, noise=3.0)
    weak = decay(MODES[:1] - 0.4j, channels=40, cycles=600, noise=0.0, seed=9).values - 0.7
    found = checked(replace(record, values=record.values + 0.2 * weak), tmp_path)
    assert len(found.exponents) == 4
    assert (found.passed, found.failed, found.reasons, found.part) == (True, False, (), (6, 300))
    assert "(6 of 40 channels, 300 of 600 periods): passes." in found.summary()


@pytest.mark.slow
@pytest.mark.usefixtures("small_part")
def test_a_mode_that_the_part_cannot_show_is_no_reason(tmp_path, monkeypatch):
    monkeypatch.setattr(_part, "CHANNELS", 1)
    monkeypatch.setattr(_part, "SAMPLES", 256 * PHASES)
    record = decay(MODES[:2], channels=40, cycles=600, noise=3.0)
    weak = decay(MODES[:1] - 0.4j, channels=40, cycles=600, noise=0.0, seed=9).values - 0.7
    found = checked(replace(record, values=record.values + 0.12 * weak), tmp_path)
    assert len(found.exponents) == 3
    assert (found.failed, found.part) == (False, (1, 256))


def test_modes_of_a_part_are_met_on_any_branch(tmp_path):
    found = fq.identify_large(lazy(decay(cycles=300)), tmp_path / "r.h5")
    model, std = found.model, found.exponent_std
    ours, theirs = _part._unmatched(found.exponents + 2j * np.pi, std, model, 1e-9)
    assert not ours.any()
    assert not theirs.any()
    ours, theirs = _part._unmatched(found.exponents + 15.0 * std.real, std, model, 1e-9)
    assert ours.all()
    assert theirs.sum() == 3


@pytest.mark.usefixtures("small_part")
def test_a_line_is_no_mode(tmp_path):
    record, sizes = decay(cycles=500), np.random.default_rng(3).standard_normal((5, 1))
    line = np.cos(2.0 * np.pi * 0.371 * np.arange(record.n_samples) / PHASES)
    found = checked(replace(record, values=record.values + 0.4 * sizes * line), tmp_path)
    assert (found.passed, found.failed) == (False, True)
    assert "steady tone at 0.371" in found.reasons[0]


@pytest.mark.usefixtures("small_part")
def test_half_the_period_is_told(tmp_path):
    found = checked(decay(cycles=500), tmp_path, period=0.5)
    assert any("true period is twice the one given" in reason for reason in found.reasons)


@pytest.mark.usefixtures("small_part")
def test_a_mode_that_was_left_out_is_missed(tmp_path):
    found = checked(decay(), tmp_path, order=4)
    assert (found.passed, found.failed) == (False, False)
    assert any("was not found. Try `order=6`." in reason for reason in found.reasons)
    assert fq.load(found.path).reasons == found.reasons


def test_checks_need_memory(tmp_path):
    found = checked(decay(cycles=300), tmp_path)
    assert (found.passed, found.failed, found.part) == (None, False, (0, 0))
    assert "no memory to check" in found.summary()


def test_parts_of_channels_and_of_cycles_give_the_same(tmp_path, monkeypatch):
    record = lazy(decay())
    whole = fq.identify_large(record, tmp_path / "a.h5")
    monkeypatch.setattr(_identify, "BLOCK", 8.0 * PHASES * 200)
    parts = fq.identify_large(record, tmp_path / "b.h5")
    assert_allclose(parts.exponents, whole.exponents, rtol=1e-9)
    assert_allclose(parts.exponent_std, whole.exponent_std, rtol=1e-6)
    assert_allclose(parts.residues(), whole.residues(), rtol=1e-5, atol=1e-9)


@pytest.mark.slow
def test_deviations_hold_a_wrong_start(tmp_path, monkeypatch):
    """A mutant of the start: poles that are off by many deviations take a further sweep, and end at the same."""
    record, found = lazy(decay()), _identify._found
    right = fq.identify_large(record, tmp_path / "a.h5")

    def off(*args):
        modes, late = found(*args)
        return replace(modes, logs=modes.logs - 2e-5), late

    monkeypatch.setattr(_identify, "_found", off)
    wrong = fq.identify_large(record, tmp_path / "b.h5")
    assert wrong.sweeps > 2
    assert np.abs(pulls(wrong.exponents, right.exponents, right.exponent_std)).max() < 0.05


@pytest.mark.slow
def test_intervals_hold_the_truth(tmp_path):
    own = np.array(
        [
            pulls(found.exponents, np.concatenate([MODES, MODES.conj()]), found.exponent_std)
            for found in (
                fq.identify_large(lazy(decay(noise=1.0, cycles=500, draw=draw)), tmp_path / "r.h5")
                for draw in range(100)
            )
        ]
    )
    assert 0.9 < np.sqrt(np.mean(own**2)) < 1.1
    assert 0.92 < np.mean(np.abs(own) < 1.96) < 0.98


@pytest.mark.parametrize("chunks", [None, (2, 240)])
def test_files_are_read_in_blocks(chunks, tmp_path):
    record = decay(cycles=300)
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file.create_dataset("values", data=record.values, chunks=chunks)
        file["sample_rate"], file["channels"] = float(PHASES), [channel.name for channel in record.channels]
    np.save(tmp_path / "r.npy", record.values)
    for name, rate in (("r.h5", None), ("r.npy", PHASES)):
        read = fq.read(tmp_path / name, period=1.0, rate=rate, lazy=True)
        again = np.full(record.values.shape, np.nan)
        for rows, samples, values in read.blocks(8 * 500, whole=PHASES):
            assert values.size <= 500
            assert values.shape[1] % PHASES == 0
            again[rows, samples] = values
        assert_array_equal(again, record.values)
    assert fq.read(tmp_path / "r.h5", lazy=True).channels == record.channels


@pytest.mark.parametrize(
    ("beside", "attributes", "words"),
    [({"gain": 0.01}, {}, "counts"), ({}, {"scale_factor": 0.01}, "scale_factor"), ({}, {"_FillValue": -1}, "_Fill")],
)
def test_counts_with_a_scale_are_not_taken_for_quantities(beside, attributes, words, tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["values"] = np.rint(100.0 * decay(cycles=300).values).astype(np.int16)
        file["values"].attrs.update(attributes)
        file["sample_rate"] = float(PHASES)
        for name, scale in beside.items():
            file[name] = scale
    with pytest.raises(InputError, match=words):
        fq.read(tmp_path / "r.h5", period=1.0, lazy=True)


def test_the_values_as_a_whole_are_refused():
    with pytest.raises(InputError, match=r"`\.blocks\(\)`"):
        _ = lazy(decay(cycles=300)).values


def test_what_cannot_be_done_is_said_and_nothing_is_lost(tmp_path, monkeypatch):
    record, target = decay(cycles=300), tmp_path / "r.h5"
    target.write_bytes(b"an older result")
    with pytest.raises(InputError, match=r"memory.*at least 2"):
        fq.identify_large(lazy(record), target, memory="200MB")
    with pytest.raises(InputError, match="whole samples a period"):
        fq.identify_large(lazy(record, clock=ConstantPeriod(period=1.003)), target)
    with pytest.raises(InputError, match="256 periods or more"):
        fq.identify_large(lazy(decay(cycles=100)), target)
    with pytest.raises(InputError, match="LazyRecord"):
        fq.identify_large(record, target)
    gappy = np.array(record.values)
    gappy[2, 7] = np.nan
    with pytest.raises(InputError, match="'x2' misses 1 sample"):
        fq.identify_large(lazy(record, array=gappy), target)
    noise = np.random.default_rng(0).standard_normal(record.values.shape)
    with pytest.raises(IdentificationError):
        fq.identify_large(lazy(record, array=noise), target)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    for name in ("summed", "_reserve"):
        with monkeypatch.context() as patched:
            patched.setattr(_identify, name, full)
            with pytest.raises(InputError, match="No space left"):
                fq.identify_large(lazy(record), target)
    assert target.read_bytes() == b"an older result"
    assert [path.name for path in tmp_path.iterdir()] == ["r.h5"]


def test_a_reader_that_fails_ends_the_sweep():
    def blocks(*_, **__):
        yield slice(0, 1), slice(0, PHASES), np.zeros((1, PHASES))
        raise OSError("the disk went away")

    record = SimpleNamespace(n_channels=1, blocks=blocks)
    with pytest.raises(InputError, match=r"readable to its end.*went away"):
        list(Plan(record, 1.0, PHASES, 10, 1e6, 16).blocks("sweep", lambda _: None))
