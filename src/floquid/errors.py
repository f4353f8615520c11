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


class UnevenError(InputError):
    """A model with a mode whose shape is even about no turning point of a path.

    Parameters
    ----------
    frequency
        Where the mode is, |λ|/2π [Hz].
    share
        The share of its energy that is odd, at the best.
    """

    def __init__(self, frequency: float, share: float) -> None:
        super().__init__(frequency, share)
        self.frequency, self.share = frequency, share

    def __str__(self) -> str:
        """The message."""
        return (
            "Argument `model` of `turning_point` must have modes whose shapes are even about a turning point of the "
            f"path, but {100.0 * self.share:.0f} % of the energy of that at {self.frequency:.6g} Hz is odd.\n"
            '  Only a sensor that runs to and fro sees such shapes: pass `branch="strongest"` or "slowest".'
        )


class IdentificationError(FloquidError):
    """The record was read, but identification failed or its result was refused."""
