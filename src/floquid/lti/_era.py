"""ERA, the eigensystem realisation algorithm, on the covariance of the Hankel matrices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, final

from floquid._checks import integer
from floquid.lti._factor import Factor, energies, factors
from floquid.lti._hankel import Realisation
from floquid.lti._horizon import energetic_length, search_window
from floquid.lti._identifier import AbstractIdentifier
from floquid.lti._order import checked_order, reached
from floquid.lti._poles import PoleSet
from floquid.lti._residues import model_of
from floquid.lti._types import ModalModel, TimeResponses


@dataclass(frozen=True, slots=True)
class Realised:
    """Responses and the realisation of their Hankel matrices."""

    data: TimeResponses
    realisation: Realisation


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class ERA(AbstractIdentifier):
    r"""The eigensystem realisation algorithm (Juang and Pappa 1985) for free responses.

    .. math:: H_0 = U \Sigma V^T, \qquad
              A_n = \Sigma_n^{-1/2} U_n^T H_1 V_n \Sigma_n^{-1/2} \sim \Lambda_n^{-1} V_n^T (H_0^T H_1) V_n,
              \qquad H_0^T H_0 = V \Lambda V^T

    H₀ and H₁, one sample later, have a column a lag and a row a start and response; the multipliers are the eigenvalues
    of A_n. With many responses only H₀ᵀH₀ and H₀ᵀH₁ are needed, and both are sums of shifted blocks of the Gram matrix
    over time: neither Hankel matrix is formed, and their size does not depend on the number of responses. Responses are
    divided by their noise. Short records without noise are realised from the Hankel matrix itself, since squaring
    halves the digits; leading directions of long windows come by Lanczos' method.

    At too low an order the estimate is biased, at too high a one it holds poles of noise: the order is the user's, or
    that of `MaximumLikelihood(initial=ERA())`.

    Parameters
    ----------
    window
        The number of lags M; None for half of the samples that hold energy, at most 200.
    most
        The highest order that can be extracted.
    """

    decides: ClassVar[bool] = False

    window: int | None = None
    most: int = 80

    def __post_init__(self) -> None:
        integer(self.most, "most", "ERA", at_least=1)
        if self.window is not None:
            integer(self.window, "window", "ERA", at_least=1)

    def prepare(self, data: TimeResponses) -> Realised:
        """The realisation of the highest order.

        Parameters
        ----------
        data
            The responses and their noise.

        Returns
        -------
        Realised
            What `extract` starts from.
        """
        samples = energetic_length(energies(data), data)
        return Realised(data, realise(factors(data, samples), self.window, self.most))

    def extract(
        self, state: Realised, order: int | None = None, *, report: Callable[[str], None] = lambda _: None
    ) -> ModalModel:
        """The model of the leading directions.

        Parameters
        ----------
        state
            What `prepare` returned.
        order
            The number of poles, conjugates one by one.
        report
            Is told of each stage.

        Returns
        -------
        ModalModel
            The model; where the data have fewer directions than poles are asked for, that of all of them.

        Raises
        ------
        InputError
            `order` is None, or not a positive integer below the number of samples.
        """
        checked_order(order, self, state.data)
        report("extracting from the realisation")
        poles = PoleSet.from_multipliers(state.realisation.multipliers(order or 0))
        return model_of(poles, state.data, outcome=reached(order, poles.order))

    def refine(self, state: Realised, model: ModalModel) -> ModalModel:
        """The model of the same order: an algorithm of directions starts nowhere.

        Parameters
        ----------
        state
            What `prepare` returned for the data.
        model
            Whose order it is.

        Returns
        -------
        ModalModel
            The model.
        """
        return self.extract(state, model.order)


def realise(blocks: tuple[Factor, ...], window: int | None, most: int) -> Realisation:
    """The realisation from factors, by covariances."""
    longest = max(len(block.values) for block in blocks)
    lags = max(1, min(window or search_window(longest), longest - 1))
    return Realisation.of(blocks, lags, most)
