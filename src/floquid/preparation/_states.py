"""Channels that are the states of A(t), as the settings name them."""

from __future__ import annotations

from collections.abc import Sequence

from floquid.core import Channel, channels_named
from floquid.preparation._settings import ALL, Settings
from floquid.reconstruction import AbstractStructure, displacement_rows, structure_of

OF = "identify"


def check_states(channels: Sequence[Channel], settings: Settings) -> None:
    """Refuse states that are not in the records, and a structure that cannot be one of them, before any long work."""
    names = states_of(channels, settings)
    if isinstance(names, str):
        return
    if settings.form == "second-order":
        displacement_rows(channels, names, of=OF)
    else:
        channels_named(channels, names, argument="states", of=OF)
    structure = structure_of(settings.structure) if settings.structure else None
    if isinstance(structure, AbstractStructure):
        structure.basis(len(names))


def states_of(channels: Sequence[Channel], settings: Settings) -> str | tuple[str, ...]:
    """The states as `reconstruct` takes them: "all" is a channel where one is called so."""
    alone = settings.states == (ALL,) and ALL not in {channel.name for channel in channels}
    return ALL if alone else settings.states
