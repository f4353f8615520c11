"""Wrote `result_v1.h5` with floquid 0.1.0, and beside it `result_v1.npz`: the same numbers, not through floquid.store.

Both are kept as they are. A later version of floquid writes files of its own, under names of their own; it must go on
reading this one. To run: `python write_result_v1.py FOLDER`.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from floquid.core import Channel, Provenance, Record
from floquid.findings import Finding
from floquid.pipeline import identify
from floquid.store import save
from floquid.systems import JeffcottRotor


def analysis():
    """Two hits of 14 and 12 cycles, in units, with A(t), a history and a warning."""
    rotor = JeffcottRotor(damping=0.05)
    records = []
    for n_periods, seed, angle in ((14, 1, 20.0), (12, 2, 75.0)):
        made = rotor.simulate(n_periods=n_periods, samples_per_period=6, noise=0.001, seed=seed, impulse_deg=angle)
        records.append(
            Record(
                values=made.values[:2],
                sample_rate=made.sample_rate,
                channels=[
                    Channel(name="x", unit="mm", location="disc", direction="X"),
                    Channel(name="y", quantity="displacement", unit="µm"),
                ],
                clock=made.clock,
                provenance=Provenance(sources=(f"hit at {angle:g}°",), steps=("simulated",)),
            )
        )
    found = identify(records, states=["x", "y"], system_times=8)
    return replace(found, findings=(Finding("sentence", "warning", words="a warning, with an ümlaut"),))


def main(folder: Path) -> None:
    found = analysis()
    save(found, folder / "result_v1.h5")
    np.savez_compressed(
        folder / "result_v1.npz",
        values_1=found.records[0].values,
        values_2=found.records[1].values,
        sample_rate=found.records[0].sample_rate,
        noise=found.lifted.noise,
        multipliers=found.modal.multipliers,
        residues=found.modal.residues,
        poles_covariance=found.modal.covariance,
        residue_spread=found.modal.residue_spread,
        residue_slope=found.modal.residue_slope,
        residual_std=found.modal.residual_std,
        cost=found.modal.stats["cost"],
        exponents=found.model.exponents,
        coefficients=found.model.coefficients,
        coefficient_std=found.model.coefficient_std,
        covariance=found.model.covariance,
        harmonics=found.model.harmonics,
        period=found.model.period,
        times=found.state.times,
        transition=found.state.transition,
        system=found.state.system,
        condition=found.state.condition,
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
