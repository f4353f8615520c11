"""Numbers that decide in the rooms of identification, each with what it was set by.

Printed by `python -m tests.architecture.numbers_that_decide`.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import floquid

ROOMS = (
    "fit",
    "inputs",
    "innovations",
    "lifting",
    "lti",
    "order",
    "periodic",
    "pipeline",
    "preparation",
    "search",
    "sync",
    "transfer",
    "checks",
)
"""Where it is decided what a record holds."""

PLAIN = ("0", "0.0", "1", "1.0", "-1", "-1.0", "2", "2.0", "0.5")
"""Numbers that a formula has, and that decide nothing by their size."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Number:
    """A number of the source.

    Parameters
    ----------
    place
        The file, below the package, and the line.
    name, value
        As written; a bare number in a comparison has no name.
    reason
        The comment behind or below it, or the docstring below it; empty where there is none.
    """

    place: str
    name: str
    value: str
    reason: str


def numbers() -> Iterator[Number]:
    """Numbers that modules name, and those that comparisons hold."""
    root = Path(floquid.__file__).parent
    for room in ROOMS:
        for path in sorted([*(root / room).rglob("*.py"), *root.glob(f"{room}.py")]):
            text = path.read_text(encoding="utf-8")
            yield from _of(path.relative_to(root).as_posix(), text)


def _of(name: str, text: str) -> Iterator[Number]:
    lines, tree = text.splitlines(), ast.parse(text)
    body = tree.body
    for place, node in enumerate(body):
        if isinstance(node, ast.Assign) and _is_number(node.value):
            following = body[place + 1] if place + 1 < len(body) else None
            yield Number(
                place=f"{name}:{node.lineno}",
                name=ast.unparse(node.targets[0]),
                value=ast.unparse(node.value),
                reason=_comment(lines[node.end_lineno - 1 :]) or _docstring(following),
            )
    for node in ast.walk(tree):
        for value in node.comparators if isinstance(node, ast.Compare) else ():
            if _is_number(value) and ast.unparse(value) not in PLAIN:
                yield Number(place=f"{name}:{node.lineno}", name="", value=ast.unparse(node), reason="")


def _is_number(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp):
        return _is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return _is_number(node.left) and _is_number(node.right)
    if isinstance(node, ast.Tuple):
        return bool(node.elts) and all(map(_is_number, node.elts))
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def _comment(lines: list[str]) -> str:
    """The comment behind the first of some lines, or alone on the one after it."""
    below = lines[1] if len(lines) > 1 and lines[1].startswith("# ") else ""
    return (lines[0].partition("# ")[2] or below.removeprefix("# ")).strip()


def _docstring(node: ast.stmt | None) -> str:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
        return node.value.value.strip()
    return ""


def main() -> None:
    """Print them, and how many each room has."""
    found = list(numbers())
    lines = [f"{one.place:55} {one.name or '-':30} {one.value:20} {one.reason}" for one in found]
    for room in ROOMS:
        named = [bool(number.name) for number in found if number.place.startswith((f"{room}/", f"{room}.py"))]
        lines.append(f"{room:12} {sum(named):4} named, {len(named) - sum(named):3} bare")
    sys.stdout.write("\n".join([*lines, f"{len(found)} in all", ""]))


if __name__ == "__main__":
    main()
