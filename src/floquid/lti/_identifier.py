"""The contract of every modal identification: the costly part once, then a model at any order."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

from floquid.lti._types import ModalModel, TimeResponses


class AbstractIdentifier(ABC):
    """One algorithm with its options as fields. Implementations are final, frozen and stateless.

    Attributes
    ----------
    decides
        Whether the algorithm finds the order by itself; one that does not refuses `extract(state, None)`.
    """

    __slots__ = ()
    decides: ClassVar[bool]

    @abstractmethod
    def prepare(self, data: TimeResponses) -> Any:
        """Do what does not depend on the order.

        Parameters
        ----------
        data
            The responses.

        Returns
        -------
        object
            What `extract` starts from; of a type of the algorithm's own.
        """

    @abstractmethod
    def extract(
        self, state: Any, order: int | None = None, *, report: Callable[[str], None] = lambda _: None
    ) -> ModalModel:
        """The model of one order.

        Parameters
        ----------
        state
            What `prepare` returned.
        order
            The number of poles, conjugates one by one; None lets an algorithm that decides do so.
        report
            Is told of each stage.

        Returns
        -------
        ModalModel
            The model; its `outcome` says how it ended.

        Raises
        ------
        InputError
            `order` is not a positive integer below the number of samples, or None where the algorithm cannot decide.
        """

    @abstractmethod
    def refine(self, state: Any, model: ModalModel) -> ModalModel:
        """The model of the same order nearest to another one, on other data or another noise.

        Parameters
        ----------
        state
            What `prepare` returned for the data.
        model
            Where to start; an algorithm that cannot start anywhere extracts a model of its order.

        Returns
        -------
        ModalModel
            The model.
        """
