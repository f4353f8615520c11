"""Samples of records whose excitation goes on, with their channels."""

from __future__ import annotations

from dataclasses import dataclass

from floquid.core import Channel, Record
from floquid.findings import Finding
from floquid.inputs import Samples
from floquid.sync import ShaftAngle


@dataclass(frozen=True, slots=True, kw_only=True)
class Parted:
    """Samples of records with inputs, and their channels.

    Parameters
    ----------
    records
        The records as used.
    samples
        Outputs and inputs, one record after another.
    outputs, inputs
        The channels of each.
    turns
        Harmonics of the period that are fitted beside the modes, those of the revolution among them (turns,).
    shafts
        The angle of the shaft in each record; none where the period is constant.
    periods_per_revolution
        Periods of a revolution, as the clock of the record has them, or the settings.
    findings
        What is said of these harmonics.
    """

    records: tuple[Record, ...]
    samples: Samples
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    turns: tuple[float, ...]
    shafts: tuple[ShaftAngle, ...]
    periods_per_revolution: float
    findings: tuple[Finding, ...]
