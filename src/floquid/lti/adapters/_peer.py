"""Loading and running a package of other people's without its side effects on the process."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib import import_module
from types import ModuleType

import numpy as np

from floquid.errors import InputError


def load(module: str, *, package: str, needed_by: str) -> ModuleType:
    """The module of a package that may not be installed.

    Importing one of these packages warns of its own affairs and even sets numpy's handling of floating-point errors;
    the latter is put back.

    Raises
    ------
    InputError
        It is not installed.
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
