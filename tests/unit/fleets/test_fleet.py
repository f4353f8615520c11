"""Records to one table: rows, what is done again, and what is refused."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import floquid as fq
from floquid.fleets import _fleet as module
from floquid.fleets import kept_results
from floquid.fleets._runner import DIED
from floquid.fleets._table import COLUMNS, opened
from floquid.systems import JeffcottRotor

parquet = pytest.importorskip("pyarrow.parquet")
QUICK = {"order": 4, "channels": ["X", "Y"], "validate": False, "constrained": False, "workers": 1}


@pytest.fixture(scope="module")
def records():
    each = [
        JeffcottRotor(speed=0.6 + 0.01 * k).simulate(n_periods=40, samples_per_period=8, noise=0.01, seed=k)
        for k in range(3)
    ]
    return [record.with_point({"load": float(k)}) for k, record in enumerate(each)]


FOUND = {}
"""What was identified, by the samples and points of the records and the settings."""


@pytest.fixture(autouse=True)
def nothing_is_identified_twice(monkeypatch):
    """Fleets are about which records are identified, and what becomes of the results."""
    real = module.identify

    def found(records, settings):
        key = settings, *((record.values.tobytes(), *record.point.items()) for record in records)
        if key not in FOUND:
            FOUND[key] = real(records, settings)
        return FOUND[key]

    monkeypatch.setattr(module, "identify", found)


@pytest.fixture
def lake(records, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k, record in enumerate(records):
        place = tmp_path / "lake" / f"machine{k}"
        place.mkdir(parents=True)
        fq.write(record, place / "run.npz")
    (tmp_path / "lake" / "machine0" / "bad.npz").write_bytes(b"no archive")
    return tmp_path


def rows(path="modes.parquet"):
    return parquet.read_table(path).sort_by([("file", "ascending"), ("mode", "ascending")]).to_pylist()


def numbers(path="modes.parquet"):
    """All that a record itself decides."""
    return [{name: cell for name, cell in row.items() if name != "seconds"} for row in rows(path)]


@pytest.fixture
def identified(monkeypatch):
    """Names of the files that are identified."""
    taken, right = [], module.done_of
    monkeypatch.setattr(module, "done_of", lambda job: taken.append(job.files[0].name) or right(job))
    return taken


def test_a_row_a_mode_and_one_for_a_record_without_a_result(lake, records):
    found = fq.fleet("lake/*/*.npz", **QUICK)
    assert (found.n_records, found.n_identified, found.n_before, found.n_modes) == (4, 3, 0, 6)
    assert [file for file, _ in found.lost] == [str(lake / "lake/machine0/bad.npz")]
    assert str(found) == "4 records: 3 identified (0 passed), 1 without a result; 6 modes."
    table = rows()
    assert list(table[0]) == [*COLUMNS, "load", "speed_rpm"]
    bad, good = table[0], table[1:]
    assert bad["mode"] is None
    assert "whole" in bad["reason"]
    assert bad["floquid"] == fq.__version__
    for k, record in enumerate(records):
        model = fq.identify(record, **{name: value for name, value in QUICK.items() if name != "workers"}).model
        for row, mode in zip(good[2 * k : 2 * k + 2], model.upper_modes, strict=True):
            assert row["file"] == str(lake / f"lake/machine{k}/run.npz")
            assert complex(row["re"], row["im"]) == model.exponents[mode]
            assert complex(row["std_re"], row["std_im"]) == model.exponent_std[mode]
            assert row["covariance"] == model.covariance[mode, 4 + mode]
            assert complex(row["multiplier_re"], row["multiplier_im"]) == model.multipliers[mode]
            assert row["load"] == float(k)
            assert 0 in row["harmonics"]
            assert row["order"] == 4


def test_workers_give_what_a_serial_run_gives(lake):
    fq.fleet("lake", out="serial.parquet", **QUICK)
    with ThreadPoolExecutor(3) as executor:
        fq.fleet("lake", executor=executor, out="others.parquet", **QUICK | {"workers": None})
    assert numbers("serial.parquet") == numbers("others.parquet")


def test_nothing_finished_is_done_twice(lake, identified):
    fq.fleet("lake/machine1/run.npz", **QUICK)
    assert fq.fleet("lake", **QUICK).n_before == 1
    assert sorted(identified) == ["bad.npz", "run.npz", "run.npz", "run.npz"]
    before = numbers()
    assert fq.fleet("lake", **QUICK).n_before == 4
    assert len(identified) == 4
    assert numbers() == before


@pytest.mark.parametrize("change", ["time", "content", "settings", "reading"])
def test_what_has_changed_is_done_again_and_its_rows_replaced(lake, identified, records, change):
    file, options, reading = lake / "lake/machine1/run.npz", dict(QUICK), None
    fq.fleet(file, **options)
    if change == "time":
        os.utime(file, ns=(1, 1))
    elif change == "content":
        fq.write(records[2], file)
    elif change == "settings":
        options["harmonics"] = 1
    else:
        reading = fq.preparation.Reading(point={"load": 7.0})
    assert fq.fleet(file, reading=reading, **options).n_before == 0
    assert len(identified) == 2
    assert len(rows()) == 2
    assert rows()[0]["load"] == {"content": 2.0, "reading": 7.0}.get(change, 1.0)


def test_a_run_that_was_stopped_keeps_what_it_had(lake, identified, monkeypatch):
    right = module.done_of

    def stopped(job):
        if len(identified) == 2:
            raise KeyboardInterrupt
        return right(job)

    monkeypatch.setattr(module, "done_of", stopped)
    with pytest.raises(KeyboardInterrupt):
        fq.fleet("lake", **QUICK)
    assert not (lake / "modes.parquet").exists()
    assert len(list((lake / ".modes.parquet.parts").iterdir())) == 1
    monkeypatch.setattr(module, "done_of", right)
    assert fq.fleet("lake", **QUICK).n_before == 2
    assert len(identified) == 4
    assert len(rows()) == 7
    assert not (lake / ".modes.parquet.parts").exists()


def test_a_part_that_was_not_written_whole_is_no_part(lake):
    parts = lake / ".modes.parquet.parts"
    parts.mkdir()
    (parts / ".0a1b2c-00000000-ff.parquet").write_bytes(b"PAR1 and no more")
    assert fq.fleet("lake/machine1/run.npz", **QUICK).n_identified == 1


def test_a_record_whose_process_died_is_done_again(lake, identified):
    file = lake / "lake/machine1/run.npz"
    fq.fleet(file, **QUICK)
    with opened(lake / "modes.parquet", "fleet") as table:
        size, modified, settings = table.done[str(file)].key
        cells = {"file": str(file), "size": size, "modified": modified, "settings": settings}
        table.add(str(file), [{**cells, "passed": False, "reason": DIED}])
    assert [row["reason"] for row in rows()] == [DIED]
    assert fq.fleet(file, **QUICK).n_modes == 2
    assert len(rows()) == 2


def test_whole_results_are_kept_by_choice(lake, identified):
    fq.fleet("lake", **QUICK)
    assert all(own.result is None for own in kept_results(lake / "modes.parquet"))
    fq.fleet("lake", keep="results", **QUICK)
    assert len(identified) == 7  # of bad.npz there is nothing to keep
    found = kept_results(lake / "modes.parquet")
    assert [own.file for own in found if own.result is None] == [str(lake / "lake/machine0/bad.npz")]
    for own in found:
        if own.result is not None:
            row = next(row for row in rows() if row["file"] == own.file)
            assert complex(row["re"], row["im"]) in fq.load(own.result).model.exponents.tolist()
            assert own.point["load"] == row["load"]
    assert kept_results(lake / "lake/machine0/bad.npz") is None


def test_hits_on_one_system_are_one_record(lake, records):
    fq.write(records[0], "again.npz")
    found = fq.fleet([["lake/machine0/run.npz", "again.npz"], "lake/machine1/run.npz"], **QUICK)
    assert found.n_records == 2
    assert rows()[0]["file"] == f"{lake / 'lake/machine0/run.npz'}; {lake / 'again.npz'}"


@pytest.mark.parametrize(
    ("sources", "options", "message"),
    [
        ([], {}, "`sources` of `fleet` must name a record"),
        ("none/*.npz", {}, "none/*.npz matches no file"),
        ("empty", {}, "empty holds no record"),
        ("lake", {"out": "modes.csv"}, "must end in .parquet"),
        ("lake", {"out": "no/modes.parquet"}, "must lie in a folder that exists"),
        ("lake", {"out": "mine.parquet"}, "must be a table of `fleet`, or no file yet"),
        ("lake", {"keep": "lake/machine0/run.npz"}, "must be a folder that results can be written to"),
        ("lake", {"workers": 0}, "`workers` of `fleet` must"),
        ("lake", {"perid": 1.0}, "`fleet` has no option `perid`"),
    ],
)
def test_what_is_refused(lake, records, sources, options, message):
    (lake / "empty").mkdir()
    fq.write(records[0], "mine.parquet")
    with pytest.raises(fq.InputError) as raised:
        fq.fleet(sources, **QUICK | options)
    assert message in str(raised.value)
    assert not list(lake.glob("*.parts"))


def test_workers_beside_an_executor(lake):
    with ThreadPoolExecutor(1) as executor, pytest.raises(fq.InputError, match="not be given beside an executor"):
        fq.fleet("lake", executor=executor, **QUICK)


def test_what_is_hidden_and_the_table_itself_are_no_records(lake, records):
    fq.write(records[0], lake / "lake" / "machine0" / "run.parquet")
    for source in ("lake", "lake/*/*.parquet"):
        (lake / "lake" / ".hidden").mkdir(exist_ok=True)
        fq.write(records[0], lake / "lake" / ".hidden" / "run.parquet")
        files = [fq.fleet(source, out="lake/machine0/modes.parquet", **QUICK).n_records for _ in range(2)]
        assert files == [5, 5] if source == "lake" else [1, 1]


def test_two_runs_into_one_table(lake):
    with opened(lake / "modes.parquet", "fleet"), pytest.raises(fq.InputError, match="another run is writing"):
        fq.fleet("lake", **QUICK)
    assert not list(lake.glob(".modes*"))


def test_a_disk_that_is_full_ends_the_run_and_keeps_the_parts(lake, monkeypatch):
    fq.fleet("lake/machine1/run.npz", **QUICK)
    before = numbers()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("floquid.io._files.flush", full)
    with pytest.raises(fq.InputError, match="No space left on device"):
        fq.fleet("lake", **QUICK)
    assert numbers() == before


def test_columns_of_operating_points_are_those_of_all(lake, records):
    fq.write(records[0].with_point({"wind_m_s": 8.0, "order": 3.0}), "windy.npz")
    fq.fleet(["lake/machine0/run.npz", "windy.npz"], **QUICK)
    assert [row["wind_m_s"] for row in rows()] == [None, None, 8.0, 8.0]
    assert [row["point_order"] for row in rows()] == [None, None, 3.0, 3.0]
    assert [row["order"] for row in rows()] == [4] * 4
    assert np.isfinite([row["seconds"] for row in rows()]).all()
