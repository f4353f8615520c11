"""The chain up to the lifted responses: what is looked at before poles are searched for."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from floquid.core import Record
from floquid.lifting import Lifted, lift, whitened
from floquid.pipeline._colour import first_filter
from floquid.pipeline._identify import LARGE, _prepare, _refuse_impossible, _settings
from floquid.pipeline._independent import refuse_copies, refuse_unusable
from floquid.pipeline._settings import Settings
from floquid.sync import segment


def lifted(
    records: Record | Sequence[Record],
    settings: Settings | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
    **options: object,
) -> Lifted:
    """The lifted responses of records, with the noise of each channel and hit: where `identify` starts from.

    Where the noise is coloured along the record, they are whitened.

    Parameters
    ----------
    records
        One record, or one a hit on the same system.
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
        The record is too short.
    """
    from threadpoolctl import threadpool_limits

    chosen = _settings(settings, options)
    used = _prepare(records, chosen)
    few = sum(record.values.size for record in used) < LARGE
    with threadpool_limits(limits=1 if few else None, user_api="blas"):
        refuse_unusable(used)
        refuse_copies(used)
        report("cutting into periods")
        cycles = segment(used)
        _refuse_impossible(chosen, cycles)
        report("estimating the noise")
        found = lift(cycles, floor=chosen.noise_floor)
        taps = first_filter(found)
        return found if taps is None else whitened(found, taps)
