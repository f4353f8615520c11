"""Names of channels that come again, and names that the user or a text in the file gives instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from floquid._checks import counted, input_error
from floquid.core import Channel
from floquid.errors import InputError
from floquid.io import Source
from floquid.tables._table import Table, check_distinct


def numbered(names: Sequence[str]) -> list[str]:
    """The `names` of columns, those that come again with their number: x, x_2, x_3."""
    found: list[str] = []
    for name in names:
        number, new = 1, name
        while new in found:
            number += 1
            new = f"{name}_{number}"
        found.append(new)
    return found


def with_names(table: Table, names: Sequence[str], source: Source) -> Table:
    """The `table` of a `source`, its first channels renamed: to the `names`, or to the labels that one names."""
    if isinstance(names, str) or not names or not all(isinstance(name, str) for name in names):
        raise input_error("names", source.of, "be a list of names, at least one", f"is {names!r}")
    chosen = table.labels[names[0]] if len(names) == 1 and names[0] in table.labels else names
    count = len(table.channels)
    if len(chosen) > count:
        listing = f" Texts in the file: {', '.join(table.labels)}." if table.labels else ""
        got = f"are {len(chosen)} for {counted(count, 'channel')} of {source.name}"
        raise input_error("names", source.of, "be as many as the channels", got, f"Leave some out.{listing}")
    channels = []
    for channel, name in zip(table.channels, chosen, strict=False):
        is_plain = Channel(name=channel.name, unit=channel.unit).quantity == channel.quantity
        try:
            channels.append(replace(channel, name=name, quantity=None if is_plain else channel.quantity))
        except InputError as error:
            raise source.wrapped(error) from None
    channels += table.channels[len(channels) :]
    check_distinct(source, [channel.name for channel in channels])
    return replace(table, channels=tuple(channels))
