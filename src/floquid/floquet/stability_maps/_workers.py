"""Threads or processes that share the points of a stability map."""

from __future__ import annotations

import pickle
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor
from contextlib import contextmanager
from functools import partial

from floquid._arrays import Floats
from floquid._checks import input_error, integer
from floquid.errors import InputError
from floquid.floquet.stability_maps._family import Family
from floquid.floquet.stability_maps._spectra import Spectra, joined, spectra

_CHUNK = 512  # points of one batch of a vectorised system
_CHUNK_PLAIN = 32  # and of a plain one, whose cost is its own
_NUMBERS = 50_000  # of the matrices of one sample of a batch


@contextmanager
def shared_by(count: int, of: Family) -> Iterator[Callable[..., Spectra]]:
    """The spectra at points (points, parameters), found by `workers` processes; a listener is told how many are done.

    The points are taken in chunks that do not depend on how many work on them. Nothing is left behind.
    """
    pool = _pool(of, count) if integer(count, "workers", of.of, at_least=1) > 1 else None
    size = min(_CHUNK if of.vectorised else _CHUNK_PLAIN, 1 + _NUMBERS // len(of.scale) ** 2)

    def evaluate(points: Floats, done: Callable[[int], None] = lambda _: None) -> Spectra:
        chunks = [points[start : start + size] for start in range(0, len(points), size)]
        own, parts = partial(spectra, of), []
        if pool is None or (len(chunks) == 1 and of.vectorised):
            found = map(own, chunks)
        else:
            found = pool.map(own if of.vectorised else _one_chunk, chunks)
        try:
            for part in found:
                parts.append(part)
                done(sum(len(each.growth) for each in parts))
        except BrokenExecutor:
            raise _unreachable(of, "the processes that should call it ended at once") from None
        return joined(parts)

    try:
        yield evaluate
    finally:
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)


def _pool(of: Family, count: int) -> Executor:
    """Threads for a vectorised system, processes for a plain one."""
    from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

    if of.vectorised:
        return ThreadPoolExecutor(count)
    import multiprocessing

    try:
        pickle.dumps((of.system, of.period))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise _unreachable(of, f"it cannot be sent to one ({error})") from None
    # A fresh interpreter: a fork of a process with threads may hang.
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(of,))


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
