"""The stabilisation diagram and the indicators: what is drawn is what was given, and nothing covers anything."""

import numpy as np
import pytest
from matplotlib.colors import to_hex
from tests.unit.order.test_order_scan import DT, decays
from tests.unit.plot.test_plot_spectra import drawn, legend, outside_and_overlaps

from floquid.errors import InputError
from floquid.lti import WHITE, MaximumLikelihood, Outcome, fit_residues
from floquid.order import Stability, indicators, scan
from floquid.plot import indicators as draw_indicators
from floquid.plot import save_figure, stabilisation

LABELS = {
    Stability.NEW: "new",
    Stability.FREQUENCY: "stable in frequency",
    Stability.DAMPING: "and damping",
    Stability.SHAPE: "and shape",
}


@pytest.fixture(scope="module")
def found():
    return scan(decays(), orders=range(2, 21, 2))


@pytest.fixture(scope="module")
def other():
    """Order 3 is not reached: a pair would have to be halved."""
    return scan(decays(seed=1, samples=60), MaximumLikelihood(), orders=[3, 6, 7, 8])


@pytest.fixture(scope="module")
def seen():
    data = decays(inputs=2)
    return indicators(data, fit_residues(scan(data, orders=[7]).models[0].multipliers, data))


# The stabilisation diagram.


def test_each_pole_is_drawn_once_at_its_frequency_and_level(found):
    axes = stabilisation(found).axes[0]
    total = 0
    for level, label in LABELS.items():
        expected = [
            (abs(np.angle(mu)) / (2.0 * np.pi * DT), order)
            for order, model, levels in zip(found.orders, found.models, found.stable, strict=True)
            for mu, own in zip(model.multipliers, levels, strict=True)
            if own == level and np.angle(mu) >= 0
        ]
        total += len(expected)
        assert np.array(drawn(axes, label)).T.ravel() == pytest.approx(np.array(expected).ravel())
    assert total > 40
    assert axes.get_xlim() == pytest.approx((0.0, 0.5 / DT))
    assert axes.get_xlabel() == r"frequency in the lifted band, 0 to $\omega$/2 [Hz]"
    assert axes.get_ylabel() == "order [complex poles]"


def test_levels_differ_in_form_and_colour(found):
    lines = [line for line in stabilisation(found).axes[0].lines if line.get_label() in LABELS.values()]
    assert len({line.get_marker() for line in lines}) == len({to_hex(line.get_color()) for line in lines}) == 4


def test_the_indicator_lies_behind_on_its_own_axis(found):
    front, back = stabilisation(found).axes
    x, y = drawn(back, "CMIF")
    assert y == pytest.approx(found.indicators.cmif[:, 0])
    assert x == pytest.approx(found.indicators.angles / (2.0 * np.pi * DT))
    assert back.get_yscale() == "log"
    assert back.get_ylabel().endswith("/ white noise")
    assert front.get_zorder() > back.get_zorder()
    assert not front.patch.get_visible()


def test_the_order_chosen_is_marked_where_it_is_given(found):
    assert "order chosen" not in legend(stabilisation(found))
    figure = stabilisation(found, chosen=7)
    assert "order chosen" in legend(figure)
    assert drawn(figure.axes[0], "order chosen")[1] == [7, 7]


def test_an_order_not_reached_is_not_drawn(other):
    assert other.models[0].outcome is Outcome.ORDER_UNREACHED
    axes = stabilisation(other).axes[0]
    assert {y for label in LABELS.values() for y in drawn(axes, label)[1]} == {6, 7, 8}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scan": 3}, "`scan` of `stabilisation` must be an OrderScan"),
        ({"chosen": 0}, "`chosen` of `stabilisation` must be an integer"),
    ],
)
def test_what_cannot_be_drawn_is_refused(found, changes, words):
    given = {"scan": found, **changes}
    with pytest.raises(InputError, match=words):
        stabilisation(given.pop("scan"), **given)


# The indicators.


def test_curves_are_drawn_over_white_noise(seen):
    left, right = draw_indicators(seen).axes
    frequencies = seen.angles / (2.0 * np.pi * DT)
    curves = {f"CMIF {k + 1}": seen.cmif[:, k] for k in range(4)}
    curves |= {"composite": seen.composite / WHITE, "composite, data − model": seen.residual / WHITE}
    for label, values in curves.items():
        x, y = drawn(left, label)
        assert x == pytest.approx(frequencies)
        assert y == pytest.approx(values)
    assert set(drawn(left, "white noise alone")[1]) == {1.0}
    assert left.get_xlabel() == r"lifted band, 0 to $\omega$/2 [Hz]"
    assert right.get_ylabel() == "singular values / noise"


def test_singular_values_are_told_apart_by_the_edge(seen):
    right = draw_indicators(seen).axes[1]
    number, values = drawn(right, "above the noise")
    below = drawn(right, "not above it")
    assert number.tolist() == list(range(1, 8))
    assert values == pytest.approx(seen.singular_values[:7])
    assert min(values) > seen.noise_edge > max(below[1])
    assert below[0].tolist() == list(range(8, 28))
    assert [text.get_text() for text in right.texts] == ["7 above the noise"]
    fills = {line.get_label(): line.get_markerfacecolor() for line in right.lines}
    assert fills["above the noise"] != fills["not above it"] == "none"


def test_without_a_model_there_is_no_residual(found):
    assert "composite, data − model" not in legend(draw_indicators(found.indicators))


def test_what_is_no_indicator_is_refused(found):
    with pytest.raises(InputError, match="`found` of `indicators` must be an Indicators"):
        draw_indicators(found)


# Both.


def figures(found, other, seen):
    yield stabilisation(found, chosen=7)
    yield stabilisation(other, chosen=8)
    yield draw_indicators(seen)
    yield draw_indicators(found.indicators)


@pytest.mark.pages
def test_nothing_meets_or_sticks_out(found, other, seen):
    for figure in figures(found, other, seen):
        assert outside_and_overlaps(figure) == []


@pytest.mark.pages
def test_the_same_figure_is_the_same_file(found, seen, tmp_path):
    for name, draw in (("s", lambda: stabilisation(found)), ("i", lambda: draw_indicators(seen))):
        files = [save_figure(draw(), tmp_path / f"{name}{n}.png") for n in range(2)]
        assert files[0].read_bytes() == files[1].read_bytes()
