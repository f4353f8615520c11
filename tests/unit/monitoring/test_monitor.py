"""Monitoring whole: what is found, what is missing, what is refused, and what it is written as."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from tests.contracts.test_copies import assert_same
from tests.machines import as_point, machine, shapes_of

import floquid as fq
from floquid.errors import InputError
from floquid.exports import columns_text, monitor_columns, monitor_summary
from floquid.monitoring import record_rows, sentences
from floquid.shapes import Sidebands

RECORDS, MODES = 60, 2
SHAPES = shapes_of(0, MODES)


def points_of(change=lambda _: 0.0, seed=0, which=2, records=RECORDS):
    """Records of a machine, one part of its exponents changed by deviations, with sidebands that grow alike."""
    made, generator = [], np.random.default_rng(seed)
    for k, (x, covariance, point) in enumerate(machine(seed, records, MODES)):
        x = x + change(k) * np.sqrt(np.diag(covariance)) * (np.arange(2 * MODES) == which)
        own = as_point(x, covariance, {**point, "days": float(k)}, SHAPES)
        lines = 0.01 * (generator.standard_normal((MODES, 3, 2)) + 1j * generator.standard_normal((MODES, 3, 2)))
        lines[0, 0, 1] += 0.002 * change(k)
        sides = Sidebands(
            modes=np.arange(MODES), shapes=SHAPES[:, :, 0, 1] / SHAPES[:, :1, 0, 1], values=lines,
            covariance=1e-4 * np.eye(24), shares=np.full(MODES, 0.5), noise=np.ones(3), channels=("a", "b", "c"),
        )  # fmt: skip
        made.append(replace(own, files=(f"r{k}.npz",), sidebands=sides))
    return made


HEALTHY, CHANGED = points_of(), points_of(lambda k: 6.0 * (k >= 45))


def monitored(points, **options):
    return fq.monitor(points, **{"baseline": slice(0, 30)} | options)


def without(point, **options):
    return replace(point, **options)


@pytest.fixture(scope="module")
def found():
    return monitored(CHANGED)


def test_a_healthy_machine_is_quiet():
    found = monitored(HEALTHY)
    assert found.alarm.sum() <= 1
    assert found.change is None
    assert found.baseline.sum() == 30
    assert found.covariates == ("speed_rpm", "temperature")
    assert any("No alarm" in words or "1 alarm" in words for words in sentences(found))
    assert found.charts.t2[:30].sum() == pytest.approx(30 * 4, rel=0.35)


def test_a_change_is_found_where_it_is_and_by_what_changed(found):
    assert not found.alarm[:45].any()
    assert found.first_alarm in (45, 46)
    assert found.change.kind == "step"
    low, high = found.change.interval
    assert low <= 45 <= high
    first = found.change.carried_by[0]
    assert (first.feature, first.unit) == ("mode 1 frequency", "rad/s")
    assert first.size / first.std > 6.0
    words = sentences(found)
    assert any("r45.npz" in sentence for sentence in words)
    assert any(sentence.startswith("Carried by mode 1 frequency +") for sentence in words)


def test_a_direction_sees_it_sooner_and_its_opposite_does_not():
    slow = points_of(lambda k: 0.15 * max(0, k - 30))
    along = monitored(slow, direction=[0.0, 1.0, 0.0, 0.0])
    against = monitored(slow, direction=[0.0, -1.0, 0.0, 0.0])
    charts = along.charts
    assert np.argmax(charts.directed > charts.directed_limit) <= np.argmax(charts.ewma > charts.ewma_limit)
    assert not (against.charts.directed > against.charts.directed_limit).any()


def test_order_and_branch_of_modes_do_not_matter(found):
    """Each other record has its modes in another order, their branch moved by a harmonic."""
    turned = []
    for k, point in enumerate(CHANGED):
        model, order = point.model, [1, 0, 3, 2]
        if k % 2:
            shift = np.array([1.0, 1.0, -1.0, -1.0])
            lines = np.zeros((4, 3, 1, 7), complex)
            for mode in range(4):
                lines[mode, :, :, 2 - int(shift[mode]) : 5 - int(shift[mode])] = model.coefficients[mode]
            parts = np.concatenate([order, np.array(order) + 4])
            model = replace(
                model, exponents=(model.exponents + 1j * shift * model.fundamental)[order],
                coefficients=lines[order], harmonics=np.arange(-3, 4),
                covariance=model.covariance[np.ix_(parts, parts)],
            )  # fmt: skip
        turned.append(without(point, model=model, sidebands=None))
    again = monitored(turned)
    np.testing.assert_allclose(again.charts.t2, found.charts.t2, rtol=1e-6)
    assert again.amounts is None
    assert any("sidebands" in words for words in again.warnings)


def test_bad_records_cost_one_record_each(found):
    points = list(CHANGED)
    points[3] = without(points[3], model=None, passed=False, reason="It is too short.")
    points[35] = without(points[35], reason="The residual is too large.")
    points[36] = without(points[36], values={"speed_rpm": points[36].values["speed_rpm"]})
    points[37] = without(points[37], weak=np.array([True, False, True, False]))
    far = {"speed_rpm": 900.0, "temperature": 20.0}
    period = points[38].model.period * points[38].values["speed_rpm"] / 900.0
    points[38] = without(points[38], values=far, model=replace(points[38].model, period=period))
    bad = monitored(points, baseline=np.arange(60) < 30)
    assert [np.isfinite(bad.charts.t2[k]) for k in (3, 35, 36, 37, 38)] == [False, False, False, True, True]
    assert bad.reasons[3] == "No result: It is too short."
    assert bad.reasons[35] == "The model fails: The residual is too large."
    assert bad.reasons[36] == "temperature is missing."
    assert bad.reasons[37] == "Missing: mode 1."
    assert bad.charts.t2_limit[37] < bad.charts.t2_limit[39]
    assert bad.charts.extrapolated[38]
    assert bad.charts.leverage[38] > 1.0
    assert not bad.alarm[38]
    assert bad.change.interval[0] <= 45 <= bad.change.interval[1]
    assert len(record_rows(bad)) == 60


@pytest.mark.slow
def test_scatter_of_the_baseline_is_allowed_for():
    """Of three deviations in one feature, in any order, a mode missing now and then."""
    scatter = np.random.default_rng(5).standard_normal(RECORDS)
    points = points_of(lambda k: 3.0 * scatter[k])
    points[4] = without(points[4], weak=np.array([True, False, True, False]))
    made = monitored(points)
    assert made.charts.scatter_directions == 1
    assert any("scatters more than its deviations say, in 1 direction" in words for words in made.warnings)
    assert made.charts.t2_limit[40] > monitored(HEALTHY).charts.t2_limit[40]
    assert made.alarm.sum() <= 1


def test_constant_covariates(found):
    points = [without(point, values={**point.values, "oil": 1.0}) for point in HEALTHY]
    points[40] = without(points[40], values={**points[40].values, "oil": 2.0})
    made = monitored(points, covariates=("speed_rpm", "temperature", "oil"))
    assert np.isinf(made.charts.leverage[40])
    assert not made.alarm[40]
    assert any("Constant in the baseline: oil" in words for words in made.warnings)


def test_order_by_a_quantity_and_a_survey(found):
    shuffled = [CHANGED[k] for k in np.random.default_rng(0).permutation(60)]
    again = monitored(shuffled, over="days")
    np.testing.assert_allclose(again.charts.t2, found.charts.t2, rtol=1e-6)
    assert again.change == found.change
    followed, plain = (monitored(of, over="days") for of in (fq.survey(CHANGED[:34], over="days"), CHANGED[:34]))
    assert followed.charts.features == plain.charts.features == found.charts.features
    np.testing.assert_allclose(followed.charts.t2, plain.charts.t2, rtol=1e-6)


@pytest.mark.slow
def test_amounts_grow_with_the_crack():
    points = points_of(lambda k: 2.0 * max(0, k - 30))
    found = monitored(points)
    assert not found.amounts.along
    assert found.amounts.trend.p_value < 1e-3
    assert found.amounts.trend.slope > 0.0
    alone = monitored(points, baseline=None)
    assert alone.charts is None
    assert not alone.alarm.any()
    np.testing.assert_allclose(alone.amounts.value, found.amounts.value)


def test_amounts_along_a_labelled_record():
    points = points_of(lambda k: 4.0 * max(0, k - 40))
    found = monitored(points[:-1], direction=points[-1])
    assert found.amounts.along
    grown = found.amounts.value[50:].mean()
    assert 0.5 < grown < 1.2
    assert found.amounts.trend.p_value < 1e-3
    assert abs(np.mean(found.amounts.value[:30])) < 0.05
    assert (found.amounts.average[55:] > found.amounts.average_limit[55:]).all()
    noisy = monitored(HEALTHY[:-1], direction=HEALTHY[-1])
    assert not noisy.amounts.along
    assert any("do not rise above their noise" in words for words in noisy.warnings)


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (
            HEALTHY[:40],
            {"baseline": slice(0, 10)},
            r"`baseline`.*12 records.*twice its 6 columns, but has 10\.\n.*degree",
        ),
        (HEALTHY, {"baseline": slice(80, 90)}, "name some of the 60 records"),
        (
            HEALTHY,
            {"covariates": ("wind",)},
            r"and wind, but is none of record 0 \(r0\.npz\), which has days, speed_rpm",
        ),
        (HEALTHY, {"rate": 0.7}, "lie below 0.5"),
        (HEALTHY, {"direction": [1.0, 2.0]}, r"changes of the 4 features \(mode 1 decay, .*shape \(2,\)"),
        (HEALTHY, {"over": "hours"}, "quantity of every record, and not hours"),
        ([], {}, "hold a result"),
        ([*HEALTHY[:29], CHANGED[50], *HEALTHY[30:]], {}, r"T² of each record below .*record 29 \(r50\.npz\)"),
        ([without(one, model=None, reason="bad") for one in HEALTHY], {}, "have modes with deviations in the baseline"),
    ],
)
def test_refusals(points, options, message):
    with pytest.raises(InputError, match=message):
        monitored(points, **options)


@pytest.mark.parametrize("change", [lambda k: 0.3 * k, lambda k: 3.0 * (k >= 12)])
def test_a_baseline_that_changes_is_refused(change):
    """It would be taken for scatter, and what comes later for no more than that."""
    with pytest.raises(InputError, match=r"of a machine that does not change, but.*from record \d+"):
        monitored(points_of(change))


def test_tables_and_json(found):
    columns = monitor_columns(found)
    assert {len(column) for column in columns.values()} == {60}
    assert columns["alarm"][50]
    assert columns_text(columns).count("\n") == 61
    summary = monitor_summary(found)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["format"] == "floquid-monitor/1"
    wanted = {"file", "t2", "t2_limit", "ewma", "ewma_limit", "alarm", "extrapolated", "periodic_amount",
              "periodic_amount_std", "reason"}  # fmt: skip
    assert wanted <= set(summary["records"][0])
    assert summary["change"]["interval"][0] <= 45
    assert monitor_summary(monitored(HEALTHY, baseline=None))["change"] is None


def test_every_field_comes_back(found, tmp_path):
    assert found.change.carried_by
    assert found.amounts.trend
    for kept in (replace(found, reasons=("Too short.", *found.reasons[1:])), replace(found, charts=None, change=None)):
        fq.save(kept, tmp_path / "monitor.h5")
        assert_same(kept, fq.load(tmp_path / "monitor.h5"), "monitor")


def test_summary_and_figures(found):
    assert "It changes at once from record 45" in found.summary()
    assert isinstance(found.plot.monitor(), Figure)
    assert isinstance(found.plot.periodic_amount(), Figure)
    alone = monitored(HEALTHY, baseline=None)
    assert dir(alone.plot) == ["periodic_amount"]
    with pytest.raises(InputError, match="be a Monitor"):
        fq.plot.monitor("monitor")
    with pytest.raises(InputError, match="have a baseline"):
        fq.plot.monitor(alone)
    with pytest.raises(InputError, match="have records with sidebands"):
        fq.plot.periodic_amount(replace(found, amounts=None))


@pytest.mark.pages
def test_page(found, tmp_path):
    text = fq.report(found, tmp_path / "monitor.html").read_text(encoding="utf-8")
    assert "It changes at once from record 45" in text
    assert "r59.npz" in text
