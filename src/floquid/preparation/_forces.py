"""Refusal of records that are driven all along: by settings, by a force that goes on, by a response that is random."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floquid._arrays import Floats
from floquid._checks import wrong_value
from floquid.core import Record
from floquid.errors import IdentificationError
from floquid.preparation._before import NO_RESPONSE
from floquid.preparation._settings import Settings

PEAKED = 8.0  # the peak of a force over its rms below which it goes on: of a random one it is four, of a blow a hundred
LASTING = 0.3  # the energy of the weakest third of a record over that of the strongest from which on nothing decays
BROAD = 16.0
"""Lines of a spectrum over which the energy is spread, at least: those of a tone or a lasting mode are a few."""

WHITE = 0.125
"""Share of all lines from which on a force is noise and no response."""

BESIDE = 3  # lines on either side of a harmonic of the period that are its own


def refuse_excited(settings: Settings) -> None:
    """Refuse settings of records whose excitation goes on: the response is free."""
    if settings.inputs:
        must = "be empty: the response is free"
        raise wrong_value("inputs", "lifted", must, list(settings.inputs), "`identify` takes measured inputs.")
    if settings.excitation != "none":
        must = 'be "none": the response is free'
        raise wrong_value("excitation", "lifted", must, settings.excitation, "`identify` takes random excitation.")


def refuse_driven(records: Sequence[Record], settings: Settings) -> None:
    """Refuse records in which a measured force goes on that the settings name neither as an input nor as a response."""
    forces = forces_of(records, settings)
    every = ",".join([*settings.inputs, *forces])
    for number, record in enumerate(records, start=1):
        where = f" of record {number}" if len(records) > 1 else ""
        for channel, values in zip(record.channels, record.values, strict=True):
            if channel.name not in forces or not goes_on(values):
                continue
            if settings.inputs:
                raise IdentificationError(
                    f"Channel {channel.name!r}{where} is a force that acts during the record, too: modes found without "
                    f"it would be wrong. Name all that drives the system (`inputs={every}`); where it drives nothing, "
                    "or is a response, name the channels to use: `channels=`."
                )
            raise IdentificationError(
                f"Channel {channel.name!r}{where} is a force that acts during the record: the response is not free, "
                f"and modes found in it would be wrong. Name what drives the system (`inputs={every}`), or use a "
                "record that begins when the force is off: cut it, or pass `skip=`."
            )


def forces_of(records: Sequence[Record], settings: Settings) -> list[str]:
    """The names of forces that the settings name neither as inputs nor as responses, as the records have them."""
    named = (*settings.channels, *settings.inputs)
    names = [c.name for record in records for c in record.channels if c.quantity == "force" and c.name not in named]
    return list(dict.fromkeys(names))


def refuse_random(records: Sequence[Record], forces: Sequence[str]) -> None:
    r"""Refuse free responses that are random and do not decay.

    The energy of the response, harmonics of the period left out, is spread over

    .. math:: \Big(\sum_k P_k\Big)^2 \Big/ \sum_k P_k^2

    lines of its spectrum P: few for undamped modes and tones, many but far from all for a response to noise. Only of
    records of constant period: at a speed that wanders, harmonics are as broad. Of several records with fewer periods
    than those lines, the most must be so: there are fewer lines between two harmonics. The `forces` that the records
    held may be what drives it.
    """
    random = [record.period is not None and is_random(record, record.period) for record in records]
    for number, record in enumerate(records, start=1):
        where = f" of record {number}" if len(records) > 1 else ""
        brief = record.period is not None and record.duration < BROAD * record.period
        if random[number - 1] and (not brief or 2 * sum(random) > len(records)):
            measured = f"Name what was measured of it as inputs (`inputs={','.join(forces)}`). " if forces else ""
            raise IdentificationError(
                f"The response{where} does not decay, and is random: it is driven all along, by wind, by a process or "
                f'by the ground. {measured}Identify it as such, with `excitation="ambient"`; or '
                "use the free response after a blow or after the excitation was switched off."
            )


def goes_on(values: Floats) -> bool:
    """True for a force (samples,) that is no series of blows."""
    about = _bounded(values - np.nanmedian(values))
    size = float(np.sqrt(np.nanmean(about**2)))
    return size > 0.0 and float(np.nanmax(np.abs(about))) < PEAKED * size


def is_white(values: Floats) -> bool:
    """True where the energy of a channel (samples,) is spread over its spectrum as that of noise."""
    filled = _bounded(np.nan_to_num(values - np.nanmean(values)))
    power = np.abs(np.fft.rfft(filled * np.hanning(len(filled)))) ** 2
    return _spread(power) >= WHITE * len(power)


def _spread(power: Floats) -> float:
    """Lines of a spectrum (lines,) over which its energy is spread."""
    return float(power.sum()) ** 2 / max(float(np.sum(power**2)), np.finfo(float).tiny)


def is_random(record: Record, period: float | None) -> bool:
    """True where the response lasts, in broad peaks; harmonics of a known period and channels of noise are left out."""
    pairs = enumerate(zip(record.channels, record.values, strict=True))
    rows = [row for row, (channel, own) in pairs if channel.quantity not in NO_RESPONSE and not is_white(own)]
    samples = record.n_samples
    turn, window = samples if period is None else samples / (period * record.sample_rate), np.hanning(samples)
    beside = np.zeros(samples // 2 + 1, bool)
    if period is not None:
        turns = np.arange(len(beside)) / turn
        beside = np.abs(turns - np.rint(turns)) * turn <= BESIDE
    power = np.zeros(len(beside))
    for row in rows:
        power += np.abs(np.fft.rfft(_scaled(record.values[row]) * window)) ** 2 * ~beside
    if not BROAD < _spread(power) < WHITE * len(power):
        return False
    thirds = np.zeros(3)
    for row in rows:
        kept = np.fft.irfft(np.fft.rfft(_scaled(record.values[row])) * ~beside, samples)
        thirds += [float(np.mean(part**2)) for part in np.array_split(kept, 3)]
    return float(thirds.min()) > LASTING * float(thirds.max())


def _scaled(values: Floats) -> Floats:
    """A channel (samples,) about its mean, of unit size, missing samples zero."""
    filled = _bounded(np.nan_to_num(values - np.nanmean(values)))
    return filled / max(float(np.sqrt(np.mean(filled**2))), np.finfo(float).tiny)


def _bounded(values: Floats) -> Floats:
    """Values (samples,) over the largest of them: squares stay within floating point in any unit."""
    return values / max(float(np.fmax.reduce(np.abs(values), initial=0.0)), np.finfo(float).tiny)
