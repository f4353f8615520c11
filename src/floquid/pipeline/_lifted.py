"""The chain up to the lifted responses: what is looked at before poles are searched for."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from floquid._checks import input_error
from floquid.core import Record
from floquid.lifting import Lifted, whitened
from floquid.pipeline._colour import first_filter
from floquid.pipeline._settings import Settings
from floquid.pipeline._start import cut
from floquid.pipeline.preparation import Prepared, blas_threads, prepare, settings_of


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

    `records`, or what `prepare` made of them, `settings`, `report`, `options` and the errors are those of `identify`;
    what is set of the stages after lifting changes nothing.
    """
    if not isinstance(records, Prepared):
        records = prepare(records, settings_of(settings, options, "lifted"), report=report, of="lifted")
    elif settings is not None or options:
        must, got = "be left out with records that are prepared", "is given"
        name = "settings" if settings is not None else next(iter(options))
        raise input_error(name, "lifted", must, got, "Give it to `prepare`.")
    with blas_threads(records.responses):
        report("cutting into periods")
        found = cut(records).lifted
        report("estimating the noise")
        taps = first_filter(found)
        return found if taps is None else whitened(found, taps)
