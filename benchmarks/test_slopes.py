"""The slopes: records of the sizes asked for, and a table a reader can check."""

import pytest
from benchmarks.slopes import BASE, LADDERS, Size, records_of, slope, table


@pytest.mark.parametrize("kind", LADDERS)
def test_records_have_the_sizes_asked_for(kind):
    size = Size(kind=kind, periods=6, phases=8, channels=3, modes=2, hits=1, inputs=2)
    records, options = records_of(size)
    assert [own.values.shape for own in records] == [(3 + 2 * (kind == "inputs"), 48)]
    assert (kind == "free") == (not options)
    assert BASE[kind].kind == kind


def test_a_slope_is_the_exponent_of_a_power():
    assert slope([1, 2, 4, 8], [9.0, 8.0, 32.0, 128.0]) == pytest.approx(2.0)


def test_the_table_has_a_row_a_kind_and_size():
    rows = [
        {"kind": "free", "grows": "hits", "hits": n, "seconds": 0.1 * n, "memory": float(n) ** 2} for n in (1, 2, 4)
    ]
    assert "| free | hits | 1, 2, 4 | 0.1, 0.2, 0.4 | 1.00 | 1, 4, 16 | 2.00 |" in table(rows)
