"""`floquid fleet`: a folder of records to one table, what it says, and what goes on from it."""

import json

import pytest
from tests.cli.test_commands import strict_json, typed
from tests.cli.test_floquet_command import flat

import floquid as fq
from floquid.systems import JeffcottRotor

parquet = pytest.importorskip("pyarrow.parquet")
QUICK = "--channels X,Y --order 4 --no-validate --no-constrained --workers 1"
SPEEDS = (0.70, 0.71, 0.73, 0.77)


@pytest.fixture
def lake(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    for k, speed in enumerate(SPEEDS):
        place = tmp_path / "lake" / f"machine{k % 2}"
        place.mkdir(parents=True, exist_ok=True)
        record = JeffcottRotor(speed=speed).simulate(n_periods=40, samples_per_period=8, noise=0.01, seed=1)
        fq.write(record.with_point({"speed": speed}), place / f"run{k}.npz")
    (tmp_path / "lake" / "machine0" / "bad.npz").write_bytes(b"no archive")
    return tmp_path


def test_a_folder_of_records(lake):
    text = flat(typed(f"fleet lake/*/*.npz {QUICK} --point wind_m_s=8"))
    assert "5 records: 4 identified (0 passed), 1 without a result; 9 modes." in text  # one speed is inside a lock
    assert "No result:" in text
    assert "bad.npz: `FILE` must be" in text
    assert "Written to modes.parquet." in text
    rows = parquet.read_table("modes.parquet").to_pylist()
    assert len(rows) == 10
    assert {row["wind_m_s"] for row in rows if row["mode"]} == {8.0}
    again = strict_json(typed(f"fleet lake {QUICK} --point wind_m_s=8 --format json"))
    assert again == {
        "format": "floquid-fleet/1", "out": "modes.parquet", "records": 5, "before": 5, "identified": 4, "passed": 0,
        "modes": 9, "lost": [{"file": str(lake / "lake/machine0/bad.npz"), "reason": again["lost"][0]["reason"]}],
    }  # fmt: skip


def test_a_survey_goes_on_from_what_was_kept(lake):
    typed(f"fleet lake {QUICK}")
    typed("survey modes.parquet --over speed", code=2, message="--keep DIR")
    typed(f"fleet lake {QUICK} --keep results")
    content = json.loads(typed("survey modes.parquet --over speed --format json --workers 1"))
    assert [point["speed"] for point in content["points"]] == list(SPEEDS)
    assert [edge["kind"] for edge in content["edges"]] == ["lock", "lock"]
    assert "bad.npz is left out" in content["warnings"][0]


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("fleet", "`FILES` must name records"),
        ("fleet none/*.npz", "`FILES` must be files, or match some"),
        ("fleet lake --out modes.csv", "`--out` must end in .parquet"),
        ("fleet lake --scheduler tcp://localhost:1 --workers 2", "`--scheduler` must not be given beside --workers"),
        ("fleet lake --workers 0", "`--workers` must"),
    ],
)
def test_what_is_refused(lake, command, message):
    typed(command, code=2, message=message)


def test_no_result_at_all_is_a_failure(lake):
    typed("fleet lake/machine0/bad.npz --workers 1", code=1, message="No record has a result. The first:")


@pytest.mark.slow
def test_an_address_without_a_scheduler(lake):
    pytest.importorskip("distributed")
    message = "`--scheduler` must be the address of a dask scheduler that answers"
    for address in ("nonsense", "tcp://127.0.0.1:9"):
        typed(f"fleet lake --scheduler {address}", code=2, message=message)


@pytest.mark.slow
def test_processes_and_dask_give_what_one_process_gives(lake):
    typed(f"fleet lake {QUICK} --out serial.parquet")
    typed(f"fleet lake {QUICK.replace('--workers 1', '--workers 2')} --out processes.parquet")
    tables = ["serial", "processes"]
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        options = QUICK.replace("--workers 1", f"--scheduler {cluster.scheduler_address}")
        typed(f"fleet lake {options} --out dask.parquet")
    serial, *others = (
        [
            {name: cell for name, cell in row.items() if name != "seconds"}
            for row in parquet.read_table(f"{name}.parquet")
            .sort_by([("file", "ascending"), ("mode", "ascending")])
            .to_pylist()
        ]
        for name in [*tables, "dask"]
    )
    assert all(other == serial for other in others)
