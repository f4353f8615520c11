"""Who takes part. Each of other people's is told the order and has the settings that do best on the paper's record.

They are given responses that are already divided by their noise; without that most of them lose accuracy.
"""

from __future__ import annotations

import inspect
import io
import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

import floquid.lti
from floquid.lti import AbstractIdentifier, TimeResponses

NOTHING = "nothing"


@dataclass(frozen=True)
class Entry:
    """A name, what its user had to choose, and how to run it: responses and an order to multipliers."""

    name: str
    chosen: str
    run: Callable[[TimeResponses, int], NDArray[np.complex128]]
    ours: bool = False
    parts: Callable[[TimeResponses, int], Callable[[], Any]] | None = None
    """What is left to do once the data are prepared: a function to be timed by itself."""


def entries() -> list[Entry]:
    """Ours, then those of others whose packages are there."""
    found = [Entry(name, chosen, _silenced(run)) for module, name, chosen, run in PEERS if find_spec(module)]
    return [*_ours(), *found]


def _ours() -> Iterator[Entry]:
    """Every identifier that `floquid.lti` exports: left to find the order where it can, and told it."""
    public = [getattr(floquid.lti, name) for name in floquid.lti.__all__]
    kinds = [
        k for k in public if inspect.isclass(k) and issubclass(k, AbstractIdentifier) and not inspect.isabstract(k)
    ]
    for kind in sorted(kinds, key=lambda k: (k is not floquid.lti.MaximumLikelihood, k.__name__)):
        identifier = kind()
        if kind.decides:
            yield _of(identifier, told=False)
        yield _of(identifier, told=True)


def _of(identifier: AbstractIdentifier, *, told: bool) -> Entry:
    def run(data: TimeResponses, order: int) -> NDArray[np.complex128]:
        return identifier.extract(identifier.prepare(data), order if told else None).multipliers

    def parts(data: TimeResponses, order: int) -> Callable[[], Any]:
        state = identifier.prepare(data)
        return lambda: identifier.extract(state, order if told else None)

    words = "the order" if told else NOTHING
    name = f"{type(identifier).__name__} (order {'given' if told else 'unknown'})"
    return Entry(name, words, run, ours=True, parts=parts)


def _silenced(run: Callable[[NDArray, int], NDArray]) -> Callable[[TimeResponses, int], NDArray[np.complex128]]:
    """The run on one input's responses over their noise, progress bars and warnings kept quiet."""

    def quiet(data: TimeResponses, order: int) -> NDArray[np.complex128]:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            with redirect_stderr(io.StringIO()), redirect_stdout(io.StringIO()):
                return np.asarray(run(_over_noise(data), order), dtype=np.complex128).ravel()

    return quiet


_LAST: list[tuple[TimeResponses, NDArray[np.float64]]] = []


def _over_noise(data: TimeResponses) -> NDArray[np.float64]:
    """The responses over their noise (outputs, samples), made once for each data: a present to those of others."""
    if not _LAST or _LAST[0][0] is not data:
        _LAST[:] = [(data, data.values[:, 0] / data.noise)]
    return _LAST[0][1]


def principal(values: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """The first principal components (number, samples), by the smaller of the two Gram matrices."""
    if len(values) <= values.shape[1]:
        directions = np.linalg.eigh(values @ values.T)[1]
        return directions[:, ::-1][:, :number].T @ values
    squares, shapes = np.linalg.eigh(values.T @ values)
    return (np.sqrt(np.maximum(squares, 0.0)) * shapes).T[::-1][:number]


def bopdmd(values: NDArray, order: int, start: NDArray | None = None) -> NDArray:
    """Optimized DMD of the first 400 samples, from its own start.

    Growth is limited: with large eigenvalues it comes to infinite numbers, and LAPACK may never return.
    """
    from pydmd import BOPDMD

    values = values[:, :400]
    fit = BOPDMD(
        svd_rank=order,
        num_trials=0,
        init_alpha=start,
        eig_constraints={"limited"},
        real_eig_limit=1.0,
        varpro_opts_dict={"eps_stall": 1e-9},
    )
    return np.exp(fit.fit(values, np.arange(values.shape[1], dtype=float)).eigs)


def bopdmd_started(values: NDArray, order: int) -> NDArray:
    """The same from the poles of DMD with delays, as our adapter starts it."""
    return bopdmd(values, order, np.log(dmd_delayed(values, order)))


def dmd(values: NDArray, order: int) -> NDArray:
    """Exact DMD of the first 200 samples."""
    from pydmd import DMD

    return DMD(svd_rank=order).fit(values[:, :200]).eigs


def dmd_delayed(values: NDArray, order: int) -> NDArray:
    """Exact DMD of delayed copies of the principal components."""
    from pydmd import DMD

    values = principal(values[:, :400], order)
    delays = min(values.shape[1] // 3, max(8, 600 // order))
    windows = np.lib.stride_tricks.sliding_window_view(values, values.shape[1] - delays + 1, axis=1)
    return DMD(svd_rank=order).fit(windows.transpose(1, 0, 2).reshape(delays * len(values), -1)).eigs


def hodmd(values: NDArray, order: int) -> NDArray:
    """Higher-order DMD of the first 300 samples with half as many delays."""
    from pydmd import HODMD

    values = values[:, :300]
    return HODMD(svd_rank=order, svd_rank_extra=order, d=values.shape[1] // 2).fit(values).eigs


def pymor_era(values: NDArray, order: int) -> NDArray:
    """ERA of pyMOR on the first 300 samples, projected onto as many directions as poles, not forced to be stable."""
    from pymor.algorithms.to_matrix import to_matrix
    from pymor.core.logger import set_log_levels
    from pymor.reductors.era import ERAReductor

    set_log_levels({"pymor": "ERROR"})
    half = min(150, values.shape[1] // 2)
    reductor = ERAReductor(values[:, : 2 * half - 1].T[:, :, None], 1.0, force_stability=False)
    return np.linalg.eigvals(to_matrix(reductor.reduce(order, num_left=min(order, len(values))).A))


def control_era(values: NDArray, order: int) -> NDArray:
    """ERA of python-control on as many principal components as poles."""
    import control

    components = principal(values, order)
    rows = min(100, components.shape[1] // 3, max(10, 600 // order))
    columns = min(200, components.shape[1] - rows - 2)
    system, _ = control.eigensys_realization(components[:, None, :], order, m=rows, n=columns)
    return np.linalg.eigvals(system.A)


def sdypy_lscf(values: NDArray, order: int) -> NDArray:
    """LSCF on as many principal components as poles; the band starts one line above zero (see `adapters`)."""
    from sdypy import EMA

    components = principal(values[:, : values.shape[1] // 2 * 2], order)
    lines = np.fft.rfft(components)
    lines = np.concatenate([lines, lines[:, -1:]], axis=1)
    frequencies = np.arange(lines.shape[1]) / components.shape[1]
    limits = {"lower": float(frequencies[1]), "upper": float(frequencies[-1])}
    model = EMA.Model(lines, frequencies, dt=1.0, pol_order_high=max(40, 3 * order // 2), **limits)
    model.get_poles("lscf", show_progress=False)
    return np.exp(model.all_poles[-1])


def pyoma_ssi(values: NDArray, order: int) -> NDArray:
    """Covariance-driven SSI on as many principal components as poles, cut off at the order."""
    ssi = _ssi()
    components = principal(values, order)
    rows = max(2, components.shape[1] // 20)
    hankel, _ = ssi.build_hank(components, components, rows, "cov")
    return np.linalg.eigvals(ssi.SSI_fast(hankel, rows, order)[1][order])


@cache
def _ssi() -> Any:
    from pyoma2.functions import ssi

    logging.getLogger("pyoma2").setLevel(logging.ERROR)
    return ssi


PEERS = [
    ("pydmd", "PyDMD BOPDMD", "the order, the cycles to look at, a limit of growth", bopdmd),
    ("pydmd", "PyDMD BOPDMD (started from DMD)", "the same, the start and its delays", bopdmd_started),
    ("pydmd", "PyDMD DMD", "the order, the cycles to look at", dmd),
    ("pydmd", "PyDMD DMD with delays", "the order, the cycles, the delays, the components", dmd_delayed),
    ("pydmd", "PyDMD HODMD", "the order, two ranks, the cycles, the delays", hodmd),
    ("pymor", "pyMOR ERA", "the order, the cycles, the directions, not to force stability", pymor_era),
    ("control", "python-control ERA", "the order, rows and columns of the Hankel matrix, the components", control_era),
    (
        "sdypy",
        "sdypy-EMA LSCF",
        "the poles, out of 80; the degree, the band (not from zero), the components",
        sdypy_lscf,
    ),
    ("pyoma2", "pyOMA2 SSI", "the order, block rows, the method, the components", pyoma_ssi),
]
"""The package to look for, the name, what was chosen, and the run."""
