"""Plain words in the source and the documentation: docstrings that say what is computed, and no phrase that puzzles."""

import ast
import re
from pathlib import Path

import floquid

ROOT = Path(floquid.__file__).parent

UNCLEAR = (
    "What|Whether|The same|Those|That|How|Of|It|Its|They|Their|These|This|Which|Who|When|Where|As|So|Both|Others|If"
)
"""Beginnings of a first line that name no thing and no action."""

PUZZLING = re.compile(
    r"\b(but for|of which|so many|by itself|is had by|at the begin|as far as can be told)\b", re.IGNORECASE
)
"""Phrases that readers had to read twice."""


def first_lines(text):
    """First lines of all docstrings of a module, those of constants and fields among them."""
    blocks = [ast.parse(text)]
    for block in blocks:  # which grows by the statements inside: no other node has a docstring
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            blocks += [own for own in getattr(block, part, []) if not isinstance(own, ast.Expr)]
        for child in getattr(block, "body", []):
            value = child.value if isinstance(child, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str) and value.value.strip():
                yield value.value.strip().splitlines()[0]


def unclear(text):
    return [line for line in first_lines(text) if re.match(rf"(?:{UNCLEAR})\b", line)]


def puzzling(text):
    """Phrases that puzzle, wherever a line is broken; code between backticks may be called anything."""
    return PUZZLING.findall(re.sub(r"`[^`\n]*`", "`", re.sub(r"\s+", " ", text)))


def pages():
    places = [Path(name) for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    return places + [page for page in Path("docs").rglob("*.md") if "decisions" not in page.parts]


def test_first_lines_name_a_thing_or_an_action():
    paths = list(ROOT.rglob("*.py"))
    found = {str(path.relative_to(ROOT)): unclear(path.read_text(encoding="utf-8")) for path in paths}
    assert len(found) == len(paths) > 200
    assert {name: lines for name, lines in found.items() if lines} == {}


def test_no_phrase_puzzles():
    texts = {path: path.read_text(encoding="utf-8") for path in [*ROOT.rglob("*.py"), *pages()]}
    assert len(texts) > len(pages()) > 10
    assert {str(path): found for path, text in texts.items() if (found := puzzling(text))} == {}


def test_what_is_unclear_would_be_found():
    text = '"""What is left."""\nx = 1\n"""Its size [m]."""\n\n\ndef f():\n    """Whatever the unit, the size."""\n'
    assert unclear(text) == ["What is left.", "Its size [m]."]
    assert puzzling("All of them but\nfor one.") == ["but for"]
