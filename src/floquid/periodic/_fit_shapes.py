"""The fit of the samples of brief hits, which share the shapes of their modes: started at outer products."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from floquid.core import PeriodicModel, PhaseClock, Record
from floquid.lifting import Lifted
from floquid.periodic._fit_records import Fit, Samples, result_of
from floquid.periodic._refit import scaled
from floquid.periodic.least_squares import ModeParameters
from floquid.periodic.search import of_shapes


def fit_shapes(
    records: Sequence[Record],
    clocks: Sequence[PhaseClock],
    model: PeriodicModel,
    lifted: Lifted,
    *,
    noise_floor: float = 1e-10,
    report: Callable[[str], None] = lambda _: None,
) -> Fit:
    r"""Modes of brief hits with one shape for all of them, and a state in each.

    .. math:: y_{c,h}(t) = 2 \Re \sum_r a_{r,h} \sum_{m \in M_r} c_{r,m,c}\, e^{(\lambda_r + i m \omega) t}

    Of many hits that are over in a few periods, residues of its own ask of each hit more than it holds: P H numbers a
    mode and channel, where P shapes and H states do.

    Raises IdentificationError where a mode is not determined.

    Parameters
    ----------
    records, clocks
        One record a hit, and what ties each to the phase.
    model
        Where to start: outer products of shape and hit, with the bands of harmonics.
    lifted
        The same records lifted, with their noise.
    noise_floor
        The share of the largest free response that the noise is taken to be at least.
    report
        Is told of the stage.
    """
    report("fitting one shape for all hits")
    samples = Samples.of(records, clocks, lifted, None, 1.0)
    entries = ModeParameters.of(model)
    values = [2.0 * scaled(model, entries, block) for block in samples.final]
    result = of_shapes(samples.final, entries, values, noise_floor, samples.most)
    noise = np.zeros(lifted.noise.shape)
    for block in result.blocks:
        noise[block.rows, block.hit] = block.noise
    common = {"free_period": False, "noise_floor": noise_floor, "ended": (), "noise": noise}
    return result_of(result, records, clocks, samples, lifted.whitening, **common)
