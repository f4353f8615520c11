"""The chain up to the lifted responses: what is looked at before poles are searched for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from floquid._checks import input_error
from floquid.core import Cycles, Record
from floquid.lifting import Lifted, lift, whitened
from floquid.pipeline._colour import first_filter
from floquid.pipeline._identify import _refuse_impossible
from floquid.pipeline._measured import why_measured
from floquid.pipeline._prepare import Prepared, blas_threads, prepare
from floquid.pipeline._settings import Settings
from floquid.sync import resample, segment


def lifted(
    records: Record | Sequence[Record] | Prepared,
    settings: Settings | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
    **options: object,
) -> Lifted:
    """The lifted responses of records, with the noise of each channel and hit: what `identify` searches for poles.

    The channels and cycles are those of `identify`. Records that cannot be cut into whole samples a period as they
    are, with a tachometer, a rate out of step or missing samples, are resampled to them. Where the noise is coloured
    along the record, the responses are whitened.

    Parameters
    ----------
    records
        One record, or one a hit on the same system; or what `prepare` made of them.
    settings
        The options; or give them by name. Those of what comes after lifting change nothing.
    report
        Is told what is being done, a phrase a stage.
    **options
        Fields of `Settings`.

    Returns
    -------
    Lifted
        The responses.

    Raises
    ------
    InputError
        A record or an option is not possible.
    IdentificationError
        The record is too short, or the angle of its shaft cannot be told or is not constant enough.
    """
    if not isinstance(records, Prepared):
        records = prepare(records, settings, report=report, of="lifted", **options)
    elif settings is not None or options:
        must, got = "be left out with records that are prepared", "is given"
        name = "settings" if settings is not None else next(iter(options))
        raise input_error(name, "lifted", must, got, "Give it to `prepare`.")
    with blas_threads(records.responses):
        report("cutting into periods")
        cycles = _cycles(records)
        _refuse_impossible(records.settings, cycles)
        report("estimating the noise")
        found = lift(cycles, floor=records.settings.noise_floor)
        taps = first_filter(found)
        return found if taps is None else whitened(found, taps)


def _cycles(prepared: Prepared) -> tuple[Cycles, ...]:
    """The responses cut into whole samples a period, resampled where they have none.

    Shafts turn at a speed of their own in each hit: there, a cycle is as long as the mean over all of them, as the
    period of the model is.
    """
    if not why_measured(prepared.records, prepared.settings):
        return segment(prepared.responses)
    cycles = resample(prepared.responses, prepared.clocks)
    if not prepared.shafts:
        return cycles
    period = float(np.mean([shaft.period for shaft in prepared.shafts]))
    return tuple(replace(hit, periods=np.full(hit.n_cycles, period)) for hit in cycles)
