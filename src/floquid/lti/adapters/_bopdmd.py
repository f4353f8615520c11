"""PyDMD's optimized dynamic mode decomposition as an identifier."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import ModuleType
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from floquid.lti._identifier import AbstractIdentifier, given_order
from floquid.lti._poles import FASTEST
from floquid.lti._types import ModalModel, TimeResponses
from floquid.lti.adapters._peer import Components, components, delayed, fitted, load, paired, quiet

LARGEST = 600.0
"""The logarithm of the largest number that a mode may grow to."""


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class BOPDMD(AbstractIdentifier):
    r"""Optimized dynamic mode decomposition by PyDMD: variable projection on the leading principal components.

    .. math:: \min_{\alpha, B} \sum_k \big\| y_k - B^T e^{\alpha k} \big\|^2

    (Askham and Kutz 2018, "Variable projection methods for an optimized dynamic mode decomposition", SIAM J. Appl. Dyn.
    Syst. 17; the package is that of Ichinaga et al. 2024.) What is given to it: responses over their noise, inputs
    stacked as outputs and cut to the shortest, as their first `order` principal components. It starts from PyDMD's DMD
    of delayed copies: its own start, by the trapezoidal rule, is wrong for poles far up in the band. Its constraint
    to conjugate pairs rounds to single precision and cannot keep two real poles, so that of `paired` is passed.

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

    def extract(
        self, state: Components, order: int | None = None, *, report: Callable[[str], None] = lambda _: None
    ) -> ModalModel:
        """The model of `order` poles, from the components in `state`; `report` is told of the start."""
        wanted = given_order(order, self, state.data)
        report(f"PyDMD: {wanted} poles from those of DMD")
        return self._fitted(state, self._start(state, wanted), wanted)

    def refine(self, state: Components, model: ModalModel) -> ModalModel:
        """The fit to `state` started from the poles of `model`."""
        return self._fitted(state, np.log(model.multipliers), model.order)

    def _start(self, state: Components, order: int) -> NDArray[np.complex128]:
        """The logarithms of DMD's eigenvalues (at most `order`,)."""
        values = state.first(order)
        delays = min(max(self.delays, -(-2 * order // len(values))), max(1, state.samples // 2))
        with quiet():
            found = _pydmd().DMD(svd_rank=order).fit(delayed(values, delays)).eigs
            logs: NDArray[np.complex128] = np.log(np.asarray(found, dtype=np.complex128))
        return np.clip(np.nan_to_num(logs.real, nan=FASTEST[0]), *FASTEST) + 1j * np.nan_to_num(logs.imag)

    def _fitted(self, state: Components, start: NDArray[np.complex128], order: int) -> ModalModel:
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


def _within(samples: int) -> Callable[[NDArray[np.complex128]], NDArray[np.complex128]]:
    """The constraint on the eigenvalues of a fit to so many samples.

    Conjugates are paired, and growth stays below what overflows: on infinite numbers LAPACK does not come back.
    """
    most = min(FASTEST[1], LARGEST / samples)

    def constrained(alpha: NDArray[np.complex128]) -> NDArray[np.complex128]:
        if not np.isfinite(alpha).all():
            raise np.linalg.LinAlgError("an eigenvalue is not finite")
        pairs = paired(np.asarray(alpha, dtype=np.complex128))
        return np.clip(pairs.real, FASTEST[0], most) + 1j * pairs.imag

    return constrained


def _pydmd() -> ModuleType:
    return load("pydmd", package="pydmd", needed_by="BOPDMD")
