"""Numbers of modes beside their marks do not lie on one another, on a phone either."""

import numpy as np
import pytest

from floquid.reporting._modes_figures import mark_labels

WIDTH, HEIGHT = 290.0, 210.0  # of the axes on a screen of 390 pixels
LETTER, LINE = 7.2, 14.0  # of a text of 12 pixels


def boxes(x, y, labels):
    """Texts as boxes in pixels: left, right, low, high."""
    across, up = (WIDTH / (np.ptp(x) or 1.0), HEIGHT / (np.ptp(y) or 1.0))
    return [
        (x[k] * across, x[k] * across + LETTER * len(text), y[k] * up, y[k] * up + LINE)
        for k, text in enumerate(labels) if text
    ]  # fmt: skip


def area(one, other):
    across, up = min(one[1], other[1]) - max(one[0], other[0]), min(one[3], other[3]) - max(one[2], other[2])
    return max(across, 0.0) * max(up, 0.0)


@pytest.mark.parametrize("count", [1, 2, 9, 24])
@pytest.mark.parametrize("flat", [False, True])
def test_no_two_numbers_meet(count, flat):
    for seed in range(20):
        x, y = np.random.default_rng(seed).random((2, count))
        y = 0.0 * y if flat else y
        labels = mark_labels(x, y)
        drawn = boxes(x, y, labels)
        assert max((area(a, b) for k, a in enumerate(drawn) for b in drawn[:k]), default=0.0) == 0.0


def test_every_mode_has_its_number():
    x, y = np.array([0.0, 0.01, 1.0, 2.0]), np.array([0.0, 0.0, 0.0, 5.0])
    assert mark_labels(x, y) == ["1, 2", "", "3", "4"]
    assert mark_labels(x, y, 100.0, 1.0) == ["1–3", "", "", "4"]
    assert mark_labels(np.array([0.0, 0.001, 0.002, 0.5, 1.0]), np.zeros(5)) == ["1–3", "", "", "4", "5"]
    assert mark_labels(np.array([0.0, 0.5, 0.001, 1.0]), np.zeros(4)) == ["1, 3", "2", "", "4"]
    assert mark_labels(x[:0], y[:0]) == []
