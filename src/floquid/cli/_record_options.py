"""What is said of records wherever they are used: how they are read, what ties them to the phase, what is cut off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Parameter

from floquid.cli._options import OptionalWhole, split
from floquid.cli._records import period_of

Flag = Annotated[bool | None, Parameter(negative=())]


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class RecordOptions:
    """Options of every command that starts from records.

    Parameters
    ----------
    period
        The period of the system [s]: half a revolution for a two-fold symmetric shaft seen from the ground.
    frequency
        The fundamental frequency [Hz], one over the period; instead of --period.
    tach
        The channel of a tachometer, whose pulses tell the angle of the shaft; instead of --period.
    azimuth
        The channel that holds the angle of the shaft, in degrees or radians; instead of --period.
    estimate_period
        Find the period from the response alone; --period may give a first value, right to a factor of 1.5.
    pulses_per_rev
        Pulses of the tachometer in a revolution; 1 when not given.
    periods_per_rev
        Periods of the system in a revolution of the shaft: 2 for a two-fold symmetric shaft seen from the ground; 1
        when not given.
    origin
        The time of phase zero [s]; 0 when not given.
    rate
        The sampling rate [Hz], overriding what the files say.
    channels
        The channels to use, comma-separated; all when not given. In .mat and .h5 files of other names, the paths of
        the variables: run/acc/x, or data[2] for a row, data.T[2] for a column.
    orbit
        Subtract the periodic orbit that a file holds; --no-orbit leaves it in.
    find_hits
        Look for impacts in each record, and take each free response after one as a hit of its own.
    skip
        Periods left out at the start, or after each impact found, where the response is not linear yet; 0 when not
        given.
    trust_period
        Warn instead of refusing when the response seems to repeat with another period than the one given, or the speed
        of the shaft is not constant enough.
    """

    period: float | None = None
    frequency: float | None = None
    tach: str | None = None
    azimuth: str | None = None
    estimate_period: Flag = None
    pulses_per_rev: OptionalWhole = None
    periods_per_rev: float | None = None
    origin: float | None = None
    rate: float | None = None
    channels: str | None = None
    orbit: bool | None = None
    find_hits: Flag = None
    skip: float | None = None
    trust_period: Flag = None

    def given(self, of: str) -> dict[str, Any]:
        """The fields of `Choices` by name, None where nothing was said; `of` is the command, for messages.

        Raises
        ------
        InputError
            Period and frequency are both given, or the frequency is not possible.
        """
        return {
            "period": period_of(self.period, self.frequency, of),
            "tach": self.tach,
            "azimuth": self.azimuth,
            "estimate_period": self.estimate_period,
            "pulses_per_revolution": self.pulses_per_rev,
            "periods_per_revolution": self.periods_per_rev,
            "origin": self.origin,
            "rate": self.rate,
            "channels": None if self.channels is None else split(self.channels),
            "orbit": self.orbit,
            "find_hits": self.find_hits,
            "skip": self.skip,
            "trust_period": self.trust_period,
        }
