"""Figures in axes of the caller: the curves of a figure of its own, and nothing beside the axes that were given."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from tests.locks import known

from floquid import floquet, plot
from floquid.comparison import compare
from floquid.core import Channel, PulseTimes, Record
from floquid.errors import InputError
from floquid.inputs import TransferFunctions
from floquid.monitoring import monitor
from floquid.order import scan
from floquid.pipeline import identify
from floquid.surveys import Point, survey
from floquid.sync import shaft_angle
from floquid.systems import JeffcottRotor

FUNCTIONS = [name for name in plot.__all__ if name not in ("FIGURES", "save_figure", "save_figures")]


def mathieu(t, a):
    return np.stack([np.stack([0 * t, 1 + 0 * t], -1), np.stack([-(a - 0.6 * np.cos(2 * t)), -0.1 + 0 * t], -1)], -2)


@pytest.fixture(scope="module")
def draws():
    """What draws each figure, with a keyword `ax`."""
    record = JeffcottRotor(damping=0.02).simulate(n_periods=50, samples_per_period=20, noise=0.01, seed=1)
    found = identify(record, states=["X", "Y"], validate=False)
    poles = scan(found.lifted.responses, orders=[2, 4, 6])
    hertz = np.linspace(0.1, 10.0, 200)
    values = 1.0 / (4.0 - hertz**2 + 0.1j * hertz) * np.array([1.0, 0.3])[:, None, None, None] * np.ones((2, 2, 1, 1))
    lines = TransferFunctions(
        frequencies_hz=hertz, harmonics=[0, 1], values=values, std=0.01 * np.abs(values) * (1 + 1j),
        outputs=(Channel(name="x"), Channel(name="y")), inputs=(Channel(name="F"),),
    )  # fmt: skip
    clock = PulseTimes(times=np.arange(0.0, 9.9, 0.1))
    pulses = Record(values=np.zeros((1, 1000)), sample_rate=100.0, channels=["x"], clock=clock)
    shaft = shaft_angle(pulses)
    modes = floquet.modes(lambda t: mathieu(t, 1.7), np.pi)
    growth = floquet.stability_map(mathieu, np.pi, {"a": np.linspace(0.5, 2.0, 9)})
    points = [
        Point(values={"speed_rpm": 9.5 * w}, model=known(w, std=0.01, shape_std=0.01)) for w in (18.0, 18.5, 19.5)
    ]
    followed = survey(points)
    held = compare(known(18.0, std=0.01, shape_std=0.01), known(18.0))
    watched = monitor([found] * 3, baseline=slice(0, 2))
    made = {name: getattr(one.plot, name) for one in (found, followed, held, watched) for name in dir(one.plot)}
    return made | {
        "exponents": lambda **how: plot.exponents(modes, **how),
        "stabilisation": lambda **how: plot.stabilisation(poles, **how),
        "stability_map": lambda **how: plot.stability_map(growth, **how),
        "speed": lambda **how: plot.speed(shaft, **how),
        "transfer": lambda **how: plot.transfer(lines, **how),
        "nyquist": lambda **how: plot.nyquist(lines, **how),
    }


def curves(axes):
    return [np.asarray(line.get_xydata()) for one in axes for line in one.lines]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_figure_is_drawn_into_axes(name, draws):
    assert inspect.signature(getattr(plot, name)).parameters["ax"].default is None
    if name not in draws:
        return
    alone = draws[name]()
    # An axis to the right has the place of the one that it belongs to.
    panels = list({str(one.get_position()): one for one in reversed(alone.axes)}.values())
    whole = Figure(figsize=(9.0, 9.0))
    beside, *mine = whole.subplots(1 + len(panels), squeeze=False)[:, 0]
    assert draws[name](ax=mine[0] if len(mine) == 1 else mine) is whole
    assert len(whole.axes) == 1 + len(alone.axes)
    assert not beside.lines
    assert not whole.legends
    drawn, wanted = curves(whole.axes[1:]), curves(alone.axes)
    assert len(drawn) == len(wanted) > 0
    for one, other in zip(drawn, wanted, strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(InputError, match=f"`ax` of `{name}` must be .*axes of matplotlib"):
        draws[name](ax=[*mine, beside])
    with pytest.raises(InputError, match=f"`ax` of `{name}` must be .*axes of matplotlib"):
        draws[name](ax="here")


def test_bode_plots_have_magnitude_and_phase_of_every_path(draws):
    one, its_phase, other, phase = draws["transfer"]().axes
    assert [axes.get_title(loc="left") for axes in (one, other)] == ["F to x", "F to y"]
    assert one.get_yscale() == "log"
    assert phase.get_ylabel() == "arg $G_m$ [deg]"
    hertz, degrees = its_phase.lines[0].get_data()
    np.testing.assert_allclose(degrees, np.degrees(np.angle(1.0 / (4.0 - hertz**2 + 0.1j * hertz))), atol=1e-9)
    assert len(draws["transfer"](output=1).axes) == 2


def test_bode_plots_with_logarithmic_frequencies_and_however_many_paths(draws):
    figure = draws["transfer"](frequency_axis="log")
    assert {axes.get_xscale() for axes in figure.axes} == {"log"}
    hertz = np.linspace(-1.0, 3.0, 9)
    many = TransferFunctions(
        frequencies_hz=hertz, harmonics=[0], values=np.ones((1, 3, 3, 9), complex), std=None,
        outputs=[Channel(name=f"y{k}") for k in range(3)], inputs=[Channel(name=f"u{k}") for k in range(3)],
    )  # fmt: skip
    assert len(plot.transfer(many).axes) == 2 * 8
    whole = plot.transfer(many, all_paths=True, frequency_axis="log")
    assert len(whole.axes) == 2 * 9
    assert {axes.get_ylabel() for axes in whole.axes[1::2]} == {"arg $G_m$ [deg]"}
    assert min(line.get_xdata().min() for axes in whole.axes for line in axes.lines) == 0.5
    with pytest.raises(InputError, match='`frequency_axis` of `transfer` must be "linear" or "log"'):
        plot.transfer(many, frequency_axis="db")
    with pytest.raises(InputError, match="have frequencies above zero"):
        plot.transfer(replace(many, frequencies_hz=hertz - 4.0), frequency_axis="log")


def test_nyquist_plots_are_curves_in_the_plane_with_a_cross_for_loops(draws):
    one, other = draws["nyquist"]().axes
    assert [axes.get_title(loc="left") for axes in (one, other)] == ["F to x", "F to y"]
    hertz = np.linspace(0.1, 10.0, 200)
    curve = 1.0 / (4.0 - hertz**2 + 0.1j * hertz)
    x, y = one.lines[0].get_data()
    np.testing.assert_allclose(np.asarray(x) + 1j * np.asarray(y), curve, atol=1e-12)
    assert one.get_aspect() == 1.0
    crosses = [line for line in one.lines if line.get_marker() == "+"]
    assert [line.get_xydata().tolist() for line in crosses] == [[[-1.0, 0.0]]]
    assert one.get_xlabel() == "Re $G_m$ [no unit]"
    assert len(draws["nyquist"](output=1).axes) == 1
