"""Identification of a record larger than memory: two or three sweeps over it, and residues on the disk."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryFile
from typing import BinaryIO

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import an_instance, input_error, positive, wrong_value
from floquid._version import __version__
from floquid.core import LazyRecord
from floquid.errors import IdentificationError
from floquid.findings import failure, texts
from floquid.fit import HALF_DIGITS, SLOW, chi2_limit
from floquid.io import LARGE_FORMAT, as_path, atomic_path
from floquid.large._modes import OF, Basis, Modes, Plan, Sums, sketched, summed
from floquid.large._part import FEWEST, Verdict, judged, part_of
from floquid.large._result import LARGE_VERSION, LargeResult, opened
from floquid.lti import ERA, MaximumLikelihood, Outcome, TimeResponses
from floquid.periodic import strongest_branch
from floquid.search import SECONDS

COLUMNS = 64  # of the sketch: enough for some 30 modes
SMALL = 0.1  # deviations: the error of a step is its square, so a step of that needs no other
SWEEPS = 4  # of exact sums at most: a start from a good sketch needs one or two
SEARCHED = 8192  # cycles in which the order is looked for: the search takes time with their square
LONGER = (
    4  # times as many cycles in which the poles are fitted next: they are known to a small part of a turn over these
)
COPIES = 80.0  # bytes of a sample of the part that is checked: the checks take up to nine times the data
PROGRAM = 2.0e8  # bytes that floquid takes without any record, with what it imports
UNITS = {"": 1.0, "K": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}


def identify_large(
    record: LazyRecord,
    out: str | PathLike[str],
    *,
    memory: float | str = "1GB",
    order: int | None = None,
    false_alarm: float = 1e-9,
    seconds: float = SECONDS,
    report: Callable[[str], None] = lambda _: None,
) -> LargeResult:
    r"""Identify the Floquet exponents of a free response that is read in blocks, with residues on the disk.

    .. math:: \min_{\lambda, R} \sum_{c} \frac{1}{\sigma_c^2} \sum_{k,n}
              \Big(y_c(\tau_k + nT) - a_{c,k} - \sum_r R_{r,c,k}\, e^{\lambda_r n T}\Big)^2

    The first sweep makes a sketch of 64 columns, in which maximum likelihood finds the order and first exponents. The
    second sums the products of all responses with a basis at these: one Gauss-Newton step, the noise of each channel,
    residues and deviations. Further sweeps follow where that step was not small. What repeats in each period, an
    offset or a forced response of the period, is fitted beside the modes.

    Residues are free at each phase, and noise counts as white. A part of the record goes through all
    checks of `identify`, and has the verdict. There are no A(t), whitening, gaps, clocks other than a constant period
    of whole samples, several hits, and forced responses of other periods.

    Parameters
    ----------
    record
        The record, by custom of `read(..., lazy=True, period=...)`.
    out
        The file of the result, by custom `result.h5`; it appears whole or not at all.
    memory
        Bytes that may be used in all, or a text such as "1GB".
    order
        The number of poles, conjugates one by one; None finds it.
    false_alarm
        The probability that noise passes for a mode.
    seconds
        Processor time of the search for modes in the sketch [s], after which it goes on with those found, and the
        result fails.
    report
        Is told what is being done, with the time left of each sweep.

    Returns
    -------
    LargeResult
        Exponents with deviations, the noise of each channel, the verdict, and residues that are read when they are
        asked for; `.model` is the periodic model.

    Raises
    ------
    InputError
        The record misses samples or has no whole number of samples a period, the memory is too small, the seconds are
        none, or the file cannot be written.
    IdentificationError
        No mode rises above the noise, or the order cannot be told.
    """
    seconds = positive(seconds, "seconds", OF, unit="s")
    plan = planned(record, memory_of(memory))
    path = as_path(out, of=OF, argument="out")
    sketch = sketched(plan, report)
    report("searching the sketch for modes")
    modes, late = _found(sketch, plan.clock.period, order, false_alarm, seconds)
    del sketch
    with atomic_path(path, of=OF, argument="out") as temporary:
        loud = _write(plan, modes, temporary, report)
        _check(plan, temporary, loud, (memory_of(memory) - PROGRAM) / COPIES, false_alarm, late, report)
    return opened(path)


def memory_of(value: float | str) -> float:
    """Bytes of a number, or of a text such as 500MB; InputError where it is neither."""
    match = re.fullmatch(r"\s*([\d.]+)\s*([KMGT]?)i?B?\s*", str(value), re.IGNORECASE)
    try:
        size = float(match[1]) * UNITS[match[2].upper()] if match else float(value)
    except (TypeError, ValueError):
        size = 0.0
    if size <= 0.0:
        raise wrong_value("memory", OF, "be bytes, or a text such as 1GB", value)
    return size


def planned(record: LazyRecord, memory: float) -> Plan:
    """Cycles and blocks of a record within a memory [bytes]; InputError where it cannot be cut, or has no room."""
    an_instance(record, LazyRecord, "record", OF, "Take `read(path, lazy=True)`; `identify` takes a record in memory.")
    if record.clock is None:
        raise input_error("record", OF, "have a period", "has none", "Pass `period=` to `read`.")
    exact = record.clock.period * record.sample_rate
    phases, cycles = round(exact), int(record.n_samples / exact)
    if phases < 1 or abs(exact - phases) * cycles > HALF_DIGITS:
        must, got = "have whole samples a period", f"has {exact:.8g}"
        raise input_error("record", OF, must, got, "Identify a part that fits into memory with `identify`.")
    most = 4 * COLUMNS
    if cycles < most:
        raise input_error("record", OF, f"have {most} periods or more", f"has {cycles}", "Identify it with `identify`.")
    # The sketch with the copies that the search makes of it, then a block that is read, one that waits and one in work.
    left = memory - PROGRAM
    columns = min(COLUMNS, int(0.5 * left / (SKETCH * cycles)))
    block = min(0.1 * left, BLOCK)
    if columns < COLUMNS // 4 or block < 8.0 * phases:
        least = PROGRAM + max(0.5 * COLUMNS * SKETCH * cycles, 80.0 * phases)
        must = f"be at least {least / 1e6:.0f} MB for {cycles} periods of {phases} samples"
        raise input_error("memory", OF, must, f"is {memory / 1e6:.0f} MB", "Allow more.")
    return Plan(record, record.clock, phases, cycles, block, columns)


SKETCH = 40.0  # bytes of a number of the sketch, with the copies that the search makes
BLOCK = 2.0**26  # bytes of a block at most: larger ones are read no faster


def _found(
    sketch: Floats, period: float, order: int | None, false_alarm: float, seconds: float
) -> tuple[Modes, tuple[str, ...]]:
    """The modes of a sketch by maximum likelihood, its noise being what generous poles leave, and then these."""
    era, search, cycles = ERA(), MaximumLikelihood(false_alarm=false_alarm, seconds=seconds), sketch.shape[1]
    raw = TimeResponses(values=(sketch - sketch.mean(axis=1, keepdims=True))[:, None], dt=period)
    generous = Modes.of(era.extract(era.prepare(raw), COLUMNS // 2).multipliers)
    apart = generous.picked(np.abs(generous.logs) * cycles > SLOW)
    system = np.concatenate([np.ones((cycles, 1)), apart.columns(cycles)], axis=1)
    system /= np.linalg.norm(system, axis=0)
    amplitudes, ones = np.linalg.lstsq(system, sketch.T)[0], system[:, :1]
    std = np.sqrt(np.mean((sketch - (system @ amplitudes).T) ** 2, axis=1, keepdims=True))
    values = (sketch - amplitudes[0][:, None] * ones.T)[:, None]
    found, length = None, min(cycles, SEARCHED)
    while True:
        part = values[:, :, :length]
        noise = np.maximum(std, np.finfo(float).eps * np.abs(part).max(axis=2))
        state = search.prepare(TimeResponses(values=part, dt=period, taken=ones[:length], noise=noise))
        last = found is not None and length == cycles
        found = search.extract(state, order) if found is None else search.refine(state, found)
        late = () if found.outcome is not Outcome.OUT_OF_TIME else texts([failure(found.outcome.value)])
        if found.outcome is not Outcome.SUCCESS and not late:
            raise IdentificationError(f"{failure(found.outcome.value).clause}.")
        assert found.residual_std is not None
        std = found.residual_std
        if last:
            modes = Modes.of(found.multipliers)
            return modes if order is not None else _risen(modes, sketch / std, false_alarm), late
        length = min(cycles, LONGER * length)


def _risen(modes: Modes, responses: Floats, false_alarm: float) -> Modes:
    """The modes that rise above the noise of responses (columns, cycles) in units of it, with constants beside them.

    What an estimate of the constants has wrong is left in each response, and passes for a slow real mode.
    """
    while len(modes.logs):
        basis = Basis.of(modes, responses.shape[1])
        sums = basis.columns.T @ responses.T
        limits = [chi2_limit(len(responses) * (1 if real else 2), false_alarm) for real in modes.real]
        share = basis.rises(sums @ sums.T) / limits
        if share.min() > 1.0:
            return modes
        modes = modes.picked(np.arange(len(share)) != share.argmin())
    raise IdentificationError(f"{failure(Outcome.NO_MODE.value).clause}.")


def _write(plan: Plan, modes: Modes, path: Path, report: Callable[[str], None]) -> Floats:
    """Sweeps of exact sums until the step is small, and the result written to a path."""
    # A plain file for the sums: where a disk is full, HDF5 does not end with an error that can be caught.
    with TemporaryFile(dir=path.parent) as kept:
        number = 2
        while True:
            basis = Basis.of(modes, plan.cycles)
            sums = summed(plan, basis, kept, number, report)
            step, covariance = basis.step(sums.gram, plan.responses)
            if not np.isfinite(step).all() or np.abs(step).max() > 1.0:
                raise IdentificationError(
                    "The exponents of the sketch are none of the record: the step diverges, as where the channels "
                    "drift. `identify` says more of a part of it that fits into memory."
                )
            modes, size = modes.moved(step), float(np.max(np.abs(step) / np.sqrt(np.diag(covariance))))
            if size < SMALL or number > SWEEPS:
                break
            number += 1
        report("writing the residues")
        _reserve(path, 16 * len(modes.logs) * plan.responses)
        return _put(plan, basis, modes, sums, covariance, {"sweeps": number, "last_step": size}, kept, path)


def _check(
    plan: Plan,
    path: Path,
    loud: Floats,
    room: float,
    false_alarm: float,
    late: tuple[str, ...],
    report: Callable[[str], None],
) -> None:
    """Identify a part of the record, and write what it says of the result at a path into it."""
    import h5py

    found = opened(path)
    verdict = Verdict(reasons=(f"There is no memory to check {FEWEST} periods of a channel. Allow more.",))
    if room >= FEWEST * plan.phases:
        rows, part = part_of(plan, loud, room)
        both = found.exponents, found.exponent_std
        verdict = judged(part, found.modes, *both, found.noise[rows], plan.phases, false_alarm, report)
    if late:
        verdict = replace(verdict, passed=False, failed=True, reasons=(*late, *verdict.reasons))
    with h5py.File(path, "r+") as file:
        passed = -1 if verdict.passed is None else int(verdict.passed)
        file.attrs.update({"passed": passed, "failed": int(verdict.failed)})
        file.attrs.update({"part_channels": verdict.channels, "part_cycles": verdict.cycles})
        file["reasons"] = np.array(verdict.reasons, dtype=h5py.string_dtype())


def _reserve(path: Path, size: int) -> None:
    """Raise OSError where the disk has no room for twice the `size` of the residues [bytes]."""
    room = 2 * size + 2**20
    with TemporaryFile(dir=path.parent) as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, room)
        elif shutil.disk_usage(path.parent).free < room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _put(
    plan: Plan,
    basis: Basis,
    modes: Modes,
    sums: Sums,
    covariance: Floats,
    more: Mapping[str, float],
    kept: BinaryIO,
    path: Path,
) -> Floats:
    """Write the result: exponents on the branch that carries most energy, and residues channel by channel."""
    import h5py

    record, clock = plan.record, plan.clock
    modes, exponents, covariance, loud = _physical(plan, basis, modes, sums, covariance, kept)
    inverse = basis.pseudoinverse(modes)
    shape = (record.n_channels, len(modes.logs), plan.phases)
    with h5py.File(path, "w") as file:
        target = file.create_dataset("residues", shape, np.complex128, chunks=(1, *shape[1:]))
        for rows, found in _residues(plan, inverse[modes.places], kept):
            target[rows] = found
        file.attrs.update(
            {"format": LARGE_FORMAT, "version": LARGE_VERSION, "floquid": __version__, "source": record.source}
        )
        file.attrs.update({"period": clock.period, "sample_rate": record.sample_rate, "start": record.start})
        file.attrs.update({"origin": clock.origin, "phases": plan.phases, "cycles": plan.cycles, **more})
        file["exponents"], file["real"] = exponents, np.array(modes.real)
        file["exponent_std"] = modes.deviations(covariance) / clock.period
        file["covariance"], file["noise"] = covariance / clock.period**2, sums.noise
        file["residue_spread"] = inverse @ inverse.conj().T
        file["residue_slope"] = basis.slope(modes, inverse)
        for name in ("name", "unit"):
            words = [getattr(channel, name) for channel in record.channels]
            file[f"channels/{name}"] = np.array(words, dtype=h5py.string_dtype())
    return loud


def _residues(plan: Plan, inverse: Complexes, kept: BinaryIO) -> Iterator[tuple[slice, Complexes]]:
    """Residues (channels, modes, phases) of some channels after the other, from their sums in a file."""
    width = inverse.shape[1]
    step = max(1, int(BLOCK // (8 * width * plan.phases)))
    kept.seek(0)
    for first in range(0, plan.record.n_channels, step):
        count = min(step, plan.record.n_channels - first)
        own = np.frombuffer(kept.read(8 * count * width * plan.phases)).reshape(count, width, plan.phases)
        yield slice(first, first + count), inverse @ own


def _physical(
    plan: Plan, basis: Basis, modes: Modes, sums: Sums, covariance: Floats, kept: BinaryIO
) -> tuple[Modes, Complexes, Floats, Floats]:
    """The modes of positive frequency on the branch whose zeroth harmonic is strongest, exponents and covariance."""
    phases, loud = plan.phases, np.zeros((plan.record.n_channels, len(modes.logs)))
    energy, decay = np.zeros((len(modes.logs), phases)), np.exp(-np.outer(modes.logs, np.arange(phases) / phases))
    for rows, found in _residues(plan, basis.pseudoinverse(modes)[modes.places], kept):
        scaled = found / sums.noise[rows, None, None]
        energy += np.sum(np.abs(np.fft.fft(scaled * decay, axis=2)) ** 2, axis=0)
        loud[rows] = np.sum(np.abs(scaled) ** 2, axis=2)
    turns = np.arange(-(phases // 2), phases // 2 + 1)
    principal = modes.logs.imag / (2.0 * np.pi)
    of = [
        turns[strongest_branch(own[turns % phases], angle + turns, phases)]
        for own, angle in zip(energy, principal, strict=True)
    ]
    logs = modes.logs + 2j * np.pi * np.array(of)
    flipped = (logs.imag < 0.0) & ~np.array(modes.real)
    sign = np.array(
        [s for flip, real in zip(flipped, modes.real, strict=True) for s in ((1,) if real else (1, 1 - 2 * flip))]
    )
    exponents = Modes(logs, modes.real).mirrored(flipped).logs / plan.clock.period
    return modes.mirrored(flipped), exponents, covariance * np.outer(sign, sign), loud
