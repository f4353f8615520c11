"""One case identified within a limit of time, its linearisations counted, and judged by its truth."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib import import_module
from types import FrameType

import numpy as np
from benchmarks.chain.case import Case, wrapped
from numpy.typing import NDArray

import floquid
from floquid import FloquidError, PeriodicModel

WITHIN = 4.0
"""Deviations within which an exponent is right."""

ROUNDING = 1e-9
"""The share of the fundamental that an exponent may be off beside its deviations."""

NEARLY = 1e-6
"""The share of the fundamental within which no exponent is called false."""

SAME = 1e-12
"""The relative difference below which a period is the one that was given."""


LOST = 1e9
"""What stands for an infinite number of deviations."""


class OutOfTime(BaseException):
    """The limit of time is over; no `except Exception` on the way may swallow it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What came of one case and seed; deviations are those that the model states.

    `outcome` is "refused", "no answer" (out of time), "failed" (any other error), "mended" (with another period than
    the one given) or "believed". `right` says that every must-find was found and no confident exponent is false.
    `pulls` are the errors of all must-finds over their deviations, the larger of both parts, at most `LOST`;
    `ratios` those over the Cramér-Rao bound, both parts.
    """

    record: str
    seed: int
    outcome: str
    message: str
    seconds: float
    linearisations: int
    must: int
    found: int
    sure: int
    """Those found that are confident, too."""
    pulls: tuple[float, ...]
    ratios: tuple[float, ...]
    worst: float
    """The largest error of a confident exponent that is not false, or of a must-find found, in deviations."""
    false: int
    order: int
    true: int

    @property
    def right(self) -> bool:
        """Whether every must-find was found and no confident exponent is false."""
        return self.outcome in ("believed", "mended") and self.found == self.must and not self.false

    def as_json(self) -> dict:
        """The row with what follows from it."""
        return {**asdict(self), "right": self.right}


class Counter:
    """Counts calls."""

    def __init__(self) -> None:
        self.calls = 0


@contextmanager
def counted(name: str = "eliminated", module: str = "floquid.periodic.least_squares._solver") -> Iterator[Counter]:
    """Counts the calls of a function wherever floquid's modules hold it; none are counted where it is not there."""
    counter = Counter()
    try:
        original = getattr(import_module(module), name)
    except (ImportError, AttributeError):
        yield counter
        return

    def wrapper(*arguments: object, **keywords: object) -> object:
        counter.calls += 1
        return original(*arguments, **keywords)

    def swap(old: object, new: object) -> None:
        for held in [m for key, m in sys.modules.items() if key.split(".")[0] == "floquid" and m is not None]:
            for key in [key for key, value in vars(held).items() if value is old]:
                setattr(held, key, new)

    swap(original, wrapper)
    try:
        yield counter
    finally:
        swap(wrapper, original)


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Ends what takes more than so many seconds of the processor, whatever else the machine does."""

    def end(number: int, frame: FrameType | None) -> None:
        raise OutOfTime

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def judged(name: str, case: Case, seed: int, limit: float) -> Row:
    """The row of one case: `identify` as a user would call it, with validation."""
    model, outcome, message = None, "believed", ""
    with counted() as counter:
        begin = time.process_time()
        try:
            with limited(limit):
                model = floquid.identify(list(case.records), **case.options).model
        except OutOfTime:
            outcome, message = "no answer", f"out of time after {limit:g} s"
        except FloquidError as error:
            outcome, message = "refused", str(error).splitlines()[0]
        except Exception as error:  # noqa: BLE001  # a defect is a row of its own, not the end of the table
            outcome, message = "failed", f"{type(error).__name__}: {error}".splitlines()[0]
        seconds = time.process_time() - begin
    if model is not None and case.declared is not None and abs(model.period / case.declared - 1.0) > SAME:
        outcome = "mended"
    found = {"found": 0, "sure": 0, "pulls": (), "ratios": (), "worst": 0.0, "false": 0, "order": 0}
    return Row(
        record=name,
        seed=seed,
        outcome=outcome,
        message=message,
        seconds=seconds,
        linearisations=counter.calls,
        must=int(case.must.sum()),
        true=len(case.exponents),
        **(found if model is None else compared(case, model)),
    )


def compared(case: Case, model: PeriodicModel) -> dict:
    """What a model says of the case, over its own deviations."""
    from scipy.optimize import linear_sum_assignment

    std = model.exponent_std
    std = np.full(model.order, complex(np.nan, np.nan)) if std is None else np.asarray(std)
    gaps = np.subtract.outer(case.exponents, model.exponents)
    gaps = gaps.real + 1j * wrapped(gaps.imag, model.fundamental)
    slack = np.zeros(len(gaps), complex) if case.slack is None else case.slack
    beside = slack[:, None] + (1.0 + 1.0j) * ROUNDING * model.fundamental
    pulls = np.maximum(_over(gaps.real, std.real, beside.real), _over(gaps.imag, std.imag, beside.imag))
    true, estimated = linear_sum_assignment(np.abs(gaps))
    own = np.full(len(case.exponents), np.inf)
    own[true] = pulls[true, estimated]
    confident = np.maximum(std.real, std.imag) < case.sure * model.fundamental
    sure = np.zeros(len(case.exponents), bool)
    sure[true] = confident[estimated]
    found = case.must & (own <= WITHIN)
    nearest = pulls.min(axis=0)
    false = confident & (nearest > WITHIN) & (np.abs(gaps).min(axis=0) > NEARLY * model.fundamental)
    ratios = np.zeros(0)
    if case.bound is not None:
        errors = np.full(len(case.exponents), complex(np.nan, np.nan))
        errors[true] = gaps[true, estimated]
        parts = [(errors.real, case.bound.real), (errors.imag, case.bound.imag)]
        ratios = np.concatenate([np.abs(error[case.must & (b > 0)]) / b[case.must & (b > 0)] for error, b in parts])
    return {
        "found": int(found.sum()),
        "sure": int((found & sure).sum()),
        "pulls": tuple(float(min(x, LOST)) for x in own[case.must]),
        "ratios": tuple(float(x) for x in ratios),
        "worst": float(max([*own[found], *nearest[confident & ~false], 0.0])),
        "false": int(false.sum()),
        "order": int(model.order),
    }


def _over(errors: NDArray[np.float64], std: NDArray[np.float64], beside: NDArray[np.float64]) -> NDArray[np.float64]:
    """Errors beyond those allowed, over deviations; infinite where there are none (true, estimated)."""
    left = np.maximum(np.abs(errors) - beside, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(left > 0.0, np.nan_to_num(left / std, nan=np.inf, posinf=np.inf), 0.0)
