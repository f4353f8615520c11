"""Each public room has its page in the reference, so that `make docs` checks its docstrings."""

import pkgutil
from pathlib import Path

import floquid

ROOT = Path(__file__).parents[2]
# The command line documents itself: `floquid --help`.
WITHOUT_A_PAGE = {"cli"}


def test_every_room_has_its_page():
    rooms = {info.name for info in pkgutil.iter_modules(floquid.__path__) if not info.name.startswith("_")}
    pages = [path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "reference").glob("*.md")]
    shown = {room for room in rooms if any(f".. automodule:: floquid.{room}\n" in page for page in pages)}
    assert rooms - shown == rooms & WITHOUT_A_PAGE
