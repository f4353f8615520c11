"""Wrote `result_v1_resampled.h5`, the last layout of version 1: samples are missing, and residues were left free.

The file has no group `fit`: what was lifted is under `records`, the record as it was read under `measured`. Beside it
`result_v1_resampled.npz` has numbers of the analysis, not through floquid.store. To run:
`python write_result_v1_resampled.py FOLDER`.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from floquid.pipeline import identify
from floquid.store import save
from floquid.systems import JeffcottRotor
from floquid.views import synthesis


def main(folder: Path) -> None:
    record = JeffcottRotor(damping=0.03).simulate(n_periods=30, samples_per_period=8, noise=0.005, seed=1)
    values = record.values[:2].copy()
    values[:, 100:103] = np.nan
    record = replace(record.select(["X", "Y"]), values=values)
    found = identify(record, constrained=False, validate=False)
    # A small file: without what takes most of the room.
    bare = replace(found.model, estimates=None, unselected=None)
    found = replace(found, model=bare, periodicity=None)
    save(found, folder / "result_v1_resampled.h5")
    seen = synthesis(found, 1)
    np.savez_compressed(
        folder / "result_v1_resampled.npz",
        values=record.values,
        noise=found.noise,
        exponents=found.model.exponents,
        residues=found.modal.residues,
        lifted=found.lifted.responses.values,
        times=seen.times,
        residual=seen.residual,
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
