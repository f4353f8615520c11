"""The page of records whose excitation goes on: what it says, what it draws, and what it leaves out without inputs."""

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.driven import ambient_of, lag, mathieu, record_of, two_masses
from tests.unit.transfer.test_fit import of_equations

import floquid
from floquid import Channel, Record
from floquid.findings import warning
from floquid.inputs import TransferFunctions
from floquid.pipeline import predicted_rest
from floquid.reporting._chosen_figures import harmonic_source
from floquid.reporting._driven_figures import (
    harmonic_figure,
    matrix_rows,
    measured_beside,
    measured_figures,
    paths_of,
)
from floquid.views import magnitude_bands, spectra_of_modes

PHASES = 20


def record_with_force(system, periods):
    values, inputs = record_of(system, periods, PHASES, 0.02, 1)
    channels = [Channel(name="tip <b>", unit="mm"), Channel(name="force", unit="N")]
    return Record(values=np.vstack([values, inputs]), sample_rate=PHASES / system.period, channels=channels)


@pytest.fixture(scope="module")
def driven():
    system = mathieu()
    record = record_with_force(system, 50)
    return floquid.identify(record, period=system.period, inputs=["force"], states=["tip <b>"], system_times=8)


def words_of(page):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", page[: page.index('<script type="application/json"')]))


def test_the_page_of_a_driven_analysis(driven, tmp_path):
    page = floquid.report(driven, tmp_path / "report.html").read_text(encoding="utf-8")
    said = words_of(page)
    assert "The model passes its checks." in said
    assert "1 mode (order 2) found in 1 record of 1 output and 1 measured input, 50 periods" in said
    assert "Harmonic transfer functions" in said
    assert "by a fit to the first three quarters alone" in said
    assert "The records are too short for that: a line is measured over 0.248 Hz" in said
    assert "deviations apart" not in page
    assert "no standard deviations" not in said
    assert "tip &lt;b&gt;" in page
    assert "The state matrix A(t) and the input matrix B(t)" in said
    assert (
        "x′ = A(t) x + B(t) u with the states 1: tip &lt;b&gt;, 2: d/dt tip &lt;b&gt; and the inputs 1: force" in said
    )
    assert "Shown: 2 of 4 elements of A(t) and 1 of 2 of B(t); summary.json holds all." in said
    for label in (
        "A21 [1/s\\u00b2]",
        "B21 [mm/N \\u00b7 1/s\\u00b2]",
        "|G| [mm/N]",
        "arg G [\\u00b0]",
        "|b| times rms [1/s]",
        "response [mm]",
        "time [s]",
    ):
        assert f'"{label}"' in page


@pytest.mark.slow
def test_the_page_of_outputs_alone_has_no_inputs(tmp_path):
    system = mathieu()
    values = ambient_of(system, 400, PHASES, 0.02, 1)
    record = Record(values=values, sample_rate=PHASES / system.period, channels=["y"])
    found = floquid.identify(record, period=system.period, validate=False, excitation="ambient")
    said = words_of(floquid.report(found, tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "The model was not checked" in said
    assert "no samples were left out" in said
    assert "transfer functions" not in said
    assert "The state matrix" not in said
    assert "delayed" not in said


@pytest.mark.pages
def test_each_mode_of_outputs_alone_has_its_lines_in_the_spectra_and_what_its_decay_needs(tmp_path):
    system, periods = two_masses(), 100
    values = ambient_of(system, periods, PHASES, 0.02, 1) * [[1.0], [1e3]]
    channels = [Channel(name="tower", unit="m"), Channel(name="blade", unit="με")]
    record = Record(values=values, sample_rate=PHASES / system.period, channels=channels)
    found = floquid.identify(record, period=system.period, validate=False, excitation="ambient")
    page = floquid.report(found, tmp_path / "report.html").read_text(encoding="utf-8")
    model, modes = found.model, list(found.model.upper_modes)
    needed = periods * (model.exponent_std.real / 0.1 / model.exponents.real)[modes] ** 2
    lengths = [int(one) for one in re.findall(r'<td>(\d+)</td><td class="words">', page)]
    assert lengths == pytest.approx(needed, rel=0.01)
    assert len(lengths) == 2
    assert max(lengths) > 1.3 * min(lengths)
    assert '"harmonic power spectra [1/Hz]"' in page
    assert "Channels of different units are divided by their rms." in words_of(page)
    spectra = spectra_of_modes(found)
    lines = harmonic_source(spectra)
    drawn = harmonic_figure(spectra, lines)
    (numbers,) = (own.data_source.data for own in drawn.renderers if own.glyph.__class__.__name__ == "Text")
    assert np.sort(numbers["x"]) == pytest.approx(np.sort(np.abs(model.exponents.imag[modes])) / (2.0 * np.pi))
    for row, mode in zip(lines.modes, modes, strict=True):
        moved = np.abs(model.exponents.imag[mode] + np.array([-1.0, 0.0, 1.0])) / (2.0 * np.pi)
        assert all(np.abs(row["frequency"] - line).min() < 1e-9 for line in moved)


def test_samples_left_out_are_predicted_by_the_first_three_quarters_alone(driven):
    found, fitted = predicted_rest(driven)
    assert fitted.sum() == 750
    samples = driven.fit.samples
    left = samples.values - found
    assert np.std(left[0, ~fitted]) < 1.3 * driven.noise[0, 0]
    # The fit to all is another one.
    whole = driven.fit.at.columns.response(driven.fit.at.coefficients)
    assert np.abs(found - whole).max() > 1e-6 * np.abs(whole).max()


def test_paths_and_harmonics_that_are_large_are_named():
    values = np.zeros((2, 2, 2, 3), complex)
    values[0, 0, 0], values[1, 0, 0], values[1, 1, 1] = [1.0, 2.0, 1.0], 0.5j, 3.0
    found = TransferFunctions(
        frequencies_hz=[1.0, 2.0, 3.0], harmonics=[0, 1], values=values, std=None,
        outputs=(Channel(name="a"), Channel(name="b")), inputs=(Channel(name="u"), Channel(name="v")),
    )  # fmt: skip
    assert paths_of(found, np.ones((2, 1)), np.ones(2))[0] == (0, 0)
    rows = matrix_rows(found, [(0, 0), (1, 1)])
    assert rows == [("u to a", [("100 %", 130), ("25 %", 224)]), ("v to b", [("0 %", 255), ("100 %", 130)])]


def test_a_band_holds_its_curve_and_goes_to_the_end_of_the_axis_where_nothing_is_told():
    values, std = np.array([[2.0, 1e-5]]), np.array([[0.1 + 0.1j, 0.1 + 0.1j]])
    found = TransferFunctions(
        frequencies_hz=[1.0, 2.0], harmonics=[0], values=values[:, None, None], std=std[:, None, None],
        outputs=(Channel(name="a", unit="m"),), inputs=(Channel(name="u", unit="m/s"),),
    )  # fmt: skip
    size, low, high, floor = magnitude_bands(found, 0, 0)
    assert low[0] == pytest.approx([2.0 - 0.196, floor])
    assert high[0] == pytest.approx([2.0 + 0.196, 0.196 + 1e-5])
    assert size[0, 1] < floor < 0.1
    assert found.unit(0, 0) == "m/(m/s)"


def test_every_result_says_in_one_line_what_it_is(driven):
    assert repr(driven) == "Analysis(order=2, period=3.142 s, 1 channel, 1 input, 50 periods: passes)"
    assert "The model passes its checks." in driven._repr_html_()
    assert driven.summary().splitlines()[0].startswith("1 record, 1 input and 1 output")


def test_the_frequencies_of_transfer_functions_have_the_tops_of_the_resonances(driven):
    model = driven.model
    peak = driven.transfer([model.exponents[0].imag / (2.0 * np.pi)], [0])
    assert np.abs(driven.transfer(harmonics=[0]).values).max() == pytest.approx(abs(peak.values[0, 0, 0, 0]), rel=1e-3)


@pytest.mark.pages
def test_lines_measured_without_the_model_tell_a_wrong_one(tmp_path):
    system = mathieu()
    record = record_with_force(system, 200)
    found = floquid.identify(record, period=system.period, inputs=["force"], validate=False)
    page = floquid.report(found, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Polynomials over" in words_of(page)
    assert 0.7 < float(re.search(r"([\d.]+) deviations apart", page)[1]) < 1.5
    # The same lines beside a model of another force.
    louder = replace(record, values=record.values * [[1.0], [1.1]])
    measured, _ = measured_beside(replace(found, records=(louder,)), found.transfer())
    at, drawn = (
        found.transfer(hertz, measured.transfer.harmonics, sampled=True)
        for hertz in (measured.transfer.frequencies_hz, None)
    )
    wrong = measured_figures(measured.transfer, at, drawn, [(0, 0)])[0].title.text
    assert float(re.search(r"([\d.]+) deviations apart", wrong)[1]) > 3.0


@pytest.mark.pages
def test_the_page_of_modes_fitted_to_lines(tmp_path):
    """Of two inputs in turn half of the lines of a path are missing: so is one here."""
    lines = of_equations(lag(), np.linspace(0.02, 0.4, 20), harmonics=np.arange(-1, 2))
    missing = np.arange(20) == 7
    values, std = (np.where(missing, np.nan, own) for own in (lines.values, lines.std))
    fit = floquid.fit_transfer(replace(lines, values=values, std=std), period=lag().period)
    page = floquid.report(fit, tmp_path / "report.html").read_text(encoding="utf-8")
    said = words_of(page)
    assert "The modes explain the lines." in said
    assert "1 mode (order 1) fitted to 19 lines from 0.02 to 0.4 Hz of 1 input and 1 output, 3 harmonics" in said
    apart = [float(one) for one in re.findall(r"m = -?\d: ([\w.]+) deviations apart", page)]
    assert len(set(apart)) >= 2
    assert 0.5 < min(apart) <= max(apart) < 1.6
    for hidden in ("The state matrix", "phase is drawn", "Which input reaches", "The record and the model"):
        assert hidden not in said
    # The same modes beside lines that are twice as large, with what is then found.
    measured = replace(fit.measured, values=2.0 * fit.measured.values)
    misfit = replace(fit, measured=measured, findings=(warning("modes_of_lines_misfit", ratio=2.0),))
    page = floquid.report(misfit, tmp_path / "report.html").read_text(encoding="utf-8")
    assert max(float(one) for one in re.findall(r"([\w.+]+) deviations apart", page)) > 10.0
    said = words_of(page)
    assert "The modes do not explain all of the lines." in said
    assert "2 times the variance of the lines" in said


def test_where_no_lines_can_be_measured_the_page_says_why(driven):
    short = replace(driven, records=(replace(driven.records[0], values=driven.records[0].values[:, :60]),))
    assert "period" in measured_beside(short, driven.transfer())[1][0]
