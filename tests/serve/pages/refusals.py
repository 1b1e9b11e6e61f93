"""What the server refuses with, as its source has it: texts with `{{1}}` for their first value."""

import ast
import re
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import elfslam.app
import elfslam.serve
from elfslam.serve.jobs.executors import DIED, DISK_FULL, OVERDUE
from elfslam.serve.jobs.runner import MISTAKE

FOR_PROGRAMS = ("Upload-", "Tus-", "Content-", "filename ", "wanted either Upload-")
"""Said to whoever writes another client: no page of ours is answered so."""
SAID = ("Problem", "problem_response", "unknown_token", "not_found", "own", "NoAnswerError")
"""Of `not_found` and `own`, what it is that is not there."""
APP = ("map.py", "merge.py")
REFUSED_INPUT = ("tasks.py", "zips.py", "webhooks.py")
"""Whose InputError a page shows; refusals of log files stay English, with their figures."""
REASONS = ("app/merge.py", "slam/merging/grow.py", "stages/map_alignment.py")
"""Where it is said why walks are not merged, and under which names."""
REASONS_AS = ("refusal", "refused", "apart")
REASONS_GIVEN = ("_why_not", "_too_little")
SAID_OF_JOBS = (DIED, DISK_FULL, OVERDUE, MISTAKE)


def refusals() -> set[str]:
    """Every text that a page may be answered with and that stands in the source as it is."""
    app = (Path(elfslam.app.__path__[0], name) for name in APP)
    texts = {
        text
        for file in (*app, *Path(elfslam.serve.__path__[0]).rglob("*.py"))
        for text in _said(
            ast.parse(file.read_text(encoding="utf-8")),
            (*SAID, "InputError") if file.name in REFUSED_INPUT else SAID,
        )
    }
    texts |= {_numbered(text) for text in SAID_OF_JOBS}
    here = Path(elfslam.app.__path__[0]).parent
    for name in REASONS:
        texts |= set(_reasons(ast.parse((here / name).read_text(encoding="utf-8"))))
    return {text for text in texts if not text.startswith(FOR_PROGRAMS)}


def _numbered(text: str) -> str:
    """A text for `str.format` with numbers in place of names."""
    numbers = count(1)
    return re.sub(r"\{[^}]*\}", lambda _: f"{{{{{next(numbers)}}}}}", text)


def _said(module: ast.Module, said: tuple[str, ...]) -> Iterator[str]:
    known = {
        node.targets[0].id: list(_texts(node.value, {}))
        for node in module.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    for call in ast.walk(module):
        name = getattr(call.func, "id", None) if isinstance(call, ast.Call) else None
        if name in said and call.args:
            is_last = len(call.args) == 1 or name == "own"
            yield from _texts(call.args[-1 if is_last else 1], known)


def _reasons(module: ast.Module) -> Iterator[str]:
    """What is put under one of the names of reasons, and what the functions that say why return."""
    for node in ast.walk(module):
        if isinstance(node, ast.Assign):
            target = node.targets[0]
            name = getattr(target, "id", getattr(getattr(target, "value", None), "id", None))
            if name in REASONS_AS:
                yield from filter(None, _texts(node.value, {}))
        elif isinstance(node, ast.FunctionDef) and node.name in REASONS_GIVEN:
            for each in ast.walk(node):
                if isinstance(each, ast.Return) and each.value is not None:
                    yield from _texts(each.value, {})
                elif isinstance(each, ast.BoolOp):
                    yield from _texts(each.values[-1], {})


def _texts(node: ast.expr, known: dict[str, list[str]]) -> Iterator[str]:
    """The texts that an expression may be."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.JoinedStr):
        yield _template(node)
    elif isinstance(node, ast.Dict):
        for value in node.values:
            yield from _texts(value, known)
    elif isinstance(node, ast.Subscript | ast.DictComp):
        yield from _texts(node.value, known)
    elif isinstance(node, ast.Name):
        yield from known.get(node.id, [])


def _template(text: ast.JoinedStr) -> str:
    """A formatted text with the numbers of its values in their places."""
    pieces, number = [], 0
    for piece in text.values:
        if isinstance(piece, ast.Constant):
            pieces.append(str(piece.value))
        else:
            number += 1
            pieces.append(f"{{{{{number}}}}}")
    return "".join(pieces)
