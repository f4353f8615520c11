"""Every case by its name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from benchmarks.chain import measured, paper, synthetic
from benchmarks.chain.case import Case

Builder = Callable[[float, int], Case]
"""The share of noise and the seed -> the case."""

ERRORS = (0.0, 1e-5, 3e-5, 1e-4, 1e-3, 1e-2)
"""Relative errors of the period told."""

RECORDS: dict[str, Builder] = {
    "rotor_650rpm": measured.rotor_650rpm,
    "rotor_1900rpm": measured.rotor_1900rpm,
    "rotor_650rpm_tach": measured.rotor_650rpm_tach,
    "duffing_orbit": measured.duffing_orbit,
    "paper_wander": paper.paper_wander,
    "paper_imbalance": paper.paper_imbalance,
    "paper_gaps": paper.paper_gaps,
    "paper_dropouts": paper.paper_dropouts,
    "paper_out_of_step_both": paper.paper_out_of_step_both,
    "turbine_orbit": synthetic.turbine_orbit,
    "two_real": synthetic.two_real,
    "two_close_lifted": synthetic.two_close_lifted,
    "two_close_out_of_step": synthetic.two_close_out_of_step,
    "coloured_sync_orbit": paper.coloured_sync_orbit,
    "coloured_out_of_step": paper.coloured_out_of_step,
    "coloured_tach": paper.coloured_tach,
    **{
        f"period_off_{way}_{error:g}": paper.period_off(samples, error)
        for way, samples in (("lifted", 50.0), ("out_of_step", paper.OUT_OF_STEP))
        for error in ERRORS
    },
    "paper_clean": paper.paper_clean,
    "paper_clean_unvalidated": partial(paper.paper_clean, validate=False),
}
