"""Names of channels in as much room as there is."""

from __future__ import annotations


def shortened(name: str, longest: int) -> str:
    """A name, or its beginning and its end: names of channels often differ in either alone.

    Parameters
    ----------
    name
        The name.
    longest
        The most characters it may have, 1 or more.

    Returns
    -------
    str
        The name, with "…" in place of its middle where it is longer.
    """
    if len(name) <= longest:
        return name
    end = (longest - 1) // 2
    return f"{name[: longest - 1 - end]}…{name[len(name) - end :]}"
