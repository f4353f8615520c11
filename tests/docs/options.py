"""`python -m tests.docs.options` writes docs/options.md: which option counts for which kind of record, or why not."""

import re
from dataclasses import fields
from pathlib import Path

from floquid import Settings
from floquid.preparation import FORBIDDEN, SHORT

PAGE = Path(__file__).parents[2] / "docs" / "options.md"

KINDS = ("inputs", "excitation")
"""Options that say of which kind a record is."""

HEAD = """# Every option, and the records that it counts for

One set of options serves every kind of record: free responses, records with measured inputs (`inputs=`), and outputs
alone (`excitation="ambient"`, with inputs beside it or without). An option that a kind cannot have says why.

This page is made of `floquid.Settings` by `python -m tests.docs.options`.

| Python | command | what it is | free | inputs | outputs alone |
|---|---|---|---|---|---|
"""


def sentences() -> dict[str, str]:
    """The first sentence on each setting."""
    found = re.findall(r"^    (\w+)\n((?: {8}.+\n)+)", str(Settings.__doc__), re.MULTILINE)
    texts = {name: re.sub(r"\s+", " ", text).strip() for name, text in found}
    return {name: re.split(r"(?<=\.)\s(?=[A-Z\"\d])", text)[0] for name, text in texts.items()}


def page() -> str:
    """The page as text."""
    rows, told = [], sentences()
    for name in (field.name for field in fields(Settings) if field.name not in KINDS):
        flag = f"`--{SHORT.get(name, name).replace('_', '-')}`"
        cells = [f"no: {reasons[name]}" if name in reasons else "yes" for reasons in FORBIDDEN.values()]
        rows.append(f"| `{name}` | {flag} | {told[name].replace('|', chr(92) + '|')} | {' | '.join(cells)} |")
    return HEAD + "\n".join(rows) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
