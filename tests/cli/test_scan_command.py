"""`floquid scan`: what it prints and writes, and that what cannot be is one clear message and exit code 2."""

import re

import numpy as np
import pytest
from tests.cli.conftest import EARLIER, contents, save_npz, simulated
from tests.cli.test_commands import PERIOD, strict_json, typed

import floquid
from floquid.lifting import lift
from floquid.lti import AMI, ERA
from floquid.order import scan
from floquid.pipeline import lifted
from floquid.sync import segment

GOOD = f"scan good.npz --period {PERIOD}"
FILES = {"scan.json", "figures/stabilisation.png", "figures/indicators.png"}


def expected(identifier=None, orders=None):
    return scan(lift(segment(simulated())).responses, identifier, orders)


def rows_of(text):
    return [line.split() for line in text.splitlines() if re.match(r"\s+\d+\s", line)]


def test_the_table_has_a_row_for_each_order(here):
    text = typed(f"{GOOD} --orders 2..12..2")
    found, rows = expected(orders=range(2, 13, 2)), rows_of(text)
    assert [int(row[0]) for row in rows] == [2, 4, 6, 8, 10, 12]
    assert [int(row[1]) for row in rows] == found.n_stable.tolist()
    assert [float(row[3]) for row in rows] == pytest.approx(found.criteria.misfit, rel=1e-4)
    # The rotor has four poles, and every criterion says so.
    starred = [row[0] for row in rows if row[4:6] == ["0", "*"]]
    assert starred == ["4"]
    assert float(rows[1][3]) == pytest.approx(1.0, abs=0.1) != pytest.approx(float(rows[0][3]), abs=1.0)
    assert "4 singular values of the responses above white noise" in text
    assert max(map(len, text.splitlines())) <= 80
    assert set(contents(here)) == {"good.npz", *(f"out/{name}" for name in EARLIER)}


@pytest.mark.slow
def test_a_saved_result_is_scanned_as_its_record(here):
    typed(f"identify good.npz --period {PERIOD} --out kept --no-validate")
    kept, own = rows_of(typed("scan kept --orders 2..8..2")), rows_of(typed(f"{GOOD} --orders 2..8..2"))
    assert [row[:2] for row in kept] == [row[:2] for row in own]
    assert [float(row[3]) for row in kept] == pytest.approx([float(row[3]) for row in own], rel=0.01)
    typed("scan kept --period 3", code=2, message="`--period` must not be given beside a saved result")
    typed("transfer kept", code=2, message="The result must have measured inputs")


def test_json_is_the_scan_alone(here):
    text = typed(f"{GOOD} --orders 3..5,8 --format json --out new")
    content = strict_json(text)
    assert text == (here / "new" / "scan.json").read_text()
    assert set(contents(here / "new")) == FILES
    found = expected(orders=[3, 4, 5, 8])
    assert content["format"] == "floquid-scan/1"
    assert content["identifier"] == "era"
    assert (content["n_cycles"], content["n_phases"]) == ([40], 8)
    assert [entry["order"] for entry in content["orders"]] == [3, 4, 5, 8]
    assert content["indicators"]["n_above"] == found.indicators.n_above == 4
    for number, entry in enumerate(content["orders"]):
        model = found.models[number]
        assert entry["reached"] is True
        assert [complex(*pole["multiplier"]) for pole in entry["poles"]] == pytest.approx(model.multipliers)
        assert [complex(*pole["pole"]) for pole in entry["poles"]] == pytest.approx(model.poles)
        names = ["new", "frequency", "damping", "shape"]
        assert [names.index(pole["stability"]) for pole in entry["poles"]] == found.stable[number].tolist()
        folded = np.abs(np.angle(model.multipliers)) / (2.0 * np.pi * 2.0 * np.pi)
        assert [pole["frequency_hz"] for pole in entry["poles"]] == pytest.approx(folded)
        for name in ("cost", "left", "aic", "bic", "misfit"):
            assert entry[name] == pytest.approx(getattr(found.criteria, name)[number])


def test_an_order_not_reached_is_named(here):
    text = typed(f"{GOOD} --identifier ml --orders 3,4")
    assert rows_of(text)[0][1] == "-"
    assert "not reached" in text
    entry = strict_json(typed(f"{GOOD} --identifier ml --orders 3,4 --format json"))["orders"][0]
    assert (entry["reached"], entry["outcome"]) == (False, "ORDER_UNREACHED")


@pytest.mark.slow
def test_an_earlier_result_is_replaced_and_others_stay(here):
    typed(f"{GOOD} --orders 2,4 --out out")
    after = contents(here / "out")
    assert {name: after[name] for name in EARLIER} == EARLIER
    assert set(after) == FILES | set(EARLIER)
    for name in FILES - {"scan.json"}:
        assert after[name].startswith(b"\x89PNG")
    before = after["scan.json"]
    typed(f"{GOOD} --orders 2,4,6 --out out")
    assert contents(here / "out")["scan.json"] != before


def test_frequency_settings_channels_and_hits(here):
    save_npz("second.npz", simulated(periods=30).values)
    quick = "--no-validate --no-constrained"
    typed(f"identify good.npz --period {PERIOD} --channels X,Y --identifier ami {quick} --out kept")
    content = strict_json(typed("scan good.npz second.npz --settings kept/settings.toml --orders 4 --format json"))
    assert (content["channels"], content["identifier"], content["n_cycles"]) == (["X", "Y"], "ami", [40, 30])
    by_frequency = typed(f"scan good.npz --frequency {1.0 / (2.0 * np.pi)!r} --channels X --orders 4 --format json")
    assert strict_json(by_frequency)["period"] == pytest.approx(2.0 * np.pi)


def test_the_pipeline_stops_after_lifting():
    record, words = simulated(), []
    whole = lifted(record, channels=["Y", "X"], report=words.append)
    assert [channel.name for channel in whole.channels] == ["Y", "X"]
    assert np.array_equal(whole.responses.values, lift(segment(record.select(["Y", "X"]))).responses.values)
    assert words == ["cutting into periods", "estimating the noise"]
    with pytest.raises(floquid.InputError, match="has no option"):
        lifted(record, no_such=1)
    assert scan(whole.responses, ERA(), [4]).models[0].order == scan(whole.responses, AMI(), [4]).models[0].order == 4


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("scan", "`FILES` must name at least one record"),
        ("scan good.npz", "`--period` must be given"),
        ("scan none.npz --period 6", "there is no file none.npz"),
        (f"scan good.npz good.npz --period {PERIOD}", "is given twice"),
        (f"{GOOD} --frequency 1", "`--frequency` must not be given beside --period"),
        ("scan good.npz --frequency 0", "`--frequency` must be positive"),
        ("scan good.npz --period 0.02", "The period must be two sampling intervals or more (1.5708 s)"),
        ("scan good.npz --period 252", "The period must be shorter than the record"),
        ("scan good.npz --tach Q", "`--tach`"),
        ("scan good.npz --tach X --period 6", "beside another clock"),
        (f"{GOOD} --skip 100", "`--skip` must leave most of each record"),
        (f"{GOOD} --skip -1", "`--skip` must not be negative"),
        (f"{GOOD} --channels Q", "`--channels`"),
        (f"{GOOD} --orders 8..2", "`--orders` must list positive orders, but has '8..2'"),
        (f"{GOOD} --orders x", "but has 'x'"),
        (f"{GOOD} --orders 0..4", "but is '0..4'"),
        (f"{GOOD} --orders 2..8..0", "but has '2..8..0'"),
        (f"{GOOD} --orders 2..3..4..5", "but has '2..3..4..5'"),
        (f"{GOOD} --orders ²", "but has '²'"),
        (f"{GOOD} --orders ,", "but is ','"),
        (f"{GOOD} --orders 2..40", "`--orders` must be less than the 40 periods of the record, but goes up to 40"),
        (f"{GOOD} --orders 2..99999999", "`--orders` must be less than the 40 periods"),
        (f"{GOOD} --identifier svd", "Choose from"),
        (f"{GOOD} --out good.npz", "`--out` must be a folder"),
        (f"{GOOD} --out blocked", "blocked/scan.json is a folder"),
        (f"{GOOD} --settings good.npz", "`--settings` must name a file in TOML"),
    ],
)
def test_bad_input_is_one_message(here, words, message):
    (here / "blocked" / "scan.json").mkdir(parents=True)
    before = contents(here)
    assert typed(words, code=2, message=message) == ""
    assert contents(here) == before


def test_a_short_record_is_refused_as_by_identify(here):
    save_npz("short.npz", simulated().values[:, :24])
    assert typed(f"scan short.npz --period {PERIOD}", code=1, message="fewer than 4 cannot hold a mode") == ""


@pytest.mark.slow
def test_the_shortest_record_is_scanned(here):
    save_npz("short.npz", simulated().values[:, :32])
    rows = rows_of(typed(f"scan short.npz --period {PERIOD} --out new"))
    assert [row[0] for row in rows] == ["2"]
    assert set(contents(here / "new")) == FILES
