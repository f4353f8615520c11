"""Sources of a result: the files and what was done to them, in order."""

from __future__ import annotations

from dataclasses import dataclass, replace

from floquid._show import Brief


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance(Brief):
    """The history of a record or a result.

    Parameters
    ----------
    sources
        Where the data came from: file names, or the words of a simulation.
    steps
        What was done since, one sentence a step, in order.
    """

    sources: tuple[str, ...] = ()
    steps: tuple[str, ...] = ()

    def then(self, *steps: str) -> Provenance:
        """History with `steps` added at its end."""
        return replace(self, steps=self.steps + steps)

    @staticmethod
    def merge(parts: tuple[Provenance, ...]) -> Provenance:
        """One history of `parts`: every source, and each distinct step once, in order of first mention."""
        sources = dict.fromkeys(source for part in parts for source in part.sources)
        steps = dict.fromkeys(step for part in parts for step in part.steps)
        return Provenance(sources=tuple(sources), steps=tuple(steps))
