"""Other people's packages: how they are loaded and run, what goes into them, how what comes out is made a model."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from importlib import import_module
from types import ModuleType

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.errors import InputError
from floquid.lti._exponentials import fit_residues
from floquid.lti._factor import Factor, factors
from floquid.lti._identifier import reached
from floquid.lti._poles import PoleSet
from floquid.lti._removal import strongest
from floquid.lti._types import ModalModel, TimeResponses


def load(module: str, *, package: str, needed_by: str) -> ModuleType:
    """The module of a package that may not be installed: an `InputError` then.

    Importing one of these packages warns of its own affairs and even sets numpy's handling of floating-point errors;
    the latter is put back.
    """
    try:
        with warnings.catch_warnings(), np.errstate():
            warnings.simplefilter("ignore")
            return import_module(module)
    except ImportError as error:
        message = f"`{needed_by}` works with the package {package}, which cannot be imported ({error})."
        raise InputError(f"{message}\n  Install it: pip install {package}") from None


@contextmanager
def quiet(logger: str = "") -> Iterator[None]:
    """Within it, warnings, progress bars, prints and the log up to warnings of `logger` are not shown."""
    log = logging.getLogger(logger) if logger else None
    level = log.level if log else 0
    try:
        if log:
            log.setLevel(logging.ERROR)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                yield
    finally:
        if log:
            log.setLevel(level)


@dataclass(frozen=True, slots=True)
class Components:
    """Responses, and the principal components of them all over their noise (components, samples), strongest first."""

    data: TimeResponses
    values: Floats

    @property
    def samples(self) -> int:
        """The number of samples that all inputs have."""
        return self.values.shape[1]

    def first(self, order: int) -> Floats:
        """The components that `order` modes can fill (at most `order`, samples); the rest is noise."""
        return self.values[:order]


def components(data: TimeResponses) -> Components:
    """Principal components of the inputs, stacked as outputs and cut to the shortest; equal white noise stays so."""
    block = factors(data, int(data.lengths.min()))[0]
    directions, strengths, _ = np.linalg.svd(block.values, full_matrices=False)
    return Components(data, (directions * strengths).T)


def delayed(values: Floats, delays: int) -> Floats:
    """The Hankel matrix (delays * components, samples - delays + 1) of copies, each a sample later."""
    windows = np.lib.stride_tricks.sliding_window_view(values, values.shape[1] - delays + 1, axis=1)
    return windows.transpose(1, 0, 2).reshape(delays * len(values), -1)


def kept(multipliers: Complexes, state: Components, order: int) -> Complexes:
    """The `order` poles of many that the data can least do without; conjugates go together."""
    values = state.first(order)
    block = Factor.of(np.ascontiguousarray(values.T), len(values))
    return strongest(PoleSet.from_multipliers(usable(multipliers)).plausible(), [block], order).multipliers()


def usable(multipliers: Complexes) -> Complexes:
    """Those that are numbers and not zero."""
    return multipliers[np.isfinite(multipliers) & (multipliers != 0)]


def fitted(multipliers: Complexes, state: Components, order: int) -> ModalModel:
    """The model of the poles found where `order` of them were asked for."""
    model = fit_residues(usable(multipliers), state.data)
    return replace(model, outcome=reached(order, model.order))


def paired(logs: Complexes) -> Complexes:
    """Logarithms of multipliers (modes,) moved as little as need be for each to have its conjugate, or be real."""
    angles = np.mod(logs.imag + np.pi, 2.0 * np.pi) - np.pi
    wrapped = logs.real + 1j * angles
    difference: Complexes = np.subtract.outer(wrapped, wrapped.conj())
    gap = np.abs(difference.real + 1j * (np.mod(difference.imag + np.pi, 2.0 * np.pi) - np.pi))
    out = np.array(wrapped)
    free = np.ones(len(logs), dtype=bool)
    for flat in np.argsort(gap, axis=None, kind="stable"):
        i, j = divmod(int(flat), len(logs))
        if not (free[i] and free[j]):
            continue
        if i == j:
            out[i] = wrapped[i].real + (1j * np.pi if abs(angles[i]) > 0.5 * np.pi else 0.0)
        else:
            upper = 0.5 * (abs(angles[i]) + abs(angles[j]))
            mean = 0.5 * (wrapped[i].real + wrapped[j].real)
            first = 1.0 if angles[i] >= angles[j] else -1.0
            out[i], out[j] = mean + 1j * first * upper, mean - 1j * first * upper
        free[[i, j]] = False
    return out
