"""Files to records of one system, as settings and a few words on the files have them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from floquid._show import Brief
from floquid.core import Record
from floquid.preparation._settings import Settings
from floquid.readers import read


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading(Brief):
    """Options of the reading of files, beside the settings of their identification.

    Parameters
    ----------
    rate
        The sampling rate [Hz], overriding what the files say; None for theirs.
    names
        Names to give the channels, or the path of a variable that holds them.
    origin
        The time of phase zero [s].
    header
        True where text tables have a line of names.
    point
        The operating point by quantity, beside what the files say of it.
    """

    rate: float | None = None
    names: tuple[str, ...] = ()
    origin: float = 0.0
    header: bool = True
    point: Mapping[str, float] = field(default_factory=dict)

    def records(
        self, files: Sequence[Path], settings: Settings, report: Callable[[str], None] = lambda _: None
    ) -> tuple[list[Record], Settings]:
        """The records in `files`, and the `settings` with the names that channels have from here on.

        Of the channels that the settings name, and of signals and inputs beside them; of all where they name none.
        Raises InputError as `read` does. A stage of the work is told to `report`.
        """
        signals = [name for name in (settings.tach, settings.azimuth) if name is not None]
        beside = [name for name in (*signals, *settings.inputs) if name not in (*settings.channels, *self.names)]
        named = (*settings.channels, *beside) if settings.channels else None
        records = []
        for file in files:
            report(f"reading {file.name}")
            record = read(
                file, period=settings.period, rate=self.rate, channels=named, names=self.names or None,
                origin=self.origin, header=self.header,
            )  # fmt: skip
            records.append(record.with_point(self.point))
        if settings.channels:  # a path may stand for all rows of a matrix: from here on each has its name
            own = tuple(channel.name for channel in records[0].channels if channel.name not in beside)
            settings = replace(settings, channels=own)
        return records, settings
