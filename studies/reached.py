"""What a study runs: the definitions that its module reaches, and which of them have changed.

A definition is a function, a class, what a name at the top of a module is set to, or a data file in
a folder that such code names. They reach each other by name. Annotations reach nothing: what they
name was made elsewhere. Prose, layout, the module where a definition stands, and this module, are
no code.
"""

import ast
import hashlib
import subprocess
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
ENCODER = ROOT / "src" / "elfslam" / "weights" / "compact.onnx"
OWN_FILE = Path(__file__).relative_to(ROOT).as_posix()
STUDY = "STUDY"
"""What a study is called in its module."""
ON_IMPORT = ""
"""The name of the statements of a module that define nothing."""


class Definition(NamedTuple):
    """Where a definition stands, from the root of the project; a data file has no name."""

    file: str
    name: str


@dataclass(frozen=True)
class Source:
    """What a module defines, by name, and the dotted path of each name that it imports."""

    defined: Mapping[str, list[ast.stmt]]
    imported: Mapping[str, str]


def changed_since(commit: str, module: str) -> list[str]:
    """What a module runs that was other at a commit, as FILE:NAME; all where nobody knows it."""
    now = reached(module)
    try:
        changed, then = _changed_files(commit), _code_then(commit)
    except subprocess.CalledProcessError:
        return sorted(map(":".join, now))
    return sorted(
        ":".join(each) for each in now if each.file in changed and not code_of(each) <= then
    )


@cache
def digest(module: str) -> str:
    """Of the code that a module runs, of its data, and of the encoder."""
    code = sorted(set().union(*map(code_of, reached(module))))
    return hashlib.sha256(repr(code).encode() + ENCODER.read_bytes()).hexdigest()


@cache
def reached(module: str) -> frozenset[Definition]:
    """Every definition that those of a module reach, theirs too; what a study says of itself is
    none."""
    start = _file_of(module)
    found: set[Definition] = set()
    own = source(start).defined.keys() - {STUDY} if start else ()
    waiting = [Definition(start, name) for name in own if start]
    while waiting:
        each = waiting.pop()
        if each not in found:
            found.add(each)
            waiting += [*_named_by(each), Definition(each.file, ON_IMPORT)]
    return frozenset(found)


@cache
def code_of(definition: Definition) -> frozenset[tuple[str, str]]:
    """What a definition does: its name and its syntax, or the text of a data file."""
    if not _is_code(definition.file):
        return frozenset({(definition.file, (ROOT / definition.file).read_text(encoding="utf-8"))})
    return _dumped(source(definition.file), definition.name)


@cache
def source(file: str) -> Source:
    """A module of the project, from its root, without prose."""
    return _parsed((ROOT / file).read_text(encoding="utf-8"))


def git(*arguments: str) -> str:
    """What git prints in this checkout. Raises CalledProcessError where it refuses."""
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@cache
def _changed_files(commit: str) -> frozenset[str]:
    """Files that differ now; a data file that is new was not there to be read."""
    differing = git("diff", "--name-only", "--no-renames", commit, "--", "src", "studies")
    new = git("diff", "--name-only", "--no-renames", "--diff-filter=A", commit, "--", "src")
    return frozenset(differing.splitlines()) - {
        file for file in new.splitlines() if not _is_code(file)
    }


@cache
def _code_then(commit: str) -> frozenset[tuple[str, str]]:
    """What the definitions did that stood, at a commit, in files which differ now."""
    changed = _changed_files(commit)
    tree = git("ls-tree", "-r", commit, "--", "src", "studies").splitlines()
    files = {file: about.split()[2] for about, file in (line.split("\t") for line in tree)}
    return frozenset().union(
        *(_code_in(blob) for file, blob in files.items() if file in changed and _is_code(file))
    )


@cache
def _code_in(blob: str) -> frozenset[tuple[str, str]]:
    """What the definitions do in a module as git keeps it."""
    module = _parsed(git("cat-file", "blob", blob))
    return frozenset().union(*(_dumped(module, name) for name in module.defined))


def _dumped(module: Source, name: str) -> frozenset[tuple[str, str]]:
    return frozenset((name, ast.dump(each)) for each in module.defined.get(name, ()))


def _parsed(text: str) -> Source:
    tree = ast.parse(text)
    imported: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(getattr(node, "body", None), list):
            node.body = [each for each in node.body if not _is_idle(each)]  # type: ignore[attr-defined]
        if isinstance(node, ast.Import):
            short = {each.asname or each.name.split(".")[0]: each for each in node.names}
            imported |= {name: each.name if each.asname else name for name, each in short.items()}
        elif isinstance(node, ast.ImportFrom):
            imported |= {each.asname or each.name: f"{node.module}.{each.name}"
                         for each in node.names}  # fmt: skip
    defined: defaultdict[str, list[ast.stmt]] = defaultdict(list)
    for statement in tree.body:
        for name in _names(statement):
            defined[name].append(statement)
    return Source(defined, imported)


def _names(statement: ast.stmt) -> list[str]:
    """What a statement at the top of a module defines."""
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return [statement.name]
    if isinstance(statement, ast.Import | ast.ImportFrom):
        return []
    nodes = ast.walk(statement) if isinstance(statement, ast.Assign | ast.AnnAssign) else ()
    stored = (each for each in nodes if isinstance(each, ast.Name))
    return [each.id for each in stored if isinstance(each.ctx, ast.Store)] or [ON_IMPORT]


def _named_by(definition: Definition) -> Iterator[Definition]:
    """The definitions of the project, and the data files, that one names."""
    if not _is_code(definition.file):
        return
    module = source(definition.file)
    for statement in module.defined.get(definition.name, ()):
        for node in _running(statement):
            if isinstance(node, ast.Constant):
                yield from _data_in(definition.file, node.value)
            path = _path(node)
            if path in module.defined:
                yield Definition(definition.file, path)
            elif path.split(".")[0] in module.imported:
                first, *rest = path.split(".")
                yield from _at(".".join((module.imported[first], *rest)))


def _running(statement: ast.stmt) -> Iterator[ast.AST]:
    """A statement and all in it but annotations."""
    waiting: list[ast.AST] = [statement]
    while waiting:
        node = waiting.pop()
        yield node
        for name, value in ast.iter_fields(node):
            if name not in ("annotation", "returns"):
                each = value if isinstance(value, list) else [value]
                waiting += [child for child in each if isinstance(child, ast.AST)]


def _path(node: ast.AST) -> str:
    """The dotted name that a node reads, "" where it reads none."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute) and (of := _path(node.value)):
        return f"{of}.{node.attr}"
    return ""


def _at(path: str) -> Iterator[Definition]:
    """The definition at a dotted path, wherever a module takes it from."""
    names = path.split(".")
    for count in range(len(names), 0, -1):
        file = _file_of(".".join(names[:count]))
        if file == OWN_FILE:
            return
        if file is not None:
            name, *rest = names[count:] or [ON_IMPORT]
            if name in source(file).imported and name not in source(file).defined:
                yield from _at(".".join((source(file).imported[name], *rest)))
            else:
                yield Definition(file, name)
            return


def _data_in(file: str, folder: object) -> Iterator[Definition]:
    """The data files in a folder beside a module that its code names."""
    if isinstance(folder, str) and folder.isidentifier():
        inside = (ROOT / file).parent / folder
        if inside.is_dir() and not (inside / "__init__.py").exists():
            for each in sorted(inside.glob("*.toml")):
                yield Definition(each.relative_to(ROOT).as_posix(), ON_IMPORT)


@cache
def _file_of(module: str) -> str | None:
    """The file of a module of the project, from its root; None for what is no such module."""
    top, *_ = names = module.split(".")
    if top not in ("elfslam", "studies"):
        return None
    path = ROOT.joinpath("src" if top == "elfslam" else "", *names)
    found = (each for each in (path.with_suffix(".py"), path / "__init__.py") if each.exists())
    return next((each.relative_to(ROOT).as_posix() for each in found), None)


def _is_code(file: str) -> bool:
    return file.endswith(".py")


def _is_idle(node: ast.AST) -> bool:
    """Whether a statement is prose, or for type checkers alone."""
    if isinstance(node, ast.If):
        return _path(node.test) == "TYPE_CHECKING"
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
