"""What the server refuses with, as its source has it: texts with `{{1}}` for their first value."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import elfslam.app.map
import elfslam.serve

FOR_PROGRAMS = ("Upload-", "Tus-", "Content-", "filename ", "wanted either Upload-")
"""Said to whoever writes another client: no page of ours is answered so."""
SAID = ("Problem", "unknown_token", "not_found", "NoAnswerError")
"""Of the last, what it is that is not there."""


def refusals() -> set[str]:
    """Every text that a page may be answered with and that stands in the source as it is."""
    mapping = Path(elfslam.app.map.__file__)
    texts = {
        text
        for file in (mapping, *Path(elfslam.serve.__path__[0]).rglob("*.py"))
        for text in _said(ast.parse(file.read_text(encoding="utf-8")))
    }
    return {text for text in texts if not text.startswith(FOR_PROGRAMS)}


def _said(module: ast.Module) -> Iterator[str]:
    known = {
        node.targets[0].id: list(_texts(node.value, {}))
        for node in module.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    for call in ast.walk(module):
        if isinstance(call, ast.Call) and getattr(call.func, "id", None) in SAID and call.args:
            yield from _texts(call.args[-1] if len(call.args) == 1 else call.args[1], known)


def _texts(node: ast.expr, known: dict[str, list[str]]) -> Iterator[str]:
    """The texts that an expression may be."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.JoinedStr):
        yield _template(node)
    elif isinstance(node, ast.Dict):
        for value in node.values:
            yield from _texts(value, known)
    elif isinstance(node, ast.Subscript):
        yield from _texts(node.value, known)
    elif isinstance(node, ast.Name):
        yield from known.get(node.id, [])


def _template(text: ast.JoinedStr) -> str:
    """A formatted text with the numbers of its values in their places."""
    pieces, count = [], 0
    for piece in text.values:
        if isinstance(piece, ast.Constant):
            pieces.append(str(piece.value))
        else:
            count += 1
            pieces.append(f"{{{{{count}}}}}")
    return "".join(pieces)
