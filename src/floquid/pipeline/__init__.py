"""The whole chain: `identify` takes records and `Settings` and gives an `Analysis`, with every intermediate kept.

Everything starts from what `prepare` makes of records: the responses, what ties each to the phase, and what was done.
`lifted` stops after lifting, and `find_poles` goes on from there to poles and noise.
`samples_of` are the samples that are fitted, and `lifted_views` what a fit leaves of them, cut into periods and lifted.
`validated` adds the verdict on a model.
`measure_transfer` measures transfer functions line by line.
`bootstrap` checks the deviations of an `Analysis` by drawing records from its model.
"""

from floquid.periodic import CONFIDENT
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._deviations import Decay, Driven
from floquid.pipeline._identify import identify
from floquid.pipeline.draws import Bootstrap, Draw, DrawFile, Spread, bootstrap
from floquid.pipeline.excited import ambient_fit, driven_fit, measure_transfer, predicted_rest
from floquid.pipeline.free import find_poles, lifted, lifted_views, samples_of, validated
from floquid.preparation import IdentifierName, Settings, blas_threads, prepare

__all__ = [
    "CONFIDENT", "Analysis", "Bootstrap", "Decay", "Draw", "DrawFile", "Spread", "bootstrap", "find_poles", "identify",
    "lifted", "lifted_views", "measure_transfer", "samples_of", "validated",
]  # fmt: skip
