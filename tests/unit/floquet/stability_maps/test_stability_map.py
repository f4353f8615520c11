"""Stability maps against closed forms and known edges, and what they refuse."""

import numpy as np
import pytest
from scipy.special import mathieu_a, mathieu_b

from floquid.errors import InputError
from floquid.floquet import Instability, exponents, stability_map
from floquid.floquet.stability_maps._spectra import _product
from floquid.systems import JeffcottRotor
from floquid.testing import assert_exponents_close


def second_order(stiffness, damping):
    """[[0, 1], [-stiffness, -damping]], of any shape."""
    stiffness, damping = np.broadcast_arrays(stiffness, damping)
    out = np.zeros((*stiffness.shape, 2, 2))
    out[..., 0, 1] = 1.0
    out[..., 1, 0], out[..., 1, 1] = -stiffness, -damping
    return out


def mathieu(t, a, q, damping_ratio=0.0):
    return second_order(a - 2.0 * q * np.cos(2.0 * t), 2.0 * damping_ratio)


def rotor(**options):
    """The family of a rotor over its speed, on which A depends through the angle alone."""
    unit = JeffcottRotor(speed=1.0, **options)
    return lambda t, speed: unit.system(t * speed)


def half_turn(speed):
    return np.pi / speed


SPEEDS = np.linspace(0.4, 1.2, 81)


def test_bands_of_the_papers_rotor():
    """Allen 2009, section 3, with the corrected damping: recomputed by an adaptive integrator."""
    found = stability_map(rotor(), half_turn, {"speed": SPEEDS}, vectorised=True)
    assert found.bands == pytest.approx(
        np.array([[0.7212, 0.7558], [0.7849, 0.8252], [0.8483, 0.9018]]), abs=5.1e-5, rel=0.0
    )
    inside = [found.kind[(found.points[:, 0] > low) & (found.points[:, 0] < high)] for low, high in found.bands]
    assert [set(kinds) for kinds in inside] == [
        {Instability.PERIOD_DOUBLING},
        {Instability.FLUTTER},
        {Instability.PERIOD_DOUBLING},
    ]
    assert found.boundary is None
    assert found.grid_growth.shape == (81,)


def test_isotropic_support_has_one_exact_band():
    """In the rotating frame the undamped rotor is LTI, unstable between the frequencies of the shaft's axes."""
    system = rotor(damping=0.0, support_y=1.0)
    found = stability_map(system, half_turn, {"speed": np.linspace(0.4, 1.2, 30)}, vectorised=True)
    assert found.bands == pytest.approx(np.sqrt([[0.5, 0.6]]), abs=1e-9, rel=0.0)


@pytest.mark.parametrize(("ratio", "threshold"), [(0.05, 0.1000546711), (0.1, 0.2004369763), (0.2, 0.4034834834)])
def test_damped_mathieu_thresholds(ratio, threshold):
    found = stability_map(
        lambda t, q: mathieu(t, 1.0, q, ratio), np.pi, {"q": np.linspace(0.0, 0.5, 11)}, vectorised=True
    )
    assert found.bands == pytest.approx(np.array([[threshold, 0.5]]), abs=1e-9, rel=0.0)


@pytest.mark.first(3)
@pytest.mark.parametrize("n_points", [53, 60, 71])
@pytest.mark.parametrize("q", [0.1, 0.5, 1.5])
def test_every_undamped_tongue_wider_than_stated_is_found(q, n_points):
    """The widths run from 1 down to 1e-10, the steps of the grid are about a half."""
    grid = np.linspace(0.6 - 2.0 * q, 26.0, n_points)
    found = stability_map(lambda t, a: mathieu(t, a, q), np.pi, {"a": grid}, vectorised=True).bands
    tongues = np.array([[mathieu_b(k, q), mathieu_a(k, q)] for k in range(1, 6)])
    surely = (np.diff(tongues, axis=1)[:, 0] > (grid[1] - grid[0]) * 2.0**-20) & (tongues[:, 0] > grid[0])
    assert surely.sum() >= 3
    for tongue in tongues[surely]:
        assert np.abs(found - tongue).max(axis=1).min() <= 3e-8
    for band in found[found[:, 0] > grid[0]]:
        assert np.abs(tongues - band).max(axis=1).min() <= 3e-8


def test_without_refinement_a_thin_tongue_is_missed():
    options = {"vectorised": True, "edge_tolerance": 1e-6}
    grid = {"a": np.linspace(8.1, 9.7, 5)}
    system = lambda t, a: mathieu(t, a, 0.5)  # noqa: E731
    assert not len(stability_map(system, np.pi, grid, refinements=0, **options).bands)
    assert len(stability_map(system, np.pi, grid, refinements=7, **options).bands) == 1


def test_thin_damped_band_is_found_by_its_growth():
    """Just above the threshold of test_damped_mathieu_thresholds the band in a is 6e-3 wide, the grid's steps 0.15."""
    grid = {"a": np.linspace(0.21, 3.0, 20)}
    found = stability_map(lambda t, a: mathieu(t, a, 0.10006, 0.05), np.pi, grid, vectorised=True).bands
    assert len(found) == 1
    assert 1e-4 < found[0, 1] - found[0, 0] < 1e-2
    below = stability_map(lambda t, a: mathieu(t, a, 0.10004, 0.05), np.pi, grid, vectorised=True)
    assert not below.unstable.any()
    assert below.bands.shape == (0, 2)


def test_flapping_loses_stability():
    """Rotor-blade flapping, Lock's number 12, linear aerodynamics: at an advance ratio of 1.41174."""

    def flapping(t, mu):
        damping = 1.5 * (1.0 + 4.0 / 3.0 * mu * np.sin(t))
        return second_order(1.0 + 1.5 * (4.0 / 3.0 * mu * np.cos(t) + mu**2 * np.sin(2.0 * t)), damping)

    found = stability_map(flapping, 2.0 * np.pi, {"mu": np.linspace(0.0, 2.0, 21)}, vectorised=True)
    assert found.bands == pytest.approx(np.array([[1.41174, 2.0]]), abs=5e-6)


@pytest.mark.parametrize("share", [1.0 / 3.0, 0.5])
@pytest.mark.parametrize("named", [True, False])
def test_meissner_tongues(share, named):
    """x'' + (a ± 0.4) x = 0, the sign changing twice a period: the trace of Φ is that of two rotations' product."""

    def meissner(t, a):
        sign = np.where(np.mod(t / np.pi, 1.0) < share, 1.0, -1.0)
        return second_order(a + 0.4 * sign, 0.0)

    def trace(a):
        (w1, c1, s1), (w2, c2, s2) = (
            (w, np.cos(w * length), np.sin(w * length))
            for w, length in ((np.sqrt(a + 0.4), share * np.pi), (np.sqrt(a - 0.4), (1.0 - share) * np.pi))
        )
        return 2.0 * c1 * c2 - (w1 / w2 + w2 / w1) * s1 * s2

    breaks = [0.0, share] if named else ()
    grid = {"a": np.linspace(0.5, 5.0, 19)}
    edge = 1e-9 if named else 1e-5
    found = stability_map(meissner, np.pi, grid, vectorised=True, breaks=breaks, edge_tolerance=edge, refinements=6)
    fine = np.linspace(0.5, 5.0, 200_001)
    unstable = np.abs(trace(fine)) > 2.0
    turns = fine[:-1][unstable[1:] != unstable[:-1]]
    inner = found.bands.ravel()
    assert inner[(inner > 0.5) & (inner < 5.0)] == pytest.approx(turns, abs=6e-5)
    if named:
        assert np.abs(trace(inner[(inner > 0.5) & (inner < 5.0)])) == pytest.approx(2.0, abs=2e-8)


def test_kinds_of_mathieu_tongues_alternate():
    found = stability_map(lambda t, a: mathieu(t, a, 1.0), np.pi, {"a": np.linspace(-1.5, 10.0, 60)}, vectorised=True)
    kinds = [
        set(found.kind[(found.points[:, 0] > low) & (found.points[:, 0] < high)].tolist()) for low, high in found.bands
    ]
    expected = [Instability.DIVERGENCE, Instability.PERIOD_DOUBLING] * 2
    assert kinds == [{kind} for kind in expected]
    assert (found.kind[found.multiplier.real < -1.001] == Instability.PERIOD_DOUBLING).all()


@pytest.mark.slow
def test_strutt_diagram():
    found = stability_map(
        mathieu, np.pi, {"a": np.linspace(-1.0, 10.0, 23), "q": np.linspace(0.0, 5.0, 11)}, vectorised=True
    )
    a, q = found.boundary.reshape(-1, 2).T
    curves = [mathieu_a(k, q) for k in range(5)] + [mathieu_b(k, q) for k in range(1, 5)]
    distance = np.abs(np.array(curves) - a)
    assert distance.min(axis=0).max() <= 1.1e-5
    # Each tongue's both sides are there, of the third one (1e-3 wide at q = 0.3) as well.
    for order, tip in ((1, 0.05), (2, 0.4), (3, 1.0)):
        for curve in (mathieu_b, mathieu_a):
            near = np.abs(curve(order, q) - a) < 2e-5
            assert q[near].min() < tip
            inside = np.linspace(0.0, 5.0, 200)
            inside = inside[(curve(order, inside) > -1.0) & (curve(order, inside) < 10.0)]
            assert q[near].max() == pytest.approx(inside.max(), abs=0.05)
    assert found.grid_growth.shape == (23, 11)
    assert found.bands is None
    exact = (found.points[:, 0] > mathieu_a(1, found.points[:, 1]) + 1e-3) & (
        found.points[:, 0] < mathieu_b(2, found.points[:, 1]) - 1e-3
    )
    assert not found.unstable[exact].any()


def test_segments_join():
    """Each end of a segment of a closed boundary is that of one other."""

    def ring(t, x, y):
        x, y = np.broadcast_arrays(x, y + 0.0 * t)
        return (0.25 - x**2 - y**2)[..., None, None] * np.eye(1)

    axis = np.linspace(-1.0, 1.0, 8)
    found = stability_map(ring, 1.0, {"x": axis, "y": 0.9 * axis}, vectorised=True)
    ends = found.boundary.reshape(-1, 2)
    assert np.hypot(*ends.T) == pytest.approx(0.5, abs=1e-5)
    _, count = np.unique(ends, axis=0, return_counts=True)
    assert set(count) == {2}


def test_ends_of_the_grid_end_bands():
    grid = {"p": np.linspace(-1.0, 1.0, 5)}
    rise = lambda t, p: (p + 0.0 * t)[..., None, None] * np.eye(2)  # noqa: E731
    assert stability_map(rise, 1.0, grid, vectorised=True).bands == pytest.approx(np.array([[0.0, 1.0]]), abs=1e-8)
    assert stability_map(rise, 1.0, grid, vectorised=True, margin=0.25).bands[0, 0] == pytest.approx(0.25, abs=1e-8)
    assert stability_map(rise, 1.0, grid, vectorised=True, margin=-2.0).bands.tolist() == [[-1.0, 1.0]]
    assert stability_map(rise, 1.0, grid, vectorised=True, margin=2.0).bands.shape == (0, 2)


@pytest.mark.parametrize("shift", [-0.01, 0.01])
def test_multipliers_65_decades_apart_do_not_spoil_the_largest(shift):
    """Colaneri's system has exponents 0 and -24."""

    def colaneri(t, p):
        out = second_order(10.0 * np.cos(t) + 0.0 * p, 24.0 + 10.0 * np.sin(t) + 0.0 * p)
        return out + shift * np.eye(2)

    found = stability_map(colaneri, 2.0 * np.pi, {"p": [0.0, 1.0]}, vectorised=True)
    assert found.growth == pytest.approx(shift, abs=1e-10)
    assert (found.unstable == (shift > 0.0)).all()


@pytest.mark.slow
def test_a_stable_system_of_large_transients_is_stable():
    """Turned by half a turn a period: coupled by 1000, decays of 1e-7 and 2e-7 may come out as growth of 1e-6."""

    def system(t, p):
        c, s = np.cos(t + p), np.sin(t + p)
        turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
        core = np.array([[-1e-7, 1e3], [0.0, -2e-7]])
        spin = np.array([[0.0, -1.0], [1.0, 0.0]])
        return turn @ core @ np.swapaxes(turn, -1, -2) + spin

    found = stability_map(system, np.pi, {"p": np.linspace(0.0, 1.0, 20)}, vectorised=True)
    assert (found.growth > 0.0).any()
    assert not found.unstable.any()


def test_errors_count_by_the_largest_product_on_either_side():
    """Of two owners: the factors of one swell to 1e8 and shrink back, the other has a factor of its own size."""
    swell = np.diag([1e8, 1e-8])
    factors = np.stack([np.eye(2), swell, swell[::-1, ::-1], np.eye(2)])
    product, power, gain = _product(np.array([0, 0, 0, 1]), factors)
    assert product * 2.0 ** power[:, None, None] == pytest.approx(np.stack([np.eye(2)] * 2), rel=1e-14)
    assert 1e16 <= gain[0] <= 1e17
    assert 1.0 <= gain[1] <= 4.0


def test_harmonics_that_the_first_samples_fold_are_seen():
    """Of 16 samples a period the 16th harmonic is a constant; only the check between them can tell."""

    def system(t, a):
        return second_order(a + 8.0 * np.cos(32.0 * t), 0.02)

    found = stability_map(system, np.pi, {"a": [0.5, 1.5]}, vectorised=True, refinements=0)
    for row, (a,) in zip(found.exponents, found.points, strict=True):
        assert_exponents_close(row, exponents(lambda t, a=a: system(t, a), np.pi), 2.0, atol=1e-10)


def test_named_breaks_spare_the_search_for_them():
    calls = [0, 0]

    def counted(which):
        def system(t, a):
            calls[which] += 1
            return second_order(a + (0.4 if t % 1.0 < 0.3 else -0.4), 0.0)

        return system

    for which, breaks in enumerate(([0.0, 0.3], ())):
        stability_map(counted(which), 1.0, {"a": [1.0, 2.0]}, breaks=breaks, refinements=0)
    assert 10 * calls[0] < calls[1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_saddle_cuts_off_each_unstable_corner(sign):
    """Growth where xy > 0.01, and where it is below -0.01: the cell about the origin has four crossings."""
    axis = [-1.5, -0.5, 0.5, 1.5]
    found = stability_map(
        lambda t, x, y: (sign * x * y - 0.01 + 0.0 * t)[..., None, None] * np.eye(1),
        1.0,
        {"x": axis, "y": axis},
        vectorised=True,
        refinements=0,
    )
    x, y = found.boundary.mean(axis=1).T
    assert len(x) == 6
    assert (sign * x * y > 0.0).all()


def test_growth_out_of_the_range_of_floating_point():
    found = stability_map(
        lambda t, p: (p + 0.0 * t)[..., None, None] * np.eye(1), 10.0, {"p": [-500.0, 500.0]}, vectorised=True
    )
    assert found.growth[[0, -1]] == pytest.approx([-500.0, 500.0])
    assert found.multiplier[0] == 0.0
    assert np.isposinf(found.multiplier[-1].real)
    assert found.bands == pytest.approx(np.array([[0.0, 500.0]]), abs=1e-6)


@pytest.mark.slow
def test_exponents_are_those_of_one_system():
    found = stability_map(rotor(), half_turn, {"speed": [0.5, 0.73, 1.1]}, vectorised=True, refinements=0)
    assert len(found.points) > 3
    for row, (speed,) in zip(found.exponents, found.points, strict=True):
        one = JeffcottRotor(speed=float(speed)).exponents()
        assert_exponents_close(row, one, 2.0 * speed, atol=1e-8)
    assert found.growth == pytest.approx(found.exponents.real.max(axis=1), abs=0.0)


def test_a_plain_callable_is_called_as_often_as_said():
    calls = []

    def counted(t, a):
        calls.append(t)
        return mathieu(t, a, 0.5)

    found = stability_map(counted, np.pi, {"a": np.linspace(0.0, 5.0, 40)}, edge_tolerance=1e-4, refinements=2)
    assert len(calls) <= 70 * (len(found.points) + 3)
    vectorised = stability_map(
        lambda t, a: mathieu(t, a, 0.5),
        np.pi,
        {"a": np.linspace(0.0, 5.0, 40)},
        vectorised=True,
        edge_tolerance=1e-4,
        refinements=2,
    )
    assert found.growth == pytest.approx(vectorised.growth, abs=1e-12)


def test_stages_are_reported():
    said = []
    grid = {"a": np.linspace(0.5, 10.0, 700)}
    stability_map(lambda t, a: mathieu(t, a, 0.5), np.pi, grid, vectorised=True, report=said.append)
    assert said[:2] == ["evaluating the grid: 512 of 700", "evaluating the grid: 700 of 700"]
    assert list(dict.fromkeys(words.split(":")[0] for words in said)) == [
        "evaluating the grid",
        "looking for thin bands",
        "refining edges",
    ]


GRID = {"a": [0.0, 1.0, 2.0]}


@pytest.mark.parametrize(
    ("arguments", "keywords", "message"),
    [
        ((mathieu, np.pi, {}), {}, "`parameters` of .* must map one or two names to their values, but holds 0"),
        ((mathieu, np.pi, [1.0]), {}, "but is list"),
        ((mathieu, np.pi, {"a": [1.0]}), {}, "ascending values of `a`"),
        ((mathieu, np.pi, {"a": [1.0, 0.0]}), {}, "that do not ascend"),
        ((np.eye(2), np.pi, GRID), {}, "`system` of .* must be a callable"),
        ((lambda t, a: np.eye(2)[:1], np.pi, GRID), {}, r"must return a square matrix \(n, n\)"),
        ((lambda t, a: np.eye(2 + (a > 1.5)), np.pi, GRID), {}, r"shape \(3, 3\) at a = 2"),
        ((lambda t, a: np.eye(2) * 1j, np.pi, GRID), {}, "must return a real matrix"),
        ((lambda t, a: np.eye(2) * (np.nan if a > 1.5 else 1.0), np.pi, GRID), {}, "is not at a = 2"),
        ((lambda t, a: np.zeros((5, 2, 2)), np.pi, GRID), {"vectorised": True}, "Let times and parameters broadcast"),
        ((lambda t, a: mathieu(t, a, 0.5), lambda a: 1.0 - a, GRID), {}, "`period` of .* must be positive"),
        ((lambda t, a: mathieu(t, a, 0.5), lambda a: [a, a], GRID), {}, "must return one real number"),
        ((lambda t, a: mathieu(t, a, 0.5), 3.0, GRID), {}, r"must be a period of A\(t\), but A differs"),
        ((lambda t, a: mathieu(t, a, 0.5), -1.0, GRID), {}, "must be positive"),
        ((lambda t, a: mathieu(t, a, 0.5), np.pi, GRID), {"breaks": [1.5]}, r"must lie in \[0, 1\)"),
        ((lambda t, a: mathieu(t, a, 0.5), np.pi, GRID), {"tolerance": 1.0}, "`tolerance`"),
        ((lambda t, a: mathieu(t, a, 0.5), np.pi, GRID), {"margin": np.nan}, "`margin`"),
        ((lambda t, a: mathieu(t, a, 0.5), np.pi, GRID), {"edge_tolerance": 0.0}, "`edge_tolerance`"),
        ((lambda t, a: mathieu(t, a, 0.5), np.pi, GRID), {"refinements": -1}, "`refinements`"),
        ((mathieu, np.pi, {"a": [0.0, 1.0], "q": [0.0, 1.0]}), {"refinements": 20}, "at most 5e"),
    ],
)
def test_wrong_arguments_are_refused(arguments, keywords, message):
    with pytest.raises(InputError, match=message):
        stability_map(*arguments, **keywords)


@pytest.mark.parametrize("wanted", [False, True])
def test_a_progress_bar_is_drawn_where_it_is_wanted(wanted, capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as if stderr were a terminal
    told = []
    stability_map(
        lambda t, a: [[0.0, 1.0], [0.2 * np.cos(t) - a, 0.0]],
        2 * np.pi,
        {"a": [0.1, 0.2, 0.3]},
        progress=wanted,
        report=told.append,
    )
    printed = capsys.readouterr()
    assert printed.out == ""
    assert bool(printed.err) == wanted
    assert told[0] == "evaluating the grid: 3 of 3"


def test_without_a_terminal_each_stage_is_a_line(capsys):
    stability_map(lambda t, a: [[0.0, 1.0], [0.2 * np.cos(t) - a, 0.0]], 2 * np.pi, {"a": [0.1, 0.2]}, progress=True)
    assert capsys.readouterr() == ("", "evaluating the grid\nrefining edges\n")
