"""Wrote `result_v1_sampled.h5`, the last layout of version 1: a tachometer, and an imbalance beside the free response.

The file has the records as they were read under `fit/measured`, the free response resampled under `records`. Beside it
`result_v1_sampled.npz` has numbers of the analysis, not through floquid.store. To run:
`python write_result_v1_sampled.py FOLDER`.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from floquid.pipeline import identify
from floquid.store import save
from floquid.systems import JeffcottRotor, Run
from floquid.views import synthesis


def main(folder: Path) -> None:
    run = Run(rotor=JeffcottRotor(damping=0.05), n_periods=36, samples_per_period=7.3, noise=0.002, seed=1)
    record = run.record()
    found = identify(record.select(["X", record.clock.channel]), order=4, validate=False)
    # A small file: without what takes most of the room.
    bare = replace(found.model, estimates=None, unselected=None)
    found = replace(found, model=bare, periodicity=None)
    save(found, folder / "result_v1_sampled.h5")
    seen = synthesis(found, 0)
    np.savez_compressed(
        folder / "result_v1_sampled.npz",
        values=np.concatenate([record.values[:1], record.values[-1:]]),
        free=seen.measured,
        noise=found.noise,
        misfit=found.misfit,
        exponents=found.model.exponents,
        residues=found.modal.residues,
        lifted=found.lifted.responses.values,
        forced=found.fit.forced.coefficients,
        angle=found.shafts[0].angle(record.times[10:-10]),
        times=seen.times,
        residual=seen.residual,
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
