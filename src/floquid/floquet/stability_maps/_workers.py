"""Threads or processes that share the points of a stability map."""

from __future__ import annotations

import pickle
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from functools import partial
from typing import Self

from floquid._arrays import Floats
from floquid._checks import input_error, integer
from floquid.errors import InputError
from floquid.floquet.stability_maps._family import Family
from floquid.floquet.stability_maps._spectra import Spectra, joined, spectra

_CHUNK = 512  # points of one batch of a vectorised system
_CHUNK_PLAIN = 32  # and of a plain one, whose cost is its own
_NUMBERS = 50_000  # of the matrices of one sample of a batch


class Workers:
    """Evaluates points in chunks that do not depend on how many work on them; a context that leaves nothing behind."""

    def __init__(self, of: Family, count: int) -> None:
        self._family = of
        self._count = integer(count, "workers", of.of, at_least=1)
        self._pool: Executor | None = None

    def __enter__(self) -> Self:
        if self._count > 1 and self._family.vectorised:
            from concurrent.futures import ThreadPoolExecutor

            self._pool = ThreadPoolExecutor(self._count)
        elif self._count > 1:
            import multiprocessing
            from concurrent.futures import ProcessPoolExecutor

            try:
                pickle.dumps((self._family.system, self._family.period))
            except (pickle.PicklingError, AttributeError, TypeError) as error:
                raise _unreachable(self._family, f"it cannot be sent to one ({error})") from None
            # A fresh interpreter: a fork of a process with threads may hang.
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(
                self._count, mp_context=context, initializer=_begin, initargs=(self._family,)
            )
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def spectra(self, points: Floats, done: Callable[[int], None] = lambda _: None) -> Spectra:
        """The spectra at the points (points, parameters); `done` is told how many are."""
        size = min(_CHUNK if self._family.vectorised else _CHUNK_PLAIN, 1 + _NUMBERS // len(self._family.scale) ** 2)
        chunks = [points[start : start + size] for start in range(0, len(points), size)]
        parts = []
        for part in self._parts(chunks):
            parts.append(part)
            done(sum(len(each.growth) for each in parts))
        return joined(parts)

    def _parts(self, chunks: list[Floats]) -> Iterator[Spectra]:
        if self._pool is None or (len(chunks) == 1 and self._family.vectorised):
            yield from (spectra(self._family, chunk) for chunk in chunks)
        elif self._family.vectorised:
            yield from self._pool.map(partial(spectra, self._family), chunks)
        else:
            from concurrent.futures.process import BrokenProcessPool

            try:
                yield from self._pool.map(_one_chunk, chunks)
            except BrokenProcessPool:
                raise _unreachable(self._family, "the processes that should call it ended at once") from None


_FAMILY: list[Family] = []  # that of this worker process


def _begin(of: Family) -> None:
    # Ctrl-C reaches every process of a terminal; the first of them ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _FAMILY[:] = [of]


def _one_chunk(points: Floats) -> Spectra:
    return spectra(_FAMILY[0], points)


def _unreachable(of: Family, why: str) -> InputError:
    return input_error(
        "workers",
        of.of,
        "be 1 for a plain callable that other processes cannot import",
        why,
        "Define it and the period at the top level of a module, or pass `vectorised` ones, which need threads only.",
    )
