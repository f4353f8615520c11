"""Wrote `result_v1_plain.h5`, the last layout of version 1: a record of whole samples a period, nothing forced in it.

The file has no group `fit`: its records were lifted as they are. Beside it `result_v1_plain.npz` has numbers of the
analysis, not through floquid.store. To run: `python write_result_v1_plain.py FOLDER`.
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
    record = JeffcottRotor(damping=0.05).simulate(n_periods=16, samples_per_period=6, noise=0.002, seed=1)
    found = identify(record.select(["X", "Y"]), order=4, validate=False)
    # A small file: without what takes most of the room.
    bare = replace(found.model, estimates=None, unselected=None)
    found = replace(found, model=bare, periodicity=None)
    save(found, folder / "result_v1_plain.h5")
    seen = synthesis(found, 1)
    np.savez_compressed(
        folder / "result_v1_plain.npz",
        values=found.cycles[0].values,
        noise=found.noise,
        misfit=found.misfit,
        exponents=found.model.exponents,
        residues=found.modal.residues,
        lifted=found.lifted.responses.values,
        times=seen.times,
        residual=seen.residual,
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
