"""Wrote `result_v2.h5`, of the last version that kept sentences alone: warnings, reasons and doubts, and no findings.

Beside it `result_v2.json` has what the analysis said, not through floquid.store. To run:
`python write_result_v2.py FOLDER`.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

from floquid.pipeline import identify
from floquid.store import save
from floquid.systems import JeffcottRotor, Run


def main(folder: Path) -> None:
    run = Run(rotor=JeffcottRotor(damping=0.05), n_periods=36, samples_per_period=7.3, noise=0.002, seed=1)
    record = run.record()
    found = identify(record.select(["X", record.clock.channel]), harmonics=1)
    # A small file: without what takes most of the room.
    bare = replace(found.model, estimates=None, unselected=None)
    found = replace(found, model=bare, periodicity=None)
    save(found, folder / "result_v2.h5")
    said = {
        "synchronisation": found.synchronisation,
        "warnings": found.warnings,
        "validation": found.validation.reasons,
        "reasons": () if found.choice is None else found.choice.reasons,
        "doubts": () if found.choice is None else found.choice.doubts,
        "shaft": found.shafts[0].reasons,
    }
    (folder / "result_v2.json").write_text(json.dumps(said, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
