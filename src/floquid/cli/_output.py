"""The result folder and what goes to stdout."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from floquid._files import atomic_path
from floquid.errors import InputError
from floquid.pipeline import Analysis, Settings
from floquid.store import save, summary

Truth = tuple[np.ndarray, np.ndarray]
"""Instants (times,) [s] and the true A at each (times, n, n)."""


@dataclass(frozen=True, slots=True)
class ResultFolder:
    """A folder that can be written to, holding or about to hold one result."""

    path: Path

    @staticmethod
    def prepare(path: Path) -> ResultFolder:
        """Make the folder and try it before any long work.

        Raises
        ------
        InputError
            It cannot be made or written to.
        """
        try:
            (path / "figures").mkdir(parents=True, exist_ok=True)
            probe = path / ".floquid-probe"
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise InputError(
                f"Argument `--out` of `floquid` must be a folder that can be written to, but {path} is not: "
                f"{error.strerror or error}.\n  Choose another folder."
            ) from None
        return ResultFolder(path)

    def write(self, analysis: Analysis, report: Callable[[str], None], truth: Truth | None = None) -> None:
        """Write result.h5, summary.json, settings.toml and the figures, each of them whole or not at all."""
        from floquid.plot import save_figures

        report("writing the result")
        save(analysis, self.path / "result.h5")
        self.write_text("summary.json", json_text(analysis))
        self.write_text("settings.toml", settings_text(analysis.settings))
        report("drawing the figures")
        save_figures(analysis, self.path / "figures", truth=truth)

    def write_text(self, name: str, text: str) -> None:
        """Write one text file, whole or not at all."""
        with atomic_path(self.path / name) as temporary:
            temporary.write_text(text, encoding="utf-8")


def json_text(analysis: Analysis) -> str:
    """`summary.json` as text."""
    return json.dumps(summary(analysis), indent=1, allow_nan=False) + "\n"


def print_json(analysis: Analysis) -> None:
    """`summary.json`, alone on stdout."""
    sys.stdout.write(json_text(analysis))


def settings_text(settings: Settings) -> str:
    """The settings as TOML; those that are None are left out, and mean the same when read back."""
    import tomli_w

    content: dict[str, Any] = {name: value for name, value in asdict(settings).items() if value is not None}
    return tomli_w.dumps({name: list(value) if isinstance(value, tuple) else value for name, value in content.items()})
