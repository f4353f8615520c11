"""Spectra, residues and coefficients: what is drawn is what was given, and several results are told apart."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.paper._residues import coefficients, residues
from matplotlib.backends.backend_agg import FigureCanvasAgg
from tests.decays import with_decay

from floquid.core import Channel
from floquid.errors import InputError
from floquid.lti import AMI
from floquid.periodic import assemble
from floquid.pipeline import identify
from floquid.plot import composite, save_figure, spectra, system_elements, time_record
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor(damping=0.02)
OMEGA = 2.0 * np.pi / ROTOR.period
N_PHASES = 20


@pytest.fixture(scope="module")
def found():
    """Two hits of unequal length that start at an odd phase."""
    first = ROTOR.simulate(n_periods=60, samples_per_period=N_PHASES, noise=0.01, seed=1, first_phase=0.25)
    second = ROTOR.simulate(
        n_periods=50, samples_per_period=N_PHASES, noise=0.01, seed=2, first_phase=0.1, impulse_deg=80.0
    )
    return identify([first, second], states=["X", "Y"], constrained=False, validate=False)


@pytest.fixture(scope="module")
def pair():
    """The same record by both algorithms."""
    record = ROTOR.simulate(n_periods=60, samples_per_period=N_PHASES, noise=0.01, seed=1)
    return {
        "AMI": identify(record, states=["X", "Y"], identifier=AMI(), constrained=False, validate=False),
        "max. likelihood": identify(record, states=["X", "Y"], constrained=False, validate=False),
    }


def drawn(axes, label):
    (line,) = [line for line in axes.lines if line.get_label() == label]
    return line.get_xdata(), line.get_ydata()


def legend(axes_or_figure):
    box = axes_or_figure.legends[0] if hasattr(axes_or_figure, "legends") else axes_or_figure.get_legend()
    return [text.get_text() for text in box.get_texts()]


def outside_and_overlaps(figure):
    """Labels, titles, numbers and legends, drawn: those that stick out of the figure, and pairs that meet."""
    canvas = FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    renderer = canvas.get_renderer()
    boxes = {}
    for index, axes in enumerate(figure.axes):
        texts = [axes.xaxis.label, axes.yaxis.label, axes.title, axes._left_title]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            texts += [t.label1 for t in axis.get_major_ticks() if low <= t.get_loc() <= high]
        for text in texts:
            if text.get_text() and text.get_visible():
                boxes[f"{index} {len(boxes)} {text.get_text()}"] = text.get_window_extent(renderer)
        if axes.get_legend():
            boxes[f"legend {index}"] = axes.get_legend().get_window_extent(renderer)
    for box in figure.legends:
        boxes["legend"] = box.get_window_extent(renderer)
    names = list(boxes)
    pairs = [(a, b) for k, a in enumerate(names) for b in names[k + 1 :] if boxes[a].overlaps(boxes[b])]
    whole = figure.bbox.padded(1.0)
    return pairs + [n for n, box in boxes.items() if not (whole.contains(*box.p0) and whole.contains(*box.p1))]


# Spectra.


@pytest.mark.parametrize(("angular", "turn", "unit"), [(False, 1.0, "Hz"), (True, 2.0 * np.pi, "rad/s")])
def test_spectra_draw_the_transform_of_the_whole_periods(found, angular, turn, unit):
    figure = spectra(found, ["Y", "X_tt"], (3,), hit=1, angular=angular, limit=turn * 0.25)
    upper, strip, lower = figure.axes
    values = found.records[1].values[1]
    first = round((0.25 - 0.1) * N_PHASES)
    used = values[first : first + 49 * N_PHASES]
    frequencies, magnitudes = drawn(upper, "Y")
    step = ROTOR.period / N_PHASES
    n = np.arange(len(used))
    for line in (0, 7, len(frequencies) - 1):
        assert frequencies[line] == pytest.approx(line * turn / (len(used) * step))
        expected = step * abs(np.sum(used * np.exp(-2j * np.pi * line * n / len(used))))
        assert magnitudes[line] == pytest.approx(expected, rel=1e-9)
    assert frequencies[-1] <= 0.25 * turn
    assert upper.get_xlim() == pytest.approx((0.0, 0.25 * turn))
    assert strip.get_xlabel() == f"frequency [{unit}]"
    assert strip.get_xlim() == upper.get_xlim()
    assert lower.get_xlabel() == rf"frequency in the lifted band, 0 to $\omega$/2 [{unit}]"
    assert lower.get_xlim() == pytest.approx((0.0, 0.5 * turn / ROTOR.period))
    frequencies, magnitudes = drawn(lower, "X_tt, 144°")  # phase 0.25 + 3/20 of 360 degrees
    lifted = found.lifted.responses.values[2 * N_PHASES + 3, 1, :49]
    assert magnitudes == pytest.approx(ROTOR.period * np.abs(np.fft.rfft(lifted)), rel=1e-9)
    assert frequencies == pytest.approx(turn * np.arange(25) / (49 * ROTOR.period))


def test_spectra_mark_the_families_of_the_harmonics_kept(found):
    upper = spectra(found, angular=True).axes[0]
    marks = sorted(line.get_xdata()[0] for line in upper.lines if line.get_color() == "#999999")
    kept = (found.model.coefficients[:, :2] != 0).any(axis=(1, 2))
    expected = {
        round(abs(exponent.imag + m * OMEGA), 9)
        for exponent, row in zip(found.model.exponents, kept, strict=True)
        for m in found.model.harmonics[row]
    }
    assert len(marks) > 4
    assert marks == pytest.approx(sorted(expected))
    # Half a fundamental beyond the highest.
    assert upper.get_xlim()[1] == pytest.approx(marks[-1] + 0.5 * OMEGA)


def test_each_family_has_a_row_with_its_strongest_line_filled(found):
    figure = spectra(found, ["X_tt"], angular=True)
    strip = figure.axes[1]
    assert [label.get_text() for label in strip.get_yticklabels()] == ["mode 1", "mode 2"]
    for row, mode in enumerate((0, 2)):  # one of each pair
        kept = found.model.coefficients[mode, 2].any(axis=0)
        lines = np.abs(found.model.exponents[mode].imag + OMEGA * found.model.harmonics[kept])
        filled, rings = [line for line in strip.lines if set(line.get_ydata()) == {row}]
        assert sorted([*filled.get_xdata(), *rings.get_xdata()]) == pytest.approx(sorted(lines))
        assert filled.get_xdata() == pytest.approx([abs(found.model.exponents[mode].imag)])
        assert rings.get_markerfacecolor() == "none" != filled.get_markerfacecolor()
        names = {text.get_text() for text in strip.texts if text.xy[1] == row}
        assert names <= {"0", "−1", "+1", "−2", "+2"}
        assert "0" in names


def test_spectra_show_the_mean_of_the_noise(found):
    """Noise alone: the mean of its lines lies on the dotted one."""
    noise = found.lifted.noise[0, 0] * np.random.default_rng(0).standard_normal(found.cycles[0].values.shape)
    cycles = (replace(found.cycles[0], values=noise), *found.cycles[1:])
    upper, _, lower = spectra(with_decay(found, cycles=cycles), ["X"], limit=100.0).axes
    for axes, label, lines in ((upper, "X", 600), (lower, "X, 90°", 30)):
        values = drawn(axes, label)[1]
        (level,) = {y for line in axes.lines if line.get_linestyle() == ":" for y in line.get_ydata()}
        assert values[1:-1].mean() == pytest.approx(level, rel=3 * 0.52 / np.sqrt(lines))
        assert axes.get_ylim()[0] == pytest.approx(0.1 * level)


def test_spectra_labels(found):
    upper, _, lower = spectra(found, phases=(0, 5), periods_per_revolution=2).axes
    assert legend(upper) == ["X", "Y", "noise alone, mean", r"identified, $|\mathrm{Im}\,\lambda + m\omega|$"]
    assert legend(lower) == ["X, 45°", "X, 90°", "Y, 45°", "Y, 90°"]
    assert upper.get_ylabel() == "magnitude [s]\nthe record"
    assert lower.get_ylabel() == "magnitude [s]\nlifted responses, by shaft angle"
    assert {axes.get_yscale() for axes in (upper, lower)} == {"log"}
    units = tuple(Channel(name=c.name, unit=unit) for c, unit in zip(found.model.channels, ("mm", "V"), strict=False))
    cycles = tuple(replace(c, channels=(*units, *c.channels[2:])) for c in found.cycles)
    assert spectra(with_decay(found, cycles=cycles), ["X"]).axes[0].get_ylabel() == "magnitude [mm · s]\nthe record"
    assert spectra(with_decay(found, cycles=cycles)).axes[2].get_ylabel().startswith("magnitude [unit · s]\nlifted")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"channels": ["Z"]}, "Argument `channels` of `spectra`"),
        ({"channels": []}, "Argument `channels` of `spectra` must name one to 6"),
        ({"phases": (20,)}, "Argument `phases` of `spectra` must be less than 20"),
        ({"phases": (-1,)}, "Argument `phases`"),
        ({"phases": ()}, "Argument `phases` of `spectra` must name one to 4"),
        ({"phases": range(5)}, "Argument `phases` of `spectra` must name one to 4"),
        ({"hit": 2}, "Argument `hit` of `spectra` must be less than 2"),
        ({"limit": -1.0}, "Argument `limit`"),
        ({"periods_per_revolution": 0}, "Argument `periods_per_revolution` of `spectra`"),
    ],
)
def test_spectra_refuse(found, arguments, words):
    with pytest.raises(InputError, match=words):
        spectra(found, **arguments)


# Residues and coefficients.


def test_residues_are_those_identified_with_the_delay_off(found):
    """Against the residue computed from the model's own coefficients of all harmonics."""
    mode, row, hit = 2, 1, 1
    figure = residues(found, mode, ["Y"], hit=hit)
    whole = assemble(found.modal, found.lifted, harmonics=9)
    own = whole.coefficients[mode, row, hit]
    assert found.model.exponents[mode] == pytest.approx(whole.exponents[mode])
    expected = (own * np.exp(1j * OMEGA * np.outer(found.lifted.phase_times, whole.harmonics))).sum(axis=1)
    smooth = found.model.shapes(np.linspace(0.0, ROTOR.period, 361))[mode, row, hit]
    for axes, part in zip(figure.axes, ("real", "imag"), strict=True):
        phase, values = drawn(axes, "identified")
        assert phase == pytest.approx((0.25 + np.arange(N_PHASES) / N_PHASES) % 1.0 * 360.0)
        # All but the one harmonic at the Nyquist frequency, which two share.
        assert values == pytest.approx(getattr(expected, part), abs=5 * found.lifted.noise[row, hit])
        line = drawn(axes, "harmonics kept")
        assert line[0] == pytest.approx(np.linspace(0.0, 360.0, 361))
        assert line[1] == pytest.approx(getattr(smooth, part), rel=1e-9)
        scatter = np.interp(phase, *line) - values
        assert 0 < np.std(scatter) < 0.2 * np.ptp(values)


def test_residues_labels(found):
    figure = residues(found, periods_per_revolution=2)
    assert len(figure.axes) == 8
    labels = [axes.get_ylabel() for axes in figure.axes[::2]]
    assert labels == ["X [no unit]", "Y [no unit]", "X_tt [no unit]", "Y_tt [no unit]"]
    assert [axes.get_title() for axes in figure.axes[:2]] == ["real part", "imaginary part"]
    assert {axes.get_xlabel() for axes in figure.axes[-2:]} == {"shaft angle [deg]"}
    assert figure.axes[-1].get_xticks() == pytest.approx([0, 45, 90, 135, 180])
    assert legend(figure) == ["identified", "harmonics kept"]


def test_several_analyses_are_paired_by_exponent_and_told_apart(pair):
    """The modes of one analysis are put in another order: the figure still shows the same mode of both."""
    order = [2, 3, 0, 1]
    model = pair["AMI"].model
    turned = replace(
        model,
        exponents=model.exponents[order],
        coefficients=model.coefficients[order],
        coefficient_std=None,
        covariance=None,
    )
    figure = residues({**pair, "turned": replace(pair["AMI"], model=turned)}, 0, ["X"])
    axes = figure.axes[1]
    names = [*pair, "turned"]
    assert legend(figure) == [f"{name}, {what}" for name in names for what in ("identified", "harmonics kept")]
    first, second, third = (drawn(axes, f"{name}, identified")[1] for name in names)
    assert np.array_equal(third, first)
    assert second == pytest.approx(first, abs=0.01)
    looks = {
        (line.get_marker(), line.get_markersize(), line.get_markerfacecolor(), line.get_linestyle())
        for line in axes.lines
    }
    assert len(looks) == 6  # in grey too


def test_coefficients_are_those_of_the_residue(found):
    mode, row = 0, 0
    figure = coefficients(found, mode, "X")
    upper, *lower = figure.axes
    harmonics, magnitudes = drawn(upper, "identified")
    assert len(harmonics) == N_PHASES
    turns = found.model.exponents[mode].imag / OMEGA + np.asarray(harmonics)
    assert (np.abs(turns) <= N_PHASES / 2).all()
    whole = assemble(found.modal, found.lifted, harmonics=9)
    for harmonic, own, std in zip(
        whole.harmonics, whole.coefficients[mode, row, 0], whole.coefficient_std[mode, row, 0], strict=True
    ):
        place = np.flatnonzero(harmonics == harmonic)
        if len(place) and own:
            assert magnitudes[place[0]] == pytest.approx(abs(own), rel=1e-9)
            level = drawn(upper, "one standard deviation")[1][place[0]]
            assert level == pytest.approx(abs(std), rel=1e-9)
    (stems,) = upper.collections
    kept = found.model.harmonics[found.model.coefficients[mode, row, 0] != 0]
    assert [segment[0][0] for segment in stems.get_segments()] == kept.tolist()
    assert 0 < len(kept) < N_PHASES
    assert (upper.get_yscale(), upper.get_ylabel()) == ("log", "|B| of X [no unit]")
    assert upper.get_xlabel() == r"harmonic $m$ of the residue"
    assert len(lower) == 2
    assert np.array_equal(drawn(lower[0], "identified")[1], drawn(residues(found, 0, ["X"]).axes[0], "identified")[1])


def test_coefficients_that_are_dropped_lie_at_the_deviation(pair):
    upper = coefficients(pair["max. likelihood"], 0, "X").axes[0]
    harmonics, magnitudes = drawn(upper, "identified")
    std = drawn(upper, "one standard deviation")[1]
    (stems,) = upper.collections
    kept = np.isin(harmonics, [segment[0][0] for segment in stems.get_segments()])
    ratios = (magnitudes / std)[~kept & np.isfinite(std)]
    assert 0.5 < np.sqrt(np.mean(ratios**2)) < 1.5
    assert (magnitudes[kept] > 4 * std[kept]).all()


def test_coefficients_without_deviations(found):
    bare = replace(found, model=replace(found.model, covariance=None, coefficient_std=None))
    assert legend(coefficients(bare)) == ["identified", "harmonics kept"]


@pytest.mark.parametrize("function", [residues, coefficients])
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"mode": 4}, "Argument `mode` of `{}` must be less than 4"),
        ({"mode": -1}, "Argument `mode` of `{}`"),
        ({"hit": 2}, "Argument `hit` of `{}` must be less than 2"),
        ({"periods_per_revolution": 1.5}, "Argument `periods_per_revolution` of `{}`"),
    ],
)
def test_residues_and_coefficients_refuse(found, function, arguments, words):
    with pytest.raises(InputError, match=words.format(function.__name__)):
        function(found, **arguments)


def test_channels_that_are_not_there(found):
    with pytest.raises(InputError, match="Argument `channels` of `residues`"):
        residues(found, 0, ["Z"])
    with pytest.raises(InputError, match="Argument `channels` of `residues` must name at least one"):
        residues(found, 0, [])
    with pytest.raises(InputError, match="Argument `channel` of `coefficients`"):
        coefficients(found, 0, "Z")


@pytest.mark.first(1)
@pytest.mark.parametrize("function", [residues, coefficients, composite])
def test_several_must_be_analyses(found, function):
    for wrong in ({}, {"one": 1}, [found], dict.fromkeys("abcde", found)):
        with pytest.raises(
            InputError, match=f"Argument `analysis` of `{function.__name__}` must be an Analysis, or up to 4"
        ):
            function(wrong)
    if function is not composite:
        other = identify(found.records, channels=["X", "Y"], validate=False)
        with pytest.raises(InputError, match="analyses of the same channels"):
            function({"all": found, "two": other})


# Several results in the figures that there were.


def test_composite_of_several_has_a_panel_each(pair):
    figure = composite(pair, angular=True)
    assert [axes.get_title(loc="left") for axes in figure.axes] == list(pair)
    assert figure.axes[-1].get_xlabel().endswith("[rad/s]")
    for axes, analysis in zip(figure.axes, pair.values(), strict=True):
        alone = composite(analysis).axes[0]
        for label in ("data", "model", "data − model"):
            frequencies, values = drawn(axes, label)
            assert np.array_equal(values, drawn(alone, label)[1])
            assert frequencies == pytest.approx(2.0 * np.pi * drawn(alone, label)[0])


def test_system_elements_of_several(pair):
    states = {name: analysis.state for name, analysis in pair.items()}
    figure = system_elements(states, periods_per_revolution=2)
    assert legend(figure) == ["AMI, estimated", "max. likelihood, estimated", "95 % intervals"]
    assert figure.axes[-1].get_xlabel() == "shaft angle [deg]"
    for name, state in states.items():
        angle, values = drawn(figure.axes[1], f"{name}, estimated")
        assert angle == pytest.approx(3.6 * np.arange(50))
        assert np.array_equal(values, state.system[:, 2, 1])
    other = replace(states["AMI"], states=("a", "b", "c", "d"))
    with pytest.raises(InputError, match="Argument `state` of `system_elements` must hold models in the same states"):
        system_elements({**states, "other": other})


@pytest.mark.parametrize(
    ("turns", "phase", "words"),
    [
        (None, 3, "phase 3 of 20, once a period"),
        (1, 0, "shaft at 90°"),
        (2, 0, "shaft at 45° or 225°"),
        (5, 5, "shaft at 36° and every 72° from there"),
    ],
)
def test_the_circles_of_the_record_are_named_by_the_angle(found, turns, phase, words):
    assert legend(time_record(found, phase=phase, periods_per_revolution=turns))[1] == words


# All of them.


@pytest.mark.pages
def test_every_figure_is_drawn_without_overlap(found, pair):
    names = {"a name of some length": pair["AMI"], "another one, longer by some": pair["max. likelihood"]}
    states = {name: analysis.state for name, analysis in pair.items()}
    for figure in (
        spectra(found, ["X", "Y", "X_tt"], (0, 7), periods_per_revolution=2),
        residues(found, 2, ["X"]),
        residues(names, 0),
        coefficients(found, hit=1),
        coefficients(names, 2, "Y_tt", periods_per_revolution=2),
        composite(pair),
        system_elements(states, periods_per_revolution=2),
    ):
        assert outside_and_overlaps(figure) == []


@pytest.mark.slow
def test_save_figure(found, tmp_path):
    figure = composite(found)
    for name, start in (("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.PDF", b"%PDF")):
        path = save_figure(figure, tmp_path / name)
        first = path.read_bytes()
        assert first.startswith(start)
        assert save_figure(figure, tmp_path / name).read_bytes() == first
    for wrong in ("a", "a.gif", "none/a.png"):
        with pytest.raises(InputError, match="Argument `path` of `save_figure`"):
            save_figure(figure, tmp_path / wrong)
