"""Exponents, periodic shapes and stability maps: what is drawn is what was given, and nothing covers anything."""

import numpy as np
import pytest
from matplotlib.colors import to_hex
from tests.unit.plot.test_plot_spectra import drawn, legend, outside_and_overlaps

from floquid import floquet
from floquid.errors import InputError
from floquid.floquet import Instability, stability_map, state_participation
from floquid.plot import exponents, periodic_shapes, save_figure
from floquid.plot import stability_map as draw_map
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor()


def mathieu(t, a, q):
    out = np.zeros((*np.broadcast_shapes(np.shape(t), np.shape(a), np.shape(q)), 2, 2))
    out[..., 0, 1] = 1.0
    out[..., 1, 0] = -(a - 2.0 * q * np.cos(2.0 * t))
    return out


def colaneri(t):
    return [[0, 1], [-10 * np.cos(t), -24 - 10 * np.sin(t)]]


def plain(a, q, zeta=0.0):
    return lambda t: [[0, 1], [-(a - 2 * q * np.cos(2 * t)), -2 * zeta]]


@pytest.fixture(scope="module")
def rotor():
    return floquet.modes(ROTOR.system, ROTOR.period)


@pytest.fixture(scope="module")
def locked():
    return floquet.modes(plain(1.0, 0.1), np.pi)


@pytest.fixture(scope="module")
def far_apart():
    return floquet.modes(colaneri, 2.0 * np.pi)


@pytest.fixture(scope="module")
def band():
    return stability_map(lambda t, a: mathieu(t, a, 0.3), np.pi, {"a": np.linspace(-0.5, 5.0, 45)}, vectorised=True)


@pytest.fixture(scope="module")
def region():
    grids = {"a": np.linspace(-1.0, 5.0, 13), "q": np.linspace(0.0, 3.0, 7)}
    return stability_map(mathieu, np.pi, grids, vectorised=True, refinements=2)


def ordered(values):
    return np.sort_complex(np.round(values, 8))


def points(axes, label):
    x, y = drawn(axes, label)
    return ordered(np.asarray(x) + 1j * np.asarray(y))


# Exponents.


def test_exponents_are_drawn_where_they_are(rotor):
    left, right = exponents(rotor).axes
    assert points(left, "decays") == pytest.approx(ordered(rotor.exponents))
    assert {line.get_ydata()[0] for line in left.lines if "strip" in line.get_label()} == {-0.5, 0.5}
    assert drawn(left, "_child0")[0] == [0.0, 0.0]  # the line of stability
    (dots,) = [line for line in right.lines if line.get_marker() == "o"]
    found = np.asarray(dots.get_xdata()) + 1j * np.asarray(dots.get_ydata())
    assert ordered(found) == pytest.approx(ordered(rotor.multipliers))
    x, y = drawn(right, "unit circle")
    assert np.hypot(x, y) == pytest.approx(1.0)
    assert (left.get_xlabel(), left.get_ylabel()) == (r"Re $\lambda$ [1/s]", r"Im $\lambda$ [rad/s]")


def test_copies_are_whole_columns(rotor):
    left = exponents(rotor).axes[0]
    reach = np.abs(rotor.exponents.imag).max() + 1.5
    copies = np.add.outer(rotor.principal(), 1j * np.arange(-9, 10)).ravel()
    expected = copies[np.abs(copies.imag) <= reach]
    assert points(left, r"copies, $\lambda + im\omega$") == pytest.approx(ordered(expected))
    assert len(expected) == 20


def test_growth_and_rest_have_marks_of_their_own(locked, far_apart):
    left = exponents(locked).axes[0]
    assert points(left, "grows") == pytest.approx([0.0499415702 + 1j], abs=1e-8)
    assert points(left, "decays") == pytest.approx([-0.0499415702 + 1j], abs=1e-8)
    left = exponents(far_apart).axes[0]
    assert points(left, "neither, within its error") == pytest.approx([0.0], abs=1e-9)
    looks = [line for figure in (exponents(locked), exponents(far_apart)) for line in figure.axes[0].lines[4:]]
    assert len({(line.get_marker(), to_hex(line.get_color())) for line in looks}) == 3


def test_multipliers_of_vastly_different_size_have_a_logarithmic_radius():
    found = floquet.modes(lambda t: np.diag([-0.5, -2.0, 0.0]) * (1.0 + 0.3 * np.cos(t)), 2.0 * np.pi)
    right = exponents(found).axes[1]
    decades = 4.0 * np.pi / np.log(10.0)
    radii = sorted(float(np.hypot(x, y)) for line in right.lines for x, y in [line.get_data()] if len(x) and len(x) < 9
                   for x, y in zip(x, y, strict=True))  # fmt: skip
    assert radii == pytest.approx([1 - decades / 6, 1 - decades / 24, 1.0], abs=1e-9)
    assert [text.get_text() for text in right.texts] == ["$10^{-2}$", "$10^{-4}$"]
    assert right.texts[0].get_position()[1] == pytest.approx(1 - 2 / 6)


def test_what_is_below_all_rings_is_said(far_apart):
    assert r"below $10^{-12}$" in legend(exponents(far_apart))


# Shapes.


def test_shapes_over_the_period(rotor):
    names = ["X", "Y", "u", "v"]
    figure = periodic_shapes(rotor, names, of=[0, 2])
    first = min((0, 2), key=lambda r: rotor.damping_ratios[r])
    one, two = figure.axes[:2]
    assert legend(figure) == names
    for k, name in enumerate(names):
        phase, values = drawn(one, name)
        shape = rotor.shapes(np.asarray(phase) / 360.0 * rotor.period)[first, k]
        assert values == pytest.approx(np.abs(shape), abs=1e-12)
        other = np.asarray(drawn(two, name)[1])
        seen = np.isfinite(other)
        turned = np.exp(1j * np.radians(other[seen])) * np.abs(shape[seen])
        assert turned == pytest.approx(shape[seen], abs=1e-9)
        assert (np.abs(shape[~seen]) <= 0.02 * np.abs(shape).max()).all()


def test_harmonics_are_bars_of_their_part(rotor):
    bars = periodic_shapes(rotor, of=[0]).axes[2].patches
    found = {round(bar.get_x() + bar.get_width() / 2): bar.get_height() for bar in bars}
    shares = dict(zip(rotor.harmonics.tolist(), rotor.participation[0].tolist(), strict=True))
    assert found == pytest.approx({m: share for m, share in shares.items() if share >= 1e-4})
    assert len(found) >= 3


def test_the_slowest_decays_are_chosen_in_order():
    rates = np.array([-0.5, -0.1, -0.9, -0.3, -0.7])
    found = floquet.modes(lambda t: np.diag(rates) * (1.0 + 0.3 * np.cos(t)), 2.0 * np.pi)
    figure = periodic_shapes(found)
    assert [axes.get_title(loc="left") for axes in figure.axes[::3]] == [
        rf"$\lambda$ = −{rate} 1/s" for rate in (0.1, 0.3, 0.5)
    ]
    assert [len(axes.lines) for axes in figure.axes[::3]] == [1, 1, 1]  # a state that takes no part is not drawn
    turned = periodic_shapes(found, of=[int(np.argsort(found.exponents.real)[k]) for k in (0, 4)])
    assert turned.axes[0].get_title(loc="left") == r"$\lambda$ = −0.1 1/s"


def test_modes_that_swing_come_before_those_of_filters():
    """A linearised turbine has filters slower than any motion: their states alone would be drawn."""
    A = np.zeros((7, 7))
    for k, (decay, swing) in enumerate([(0.3, 2.2), (0.2, 3.3)]):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[-decay, swing], [-swing, -decay]]
    A[4:, 4:] = np.diag([-0.01, -0.02, 0.0])
    found = floquet.modes(lambda t: A * (1.0 + 0.1 * np.cos(t)), 2.0 * np.pi)
    figure = periodic_shapes(found)
    titles = [axes.get_title(loc="left") for axes in figure.axes[::3]]
    assert [title.partition(" ±")[0] for title in titles] == [
        r"$\lambda$ = −0.2", r"$\lambda$ = −0.3", r"$\lambda$ = 0 1/s",
    ]  # fmt: skip
    assert {"x1", "x2", "x3", "x4"} <= set(legend(figure))


def test_states_are_chosen_whatever_their_units():
    rng = np.random.default_rng(0)
    mean = rng.standard_normal((8, 8)) - 3.0 * np.eye(8)
    units = 10.0 ** rng.integers(-12, 12, 8)

    def system(t):
        return mean + np.diag(np.cos(t + np.arange(8)))

    plain_units = floquet.modes(system, 2.0 * np.pi)
    other_units = floquet.modes(lambda t: system(t) * units[:, None] / units, 2.0 * np.pi)
    shares = state_participation(plain_units)
    assert shares.sum(axis=1) == pytest.approx(1.0)
    assert np.ptp(shares) > 0.1
    assert state_participation(other_units) == pytest.approx(shares, abs=1e-7)
    assert legend(periodic_shapes(other_units)) == legend(periodic_shapes(plain_units))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"modes": 3}, "`modes` of `periodic_shapes` must be a FloquetModes or a PeriodicModel"),
        ({"states": ["x"]}, "`states` of `periodic_shapes` must hold 4 names, but has 1"),
        ({"states": "abcd"}, "`states` of `periodic_shapes` must hold 4 names, but is 'abcd'"),
        ({"of": [4]}, "`of` of `periodic_shapes` must list one to 6 indices from 0 to 3"),
        ({"of": []}, "`of` of `periodic_shapes` must list one to 6"),
    ],
)
def test_shapes_that_cannot_be_drawn(rotor, changes, words):
    given = {"modes": rotor, **changes}
    with pytest.raises(InputError, match=words):
        periodic_shapes(given.pop("modes"), **given)


# Stability maps.


def test_bands_are_shaded_by_their_kind(band):
    figure = draw_map(band)
    (axes,) = figure.axes
    x, y = drawn(axes, r"largest Re $\lambda$")
    assert np.array_equal(x, band.points[:, 0])
    assert np.array_equal(y, band.growth)
    spans = sorted((patch.get_x(), patch.get_width(), patch.get_label()) for patch in axes.patches if patch.get_hatch())
    assert [(low, low + width) for low, width, _ in spans] == [pytest.approx(tuple(ends)) for ends in band.bands]
    assert len(spans) == 3
    assert [label for *_, label in spans] == [
        "unstable: multiplier above 1", "unstable: multiplier below −1", "unstable: multiplier above 1",
    ]  # fmt: skip
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("a", "growth [1/s]")
    assert drawn(axes, "limit of stability")[1] == [0.0, 0.0]


def test_a_region_is_coloured_by_its_kind_inside_its_boundary(region):
    (axes,) = draw_map(region).axes
    (segments,) = [c for c in axes.collections if c.get_label() == "boundary"]
    assert np.array(segments.get_segments()) == pytest.approx(region.boundary)
    (picture,) = axes.images
    colours, (low, high, bottom, top) = picture.get_array(), picture.get_extent()
    assert (low, high, bottom, top) == (-1.0, 5.0, 0.0, 3.0)

    def colour(a, q):
        rows, columns = colours.shape[:2]
        return tuple(colours[int((q - bottom) / (top - bottom) * rows), int((a - low) / (high - low) * columns)])

    assert colour(2.7, 0.5) == (1.0, 1.0, 1.0)
    places = {Instability.DIVERGENCE: (-0.9, 0.3), Instability.PERIOD_DOUBLING: (1.0, 1.5)}
    assert len({colour(*place) for place in places.values()} | {(1.0, 1.0, 1.0)}) == 3
    assert colour(4.5, 2.5) == colour(-0.9, 0.3)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("a", "q")


def test_what_is_no_map_is_refused(rotor):
    with pytest.raises(InputError, match="`found` of `stability_map` must be a StabilityMap"):
        draw_map(rotor)
    with pytest.raises(InputError, match="`modes` of `exponents` must be a FloquetModes or a PeriodicModel"):
        exponents(3)


# All.


def figures(rotor, locked, far_apart, band, region):
    long = [f"a name of a state that is longer than there is room for, {k}" for k in range(4)]
    for found in (rotor, locked, far_apart):
        yield exponents(found)
        yield periodic_shapes(found)
    yield periodic_shapes(rotor, long, of=[0, 1, 2, 3])
    yield draw_map(band)
    yield draw_map(region)


@pytest.mark.slow
def test_nothing_meets_or_sticks_out(rotor, locked, far_apart, band, region):
    for figure in figures(rotor, locked, far_apart, band, region):
        assert outside_and_overlaps(figure) == []


@pytest.mark.slow
def test_the_same_figure_is_the_same_file(rotor, region, tmp_path):
    for name, draw in (
        ("e", lambda: exponents(rotor)),
        ("s", lambda: periodic_shapes(rotor)),
        ("m", lambda: draw_map(region)),
    ):
        files = [save_figure(draw(), tmp_path / f"{name}{n}.png") for n in range(2)]
        assert files[0].read_bytes() == files[1].read_bytes()
