"""Packages that a plain installation does not have."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from floquid.errors import InputError


def load_package(name: str, of: str, *, extra: str = "") -> Any:
    """The module called `name`, for the public callable `of`; it comes with the `extra`, by default of its own name."""
    try:
        return import_module(name)
    except ImportError as error:
        message = f"`{of}` works with the package {name.partition('.')[0]}, which cannot be imported ({error})."
        raise InputError(f'{message}\n  Install it: pip install "floquid[{extra or name}]"') from None
