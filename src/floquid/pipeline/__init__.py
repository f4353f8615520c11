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
from floquid.pipeline._analysis import Driven as Driven
from floquid.pipeline._deviations import Decay
from floquid.pipeline._identify import identify
from floquid.pipeline.draws import Bootstrap, Draw, DrawFile, Spread, bootstrap
from floquid.pipeline.excited import ambient_fit as ambient_fit
from floquid.pipeline.excited import driven_fit as driven_fit
from floquid.pipeline.excited import measure_transfer
from floquid.pipeline.excited import predicted_rest as predicted_rest
from floquid.pipeline.free import find_poles, lifted, lifted_views, samples_of, validated
from floquid.preparation import FORBIDDEN as FORBIDDEN
from floquid.preparation import WORDS as WORDS
from floquid.preparation import Excitation as Excitation
from floquid.preparation import IdentifierName as IdentifierName
from floquid.preparation import Prepared as Prepared
from floquid.preparation import Settings as Settings
from floquid.preparation import blas_threads as blas_threads
from floquid.preparation import prepare as prepare

__all__ = [
    "CONFIDENT", "Analysis", "Bootstrap", "Decay", "Draw", "DrawFile", "Spread", "bootstrap", "find_poles", "identify",
    "lifted", "lifted_views", "measure_transfer", "samples_of", "validated",
]  # fmt: skip
