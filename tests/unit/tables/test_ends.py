"""The last number of a text table that is cut short: never one with fewer digits than were written."""

import numpy as np
import pytest

from floquid.readers import _body, read
from floquid.tables import is_cut

RNG = np.random.default_rng(0)
FIXED = [f"{value:.4f}" for value in RNG.standard_normal(30)]
POWERS = [f"{value:.3E}" for value in 1e-9 * RNG.standard_normal(30)]
COUNTS = [str(value) for value in RNG.integers(1000, 9999, 30)]


@pytest.mark.parametrize("column", [FIXED, POWERS, COUNTS, [cell.replace(".", ",") for cell in FIXED]])
def test_every_number_that_has_lost_a_digit_is_told(column):
    *others, last = column
    assert not is_cut(last, others)
    assert all(is_cut(last[:length], others) for length in range(1, len(last)))


@pytest.mark.parametrize("cell", ["nan", "", "1.50"])
def test_what_is_whole_is_kept(cell):
    assert not is_cut(cell, ["0.25", "-1.75"])
    assert not is_cut(cell, ["off", ""])


def test_shortest_numbers_lose_digits_only_behind_what_all_others_have():
    cells = [repr(value) for value in RNG.standard_normal(50).tolist()]
    kept = [cells[-1][:length] for length in range(1, 30) if not is_cut(cells[-1][:length], cells[:-1])]
    assert kept
    assert max(abs(float(cell) - float(cells[-1])) for cell in kept) < 1e-12


OUT = "Time x\n(s) (m)\n" + "".join(f"{0.1 * k:.2f} {value:.3E}\n" for k, value in enumerate(RNG.standard_normal(20)))
CSV = "time [s],x [m]\n" + "".join(f"{0.1 * k:.2f},{value:.4f}\n" for k, value in enumerate(RNG.standard_normal(20)))
SEL = "\n".join(
    [*[""] * 8, f"{20:9d} {2:9d} {2.0:12.3f}  ASCII", *[""] * 3]
    + [f"{row:7d}     {name:<31}{unit:<11}x" for row, name, unit in ((1, "Time", "s"), (2, "x", "m"))]
)


@pytest.mark.parametrize(("name", "whole"), [("run.out", OUT), ("run.csv", CSV), ("run.dat", OUT.split(")\n")[1])])
def test_a_file_cut_inside_its_last_row_is_read_up_to_the_row_before(name, whole, tmp_path):
    path = tmp_path / name
    file = path
    if name == "run.dat":
        file = tmp_path / "run.sel"
        file.write_text(SEL)
    path.write_text(whole)
    expected = read(file)
    path.write_text(whole[:-1])  # without the line end alone
    np.testing.assert_array_equal(read(file).values, expected.values)
    for lost in range(2, len(whole.splitlines()[-1]) + 1):
        path.write_text(whole[:-lost])
        found = read(file)
        np.testing.assert_array_equal(found.values, expected.values[:, :-1])
        assert any("may be cut short" in step for step in found.provenance.steps)


def test_a_number_cut_alone_in_its_block_is_held_against_those_before(tmp_path, monkeypatch):
    monkeypatch.setattr(_body, "_ROWS", 4)
    rows = [f"{0.01 * row:.2f},{row + 1}.2500" for row in range(5)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["time [s],x", *rows]) + "\n")
    assert read(path).n_samples == 5
    path.write_text("\n".join(["time [s],x", *rows])[: -len(".2500")])
    found = read(path)
    assert found.n_samples == 4
    assert any("may be cut short" in step for step in found.provenance.steps)
