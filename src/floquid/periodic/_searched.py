"""A fit that is done, with what is left beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.periodic._blocks import Block
from floquid.periodic._constrained import Held
from floquid.periodic._peaks import Peak, Rest


@dataclass(frozen=True, slots=True)
class Searched:
    """The blocks with the noise that is left, the fit, the bands that are reported, and the strongest peak left."""

    blocks: tuple[Block, ...]
    held: Held
    bands: NDArray[np.int64]
    peak: Peak
    rests: tuple[Rest, ...]
    """What is left of each block."""
    misfit: float = 1.0
    """The rms of what is left over the level of its noise, the largest of all responses."""
    clusters: tuple[int, ...] = ()
    """The entries whose harmonics do not have one exponent."""
