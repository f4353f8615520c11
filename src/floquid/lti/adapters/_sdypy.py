"""sdypy-EMA's least-squares complex frequency domain method as an identifier."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import ModuleType
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from floquid.lti._identifier import AbstractIdentifier, given_order
from floquid.lti._types import ModalModel, TimeResponses
from floquid.lti.adapters._peer import Components, components, fitted, kept, load, quiet

FIRST_LINE = 1
"""The band starts here and not at zero, where sdypy-EMA 0.31 transforms an empty slice, reads memory that was never
written to (numpy's `irfft` of nothing), and gives every pole the wrong sign of the damping."""

RIDGE = 1e-7
"""Without noise a denominator above the order is singular. One more response, a blow to one sample of this share of the
norm of all, is below what any noise does, and makes it regular: its spectrum is flat."""


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class SdypyLSCF(AbstractIdentifier):
    r"""Least-squares complex frequency domain method (LSCF) by sdypy-EMA: one denominator for all responses.

    .. math:: Y_o(z) = \frac{\sum_j b_{oj} z^{-j}}{\sum_j a_j z^{-j}}, \qquad \sum_j a_j\, z_r^{-j} = 0

    on the lines of the DFT, where a free decay of finite length is such a ratio exactly (Guillaume et al. 2003;
    Verboven 2002, section 5.3.3). What is given to it: the transform of the responses over their noise, inputs stacked
    as outputs and cut to the shortest, an even number of samples, as their first `order` principal components; of those
    the lines from the first above zero on (at zero this code flips the sign of the damping). The denominator's degree
    is far above the order, so most of its poles are spurious. The `order` poles are kept that the data can least do
    without: of all poles with free residues, the one whose absence leaves least is taken away, again and again.

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

    def extract(
        self, state: Components, order: int | None = None, *, report: Callable[[str], None] = lambda _: None
    ) -> ModalModel:
        """The model of `order` poles, from the components in `state`; `report` is told how many there are to choose."""
        wanted = given_order(order, self, state.data)
        many = self._poles(state, wanted)
        report(f"{len(many)} poles of the denominator")
        return fitted(kept(many, state, wanted), state, wanted)

    def refine(self, state: Components, model: ModalModel) -> ModalModel:
        """The model in `state` of the order of `model`: this algorithm cannot start anywhere."""
        return self.extract(state, model.order)

    def _poles(self, state: Components, order: int) -> NDArray[np.complex128]:
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


def _multipliers(values: NDArray[np.float64], pairs: int) -> NDArray[np.complex128]:
    """The roots of the highest denominator, up to `pairs` pairs, that can be solved for; what is no number included."""
    blow = np.zeros((1, values.shape[1]))
    blow[0, values.shape[1] // 2] = RIDGE * np.linalg.norm(values)
    lines = np.fft.rfft(np.concatenate([values, blow]))
    # The model cuts off the line at its upper limit: one more is there to be cut off.
    lines = np.concatenate([lines, lines[:, -1:]], axis=1)
    frequencies = np.arange(lines.shape[1]) / values.shape[1]
    model = _ema().Model(
        lines,
        frequencies,
        dt=1.0,
        lower=float(frequencies[FIRST_LINE]),
        upper=float(frequencies[-1]),
        pol_order_high=pairs,
    )
    with quiet(), suppress(np.linalg.LinAlgError):
        model.get_poles("lscf", show_progress=False)
    return np.exp(np.asarray(model.all_poles[-1] if model.all_poles else [], dtype=np.complex128))


def _ema() -> ModuleType:
    return load("sdypy.EMA", package="sdypy-EMA", needed_by="SdypyLSCF")
