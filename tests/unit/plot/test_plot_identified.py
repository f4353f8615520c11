"""Figures of identified models: what is drawn is what was given, and all of them as files."""

import io
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.paper._residues import coefficients
from matplotlib.colors import to_hex
from tests.decays import one_locked, two_hits
from tests.unit.plot.test_plot_spectra import drawn, legend, outside_and_overlaps
from tests.unit.views.test_views import pair

from floquid import floquet, plot, views
from floquid.core import Channel, PeriodicModel
from floquid.errors import InputError
from floquid.order import scan
from floquid.periodic import participation
from floquid.pipeline import identify
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor(damping=0.02)
OMEGA = 2.0 * np.pi / ROTOR.period
P = 20


@pytest.fixture(scope="module")
def found():
    return two_hits()


@pytest.fixture(scope="module")
def locked():
    return one_locked()


@pytest.fixture(scope="module")
def poles(found):
    return scan(found.lifted.responses, orders=[2, 4, 6, 8])


def titled(figure, words):
    (axes,) = [one for one in figure.axes if one.get_title().startswith(words)]
    return axes


def at(line):
    return np.asarray(line.get_xdata()) + 1j * np.asarray(line.get_ydata())


# Exponents.


def test_exponents_of_a_model_are_where_they_are(found):
    left, right, *close = plot.exponents(found.model).axes
    for value in found.model.exponents:
        assert np.abs(at(next(li for li in left.lines if li.get_label() == "identified")) - value).min() < 1e-12
    copies = at(next(line for line in left.lines if line.get_label().startswith("copies")))
    turns = (copies[:, None] - found.model.exponents).imag / OMEGA
    assert np.abs(turns - np.round(turns)).min(axis=1) == pytest.approx(0.0, abs=1e-9)
    marks = next(line for line in right.lines if line.get_marker() == "o")
    assert at(marks) == pytest.approx(found.model.multipliers)
    regions = [line for line in right.lines if line.get_label() == "95 % region"]
    assert np.array([at(line) for line in regions]) == pytest.approx(views.multiplier_ellipses(found.model))
    assert len(close) == 2


def test_each_mode_is_close_up_with_its_region_and_deviation(found):
    figure = plot.exponents(found.model)
    edges = views.exponent_ellipses(found.model)
    for number, mode in ((1, 0), (2, 2)):
        axes = titled(figure, f"mode {number}:")
        region = next(line for line in axes.lines if line.get_label() == "95 % region")
        assert at(region) == pytest.approx(edges[mode] - found.model.exponents[mode])
        real, imag = axes.get_title().replace("−", "-").split("\n")
        std = found.model.exponent_std[mode]
        assert real.split()[-1] == views.with_error(found.model.exponents[mode].real, std.real)
        assert imag == f"+ {views.with_error(found.model.exponents[mode].imag, std.imag)} i"
        # The region fills much of the panel, and all of it is inside.
        low, high = axes.get_xlim()
        assert 0.25 < np.ptp(edges[mode].real) / (high - low) < 0.9


def test_the_truth_is_moved_to_the_branch_of_the_estimate(found):
    exact = floquet.exponents(ROTOR.system, ROTOR.period)
    moved = exact[exact.imag > 0] + 1j * OMEGA * np.array([3, -2])  # one of each pair, far off
    for truth in (exact, moved, moved[:1]):
        figure = plot.exponents(found.model, truth=truth)
        crosses = at(next(line for line in figure.axes[0].lines if line.get_label() == "truth"))
        shown = crosses[np.isfinite(crosses)]
        assert len(shown) == 2 * len(truth) if truth is not exact else len(shown) == 4
        off = np.abs(shown[:, None] - found.model.exponents).min(axis=1)
        assert off == pytest.approx(0.0, abs=5e-3)
        assert (off > 0).all()
    axes = titled(plot.exponents(found.model, truth=moved), "mode 1:")
    (cross,) = [line for line in axes.lines if line.get_marker() == "x"]
    assert abs(at(cross)[0]) < 6.0 * abs(found.model.exponent_std[0])


@pytest.mark.slow
def test_a_truth_far_off_widens_the_close_up(found):
    truth = found.model.exponents + 40.0 * found.model.exponent_std.real
    axes = titled(plot.exponents(found.model, truth=truth), "mode 1:")
    assert axes.get_xlim()[1] > 40.0 * found.model.exponent_std[0].real


def test_a_growing_mode_has_a_mark_of_its_own(found):
    bare = replace(found.model, estimates=None, unselected=None)
    model = replace(bare, exponents=-bare.exponents.conj())
    left = plot.exponents(model).axes[0]
    grows = next(line for line in left.lines if line.get_label() == "identified, grows")
    assert grows.get_marker() != "o"
    assert len(grows.get_xdata()) == 4


def test_a_growth_within_its_deviation_is_none(found):
    bare = replace(found.model, estimates=None, unselected=None)
    slight = bare.exponents - bare.exponents.real + 3.0 * bare.exponent_std.real
    figure = plot.exponents(replace(bare, exponents=slight))
    assert "identified, grows" not in legend(figure)
    assert not any(line.get_marker() == "^" and len(line.get_xdata()) for axes in figure.axes for line in axes.lines)


def test_without_deviations_there_is_nothing_close_up(found):
    figure = plot.exponents(replace(found.model, covariance=None))
    assert len(figure.axes) == 2
    assert "95 % region" not in legend(figure)


def test_a_real_multiplier_has_no_error_of_its_frequency(locked):
    axes = titled(plot.exponents(locked.model), "mode 1:")
    assert axes.get_title().split("\n")[1] == "+ 3.14159 i"
    region = next(line for line in axes.lines if line.get_label() == "95 % region")
    assert region.get_ydata() == pytest.approx(np.zeros(73), abs=1e-15)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"modes": 3}, "`modes` of `exponents` must be a FloquetModes or a PeriodicModel"),
        ({"truth": [[1j]]}, "`truth` of `exponents` must have shape"),
        ({"truth": "x"}, "`truth` of `exponents` must be an array"),
    ],
)
def test_exponents_that_cannot_be_drawn(found, changes, words):
    given = {"modes": found.model, **changes}
    with pytest.raises(InputError, match=words):
        plot.exponents(given.pop("modes"), **given)
    modes = floquet.modes(ROTOR.system, ROTOR.period)
    with pytest.raises(InputError, match="`truth` of `exponents` must be given for an identified model alone"):
        plot.exponents(modes, truth=modes.exponents)


# Shapes.


def with_units(model, *units):
    channels = tuple(replace(c, unit=unit) for c, unit in zip(model.channels, units, strict=True))
    return replace(model, channels=channels)


def test_channels_of_two_units_do_not_share_a_look(found):
    figure = plot.periodic_shapes(with_units(found.model, *["mm", "um"] * (len(found.model.channels) // 2)))
    looks = {
        line.get_label(): (line.get_color(), line.get_linestyle(), str(line._unscaled_dash_pattern))
        for axes in figure.axes
        for line in axes.lines
        if not line.get_label().startswith("_")
    }
    assert len(looks) == len(found.model.channels) == len(set(looks.values()))


def test_numbers_of_crowded_modes_do_not_lie_on_one_another(found):
    model, chosen = found.model, list(found.model.upper_modes)
    values = np.array([-0.3 + 0.2j, -0.162 + 1.0j, -0.138 + 1.0j, -0.14 + 1.2j])
    model = PeriodicModel(
        exponents=np.concatenate([values, values.conj()]),
        coefficients=np.repeat(model.coefficients[chosen[:1]], 8, axis=0),
        harmonics=model.harmonics,
        period=model.period,
        channels=model.channels,
    )
    figure = plot.exponents(model)
    figure.savefig(io.BytesIO())
    boxes = [text.get_window_extent() for text in figure.axes[0].texts]
    assert 2 <= len(boxes) <= 4
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])


def test_shapes_of_a_model_have_bands(found):
    figure = plot.periodic_shapes(found.model, of=[0, 2], hit=1)
    for row, mode in enumerate((0, 2)):
        curves = views.shape_curves(found.model, mode, 1, points=181)
        one, two, _ = figure.axes[3 * row : 3 * row + 3]
        for channel, name in enumerate(("X", "Y", "X_tt", "Y_tt")):
            value, std = curves.values[channel], curves.std[channel]
            phase, first = drawn(one, name)
            assert phase == pytest.approx(np.linspace(0.0, 360.0, 181))
            assert first == pytest.approx(value.real)
            band = one.collections[channel].get_paths()[0].vertices[1:182]
            assert band[:, 1] == pytest.approx(first - 1.96 * std.real)
            assert drawn(two, name)[1] == pytest.approx(value.imag)
    assert [axes.get_title(loc="left").split(":")[0] for axes in figure.axes[::3]] == ["mode 1", "mode 2"]
    assert "95 % intervals" in legend(figure)


def test_channels_share_axes_with_those_of_their_unit_alone(found):
    model = with_units(found.model, "m", "m", "rad", "rad")
    figure = plot.periodic_shapes(model, of=[0])
    upper, lower = figure.axes[0], figure.axes[3]
    assert [line.get_label() for line in upper.lines] == ["X", "Y"]
    assert [line.get_label() for line in lower.lines] == ["X_tt", "Y_tt"]
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("Re [m]", "Re [rad]")
    only = plot.periodic_shapes(model, ["Y_tt"], of=[0])
    assert [line.get_label() for line in only.axes[0].lines] == ["Y_tt"]
    assert len(only.axes) == 3


@pytest.mark.slow
def test_bands_are_left_out_where_they_are_not_known(found):
    figure = plot.periodic_shapes(replace(found.model, estimates=None))
    assert "95 % intervals" not in legend(figure)
    assert not figure.axes[0].collections


def bars(figure):
    return {round(bar.get_x() + bar.get_width() / 2): bar.get_height() for bar in figure.axes[2].patches}


def test_bars_are_the_shares_of_the_tables(found):
    harmonics, shares = participation(found.model, 0, 1.0 / found.noise)
    given = {int(m): share for m, share in zip(harmonics, shares, strict=True) if share >= 1e-4}
    assert bars(plot.periodic_shapes(found.model, of=[0], weights=1.0 / found.noise)) == pytest.approx(given)
    assert len(given) == 3


def test_bars_without_weights_do_not_depend_on_units(found):
    model = with_units(found.model, "m", "m", "rad", "rad")
    scales = np.array([1.0, 1.0, 1e6, 1e6])[:, None, None]
    bare = replace(model, covariance=None, coefficient_std=None, estimates=None, unselected=None)
    other = replace(bare, coefficients=bare.coefficients * scales)
    assert bars(plot.periodic_shapes(other, of=[0])) == pytest.approx(bars(plot.periodic_shapes(bare, of=[0])))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"of": [4]}, "`of` of `periodic_shapes` must list one to 6 indices from 0 to 3"),
        ({"of": []}, "`of` of `periodic_shapes` must list one to 6"),
        ({"states": ["Z"]}, "`states` of `periodic_shapes`"),
        ({"hit": 2}, "`hit` of `periodic_shapes` must be less than 2"),
        ({"weights": [1.0]}, "`weights` of `periodic_shapes` must have shape"),
    ],
)
def test_shapes_that_cannot_be_drawn(found, arguments, words):
    with pytest.raises(InputError, match=words):
        plot.periodic_shapes(found.model, **arguments)


# Synthesis.


def test_synthesis_draws_record_model_and_residual(found):
    figure = plot.synthesis(found, "Y", hit=1, close_cycles=3)
    close, whole, left = figure.axes
    seen = views.synthesis(found, 1, 1)
    times, values = drawn(close, "measured")
    assert len(times) == 3 * P + 1
    assert values == pytest.approx(seen.measured[: 3 * P + 1])
    assert drawn(close, "model")[1] == pytest.approx(seen.predicted[: 3 * P + 1])
    assert drawn(whole, "measured")[1] == pytest.approx(seen.measured)
    assert drawn(left, "measured − model")[1] == pytest.approx(seen.residual)
    edges = [line.get_ydata()[0] for line in left.lines if line.get_label() == "95 % of the noise"]
    assert edges == pytest.approx([-1.96 * seen.noise, 1.96 * seen.noise])
    (steps,) = left.patches
    assert np.sqrt(np.mean(steps.get_data().values ** 2)) == pytest.approx(seen.residual.std(), rel=0.02)
    ratio = float(left.get_title(loc="left").split()[1])
    assert ratio == pytest.approx(np.sqrt(np.mean(seen.residual**2)) / seen.noise, abs=6e-4)
    assert close.get_title(loc="left") == "the first 3 cycles of Y, hit 2"
    assert (left.get_xlabel(), close.get_ylabel()) == ("time [s]", "response [no unit]")


def test_what_a_wrong_model_leaves_is_seen(found):
    worse = replace(found.model, coefficients=0.9 * found.model.coefficients, estimates=None, unselected=None)
    left = plot.synthesis(replace(found, model=worse)).axes[2]
    assert float(left.get_title(loc="left").split()[1]) > 2.0
    steps = left.patches[0].get_data().values
    assert steps[0] > 3.0 * steps[-1]


@pytest.mark.slow
def test_missing_samples_are_no_end(found):
    record = pair()
    values = np.array(record.values)
    values[:, 200:400] = np.nan
    figure = plot.synthesis(identify(replace(record, values=values), validate=False))
    steps = figure.axes[2].patches[0].get_data().values
    assert np.isfinite(steps).sum() >= len(steps) - 2
    assert outside_and_overlaps(figure) == []


# Synchronisation.


def test_synchronisation_draws_slips_and_phases(locked):
    figure = plot.synchronisation(locked)
    upper, lower = figure.axes
    seen = views.synchronisation(locked)
    points = upper.containers[0].lines[0]
    assert points.get_ydata() == pytest.approx(np.degrees(seen.slip))
    assert points.get_xdata() == pytest.approx(seen.times)
    (bars,) = upper.containers[0].lines[2]
    ends = np.array(bars.get_segments())[:, :, 1]
    assert ends[:, 1] - ends[:, 0] == pytest.approx(2 * 1.96 * np.degrees(seen.slip_std))
    line = drawn(upper, "straight line through it")[1]
    assert line == pytest.approx(np.degrees(seen.offset - 2 * np.pi * seen.cycles * seen.relative))
    for number, container in enumerate(lower.containers):
        assert container.lines[0].get_ydata() == pytest.approx(np.degrees(seen.phases[number]))
    assert [c.get_label() for c in lower.containers] == [f"mode 1, $m$ = {m}" for m in ("0", "+1", "+2")]
    forms = {(c.lines[0].get_marker(), to_hex(c.lines[0].get_color())) for c in lower.containers}
    assert len(forms) == 3
    assert upper.get_ylabel() == "ahead of the clock\n[deg of the period]"


@pytest.mark.slow
def test_the_verdict_is_on_the_figure():
    good = plot.synchronisation(identify(pair(), validate=False)).axes[0].get_title(loc="left")
    assert "no other period" in good
    bad = identify(pair(period=1.0 + 1e-4), order=2, trust_period=True, validate=False)
    words = plot.synchronisation(bad).axes[0].get_title(loc="left")
    assert "of it, another period" in words
    value = float(words.split("(")[1].split()[0].replace("−", "-"))
    assert value == pytest.approx(1e6 * views.synchronisation(bad).relative, rel=0.01)


@pytest.mark.parametrize("function", [plot.synthesis, plot.synchronisation])
def test_what_is_no_analysis_or_hit_is_refused(found, function):
    name = function.__name__
    with pytest.raises(InputError, match=f"`analysis` of `{name}` must be an Analysis"):
        function(found.model)
    with pytest.raises(InputError, match=f"`hit` of `{name}` must be less than 2"):
        function(found, hit=2)


def test_no_such_channel(found):
    with pytest.raises(InputError, match="`channel` of `synthesis`"):
        plot.synthesis(found, "Z")
    with pytest.raises(InputError, match="`close_cycles` of `synthesis`"):
        plot.synthesis(found, close_cycles=0)


# The unfolded diagram.


def test_poles_are_where_they_are_on_the_machine(found, poles):
    turn = 0.5 / np.pi
    figure = plot.stabilisation(poles, analysis=found)
    axes = figure.axes[0]
    x, y = drawn(axes, "and shape")
    stays = [own for own, order in zip(np.asarray(x), np.asarray(y), strict=True) if order == 8]
    for mode in (0, 2):
        assert np.abs(np.array(stays) - turn * found.model.exponents[mode].imag).min() < 0.01 * turn * OMEGA
    expected = views.unfolded(poles, found)
    end = turn * (max(family.omega.max() for family in views.families(found)) + 0.5 * OMEGA)
    assert axes.get_xlim() == pytest.approx((0.0, end))
    drawn_poles = sum(len(line.get_xdata()) for line in axes.lines if line.get_marker() not in ("None", ""))
    inside = sum(
        int((turn * np.abs(lam.imag[np.angle(model.multipliers) >= 0]) <= end).sum())
        for lam, model in zip(expected, poles.models, strict=True)
    )
    assert drawn_poles == inside > 6
    folds = [line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == ":"]
    assert folds == pytest.approx(0.5 * OMEGA * turn * np.arange(1, len(folds) + 1))
    assert axes.get_xlabel() == "frequency [Hz]"
    assert figure.axes[1].get_ylabel() == "spectrum of the record / noise"


def test_behind_is_the_mean_spectrum_of_the_longest_hit(found, poles):
    x, y = drawn(plot.stabilisation(poles, analysis=found).axes[1], "spectrum of the record")
    spectra = [views.record_spectrum(found, row, 0) for row in range(4)]
    assert y == pytest.approx(np.mean([one.values / one.noise for one in spectra], axis=0))
    assert x == pytest.approx(spectra[0].omega / (2.0 * np.pi))


def test_a_diagram_that_cannot_be_drawn(poles):
    with pytest.raises(InputError, match="`analysis` of `unfolded` must be an Analysis"):
        plot.stabilisation(poles, analysis=3)


# All.


def figures(found, locked, poles):
    long = "a name of a channel that is longer than there is room for"
    units = ("mm", "mm", "m/s^2", "m/s^2")
    names = [Channel(name=f"{long} {k}", unit=unit) for k, unit in enumerate(units)]
    named = replace(found, model=replace(found.model, channels=names))
    exact = floquet.exponents(ROTOR.system, ROTOR.period)
    yield plot.exponents(found.model, truth=exact)
    yield plot.exponents(locked.model)
    yield plot.periodic_shapes(found.model)
    yield plot.periodic_shapes(named.model)
    yield plot.periodic_shapes(locked.model)
    yield plot.synthesis(found, hit=1)
    yield plot.synthesis(locked)
    yield plot.synchronisation(found)
    yield plot.synchronisation(locked)
    yield plot.stabilisation(poles, analysis=found, chosen=4)
    yield plot.spectra(locked)
    yield coefficients(locked)


@pytest.mark.slow
def test_nothing_meets_or_sticks_out(found, locked, poles):
    for number, figure in enumerate(figures(found, locked, poles)):
        assert outside_and_overlaps(figure) == [], number


@pytest.mark.slow
def test_the_same_figure_is_the_same_file(found, poles, tmp_path):
    for name, draw in (
        ("e", lambda: plot.exponents(found.model)),
        ("p", lambda: plot.periodic_shapes(found.model)),
        ("y", lambda: plot.synthesis(found)),
        ("z", lambda: plot.synchronisation(found)),
        ("u", lambda: plot.stabilisation(poles, analysis=found)),
    ):
        files = [plot.save_figure(draw(), tmp_path / f"{name}{n}.png") for n in range(2)]
        assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.slow
def test_every_result_has_its_figures(locked, tmp_path):
    """Also that of one channel and one real multiplier, and of a record fitted as it was sampled."""
    record = pair()
    values = np.array(record.values)
    values[:, 700:703] = np.nan
    for number, analysis in enumerate((locked, identify(replace(record, values=values), validate=False))):
        folder = tmp_path / str(number)
        folder.mkdir()
        written = plot.save_figures(analysis, folder, dpi=50)
        assert [path.stem for path in written] == list(plot.FIGURES[:8])


@pytest.mark.slow
def test_synthesis_is_of_the_strongest_response(found, tmp_path, monkeypatch):
    asked = {}
    monkeypatch.setattr(plot, "synthesis", lambda analysis, **how: asked.update(how) or plot.composite(analysis))
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda self, target, **_: target.write_bytes(b""))
    plot.save_figures(replace(found, state=None), tmp_path, dpi=30)
    energy = np.sum(np.abs(found.model.coefficients) ** 2, axis=3) / found.noise**2
    _, row, hit = np.unravel_index(np.argmax(energy[[0, 2]]), energy[[0, 2]].shape)
    assert asked == {"channel": found.model.channels[row].name, "hit": hit}
