"""Figures: what is drawn is what was given, the axes say what they show, and matplotlib's own state stays as it was."""

import io
import subprocess
import sys
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from tests.decays import two_hits, with_decay

from floquid.core import Channel
from floquid.errors import InputError
from floquid.lti import WHITE, composites
from floquid.pipeline import Analysis, identify
from floquid.plot import FIGURES, composite, save_figures, system_elements, time_record
from floquid.plot._style import plain
from floquid.reconstruction import StateModel
from floquid.systems import JeffcottRotor
from floquid.views import envelope

ROTOR = JeffcottRotor(damping=0.02)

OF_DECAYS = [name for name in FIGURES if name not in ("speed", "transfer", "harmonic_spectra")]
"""Those of free responses at a constant period, with an A(t)."""


@pytest.fixture(scope="module")
def found():
    return two_hits()


def drawn(axes, label=None):
    """The points of the one line of `axes` with that label."""
    (line,) = [line for line in axes.lines if label is None or line.get_label().startswith(label)]
    return line.get_xdata(), line.get_ydata()


def legend(figure):
    (box,) = figure.legends
    return [text.get_text() for text in box.get_texts()]


def rendered(figure):
    """The renderer of the figure, when it has been drawn."""
    canvas = FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    return canvas.get_renderer()


def overlaps(figure):
    """Titles, axis labels, tick labels and legend of the figure, drawn: pairs that meet, and those that stick out."""
    renderer = rendered(figure)
    boxes = {}
    axes = [inner for outer in figure.axes for inner in (outer, *outer.child_axes)]
    for index, one in enumerate(axes):
        texts = [one.xaxis.label, one.yaxis.label, one.title, one.xaxis.offsetText, one.yaxis.offsetText]
        ticks = []
        for axis in (one.xaxis, one.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks += [t.label1 for t in axis.get_major_ticks() if low <= t.get_loc() <= high and t.label1.get_visible()]
        for text in texts + ticks:
            if text.get_text() and text.get_visible():
                boxes[f"{index} {len(boxes)} {text.get_text()}"] = text.get_window_extent(renderer)
    boxes["legend"] = figure.legends[0].get_window_extent(renderer)
    names = list(boxes)
    pairs = [(a, b) for k, a in enumerate(names) for b in names[k + 1 :] if boxes[a].overlaps(boxes[b])]
    outside = [n for n, box in boxes.items() if not figure.bbox.padded(1.0).fully_contains(*box.p0)]
    outside += [n for n, box in boxes.items() if not figure.bbox.padded(1.0).fully_contains(*box.p1)]
    return pairs + outside


# The time record.


def test_time_record_draws_the_record_and_one_lifted_response(found):
    figure = time_record(found, "Y", phase=3, hit=1)
    (axes,) = figure.axes
    record = found.fit.free[1]
    times, values = drawn(axes, "Y")
    assert np.array_equal(times, record.times)
    assert np.array_equal(values, record.values[1])
    instants, samples = drawn(axes, "phase 3 of 20")
    assert np.array_equal(samples, found.lifted.responses.values[20 + 3, 1, :49])
    # The instants are those of the samples in the record, and lie at one phase of the clock.
    index = np.rint((instants - record.start) * record.sample_rate).astype(int)
    assert np.array_equal(record.values[1, index], samples)
    phases = (instants / ROTOR.period) % 1.0
    assert phases == pytest.approx(np.full(49, 0.25 + 3 / 20), abs=1e-9)


def test_time_record_inset_shows_the_first_cycles(found):
    (axes,) = time_record(found, phase=2, inset_cycles=4).figure.axes
    (inset,) = axes.child_axes
    line, marks = inset.lines
    assert np.array_equal(line.get_ydata(), found.records[0].values[0, : 2 + 4 * 20 + 1])
    assert np.array_equal(marks.get_ydata(), found.cycles[0].values[0, 2, :5])
    assert inset.get_title() == "the first 4 periods, same units"


def test_time_record_of_a_short_record(found):
    (axes,) = time_record(found, inset_cycles=500).axes
    line, marks = axes.child_axes[0].lines
    assert len(line.get_xdata()) == found.records[0].n_samples
    assert len(marks.get_xdata()) == found.cycles[0].n_cycles


def test_time_record_labels(found):
    figure = time_record(found, hit=1)
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "X [no unit]")
    assert legend(figure) == ["X, hit 2", "phase 0 of 20, once a period"]


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("factor", "unit", "label", "ticks"),
    [
        (1.0, "mm", "X [mm]", 1.0),
        (1e-7, "m", "X [$10^{-9}$ m]", 1e-9),
        (1e6, "-", "X [$10^{3}$]", 1e3),
        (1e-7, "m/s^2", "X [$10^{-9}$ m/s^2]", 1e-9),
    ],
)
def test_small_and_large_values_have_their_power_in_the_unit(found, factor, unit, label, ticks):
    records = tuple(
        replace(r, values=r.values * factor, channels=(Channel(name="X", unit=unit), *r.channels[1:]))
        for r in found.fit.free
    )
    figure = time_record(with_decay(found, fit=replace(found.fit, free=records)))
    (axes,) = figure.axes
    assert axes.get_ylabel() == label
    assert np.array_equal(drawn(axes, "X")[1], records[0].values[0])
    rendered(figure)
    shown = {
        tick.get_loc(): float(tick.label1.get_text().replace("−", "-"))
        for tick in axes.yaxis.get_major_ticks()
        if tick.label1.get_text()
    }
    assert len(shown) > 3
    assert [number * ticks for number in shown.values()] == pytest.approx(list(shown), abs=1e-9 * factor)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"channel": "Z"}, "Argument `channel` of `time_record`"),
        ({"phase": 20}, "Argument `phase` of `time_record` must be less than 20"),
        ({"phase": -1}, "Argument `phase` of `time_record`"),
        ({"hit": 2}, "Argument `hit` of `time_record` must be less than 2"),
        ({"inset_cycles": 0}, "Argument `inset_cycles`"),
    ],
)
def test_time_record_refuses(found, arguments, words):
    with pytest.raises(InputError, match=words):
        time_record(found, **arguments)


@pytest.mark.slow
def test_the_inset_never_covers_the_record(found):
    """Also when the response does not decay: the record then gets the lower part of the axes."""
    steady = tuple(
        replace(r, values=np.sin(np.arange(r.n_samples))[None] + [[3.0], [1], [1], [1]]) for r in found.fit.free
    )
    for analysis in (found, with_decay(found, fit=replace(found.fit, free=steady))):
        figure = time_record(analysis)
        (axes,) = figure.axes
        box = axes.child_axes[0].get_tightbbox(rendered(figure))
        times, values = drawn(axes, "X")
        points = axes.transData.transform(np.column_stack([times, values]))
        assert not [point for point in points if box.contains(*point)]


# A long curve.


@pytest.mark.parametrize(("n", "points"), [(10001, 400), (4001, 4000), (999, 10), (50, 2), (7, 3)])
def test_envelope_keeps_extremes_and_invents_nothing(n, points):
    rng = np.random.default_rng(n)
    x = np.cumsum(rng.random(n))
    y = rng.standard_normal(n)
    y[[n // 3, n // 2]] = 40.0, -50.0
    thin_x, thin_y = envelope(x, y, points)
    assert len(thin_x) <= points
    assert (np.diff(thin_x) > 0).all()
    where = np.searchsorted(x, thin_x)
    assert np.array_equal(x[where], thin_x)
    assert np.array_equal(y[where], thin_y)
    assert (thin_y.max(), thin_y.min()) == (y.max(), y.min())


def test_envelope_keeps_the_extremes_of_every_stretch():
    x = np.arange(1000.0)
    y = np.sin(x) * np.exp(-x / 300)
    thin_x, thin_y = envelope(x, y, 100)
    for start in range(0, 1000, 20):
        inside = (thin_x >= start) & (thin_x < start + 20)
        block = y[start : start + 20]
        assert {thin_y[inside].min(), thin_y[inside].max()} == {block.min(), block.max()}


def test_a_short_curve_is_kept_whole():
    x, y = np.arange(5.0), np.array([1.0, np.nan, 3.0, 4.0, 5.0])
    assert envelope(x, y, 5)[1] is y


def test_a_long_record_is_thinned_in_the_figure(found, monkeypatch):
    monkeypatch.setattr("floquid.plot._record.POINTS", 100)
    (axes,) = time_record(found).axes
    times, values = drawn(axes, "X")
    record = found.records[0].values[0]
    assert len(times) <= 100 < len(record)
    assert (values.max(), values.min()) == (record.max(), record.min())


# The composite.


def test_composites_are_mean_magnitudes_of_spectra(found):
    """Against the sum written out, one response at a time."""
    got = composites(found.lifted.responses, found.modal)
    lengths = found.lifted.responses.lengths
    assert lengths.tolist() == [60, 49]
    lines = np.arange(31)
    expected = np.zeros((3, 31))
    for hit, length in enumerate(lengths):
        m = np.arange(length)
        kernel = np.exp(-2j * np.pi * np.outer(m, lines) / 60) / np.sqrt(length)
        for output in range(80):
            std = found.lifted.responses.noise[output, hit]
            data = found.lifted.responses.values[output, hit, :length]
            model = sum(
                r * np.exp(m * np.log(mu))
                for r, mu in zip(found.modal.residues[:, output, hit], found.modal.multipliers, strict=True)
            )
            expected += np.abs([data @ kernel, model @ kernel, (data - model) @ kernel]) / std / 160
    assert got.data == pytest.approx(expected[0], rel=1e-10)
    assert got.model == pytest.approx(expected[1], rel=1e-10)
    assert got.difference == pytest.approx(expected[2], rel=1e-8)
    assert got.angles == pytest.approx(2.0 * np.pi * lines / 60)


def test_composites_do_not_depend_on_the_block(found, monkeypatch):
    whole = composites(found.lifted.responses, found.modal)
    monkeypatch.setattr("floquid.lti._poles.BLOCK", 7 * 60)
    assert composites(found.lifted.responses, found.modal).data == pytest.approx(whole.data, rel=1e-12)


def test_the_difference_of_a_right_model_lies_on_the_level_of_white_noise(found):
    """160 responses: the mean over 29 lines, less the share that the fit takes, within 2 %; the data are above it."""
    got = composites(found.lifted.responses, found.modal)
    taken = np.sqrt(1 - found.modal.order / found.lifted.responses.lengths.mean())
    assert got.difference[1:-1].mean() == pytest.approx(WHITE * taken, rel=0.02)
    assert got.data.max() > 20 * WHITE


@pytest.mark.slow
def test_composites_do_not_depend_on_units(found):
    records = tuple(replace(r, values=r.values * np.array([[1e-6], [1.0], [1e3], [1.0]])) for r in found.records)
    one, other = (composites(a.lifted.responses, a.modal) for a in (found, identify(records, validate=False)))
    assert other.data == pytest.approx(one.data, rel=1e-3)


def test_composite_draws_curves_level_and_modes(found):
    figure = composite(found)
    (axes,) = figure.axes
    got = composites(found.lifted.responses, found.modal)
    for label, values in {"data": got.data, "model": got.model, "data −": got.difference}.items():
        lines = [line for line in axes.lines if line.get_label() in (label, "data − model")]
        line = next(line for line in lines if line.get_label().startswith(label))
        assert np.array_equal(line.get_ydata(), values)
        assert line.get_xdata() == pytest.approx(got.angles / (2.0 * np.pi * ROTOR.period))
    assert drawn(axes, "white noise")[1] == [WHITE, WHITE]
    marks = sorted(
        {line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == "--" or len(line.get_xdata()) == 2}
    )
    folded = np.abs(found.model.principal().imag) / (2 * np.pi)
    assert marks[1:] == pytest.approx(np.unique(folded.round(9)), abs=1e-6)
    assert axes.get_yscale() == "log"
    assert axes.get_xlim() == pytest.approx((0.0, 0.5 / ROTOR.period))
    assert axes.get_xlabel() == r"frequency in the lifted band, 0 to $\omega$/2 [Hz]"
    assert axes.get_ylabel() == "mean magnitude / noise"
    assert legend(figure) == ["data", "model", "data − model", "white noise alone", "modes, folded"]


def test_modes_below_the_visible_range_do_not_flatten_the_figure(found):
    modal = replace(found.modal, residues=found.modal.residues * 1e-30)
    (axes,) = composite(with_decay(found, modal=modal)).axes
    assert 0.1 < axes.get_ylim()[0] < WHITE


# A(t).


def test_system_elements_draws_the_elements_and_the_truth(found):
    times = np.linspace(0.0, ROTOR.period, 181)
    truth = ROTOR.system(times)
    figure = system_elements(found.state, ((3, 1), (3, 2), (4, 4)), (times, truth), period=ROTOR.period)
    assert [axes.get_ylabel() for axes in figure.axes] == ["A(3,1) [1/s²]", "A(3,2) [1/s²]", "A(4,4) [1/s]"]
    assert legend(figure) == ["truth", "estimated", "95 % intervals"]
    assert figure.axes[-1].get_xlabel() == "phase of the period [deg]"
    for axes, (i, j) in zip(figure.axes, ((2, 0), (2, 1), (3, 3)), strict=True):
        phase, values = drawn(axes, "estimated")
        assert np.array_equal(values, found.state.system[:, i, j])
        assert phase == pytest.approx(np.arange(50) * 7.2)
        phase, values = drawn(axes, "truth")
        assert np.array_equal(values, truth[:, i, j])
        assert (phase[0], phase[-1]) == pytest.approx((0.0, 360.0))
        (marker,) = [line for line in axes.lines if line.get_label() == "estimated"]
        assert (marker.get_marker(), marker.get_linestyle()) == ("o", "None")


def test_system_elements_by_default(found):
    figure = system_elements(found.state)
    assert [axes.get_ylabel()[:6] for axes in figure.axes] == ["A(3,1)", "A(3,2)", "A(3,3)"]
    assert legend(figure) == ["estimated", "95 % intervals"]
    assert drawn(figure.axes[0])[0] == pytest.approx(np.arange(50) * 7.2)


def state(n, std=False, times=None):
    instants = np.arange(10) * 0.1 if times is None else times
    system = np.random.default_rng(0).standard_normal((len(instants), n, n))
    names = [f"s{k}" for k in range(n // 2)]
    return StateModel(
        times=instants,
        transition=system,
        system=system,
        condition=np.ones(len(instants)),
        states=(*names, *(f"d/dt {name}" for name in names)),
        system_std=np.full(system.shape, 0.25) if std else None,
    )


@pytest.mark.parametrize(("n", "labels"), [(2, ["A(2,1)", "A(2,2)"]), (6, ["A(4,1)", "A(4,2)", "A(4,4)"])])
def test_default_elements_of_other_sizes(n, labels):
    assert [axes.get_ylabel().split()[0] for axes in system_elements(state(n)).axes] == labels


def band(axes):
    """The lower and the upper edge of the band of `axes`, by angle: {degrees: (low, high)}."""
    (drawn_band,) = axes.collections
    edges = {}
    for x, y in drawn_band.get_paths()[0].vertices:
        edges.setdefault(round(float(x), 6), []).append(float(y))
    return {x: (min(y), max(y)) for x, y in edges.items()}


@pytest.mark.parametrize("order", [np.arange(10), np.arange(10)[::-1]])
def test_standard_deviations_are_bands_of_95_percent(order):
    model = state(4, std=True)
    model = replace(model, **{name: getattr(model, name)[order] for name in ("times", "system", "transition")})
    figure = system_elements(model, ((3, 1),), period=1.0)
    edges, known = band(figure.axes[0]), dict(zip(model.times, model.system[:, 2, 0], strict=True))
    # Ten instants, and the first one again at the end of the period.
    assert sorted(edges) == pytest.approx(36.0 * np.arange(11))
    for degrees, (low, high) in edges.items():
        middle = known[min(known, key=lambda t, x=degrees: abs(t - x / 360.0 % 1.0))]
        assert (low, high) == pytest.approx((middle - 1.96 * 0.25, middle + 1.96 * 0.25))
    assert legend(figure) == ["estimated", "95 % intervals"]
    assert legend(system_elements(state(4))) == ["estimated"]


@pytest.mark.parametrize(
    ("first", "second", "units"),
    [
        ("mm", "mm", {(3, 1): "1/s²", (3, 2): "1/s²", (3, 3): "1/s", (1, 3): "no unit", (1, 1): "1/s"}),
        ("mm", "rad", {(3, 2): "mm/rad · 1/s²", (4, 1): "rad/mm · 1/s²", (3, 4): "mm/rad · 1/s", (1, 4): "mm/rad"}),
        ("m/s", "m/s", {(3, 1): "1/s²", (3, 4): "1/s", (1, 4): "no unit"}),
        # Displacement in mm, and an acceleration: its displacement is in m/s² times s².
        ("m/s^2", "mm", {(3, 2): "(m/s^2)/mm", (4, 1): "mm/(m/s^2) · 1/s⁴", (3, 1): "1/s²", (3, 4): "(m/s^2)/mm · s"}),
        ("mm", "-", {(3, 2): "mm/1 · 1/s²"}),
    ],
)
def test_units_of_the_elements(first, second, units):
    channels = (Channel(name="s0", unit=first), Channel(name="s1", unit=second))
    figure = system_elements(state(4), tuple(units), channels=channels)
    labels = [axes.get_ylabel().split(" ", 1)[1][1:-1] for axes in figure.axes]
    assert labels == list(units.values())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"elements": ((5, 1),)}, "Argument `elements` of `system_elements` must hold .* from 1 to 4"),
        ({"elements": ((0, 1),)}, "Argument `elements`"),
        ({"elements": ((1, 1, 1),)}, "Argument `elements`"),
        ({"elements": (3,)}, "Argument `elements`"),
        ({"elements": ()}, "Argument `elements` .* at least one"),
        ({"truth": np.ones((9, 4, 4))}, "Argument `truth`"),
        ({"truth": (np.arange(9), np.ones((9, 2, 2)))}, r"Argument `truth\[1\]`"),
        ({"period": -1.0}, "Argument `period`"),
    ],
)
def test_system_elements_refuses(found, arguments, words):
    with pytest.raises(InputError, match=words):
        system_elements(found.state, **arguments)


def test_instants_that_do_not_tell_the_period_need_it():
    uneven = state(4, times=np.array([0.0, 0.1, 0.5]))
    with pytest.raises(InputError, match=r"Argument `period` .* None"):
        system_elements(uneven)
    assert drawn(system_elements(uneven, period=1.0).axes[0])[0] == pytest.approx([0.0, 36.0, 180.0])


# All of them.


def every_figure(found):
    times = np.linspace(0.0, ROTOR.period, 91)
    odd = Channel(
        name="a $dollar$ name_with all of 80 characters, as some programs export them, and more", unit="m/s^2"
    )
    channels = (odd, *found.model.channels[1:])
    records = tuple(replace(r, values=r.values * 1e-5, channels=channels) for r in found.fit.free)
    yield time_record(found)
    yield time_record(with_decay(found, fit=replace(found.fit, free=records)), hit=1)
    yield composite(found)
    yield system_elements(found.state, truth=(times, ROTOR.system(times)))
    yield system_elements(state(6, std=True))
    big = state(4)
    big = replace(big, system=big.system * 1e7)
    yield system_elements(big, channels=(Channel(name="s0", unit="m/s^2"), Channel(name="s1", unit="rad")))


@pytest.mark.pages
def test_every_figure_is_drawn_without_overlap(found):
    for figure in every_figure(found):
        assert isinstance(figure, Figure)
        assert overlaps(figure) == []


def test_the_overlap_is_seen():
    figure = Figure(figsize=(4, 3))
    axes = figure.add_axes((0.2, 0.2, 0.7, 0.7))
    axes.plot([0, 1], label="a")
    figure.legend(loc="center")
    assert overlaps(figure) == []
    axes.set_xlabel("pushed up over the numbers", labelpad=-10)
    assert overlaps(figure) != []
    axes.set_xlabel("far wider than the whole figure" * 5)
    assert overlaps(figure) != []


def test_a_dollar_starts_no_formula():
    assert plain("a $x$") == r"a \$x\$"
    assert len(plain("x" * 100)) < 50
    assert plain("x" * 40 + "1") != plain("x" * 40 + "2")
    figure = Figure()
    figure.subplots().plot([1.0], label=plain("_x"))
    assert figure.axes[0].get_legend_handles_labels()[1] == ["\u200b_x"]


def test_the_users_settings_neither_change_nor_matter(found):
    before = dict(mpl.rcParams)
    reference = pixels(composite(found))
    assert dict(mpl.rcParams) == before
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "axes.facecolor": "red", "text.usetex": True}):
        assert pixels(composite(found)) == reference


def pixels(figure):
    stream = io.BytesIO()
    figure.savefig(stream, format="rgba", dpi=40)
    return stream.getvalue()


@pytest.mark.slow
def test_neither_importing_nor_drawing_loads_pyplot(tmp_path):
    code = """
import sys
import floquid.plot
assert "matplotlib" not in sys.modules
import matplotlib
before = dict(matplotlib.rcParams)
from floquid.pipeline import identify
from floquid.systems import JeffcottRotor
from floquid.views import envelope
found = identify(JeffcottRotor(damping=0.02).simulate(n_periods=40, samples_per_period=8), states=["X", "Y"])
floquid.plot.save_figures(found, sys.argv[1])
assert "matplotlib.pyplot" not in sys.modules
assert dict(matplotlib.rcParams) == before
"""
    run = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


# Files.


@pytest.mark.slow
def test_save_figures_writes_every_figure_in_every_format(found, tmp_path):
    paths = save_figures(found, tmp_path, formats=("png", "svg", "pdf"))
    expected = list(OF_DECAYS)
    assert [path.name for path in paths] == [f"{name}.{form}" for name in expected for form in ("png", "svg", "pdf")]
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    assert all(path.read_bytes().startswith(starts[path.suffix[1:]]) for path in paths)


@pytest.mark.slow
def test_save_figures_writes_one_file_a_figure_and_format_the_same_each_time(found, tmp_path, monkeypatch):
    folder = tmp_path / "first"
    folder.mkdir()
    assert [path.stem for path in save_figures(found, folder, dpi=20)] == list(OF_DECAYS)
    assert len(list(folder.iterdir())) == 11
    monkeypatch.setattr(Analysis, "_figures", lambda analysis: {"time_record": (analysis, {})})
    paths = save_figures(found, folder, formats=("png", "svg", "pdf"))
    assert [path.name for path in paths] == [f"{name}.{form}" for name in FIGURES[:1] for form in ("png", "svg", "pdf")]
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    assert all(path.read_bytes().startswith(starts[path.suffix[1:]]) for path in paths)
    assert mpl.image.imread(paths[0]).shape[:2] == (600, 1050)
    again = save_figures(found, tmp_path, formats=("png", "svg", "pdf"))
    assert len(again) == 3
    assert all(path.read_bytes() == (folder / path.name).read_bytes() for path in again)


def test_save_figures_without_states(found, tmp_path, monkeypatch):
    monkeypatch.setattr(Figure, "savefig", lambda self, target, **_: target.write_bytes(b""))
    monkeypatch.setattr("floquid._show.late", lambda room, name: lambda of, **options: Figure())  # drawn elsewhere
    paths = save_figures(replace(found, state=None), tmp_path, dpi=30)
    assert [path.stem for path in paths] == [name for name in OF_DECAYS if name != "system_elements"]


@pytest.mark.slow
def test_a_figure_that_fails_leaves_the_old_file(found, tmp_path, monkeypatch):
    monkeypatch.setattr(Analysis, "_figures", lambda analysis: dict.fromkeys(FIGURES[:2], (analysis, {})))
    (path, *_) = save_figures(found, tmp_path, dpi=30)
    before = path.read_bytes()

    def fail(self, target, **options):
        target.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(InputError, match="No space left"):
        save_figures(found, tmp_path)
    assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 2


def test_save_figures_refuses(found, tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "none", tmp_path / "file", 7):
        with pytest.raises(InputError, match="Argument `folder` of `save_figures`"):
            save_figures(found, folder)
    for formats in ("png", ["gif"], [1]):
        with pytest.raises(InputError, match="Argument `formats` of `save_figures`"):
            save_figures(found, tmp_path, formats=formats)
