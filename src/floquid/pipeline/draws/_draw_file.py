"""The draws of a bootstrap that are done, on the disk: a run that is cut short is gone on with."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.io import atomic_path
from floquid.pipeline.draws._redraw import Draw

EVERY = 5.0  # seconds between two writings

_ARRAYS = ("exponents", "coefficients", "system", "transition", "inputs")


@dataclass(slots=True, kw_only=True)
class DrawFile:
    """Keeps the draws of one bootstrap in a file: an archive of plain arrays, replaced whole.

    Parameters
    ----------
    path
        The file.
    key
        What the draws are of: the result, the seed, what is fitted. Draws under another key are not taken up.
    """

    path: Path
    key: str
    _written: float = field(default_factory=time.monotonic, init=False)

    def read(self) -> list[Draw]:
        """The draws that are done; none where there is no such file, or it is of something else, or damaged."""
        try:
            with self.path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                packed = any(member.compress_type for member in file.zip.infolist())  # not as it was written
                if packed or str(file["key"]) != self.key:
                    return []
                return _draws({name: file[name] for name in file.files})
        except Exception:  # noqa: BLE001  # damage raises anything: zip, zlib, numpy; then there are no draws
            return []

    def keep(self, draws: Sequence[Draw]) -> None:
        """Write the draws, unless they were written a moment ago."""
        if time.monotonic() - self._written >= EVERY:
            self.write(draws)

    def write(self, draws: Sequence[Draw]) -> None:
        """Write all `draws` that are done. Raises InputError where the file cannot be written."""
        used = [one for one in draws if one.exponents is not None]
        content: dict[str, Any] = {
            "key": np.array(self.key),
            "orders": np.array([one.order for one in draws], np.int64),
            "failures": np.array([one.failure for one in draws], np.str_),
            "used": np.array([one.exponents is not None for one in draws], bool),
            "periods": np.array([one.period for one in used]),
        }
        for name in _ARRAYS:
            values = [getattr(one, name) for one in used]
            if values and values[0] is not None:
                content[name] = np.array(values)
        with atomic_path(self.path, of="bootstrap") as temporary, temporary.open("wb") as stream:
            np.savez(stream, **content)
        self._written = time.monotonic()


def _draws(content: dict[str, NDArray[Any]]) -> list[Draw]:
    found, row = [], 0
    for order, failure, used in zip(content["orders"], content["failures"], content["used"], strict=True):
        if not used:
            found.append(Draw(int(order), failure=str(failure)))
            continue
        arrays = {name: content[name][row] for name in _ARRAYS if name in content}
        found.append(Draw(int(order), period=float(content["periods"][row]), **arrays))
        row += 1
    return found
