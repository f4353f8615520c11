"""The laws of every likelihood: one table of small records by ten laws, each cell run or excused by mathematics."""

from __future__ import annotations

import pytest
from tests.contracts.likelihoods._laws import EXEMPT, LAWS
from tests.contracts.likelihoods._records import CASES, Case

SLOW = {("innovations: beside an input, two records", law) for law in ("curvature", "score", "conditioning")}
"""Many fits each; what an input adds is in its gradient and Wald's test, and these hold of outputs alone every day."""

CELLS = [
    pytest.param(case, law, id=f"{law}-{case.name}", marks=[pytest.mark.slow] * ((case.name, law) in SLOW))
    for law in LAWS
    for case in CASES
    if (case.name, law) not in EXEMPT
]


@pytest.mark.parametrize(("case", "law"), CELLS)
def test_law(case: Case, law: str) -> None:
    LAWS[law](case)


def test_every_cell_is_run_or_excused() -> None:
    run = {(cell.values[0].name, cell.values[1]) for cell in CELLS}
    whole = {(case.name, law) for case in CASES for law in LAWS}
    assert run | EXEMPT.keys() == whole
    assert not run & EXEMPT.keys()
    assert all(reason.endswith(".") for reason in EXEMPT.values())
