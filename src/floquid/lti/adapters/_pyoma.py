"""pyOMA2's stochastic subspace identification as an identifier."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import ModuleType
from typing import ClassVar, Literal, final, get_args

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, integer
from floquid.lti._identifier import AbstractIdentifier, given_order
from floquid.lti._residues import fit_residues
from floquid.lti._types import ModalModel, Outcome, TimeResponses
from floquid.lti.adapters._peer import Components, components, fitted, load, quiet

Method = Literal["cov", "dat"]

SHARE = 0.7
"""A single decay brings it in six tenths of its time constant, where the errors of this method are least."""


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class PyOMA2SSI(AbstractIdentifier):
    r"""Stochastic subspace identification (SSI) by pyOMA2, of the covariance of free decays or driven by the data.

    .. math:: H = Y_f Y_p^T \approx O\, \Gamma, \qquad A = (O_{\uparrow})^+ O_{\downarrow}, \qquad
              \mu = \operatorname{eig} A

    (Peeters and De Roeck 1999; Döhler and Mevel 2013 for the fast form used.) The method is made for random excitation;
    a free decay has the same observability matrix O. What is given to it: responses over their noise, inputs stacked as
    outputs and cut to the shortest, as their first `order` principal components. The Hankel matrix H is cut off at its
    first `order` singular vectors, which is what selects the poles: no pole is spurious by construction.

    Parameters
    ----------
    method
        "cov" for covariances of future and past, "dat" for the projection of one on the other.
    block_rows
        The block rows of the Hankel matrix: fewer where the responses are short, and more where needed to hold `order`
        poles. None for as many as there are samples in which `SHARE` of the energy above the noise comes: so much later
        the future must still hold what the past held.

    Raises
    ------
    InputError
        The method is neither, or there are fewer than two block rows.
    """

    decides: ClassVar[bool] = False

    method: Method = "cov"
    block_rows: int | None = None

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise input_error("method", "PyOMA2SSI", 'be "cov" or "dat"', f"is {self.method!r}")
        if self.block_rows is not None:
            integer(self.block_rows, "block_rows", "PyOMA2SSI", at_least=2)

    def prepare(self, data: TimeResponses) -> Components:
        """The principal components of the responses in `data`; `InputError` where pyOMA2 is not installed."""
        _ssi()
        return components(data)

    def extract(
        self, state: Components, order: int | None = None, *, report: Callable[[str], None] = lambda _: None
    ) -> ModalModel:
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

    def refine(self, state: Components, model: ModalModel) -> ModalModel:
        """The model in `state` of the order of `model`: this algorithm cannot start anywhere."""
        return self.extract(state, model.order)


def _energetic(values: NDArray[np.float64]) -> int:
    """The samples in which `SHARE` of the energy above that of the last tenth comes."""
    energy = np.sum(values**2, axis=0)
    above = np.cumsum(energy - energy[-(len(energy) // 10 + 1) :].mean())
    return int(np.argmax(above >= SHARE * above.max())) + 1


def _ssi() -> ModuleType:
    return load("pyoma2.functions.ssi", package="pyOMA_2", needed_by="PyOMA2SSI")
