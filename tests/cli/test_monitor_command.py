"""`floquid monitor`: a folder of records becomes charts, the instant of a change and amounts; refusals name options."""

import pytest
from tests.cli.test_commands import strict_json, typed

import floquid as fq
from floquid import plot
from floquid.systems import JeffcottRotor

QUICK = "--workers 1 --degree 0"
RECORDS, BASELINE = 8, 5


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("machine")
    (made / "runs").mkdir()
    for k in range(RECORDS):
        rotor = JeffcottRotor(rotor_y=1.0 - 0.01 * max(0, k - BASELINE + 1))
        record = rotor.simulate(n_periods=30, samples_per_period=8, noise=0.01, seed=k)
        record = record.with_point({"days": 10.0 - k})
        fq.save(fq.identify(record, order=4, validate=False), made / "runs" / f"r{k}.h5")
    fq.write(record, made / "record.npz")
    return made


@pytest.fixture
def runs(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "100")
    for name in ("monitor", "periodic_amount"):  # drawn elsewhere
        monkeypatch.setattr(plot, name, lambda found, **_: found)
    monkeypatch.setattr(plot, "save_figure", lambda _, path: path.write_text("drawn"))
    return folder


def test_records_are_compared_with_a_baseline(runs):
    (runs / "runs" / "r9.csv").write_text("time,X\n0,hello\n")
    text = typed(f"monitor runs --baseline 0:5 {QUICK} --out out")
    (runs / "runs" / "r9.csv").unlink()
    assert "9 records." in text
    assert "the first at record 5 (runs/r5.h5)" in text
    assert "In it are mode 1 at 0.1125 Hz, mode 2 at 0.1299 Hz." in text
    assert "It changes more and more from record 5" in text
    assert "No result" in text
    found = {path.name for path in (runs / "out").rglob("*") if path.is_file()}
    assert found >= {"monitor.json", "monitor.csv", "report.html", "monitor.png", "periodic_amount.png"}
    content = strict_json((runs / "out" / "monitor.json").read_text())
    assert content["format"] == "floquid-monitor/1"
    assert [one["alarm"] for one in content["records"]] == [False] * 5 + [True] * 3 + [False]
    assert content["records"][8]["t2"] is None
    fields = "file t2 t2_limit ewma ewma_limit alarm extrapolated periodic_amount periodic_amount_std reason"
    assert all(set(fields.split()) <= set(record) for record in content["records"])
    assert set(content["change"]) >= {"index", "interval", "carried_by"}
    low, high = content["change"]["interval"]
    assert low <= 5 <= high
    assert (runs / "out" / "monitor.csv").read_text().count("\n") == 10


def test_like_over_and_no_baseline(runs):
    content = strict_json(
        typed(f"monitor runs --baseline 3: --over days --like record.npz --order 4 --no-validate {QUICK} --format json")
    )
    assert content["over"] == "days"
    assert content["records"][0]["file"] == "runs/r7.h5"
    assert content["records"][0]["directed"] > content["records"][0]["directed_limit"]
    alone = strict_json(typed(f"monitor runs/r0.h5 runs/r7.h5 {QUICK} --format json"))
    assert [one["t2"] for one in alone["records"]] == [None, None]
    assert all(one["periodic_amount_high"] > 0.0 for one in alone["records"])


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("monitor", "`FILES` must name results or records"),
        ("monitor runs --baseline first", "`--baseline` must be a range of records"),
        (f"monitor runs --baseline 0:1 {QUICK}", "`--baseline` must have 2 records with a result at least"),
        (f"monitor runs/r0.h5 runs/r1.h5 --baseline 0: --covariates oil {QUICK}", "`--covariates` must be quantities"),
        (f"monitor runs/r0.h5 runs/r1.h5 --baseline 0: --false-alarms 0.6 {QUICK}", "`--false-alarms` must lie below"),
        ("monitor runs --table runs/r0.h5", "`--table` must have a column `file`"),
    ],
)
def test_what_is_refused(runs, command, message):
    typed(command, code=2, message=message)
