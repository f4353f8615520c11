"""Jobs on workers: results as they are ready, and one job costing one job."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from typing import Any, TypeAlias, TypeVar

from floquid._checks import input_error
from floquid.errors import IdentificationError
from floquid.io import load_package

Job = TypeVar("Job")
Result = TypeVar("Result")
Lost: TypeAlias = Callable[[Job, str], Result]

DIED = "The process that identified it ended at once, twice: is there memory enough? Try --workers 1."
ENDED = "The executor has ended before the work was done. Run it again: finished records are not done twice."

AHEAD = 2  # jobs that a worker of our own has waiting, the running one included: a dead one casts doubt on no more
FLIGHT = 1000  # jobs that another's executor has waiting: enough for hundreds of workers, and no million of futures
ANSWERS = 10  # time within which a scheduler must answer [s]


def outcomes(
    function: Callable[[Job], Result],
    jobs: Iterable[Job],
    lost: Lost[Job, Result],
    *,
    workers: int | None = None,
    executor: Executor | None = None,
) -> Iterator[tuple[int, Result]]:
    """The number of each job, and what a function makes of it, as they are ready.

    When a process dies, each job that it may have had is done alone in a new process: what ends that one, and a second,
    is lost. Another's `executor` is no process of ours: a job is lost for which it raises an error.

    Raises IdentificationError where that executor ends.

    Parameters
    ----------
    function
        A function of a module, which can be sent to processes, and which raises nothing.
    jobs
        The jobs, which are taken as they are needed.
    lost
        The result of a job that is lost, from the job and a sentence why.
    workers
        Processes of this machine; one for each processor when None, and none at all of 1.
    executor
        In place of them, any executor of `concurrent.futures`.
    """
    if executor is not None:
        yield from _by(executor, function, jobs, lost)
        return
    count = (os.cpu_count() or 1) if workers is None else workers
    if count <= 1:
        yield from ((number, function(job)) for number, job in enumerate(jobs))
    else:
        yield from _in_processes(function, jobs, lost, count)


def _in_processes(
    function: Callable[[Job], Result], jobs: Iterable[Job], lost: Lost[Job, Result], workers: int
) -> Iterator[tuple[int, Result]]:
    from concurrent.futures import BrokenExecutor

    left, sent = iter(enumerate(jobs)), {}
    while True:
        try:
            with _pool(workers) as pool:
                for future in _done(pool, function, left, sent, AHEAD * workers):
                    result = future.result()
                    yield sent.pop(future)[0], result
        except BrokenExecutor:
            doubtful = list(sent.items())
            sent.clear()
        else:
            return
        for future, (number, job) in doubtful:
            unbroken = future.done() and not future.cancelled() and future.exception() is None
            yield number, future.result() if unbroken else _alone(function, job, lost)


def _alone(function: Callable[[Job], Result], job: Job, lost: Lost[Job, Result]) -> Result:
    """The result of a job in a process of its own; in a second one, where the first dies of it."""
    from concurrent.futures import BrokenExecutor

    for _ in range(2):
        with suppress(BrokenExecutor), _pool(1) as pool:
            return pool.submit(function, job).result()
    return lost(job, DIED)


def _by(
    executor: Executor, function: Callable[[Job], Result], jobs: Iterable[Job], lost: Lost[Job, Result]
) -> Iterator[tuple[int, Result]]:
    """The results by another's executor."""
    from concurrent.futures import BrokenExecutor

    sent: dict[Future[Any], tuple[int, Any]] = {}
    try:
        for future in _done(executor, function, iter(enumerate(jobs)), sent, FLIGHT):
            number, job = sent.pop(future)
            try:
                result: Any = future.result()
            except (BrokenExecutor, CancelledError):
                raise
            except Exception as error:  # noqa: BLE001  # a worker that was lost, or a job that could not be sent
                result = lost(job, f"The worker gave no result: {type(error).__name__}: {error}".rstrip(".") + ".")
            yield number, result
    except (BrokenExecutor, CancelledError):
        raise IdentificationError(ENDED) from None
    finally:
        for future in sent:
            future.cancel()


def _done(
    executor: Executor,
    function: Callable[[Any], Any],
    left: Iterator[tuple[int, Any]],
    sent: dict[Future[Any], tuple[int, Any]],
    most: int,
) -> Iterator[Future[Any]]:
    """Futures as they end, `most` of them under way; who asks for the next has taken the last out of `sent`."""
    from concurrent.futures import FIRST_COMPLETED, wait
    from itertools import islice

    while True:
        for number, job in islice(left, most - len(sent)):
            # Kept first: a pool that breaks here must not lose the job.
            lost: Future[Any] = Future()
            sent[lost] = (number, job)
            sent[executor.submit(function, job)] = sent.pop(lost)
        if not sent:
            return
        yield from wait(sent, return_when=FIRST_COMPLETED).done


@contextmanager
def _pool(workers: int) -> Iterator[Executor]:
    """Fresh processes: a fork of one with threads may hang."""
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begin() -> None:
    """Leave Ctrl-C to the process that began this one, and end with it, however that ends."""
    import signal
    from multiprocessing import parent_process
    from threading import Thread

    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def follow() -> None:
        parent = parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    Thread(target=follow, daemon=True).start()


@contextmanager
def scheduled(address: str, *, of: str = "scheduled", argument: str = "address") -> Iterator[Executor]:
    """The executor of a scheduler of dask, at an `address` such as "tcp://head:8786".

    Its workers must have floquid, and see the files by the same names. Raises InputError, in the name of the callable
    `of` and its `argument`, where no scheduler answers within 10 s, and where dask is not installed.
    """
    import logging

    distributed = load_package("distributed", of, extra="fleet")
    for name in [own for own in logging.root.manager.loggerDict if own.partition(".")[0] in ("distributed", "tornado")]:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # one message of ours says it
    place = address if "://" in address else f"tcp://{address}"
    try:
        distributed.comm.get_address_host_port(place, strict=True)  # or the client would try for half a minute
        client = distributed.Client(place, timeout=ANSWERS, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        words = str(error).split("\n", maxsplit=1)[0].rstrip(".") or type(error).__name__
        must, got = "be the address of a dask scheduler that answers", f"is {address!r}: {words}"
        raise input_error(argument, of, must, got, "Start one with `dask scheduler`; it prints its address.") from None
    with client:
        yield client.get_executor()


def time_left(done: int, total: int, seconds: float) -> str:
    """Words on the time left where `done` parts of a `total` took `seconds`; empty below a second."""
    left = seconds / max(done, 1) * (total - done)
    for size, name in ((3600.0, "h"), (60.0, "min")):
        if left >= 2.0 * size:
            return f", about {left / size:.0f} {name} left"
    return f", about {left:.0f} s left" if left >= 1.0 else ""
