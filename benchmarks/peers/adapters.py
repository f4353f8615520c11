"""Other people's identifiers (PyDMD, pyOMA2, sdypy-EMA) behind our contract.

Each needs a package of its own, which is loaded when the identifier is first used; without it the identifier refuses
its work and says what to install. All are given the responses over their noise, inputs stacked as outputs and cut to
the shortest, as their first `order` principal components, and give poles; residues are ours by least squares
(`floquid.lti.fit_residues`). None decides the order: wrap one, `MaximumLikelihood(initial=...)`, for estimates at the
statistical limit, or ask for an order.
"""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, replace
from importlib import import_module
from types import ModuleType
from typing import ClassVar, Literal, final, get_args

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import integer, wrong_value
from floquid.errors import InputError
from floquid.fit import HALF_DIGITS
from floquid.lti._exponentials import fit_residues
from floquid.lti._factor import Factor, factors
from floquid.lti._poles import FASTEST, LARGEST_GROWTH, PoleSet
from floquid.lti._significance import strongest
from floquid.lti._types import (
    AbstractIdentifier,
    ModalModel,
    Outcome,
    Report,
    TimeResponses,
    given_order,
    reached,
    silent,
)

Method = Literal["cov", "dat"]

SHARE = 0.7  # a single decay brings it in six tenths of its time constant, where the errors of this method are least


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class BOPDMD(AbstractIdentifier):
    r"""Optimized dynamic mode decomposition by PyDMD: variable projection on the leading principal components.

    .. math:: \min_{\alpha, B} \sum_k \big\| y_k - B^T e^{\alpha k} \big\|^2

    (Askham and Kutz 2018, "Variable projection methods for an optimized dynamic mode decomposition", SIAM J. Appl. Dyn.
    Syst. 17; the package is that of Ichinaga et al. 2024.) It starts from PyDMD's DMD of delayed copies: its own start,
    by the trapezoidal rule, is wrong for poles far up in the band. Its constraint to conjugate pairs rounds to single
    precision and cannot keep two real poles, so another is passed.

    Parameters
    ----------
    delays
        Copies of the components, each a sample later, for the start; more where needed to hold `order` poles.
    iterations
        The most iterations.
    """

    decides: ClassVar[bool] = False

    delays: int = 8
    iterations: int = 50

    def prepare(self, data: TimeResponses) -> Components:
        """The principal components of the responses in `data`; `InputError` where PyDMD is not installed."""
        _pydmd()
        return components(data)

    def extract(self, state: Components, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The model of `order` poles, from the components in `state`; `report` is told of the start."""
        wanted = given_order(order, self, state.data)
        report(f"PyDMD: {wanted} poles from those of DMD")
        return self._fitted(state, self._start(state, wanted), wanted)

    def refine(self, state: Components, model: ModalModel) -> ModalModel:
        """The fit to `state` started from the poles of `model`."""
        return self._fitted(state, np.log(model.multipliers), model.order)

    def _start(self, state: Components, order: int) -> Complexes:
        """The logarithms of DMD's eigenvalues (at most `order`,)."""
        values = state.first(order)
        delays = min(max(self.delays, -(-2 * order // len(values))), max(1, state.samples // 2))
        with quiet():
            found = _pydmd().DMD(svd_rank=order).fit(delayed(values, delays)).eigs
            logs: Complexes = np.log(np.asarray(found, dtype=np.complex128))
        return np.clip(np.nan_to_num(logs.real, nan=FASTEST[0]), *FASTEST) + 1j * np.nan_to_num(logs.imag)

    def _fitted(self, state: Components, start: Complexes, order: int) -> ModalModel:
        """Variable projection from `start`; time is counted in samples."""
        found = np.zeros(0, dtype=np.complex128)
        values = state.first(max(order, 1))
        # It wants at least as many responses as poles: zeros make up for missing ones and take part in nothing.
        values = np.concatenate([values, np.zeros((max(0, order - len(values)), state.samples))])
        if len(start) == order and order:
            dmd = _pydmd().BOPDMD(
                svd_rank=order,
                num_trials=0,
                init_alpha=paired(start),
                eig_constraints=_within(state.samples),
                varpro_opts_dict={"maxiter": self.iterations, "tol": 0.0},
            )
            with quiet(), suppress(np.linalg.LinAlgError, ValueError):
                found = np.exp(dmd.fit(values, np.arange(state.samples, dtype=np.float64)).eigs)
        return fitted(found, state, order)


def _within(samples: int) -> Callable[[Complexes], Complexes]:
    """The constraint on eigenvalues: conjugates paired, growth below overflow (LAPACK hangs on infinite numbers)."""
    most = min(FASTEST[1], LARGEST_GROWTH / samples)

    def constrained(alpha: Complexes) -> Complexes:
        if not np.isfinite(alpha).all():
            raise np.linalg.LinAlgError("an eigenvalue is not finite")
        pairs = paired(np.asarray(alpha, dtype=np.complex128))
        return np.clip(pairs.real, FASTEST[0], most) + 1j * pairs.imag

    return constrained


def _pydmd() -> ModuleType:
    return load("pydmd", package="pydmd", needed_by="BOPDMD")


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class PyOMA2SSI(AbstractIdentifier):
    r"""Stochastic subspace identification (SSI) by pyOMA2, of the covariance of free decays or driven by the data.

    .. math:: H = Y_f Y_p^T \approx O\, \Gamma, \qquad A = (O_{\uparrow})^+ O_{\downarrow}, \qquad
              \mu = \operatorname{eig} A

    (Peeters and De Roeck 1999; Döhler and Mevel 2013 for the fast form used.) The method is made for random excitation;
    a free decay has the same observability matrix O. The Hankel matrix H is cut off at its first `order` singular
    vectors, which is what selects the poles: no pole is spurious by construction.

    Raises InputError where the method is neither, or there are fewer than two block rows.

    Parameters
    ----------
    method
        "cov" for covariances of future and past, "dat" for the projection of one on the other.
    block_rows
        The block rows of the Hankel matrix: fewer where the responses are short, and more where needed to hold `order`
        poles. None for as many as there are samples in which `SHARE` of the energy above the noise comes: so much later
        the future must still hold what the past held.
    """

    decides: ClassVar[bool] = False

    method: Method = "cov"
    block_rows: int | None = None

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise wrong_value("method", "PyOMA2SSI", 'be "cov" or "dat"', self.method)
        if self.block_rows is not None:
            integer(self.block_rows, "block_rows", "PyOMA2SSI", at_least=2)

    def prepare(self, data: TimeResponses) -> Components:
        """The principal components of the responses in `data`; `InputError` where pyOMA2 is not installed."""
        _ssi()
        return components(data)

    def extract(self, state: Components, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The model of `order` poles, from the components in `state`; `report` is told of the block rows.

        Its outcome is `TOO_FEW_SAMPLES` where a Hankel matrix of that rank cannot be filled.
        """
        wanted = given_order(order, self, state.data)
        values = state.first(wanted)
        least = -(-wanted // len(values)) + 1
        rows = max(least, min(self.block_rows or _energetic(values), state.samples // 3))
        if state.samples - 2 * rows + 1 < wanted:
            return fit_residues(np.zeros(0), state.data, outcome=Outcome.TOO_FEW_SAMPLES)
        report(f"pyOMA2: {rows} block rows")
        ssi, found = _ssi(), np.zeros(0, dtype=np.complex128)
        with quiet("pyoma2"), suppress(np.linalg.LinAlgError):
            hankel, _ = ssi.build_hank(values, values, rows, self.method)
            _, systems, _, _ = ssi.SSI_fast(hankel, rows, wanted)
            found = np.linalg.eigvals(systems[wanted]).astype(np.complex128)
        return fitted(found, state, wanted)


def _energetic(values: Floats) -> int:
    """The samples in which `SHARE` of the energy above that of the last tenth comes."""
    energy = np.sum(values**2, axis=0)
    above = np.cumsum(energy - energy[-(len(energy) // 10 + 1) :].mean())
    return int(np.argmax(above >= SHARE * above.max())) + 1


def _ssi() -> ModuleType:
    return load("pyoma2.functions.ssi", package="pyOMA_2", needed_by="PyOMA2SSI")


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class SdypyLSCF(AbstractIdentifier):
    r"""Least-squares complex frequency domain method (LSCF) by sdypy-EMA: one denominator for all responses.

    .. math:: Y_o(z) = \frac{\sum_j b_{oj} z^{-j}}{\sum_j a_j z^{-j}}, \qquad \sum_j a_j\, z_r^{-j} = 0

    on the lines of the DFT, where a free decay of finite length is such a ratio exactly (Guillaume et al. 2003;
    Verboven 2002, section 5.3.3). It is given an even number of samples, and the lines from the first above zero on: at
    zero this code flips the sign of the damping. The denominator's degree is far above the order, so most of its poles
    are spurious. The `order` poles are kept that the data can least do without: of all poles with free residues, the
    one whose absence leaves least is taken away, again and again.

    Parameters
    ----------
    pairs
        Half the degree of the denominator, the `pol_order_high` of sdypy-EMA: less where the responses are short, and
        at least one and a half times the order.
    """

    decides: ClassVar[bool] = False

    pairs: int = 40

    def prepare(self, data: TimeResponses) -> Components:
        """The principal components of the responses in `data`; `InputError` where sdypy-EMA is not installed."""
        _ema()
        return components(data)

    def extract(self, state: Components, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The model of `order` poles, from the components in `state`; `report` is told how many there are to choose."""
        wanted = given_order(order, self, state.data)
        many = self._poles(state, wanted)
        report(f"{len(many)} poles of the denominator")
        return fitted(kept(many, state, wanted), state, wanted)

    def _poles(self, state: Components, order: int) -> Complexes:
        """The multipliers of the denominator.

        Where all roots are real, sdypy-EMA takes the real logarithm of the negative ones and has none: they are the
        positive ones of the responses with every other sample's sign changed.
        """
        values = state.first(order)[:, : state.samples - state.samples % 2]
        pairs = max(-(-order // 2), min(max(self.pairs, 3 * order // 2), state.samples // 4))
        found = _multipliers(values, pairs)
        if np.isnan(found).any():
            found = np.concatenate([found, -_multipliers(values * (-1.0) ** np.arange(values.shape[1]), pairs)])
        return found


def _multipliers(values: Floats, pairs: int) -> Complexes:
    """The roots of the highest denominator, up to `pairs` pairs, that can be solved for; what is no number included."""
    # Without noise a denominator above the order is singular: a blow to one sample, below what any noise does, has a
    # flat spectrum, and makes it regular.
    blow = np.zeros((1, values.shape[1]))
    blow[0, values.shape[1] // 2] = HALF_DIGITS * np.linalg.norm(values)
    lines = np.fft.rfft(np.concatenate([values, blow]))
    # The model cuts off the line at its upper limit: one more is there to be cut off.
    lines = np.concatenate([lines, lines[:, -1:]], axis=1)
    frequencies = np.arange(lines.shape[1]) / values.shape[1]
    model = _ema().Model(
        lines,
        frequencies,
        dt=1.0,
        # From zero sdypy-EMA 0.31 transforms an empty slice, and gives every pole the wrong sign of the damping.
        lower=float(frequencies[1]),
        upper=float(frequencies[-1]),
        pol_order_high=pairs,
    )
    with quiet(), suppress(np.linalg.LinAlgError):
        model.get_poles("lscf", show_progress=False)
    return np.exp(np.asarray(model.all_poles[-1] if model.all_poles else [], dtype=np.complex128))


def _ema() -> ModuleType:
    return load("sdypy.EMA", package="sdypy-EMA", needed_by="SdypyLSCF")


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
    """Select poles that are numbers and not zero."""
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


__all__ = ["BOPDMD", "PyOMA2SSI", "SdypyLSCF"]
