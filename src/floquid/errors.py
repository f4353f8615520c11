"""The exceptions that floquid raises.

`InputError` is the caller's mistake and the message follows one grammar: the argument and its callable, what it
must be, what it is, and what to do. `IdentificationError` is a record from which no honest result can be had.
"""

from typing import Literal


class FloquidError(Exception):
    """Base of every error that floquid raises on purpose."""


class InputError(FloquidError, ValueError):
    """An argument, a file or a setting is not what it must be."""


class NotSynchronousError(InputError):
    """Records that cannot be cut into whole samples a period as they are.

    Parameters
    ----------
    message
        What is said.
    why
        What is in the way: a period that is no whole number of samples, records sampled at different phases of it, or
        records sampled at different rates.
    """

    def __init__(self, message: str, why: Literal["whole number", "phases", "rates"]) -> None:
        super().__init__(message, why)  # both, so that it can be pickled
        self.why = why

    def __str__(self) -> str:
        """The message alone."""
        return self.args[0]


class IdentificationError(FloquidError):
    """The record was read, but identification failed or its result was refused."""
