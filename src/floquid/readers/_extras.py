"""Libraries that some formats need and a plain installation does not have."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from floquid._checks import input_error


def extra(module: str, *, package: str, name: str, suffix: str, of: str) -> ModuleType:
    """The optional `module` of `package`, which comes with `floquid[name]` and is needed for files of `suffix`.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        raise input_error(
            "path",
            of,
            f"be of a format that this installation knows: {suffix} needs {package}",
            f"{package} is not installed",
            f'Install it: pip install "floquid[{name}]".',
        ) from None
