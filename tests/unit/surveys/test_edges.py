"""Edges of instability between points: against the truth, and where there is none to tell."""

from dataclasses import replace

import numpy as np
import pytest
from tests.locks import LOCKED, TOGETHER, known

from floquid.floquet import HarmonicMatrix, stability_map
from floquid.surveys import Point, survey

EDGES = np.array([*LOCKED, *TOGETHER])


def points(step=0.4, seed=0, last=25.0, **options):
    options = {"std": 0.002, "shape_std": 0.01} | options
    speeds = np.arange(17.6, last + 0.01, step)
    return [
        Point(values={"speed": speed}, model=known(speed, seed=1000 * seed + k, **options))
        for k, speed in enumerate(speeds)
    ]


@pytest.mark.slow
def test_edges_of_locks():
    edges = survey(points(), over="speed").edges
    assert [(edge.kind, edge.direction) for edge in edges] == [
        *(("lock", "onset"), ("lock", "end"), ("sum", "onset"), ("sum", "end"))
    ]
    for edge, truth in zip(edges, EDGES, strict=True):
        assert abs(edge.value - truth) < 4.0 * edge.std < 0.02
        assert edge.interval[0] < edge.value < edge.interval[1]


def test_without_noise_edges_are_exact():
    edges = survey(points(std=0.0, shape_std=0.0), over="speed").edges
    assert [edge.value for edge in edges] == pytest.approx(EDGES, abs=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("partner", ["below the noise", "uncertain"])
def test_partners_below_the_noise_do_not_matter(partner):
    """What decays faster in a lock is soon below the noise: its mean with the other one is that of the pair."""
    given = points(last=22.0)
    for k, point in enumerate(given):
        if not LOCKED[0] < point.values["speed"] < LOCKED[1]:
            continue
        model = known(point.values["speed"], std=0.002, shape_std=0.01, seed=k)
        if partner == "uncertain":
            off, covariance = np.zeros(model.order), np.array(model.covariance)
            off[1], covariance[1, 1] = 0.2 * (-1) ** k, 0.2**2
            model = replace(model, exponents=model.exponents + off, covariance=covariance)
        else:
            model = known(point.values["speed"], std=0.002, shape_std=0.01, seed=k, without=(1,))
        given[k] = Point(values=point.values, model=model)
    edges = survey(given, over="speed").edges
    assert [edge.kind for edge in edges] == ["lock", "lock"]
    for edge, truth in zip(edges, LOCKED, strict=True):
        assert abs(edge.value - truth) < 4.0 * edge.std < 0.1


@pytest.mark.slow
def test_weak_modes_hold_no_edge():
    own = points(last=21.6)
    weak = [
        Point(values=p.values, model=p.model, weak=np.full(p.model.order, 18.9 < p.values["speed"] < 19.3)) for p in own
    ]
    edge, *others = survey(weak, over="speed").edges
    assert edge.value is None
    assert edge.std is None
    assert edge.interval[0] < LOCKED[0] < edge.interval[1]
    assert all(other.value is not None for other in others)


def test_too_few_points_give_a_bracket():
    found = survey(points(last=19.2)[2:], over="speed")
    assert [edge.value for edge in found.edges] == [None]


@pytest.fixture(scope="module")
def mathieu():
    def system(frequency):
        parts = np.zeros((2, 2, 3), complex)
        parts[..., 1] = [[0.0, 1.0], [-1.0, -0.05]]
        parts[1, 0, [0, 2]] = -0.2
        return HarmonicMatrix(coefficients=parts, harmonics=[-1, 0, 1], period=2.0 * np.pi / frequency)

    return system


def test_known_systems_agree_with_the_stability_map(mathieu):
    found = survey(mathieu, over="frequency", between=(1.7, 2.3), points=13)

    def matrix(t, frequency):
        t, frequency = np.broadcast_arrays(t, frequency)
        a = np.zeros((*t.shape, 2, 2))
        a[..., 0, 1], a[..., 1, 1] = 1.0, -0.05
        a[..., 1, 0] = -1.0 - 0.4 * np.cos(frequency * t)
        return a

    period = lambda frequency: 2.0 * np.pi / frequency  # noqa: E731
    bands = stability_map(matrix, period, {"frequency": np.linspace(1.7, 2.3, 13)}, vectorised=True).bands
    assert [edge.value for edge in found.edges] == pytest.approx(bands.ravel(), abs=2e-9)
    assert {edge.kind for edge in found.edges} == {"lock"}


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.3, 0.4, 0.5])
def test_intervals_hold_the_edges(step):
    inside = []
    for seed in range(25):
        for edge in survey(points(step, seed), over="speed").edges:
            truth = EDGES[np.abs(EDGES - (edge.value or np.mean(edge.interval))).argmin()]
            inside.append(edge.interval[0] <= truth <= edge.interval[1])
    assert len(inside) == 100
    assert 0.89 <= np.mean(inside) <= 1.0
