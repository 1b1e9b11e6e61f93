"""What studies measured, as data: `results/NAME.csv`, a row a number, with where it comes from.

A study gives records; the runner adds the study, the commit, the encoder and the date. Tables and
figures of README and docs are rendered from these files alone (`studies.render`).
"""

from __future__ import annotations

import ast
import csv
import hashlib
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import SupportsFloat

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.data.atomic_files import replaced_file
from elfslam.scoring.errors import interval

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results"
ENCODER = ROOT / "src" / "elfslam" / "weights" / "compact.onnx"
DIGITS = 8


@dataclass(frozen=True)
class Record:
    """A number that a study measured, and of what.

    `condition` is what is varied ("4 people", "0.6"); `metric` ends in its unit in brackets; low
    and high bound it with 95 %; `paper` is what the paper has for it.
    """

    method: str
    metric: str = ""
    value: float = 0.0
    low: float | None = None
    high: float | None = None
    paper: float | None = None
    world: str = ""
    scenario: str = ""
    condition: str = ""
    seeds: str = ""

    def each(self, numbers: Mapping[str, SupportsFloat]) -> list[Record]:
        """A record of every number, by metric."""
        return [replace(self, metric=name, value=float(value)) for name, value in numbers.items()]


@dataclass(frozen=True)
class Result(Record):
    """A record with the study, the commit and the encoder that it was measured with, and the day.

    Raises InputError where a value is not a number: what could not be measured has no row.
    """

    study: str = ""
    commit: str = ""
    encoder: str = ""
    date: str = ""

    def __post_init__(self) -> None:
        if not np.isfinite(self.value):
            raise InputError(f"result {self}: wanted a finite value; leave the row out")


COLUMNS = (
    "study", "commit", "encoder", "date", "world", "scenario", "seeds", "method", "condition",
    "metric", "value", "low", "high", "paper",
)  # fmt: skip
NUMBERS = ("value", "low", "high", "paper")
assert set(COLUMNS) == {field.name for field in fields(Result)}


def averaged(walks: Iterable[Iterable[Record]], seeds: Sequence[int]) -> list[Record]:
    """The means over walks of what each walk gave, with their intervals.

    Records of the same world, scenario, method, condition and metric are one; what a walk could not
    tell (NaN) is left out.
    """
    found: dict[Record, list[float]] = {}
    for each in (record for walk in walks for record in walk):
        if np.isfinite(each.value):
            of = replace(each, value=0.0, low=None, high=None, seeds=seeds_text(seeds))
            found.setdefault(of, []).append(each.value)
    return [mean_of(of, values) for of, values in found.items()]


def mean_of(of: Record, values: Sequence[float] | F64) -> Record:
    """A record with the mean of values (n) of walks, and its interval by resampling the walks."""
    each = [np.atleast_1d(value) for value in np.asarray(values, float)]
    low, high = interval(each, lambda some: float(some.mean()), np.random.default_rng(0))
    return replace(of, value=float(np.mean(values)), low=low, high=high)


def seeds_text(seeds: Sequence[int]) -> str:
    """Seeds as a record has them: the first and the last of consecutive ones, or all."""
    if len(seeds) > 1 and list(seeds) == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def write_results(file: Path, results: Iterable[Result]) -> None:
    """Write results as CSV, numbers to six digits; nothing is half-written."""
    with replaced_file(file) as partial, partial.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: _cell(value) for key, value in asdict(each).items()}
                         for each in results)  # fmt: skip


def read_results(file: Path) -> list[Result]:
    """The results of a file. Raises InputError for a file that is missing, or of another form."""
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            read = csv.DictReader(stream)
            rows = list(read)
        if list(read.fieldnames or ()) != list(COLUMNS):
            raise ValueError(f"got {', '.join(read.fieldnames or ['nothing'])}")
        return [_result(row) for row in rows]
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as cause:
        raise InputError(f"{file.name}: wanted columns {', '.join(COLUMNS)} ({cause})") from cause


def stamped(study: str, records: Iterable[Record], commit: str, date: str) -> Iterator[Result]:
    """Records as results of a study that ran at a commit, with the encoder that is shipped."""
    for record in records:
        yield Result(
            **asdict(record), study=study, commit=commit, encoder=encoder_digest(), date=date
        )


@cache
def encoder_digest() -> str:
    """The shipped encoder by the first digits of its SHA-256."""
    return hashlib.sha256(ENCODER.read_bytes()).hexdigest()[:DIGITS]


def commit_now() -> str:
    """The commit that is checked out, `+` where a file of the code differs from it."""
    commit = git("rev-parse", f"--short={DIGITS}", "HEAD").strip()
    changed = git("status", "--porcelain", "--", "src", "studies").strip()
    return f"{commit}+" if changed else commit


def changed_since(commit: str, module: str) -> list[str]:
    """The files of the code that a study runs which changed since a commit, whatever the prose.

    All of them where nobody knows the commit.
    """
    files = code_of(module)
    try:
        named = git("diff", "--name-only", commit.rstrip("+"), "--", "src", "studies")
    except subprocess.CalledProcessError:
        return sorted(files)
    return [
        name
        for name in named.splitlines()
        if name in files and _code_then(commit.rstrip("+"), name) != code_now(name)
    ]


@cache
def code_of(module: str) -> frozenset[str]:
    """The files of the project that a module imports, and theirs, from the root; its own too."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        file = _file_of(waiting.pop())
        if file is not None and file not in found:
            found.add(file)
            waiting += _imports(file)
    return frozenset(found | {ENCODER.relative_to(ROOT).as_posix()})


def git(*arguments: str) -> str:
    """What git prints in this checkout. Raises CalledProcessError where it refuses."""
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@cache
def _file_of(module: str) -> str | None:
    """The file of a module of the project, from its root; None for what is no such module."""
    top, *_ = names = module.split(".")
    if top not in ("elfslam", "studies"):
        return None
    path = ROOT.joinpath("src" if top == "elfslam" else "", *names)
    found = (each for each in (path.with_suffix(".py"), path / "__init__.py") if each.exists())
    return next((each.relative_to(ROOT).as_posix() for each in found), None)


@cache
def _imports(file: str) -> tuple[str, ...]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    found: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(found)


@cache
def _code_then(commit: str, name: str) -> str:
    try:
        return _code(git("show", f"{commit}:{name}"))
    except (subprocess.CalledProcessError, SyntaxError, UnicodeDecodeError):
        return ""


@cache
def code_now(name: str) -> str:
    """What a file of the project does, from its root: Python less prose and layout."""
    file = ROOT / name
    return _code(file.read_text(encoding="utf-8")) if name.endswith(".py") else "changed"


def _code(text: str) -> str:
    """Python less comments, docstrings, layout, and when annotations are read."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [each for each in body if not _is_prose(each)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _is_prose(node: object) -> bool:
    if isinstance(node, ast.ImportFrom):
        return node.module == "__future__"
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _cell(value: object) -> object:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else value


def _result(row: dict[str, str]) -> Result:
    given = {name: row[name] for name in COLUMNS if name not in NUMBERS}
    numbers = {name: float(row[name]) if row[name] else None for name in NUMBERS}
    return Result(**given, **numbers)  # type: ignore[arg-type]
