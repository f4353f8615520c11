"""The exceptions that floquid raises.

`InputError` is the caller's mistake and the message follows one grammar: which argument of which callable, what it
must be, what it is, and what to do. `IdentificationError` is a record from which no honest result can be had.
"""


class FloquidError(Exception):
    """Base of every error that floquid raises on purpose."""


class InputError(FloquidError, ValueError):
    """An argument, a file or a setting is not what it must be."""


class IdentificationError(FloquidError):
    """The record was read, but identification failed or its result was refused."""
