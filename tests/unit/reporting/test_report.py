"""The report as a file: what it says, what it shows, and what it refuses."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from tests.decays import with_decay

import floquid as fq
from floquid.checks import Criterion
from floquid.errors import InputError
from floquid.exports._modes import csv_bytes
from floquid.findings import Finding, failure
from floquid.lti import ERA
from floquid.order import Stability
from floquid.order import scan as scan_orders
from floquid.reporting import _page
from floquid.reporting._case import CURVES, DASHES, MARKERS, MOST_CHANNELS, POINTS, case_of
from floquid.reporting._modes_figures import MOST, _upper, element_name, elements_shown
from floquid.reporting._page import page
from floquid.reporting._record_figures import _poles, response_sources
from floquid.reporting._words import CRITERIA, checks, minus, noise_table, steps
from floquid.systems import Run
from floquid.views import _mode_table, mode_table, multiplier_ellipses

pytestmark = pytest.mark.pages

TEMPLATES = Path(_page.__file__).parent / "page"

LARGEST = 6_000_000
"""Bytes that a page may have."""


def without_scripts(text):
    return re.sub(r"<(script|style)\b.*?</\1>", "", text, flags=re.DOTALL)


@pytest.fixture(scope="module")
def analysis():
    record = fq.systems.JeffcottRotor().simulate(n_periods=256, noise=0.02, seed=3)
    return fq.identify(record, states=["X", "Y"])


@pytest.fixture(scope="module")
def text(analysis, tmp_path_factory):
    return fq.report(analysis, tmp_path_factory.mktemp("report") / "report.html").read_text(encoding="utf-8")


def test_the_modes_come_first_then_the_verdict(text):
    words = without_scripts(text)
    places = [words.index(part) for part in ('id="modes"', "The model passes its checks.", 'id="mode"', 'id="cite"')]
    assert places == sorted(places)


@pytest.fixture
def no_figures(monkeypatch):
    """A page of words alone: drawing takes most of its time."""
    monkeypatch.setattr(_page, "decay_part", lambda _: ({}, {}))
    monkeypatch.setattr(_page, "system_figures", lambda *_: {})


def test_options_in_a_reason_are_code(analysis, no_figures):
    checked = replace(
        analysis.validation, passed=False, findings=(failure("system_other", pair=None, trace=True, composition=0.0),)
    )
    assert "`system_times=`" in checked.reasons[0]
    words = page(case_of(replace(analysis, validation=checked), None), title=None, truth=None)
    assert "<code>--system-times</code>" in words
    assert "`" not in without_scripts(words)


def test_every_mark_can_be_filled_and_open():
    assert not {"x", "cross", "asterisk", "dash", "dot", "y"} & set(MARKERS)
    assert len(set(MARKERS)) == len(MARKERS) == len(CURVES) == len(set(zip(CURVES, DASHES, strict=True)))


def test_the_page_is_whole(text):
    words = without_scripts(text)
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//""", words)
    assert "<link" not in words.replace('<link rel="icon" href="data:,">', "")
    assert len(text.encode()) < LARGEST
    assert "default-src 'none'" in text


def test_every_mode_stands_with_its_deviation(analysis, no_figures):
    scale = np.repeat([1.0, 3.0], analysis.model.order)  # of a pair both parts have one deviation
    model = replace(analysis.model, covariance=analysis.model.covariance * np.outer(scale, scale))
    assert model.exponent_std[0].imag > 2.0 * model.exponent_std[0].real
    analysis = with_decay(replace(analysis, model=model), fit=replace(analysis.fit, model=model))
    table, text = mode_table(analysis), page(case_of(analysis, None), title=None, truth=None)
    assert len(table.rows) == 2
    for number, mode in enumerate(np.flatnonzero(model.exponents.imag > 0)):
        row = {column.heading: table[column.heading][number] for column in table.columns}
        exponent, std = model.exponents[mode], model.exponent_std[mode]
        cells = {
            row["Re λ [1/s]"]: (exponent.real, std.real),
            row["Im λ [rad/s]"].removeprefix("±"): (exponent.imag, std.imag),
            row["f [Hz]"]: (model.frequencies_hz[mode], model.frequency_std_hz[mode]),
            row["ζ [%]"]: (100.0 * model.damping_ratios[mode], 100.0 * model.damping_ratio_std[mode]),
        }
        for cell, (estimate, deviation) in cells.items():
            value, digits = cell.rstrip(")").split("(")
            unit = 10.0 ** -len(value.partition(".")[2])
            assert float(value) == pytest.approx(estimate, abs=unit)
            assert int(digits) * unit == pytest.approx(deviation, rel=0.06)
            assert minus(cell) in text
        assert float(row["|μ|"]) == pytest.approx(abs(model.multipliers[mode]), abs=1e-4)
        assert float(row["folded"]) == pytest.approx(abs(model.principal()[mode].imag) / model.fundamental, abs=1e-4)
    short = mode_table(analysis, derived=False)
    assert list(short["f [Hz]"]) == [f"{own:.5g}" for own in model.frequencies_hz[model.exponents.imag > 0]]
    assert short["Re λ [1/s]"] == table["Re λ [1/s]"]


def test_a_column_is_added_in_one_place(analysis, no_figures, monkeypatch):
    column = _mode_table.ModeColumn(
        "half-life [s]", lambda own, mode, _: f"{np.log(0.5) / own.model.exponents[mode].real:.4g}",
        lambda model: {"half-life [s]": np.log(0.5) / model.exponents.real},
    )  # fmt: skip
    monkeypatch.setattr(_mode_table, "COLUMNS", (column, *_mode_table.COLUMNS))
    page_text = page(case_of(analysis, None), title=None, truth=None)
    file = csv_bytes(analysis.model).decode("utf-8-sig")
    for text in (analysis.summary(), page_text, analysis._repr_html_(), file):
        assert "half-life [s]" in text
    numbers = analysis.modes["half-life [s]"]
    for text in (analysis.summary(), page_text, analysis._repr_html_()):
        assert all(f"{value:.4g}" in text for value in numbers)


def said(text):
    return Finding("sentence", "warning", words=text)


def test_a_model_that_fails_says_why(analysis, no_figures):
    found = analysis.validation
    criteria = dict(found.criteria) | {"fit": Criterion(limit=1.5, at_least=True)}
    failed = replace(found, criteria=criteria, passed=False, findings=(said("Half <of it> is missing: look again."),))
    shown = page(
        case_of(replace(analysis, validation=failed, findings=(said("Mind & beware."),)), None), title=None, truth=None
    )
    words = without_scripts(shown)
    assert "The model does not pass its checks." in words
    assert "Half &lt;of it&gt; is missing: look again." in words
    assert "Mind &amp; beware." in words
    assert [row.met for row in checks(replace(analysis, validation=failed))].count(False) == 1


def test_every_criterion_of_the_validation_has_words(analysis):
    assert set(analysis.validation.criteria) <= set(CRITERIA)


def test_what_was_not_checked_is_said(analysis, no_figures):
    words = without_scripts(page(case_of(replace(analysis, validation=None), None), title=None, truth=None))
    assert "was not checked" in words
    assert "passes its checks" not in words


def test_a_long_record_keeps_its_extremes(analysis):
    record = fq.systems.JeffcottRotor().simulate(n_periods=600, noise=0.02, seed=4)
    long = fq.identify(record, validate=False)
    curves = response_sources(case_of(long, None))["record"].modes
    for channel in range(4):
        assert len(curves[channel]["x"]) <= POINTS + 2
        kept = np.float32(record.values[channel])
        assert (curves[channel]["y"].max(), curves[channel]["y"].min()) == (kept.max(), kept.min())


def many_channels(n_channels):
    """A record of three modes seen by many channels."""
    rng = np.random.default_rng(5)
    period, phases, cycles = 1.0, 24, 120
    times = np.arange(phases * cycles) * period / phases
    exponents = np.array([-0.03 + 2.1j, -0.04 + 9.0j, -0.05 + 16.3j])
    shapes = rng.standard_normal((3, n_channels, 3)) + 1j * rng.standard_normal((3, n_channels, 3))
    waves = np.exp(2j * np.pi * np.outer([-1, 0, 1], times))
    values = np.einsum("rcm,mt,rt->ct", shapes, waves, np.exp(np.outer(exponents, times))).real
    values += 0.02 * np.abs(values).max(axis=1, keepdims=True) * rng.standard_normal(values.shape)
    names = [f"a sensor with a rather long name, {number}" for number in range(n_channels)]
    return fq.Record(values=values, sample_rate=phases / period, channels=names, clock=fq.ConstantPeriod(period=period))


@pytest.mark.slow
def test_many_channels_stay_within_the_size(tmp_path):
    found = fq.identify(many_channels(60), validate=False)
    path = fq.report(found, tmp_path / "many.html")
    assert path.stat().st_size < LARGEST
    assert f"{60 - MOST_CHANNELS} more are in the result file" in path.read_text(encoding="utf-8")
    labels = case_of(found, None).labels()
    assert len(set(labels)) == MOST_CHANNELS, "names that begin alike are told apart"


def test_of_many_elements_those_that_vary_most():
    rng = np.random.default_rng(6)
    system = 1e-3 * rng.standard_normal((20, 8, 8))
    system[:, 5, 2] += np.cos(np.linspace(0, 6, 20))
    chosen = elements_shown(system, None, second_order=True)
    assert len(chosen) == MOST
    assert (5, 2) in chosen
    assert all(row >= 4 for row, _ in chosen)
    names = {element_name("B", i, j) for i in range(12) for j in range(12)}
    assert len(names) == 144, "B1,12 is not B11,2"


def test_without_deviations(tmp_path):
    record = fq.systems.JeffcottRotor().simulate(n_periods=100, noise=0.02, seed=3)
    found = fq.identify(record, identifier=ERA(), order=4, harmonics=2, validate=False)
    text = fq.report(found, tmp_path / "era.html").read_text(encoding="utf-8")
    assert "|B| [units of the channels]" in text
    words = without_scripts(text)
    assert "gives no standard deviations" in words
    assert not re.search("bands of 95 %|one standard deviation|see the ellipses", words)


def test_one_channel_that_locks_at_half_a_period(no_figures, tmp_path):
    times = np.arange(16 * 80) / 16.0
    values = np.exp(-0.05 * times) * (np.cos(np.pi * times) + 0.3 * np.cos(3 * np.pi * times))
    values += 0.01 * np.random.default_rng(7).standard_normal(len(times))
    record = fq.Record(values=values[None], sample_rate=16.0, channels=["flap"], clock=fq.ConstantPeriod(period=1.0))
    text = fq.report(fq.identify(record), tmp_path / "lock.html").read_text(encoding="utf-8")
    assert "a negative real multiplier, no pair" in text


def test_a_result_read_back_gives_the_same_page(analysis, text, tmp_path):
    fq.save(analysis, tmp_path / "result.h5")
    again = fq.report(fq.load(tmp_path / "result.h5"), tmp_path / "again.html").read_text(encoding="utf-8")
    assert again == text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"analysis": "result.h5"}, "`analysis` of `report` must be an Analysis, but is a str"),
        ({"analysis": SimpleNamespace(kind=np.zeros(2))}, "must be an Analysis, but is a SimpleNamespace"),
        ({"path": "report.pdf"}, "`path` of `report` must end in .html"),
        ({"path": "no/such/folder/report.html"}, "there is no folder"),
        ({"title": 3}, "`title` of `report` must be a text"),
        ({"truth": np.zeros(3)}, "`truth` of `report` must be a pair"),
        ({"truth": (np.zeros(3), np.zeros((3, 2, 2)))}, "truth"),
    ],
)
def test_mistakes_are_told(analysis, change, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments, told = {"analysis": analysis, "path": "report.html"} | change, []
    with pytest.raises(InputError, match=re.escape(message)):
        fq.report(arguments.pop("analysis"), arguments.pop("path"), progress=told.append, **arguments)
    assert told == [], "nothing is drawn that cannot be written"
    assert list(tmp_path.iterdir()) == []


def test_a_report_that_fails_leaves_the_old_one(analysis, tmp_path):
    path = tmp_path / "report.html"
    path.write_text("the old one", encoding="utf-8")
    with pytest.raises(InputError):
        fq.report(analysis, path, truth=(np.zeros(3), np.zeros((3, 2, 2))))
    assert path.read_text(encoding="utf-8") == "the old one"


def test_truth_needs_an_estimate(tmp_path):
    record = fq.systems.JeffcottRotor().simulate(n_periods=128, noise=0.02, seed=3)
    with pytest.raises(InputError, match="the analysis has none"):
        fq.report(fq.identify(record, validate=False), tmp_path / "r.html", truth=(np.zeros(1), np.zeros((1, 4, 4))))


def test_each_ellipse_is_about_its_mark():
    """Also where the conjugate below the real axis is the mode of the model: the mark is at |Im μ|."""
    record = fq.systems.JeffcottRotor().simulate(n_periods=256, noise=0.02, seed=3)
    shown = case_of(fq.identify(record, validate=False), None)
    multipliers = shown.analysis.model.multipliers[list(shown.modes)]
    assert (multipliers.imag < 0).any()
    ellipses = _upper(multiplier_ellipses(shown.analysis.model), shown)
    centres = ellipses[:, :-1].mean(axis=1)
    np.testing.assert_allclose(centres, multipliers.real + 1j * np.abs(multipliers.imag), rtol=1e-6)


def test_a_pole_belongs_to_the_mode_of_its_decay():
    """Two real multipliers lie at one frequency; their poles differ by the decay alone."""
    times = np.arange(16 * 150) / 16.0
    waves = 1.0 + 0.4 * np.cos(2.0 * np.pi * times), 1.0 + 0.4 * np.sin(2.0 * np.pi * times)
    values = [waves[k] * np.exp(-0.02 * times) + (-1) ** k * np.exp(-0.1 * times) for k in (0, 1)]
    values += 0.005 * np.random.default_rng(8).standard_normal((2, len(times)))
    record = fq.Record(values=values, sample_rate=16.0, channels=["a", "b"], clock=fq.ConstantPeriod(period=1.0))
    found = fq.identify(record, validate=False)
    assert found.model.order == 2
    scan = scan_orders(found.lifted.responses, orders=[2, 3, 4])
    shown = case_of(found, scan)
    principal, seen = found.model.principal()[list(shown.modes)], set()
    for stability in Stability:
        poles = _poles(shown, stability, tuple(np.abs(model.poles.imag) for model in scan.models))
        for decay, row in zip(poles["decay"], poles["row"], strict=True):
            if row >= 0:
                assert row == np.argmin(np.abs(principal.real - decay))
                seen.add(row)
    assert seen == {0, 1}


def test_with_a_tachometer_what_is_left_is_noise_from_a_file_too(tmp_path):
    run = Run(n_periods=40, samples_per_period=25.1, wander=0.003, imbalance=0.5, pulse_deg=36.0).record()
    found = fq.identify(run, tach="tach", periods_per_revolution=2, validate=False)
    curves = response_sources(case_of(found, None))
    left = curves["left"].modes[0]["y"]
    assert left.std() == pytest.approx(found.noise[0, 0], rel=0.1)
    fq.save(found, tmp_path / "result.h5")
    again = fq.load(tmp_path / "result.h5")
    assert np.array_equal(response_sources(case_of(again, None))["left"].modes[0]["y"], left)
    words = without_scripts(page(case_of(again, None), title=None, truth=None))
    assert words.index('id="modes"') < words.index("The speed of the shaft") < words.index('id="mode"')


@pytest.mark.slow
def test_many_samples_a_period_stay_within_the_size(tmp_path):
    record = fq.systems.JeffcottRotor().simulate(n_periods=20, samples_per_period=3000, noise=0.02, seed=1)
    found = fq.identify(record, order=4, harmonics=1, validate=False)
    assert fq.report(found, tmp_path / "dense.html").stat().st_size < 0.6 * LARGEST


def test_the_noise_of_the_page_is_that_of_the_record():
    rng = np.random.default_rng(9)
    quiet = fq.systems.JeffcottRotor().simulate(n_periods=256, noise=0.0, seed=0)
    noise = lfilter([0.01], [1.0, -0.9], rng.standard_normal(quiet.values.shape))
    found = fq.identify(replace(quiet, values=quiet.values + noise), validate=False)
    assert found.lifted.whitening is not None
    for (_, _, (cell,)), own in zip(noise_table(found)[1], noise.std(axis=1), strict=True):
        assert float(cell.split()[0]) == pytest.approx(own, rel=0.1)
    assert any("coloured along the record" in step for step in steps(found))


@pytest.mark.first(1)
@pytest.mark.parametrize("brief", [False, True])
def test_damping_is_the_decrement_where_asked_for(analysis, brief, tmp_path):
    text = fq.report(analysis, tmp_path / "page.html", brief=brief, damping_unit="decrement").read_text("utf-8")
    assert '<th scope="col">δ</th>' in text
    assert "ζ [%]" not in text
    assert "δ = −2π Re λ/|Im λ| go with that line" in text
    if not brief:
        assert '"@damping{%.4g}"' in text
    with pytest.raises(InputError, match='`damping_unit` of `report` must be "percent" or "decrement"'):
        fq.report(analysis, tmp_path / "page.html", damping_unit="%")
