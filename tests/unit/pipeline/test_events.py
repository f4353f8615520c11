"""Records whose periods lie between events, pooled in phase, and brief decays that all hits decide together."""

import io
from dataclasses import replace
from functools import cache
from itertools import compress

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rich.console import Console
from scipy.integrate import solve_ivp

from floquid import ConstantPeriod, InputError, PulseTimes, Record, identify, load, save
from floquid.cli.arguments.records import event_files, read_events
from floquid.cli.output.printed import print_found
from floquid.exports import summary
from floquid.preparation import in_phase
from floquid.preparation._prepare import common_orbit
from floquid.sync import between_events

REAL, PAIR = 0.62, 0.45 + 0.35j
RATE = 100.0
TURN = 2j * np.pi


def strides(seed, records=20, noise=0.02, channels=3, spread=0.012, least=2, most=10):
    """Decays about an orbit, of strides that last 1.1 s ± 1.2 %: (values, events) a record; all of it in phase."""
    shapes, generator = np.random.default_rng(7), np.random.default_rng(seed)
    turns = np.arange(-2, 3)
    first, second = ((shapes.standard_normal((2, channels, 5)) * 0.5 ** np.abs(turns)) for _ in range(2))
    real, pair = first[0] + 1j * first[1], second[0] + 1j * second[1]
    orbit = 5.0 * (shapes.standard_normal((2, channels, 5)) * 0.6 ** np.arange(5))
    found = []
    for _ in range(records):
        number = int(generator.integers(least, most + 1))
        events = np.cumsum(1.1 * (1.0 + spread * generator.standard_normal(number + 2)))
        times = np.arange(events[0], events[-1], 1.0 / RATE)
        phase = np.interp(times, events, np.arange(number + 2))
        around = ((orbit[0] + 1j * orbit[1]) @ np.exp(TURN * np.outer(np.arange(5), phase))).real
        a, b, c = generator.standard_normal(3)
        values = a * REAL**phase * (real @ np.exp(TURN * np.outer(turns, phase))).real
        values = values + ((b + 1j * c) * PAIR**phase * (pair @ np.exp(TURN * np.outer(turns, phase)))).real
        found.append((around + values + noise * generator.standard_normal(values.shape), events))
    return found


def records_of(seed, **how):
    return [
        Record(
            values=values,
            sample_rate=RATE,
            channels=["hip", "knee", "ankle"][: len(values)],
            start=events[0],
            clock=PulseTimes(times=events, cycles=True),
        )
        for values, events in strides(seed, **how)
    ]


def errors(model):
    """Errors of the three multipliers' parts over their deviations."""
    found = []
    for value in (REAL, PAIR):
        mode = int(np.argmin(np.abs(model.multipliers - value)))
        off, std = model.multipliers[mode] - value, model.multiplier_std[mode]
        found += [off.real / std.real] + ([off.imag / std.imag] if np.imag(value) else [])
    return np.array(found)


@cache
def walk():
    return identify(records_of(0, records=12))


def test_strides_of_any_duration_are_one_in_phase():
    generator = np.random.default_rng(3)
    events = np.cumsum(generator.uniform(0.6, 1.6, 9))
    times = events[0] + np.arange(int((events[-1] - events[0]) * RATE)) / RATE
    phase = np.interp(times, events, np.arange(9.0))
    values = np.array([np.cos(2 * np.pi * phase), np.sin(4 * np.pi * phase) * 0.8**phase])
    clock = PulseTimes(times=events, cycles=True)
    record = Record(values=values, sample_rate=RATE, channels=["x", "y"], start=events[0], clock=clock)
    (cycles,) = between_events([record])
    at = (np.arange(cycles.n_phases * cycles.n_cycles).reshape(cycles.n_cycles, -1).T + 0.5) / cycles.n_phases
    truth = np.array([np.cos(2 * np.pi * at), np.sin(4 * np.pi * at) * 0.8**at])
    assert_allclose(cycles.values, truth, atol=2e-3)
    assert_allclose(cycles.periods, np.diff(events)[: cycles.n_cycles])
    gone = values.copy()
    gone[1, 150:200] = np.nan
    (cycles,) = between_events([replace(record, values=gone)])
    assert np.isnan(cycles.values[1]).any()
    assert not np.isnan(cycles.values[0]).any()


def test_the_orbit_is_taken_beside_decays_that_all_begin_alike():
    cycles = between_events(records_of(1, records=8))
    whole = np.concatenate([hit.values for hit in cycles], axis=2)
    truth = between_events(records_of(1, records=8, noise=0.0))
    scale = np.concatenate([hit.values for hit in truth], axis=2).std()
    later = [hit.values[:, :, -1] for hit in cycles if hit.n_cycles > 8]  # decayed to one in a hundred
    off = np.abs(common_orbit(cycles, 1e-9) - np.mean(later, axis=0)).max()
    assert off < 0.02 * scale
    assert off < 0.5 * np.abs(whole.mean(axis=2) - np.mean(later, axis=0)).max()


def test_clocks_of_events_are_refused_where_they_say_nothing():
    with pytest.raises(InputError, match=r"`cycles` of `PulseTimes` must be true or false"):
        PulseTimes(times=[0.0, 1.0], cycles=1)
    with pytest.raises(InputError, match="must be false beside pulses and periods of a turn"):
        PulseTimes(times=[0.0, 1.0], cycles=True, pulses_per_revolution=2)
    record = Record(values=np.zeros((1, 200)), sample_rate=RATE, channels=["x"])
    with pytest.raises(InputError, match="two events or more"):
        between_events([record.with_clock(PulseTimes(times=[1.0, 5.0], cycles=True))])
    with pytest.raises(InputError, match="16 samples or more between two events"):
        between_events([record.with_clock(PulseTimes(times=[1.0, 1.1], cycles=True))])
    with pytest.raises(InputError, match="have clocks of events"):
        between_events([record.with_clock(ConstantPeriod(period=1.0))])


def test_tables_of_events_name_records_by_file_or_number(tmp_path):
    files = [tmp_path / "a.npz", tmp_path / "b.npz"]
    table = tmp_path / "events.csv"
    table.write_text("file,time\na,0.5\nb.npz,0.25\n1,1.5\n2,1.25\nc.npz,7\n")
    first, second = read_events(event_files(str(table)), files, "identify")
    assert_allclose(first, [0.5, 1.5])
    assert_allclose(second, [0.25, 1.25])
    alone = [tmp_path / f"{name}.txt" for name in "ab"]
    for path in alone:
        path.write_text("0.5\n1.5\n")
    assert len(read_events(event_files(",".join(map(str, alone))), files, "identify")) == 2
    assert event_files("heel") == ()
    for words, text in {"a number last": "1,x,y\n1,0.2\n1,abc\n", "two events or more": "1,0.5\n1,0.7\n2,1.0\n",
                        "name a record": "time\n0.5\n0.7\n"}.items():  # fmt: skip
        table.write_text(text)
        with pytest.raises(InputError, match=words):
            read_events([table], files, "identify")


@pytest.mark.slow
def test_multipliers_of_many_brief_walks_are_found_and_said():
    found = walk()
    assert found.passed, found.reasons
    assert found.model.order == 3
    assert np.abs(errors(found.model)).max() < 4.0
    text = io.StringIO()
    print_found(Console(file=text, width=100), found)
    words = " ".join(text.getvalue().split())
    assert "Multipliers 0.6" in words
    assert "in brackets 95 % intervals" in words
    assert "the mean between events" in words
    assert "as given" not in words
    ends = np.array([mode["multiplier_interval"] for mode in summary(found)["modes"]])
    assert ends.shape == (3, 2, 2)
    values = found.model.multipliers
    assert (ends[:, 0, 0] < values.real).all()
    assert (values.real < ends[:, 0, 1]).all()


@pytest.mark.slow
def test_a_result_by_events_comes_back(tmp_path):
    save(walk(), tmp_path / "r.h5")
    back = load(tmp_path / "r.h5")
    assert in_phase(back.findings)
    assert_allclose(back.model.multipliers, walk().model.multipliers)
    assert back.records[0].period == pytest.approx(walk().model.period)


@pytest.mark.slow
def test_deviations_hold_over_draws():
    scores = np.concatenate([errors(identify(records_of(seed, noise=0.05)).model) for seed in range(20, 34)])
    assert 0.7 < np.sqrt(np.mean(scores**2)) < 1.35
    assert (np.abs(scores) < 1.96).mean() > 0.85


@pytest.mark.slow
def test_a_channel_of_events_is_the_same_as_their_times():
    records, marked = records_of(2, records=10), []
    for record in records:
        strikes = np.zeros(record.n_samples)
        for event in record.clock.times:
            since = (record.times - event) * RATE
            strikes += np.clip(since + 0.5, 0, 1) * np.clip(10.5 - since, 0, 1)
        # A pulse that the record begins or ends in is none.
        marked.append(
            Record(
                values=np.vstack([record.values, strikes]),
                sample_rate=RATE,
                channels=[*record.channels, "heel"],
                start=record.start,
            )
        )
    long = [len(record.clock.times) > 5 for record in records]
    inner = [record.with_clock(PulseTimes(times=record.clock.times[1:-1], cycles=True)) for record in records]
    inner, marked = (list(compress(several, long)) for several in (inner, marked))
    one, other = identify(marked, events="heel").model, identify(inner).model
    for value in (REAL, PAIR):
        gaps = [model.multipliers[np.argmin(np.abs(model.multipliers - value))] - value for model in (one, other)]
        assert np.abs(gaps).max() < 0.02


def flapping(lock, seed, advance=0.3, revolutions=8, samples=100, noise=1e-5):
    """Two hits of a flapping blade: angle and rate, after a step of each."""

    def system(t):
        g = lock / 8.0
        stiffness = 1.0 + g * (4.0 / 3.0 * advance * np.cos(t) + advance**2 * np.sin(2.0 * t))
        return np.array([[0.0, 1.0], [-stiffness, -g * (1.0 + 4.0 / 3.0 * advance * np.sin(t))]])

    generator, times = np.random.default_rng(seed), np.arange(revolutions * samples) * 2.0 * np.pi / samples
    hits, monodromy = [], []
    for begin in np.eye(2):
        path = solve_ivp(lambda t, x: system(t) @ x, (0.0, times[-1]), begin, t_eval=times, rtol=1e-10, atol=1e-13).y
        monodromy.append(path[:, samples])
        hits.append(
            Record(
                values=path + noise * generator.standard_normal(path.shape),
                sample_rate=samples / (2.0 * np.pi),
                channels=["angle", "rate"],
                clock=ConstantPeriod(period=2.0 * np.pi),
            )
        )
    return hits, np.linalg.eigvals(np.array(monodromy).T)


@pytest.mark.slow
@pytest.mark.parametrize("lock", [8.0, 12.0])
@pytest.mark.parametrize("seed", [0, 3])
def test_flapping_that_is_gone_after_a_revolution_is_judged_by_its_samples(lock, seed):
    hits, truth = flapping(lock, seed)
    found = identify(hits)
    assert found.passed, found.reasons
    assert not found.choice.ambiguous, found.choice.doubts
    assert_allclose(np.sort_complex(found.model.multipliers), np.sort_complex(truth), atol=1e-4)
