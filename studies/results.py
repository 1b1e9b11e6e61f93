"""What studies measured, as data: `results/NAME.csv`, a row a number, with where it comes from.

A study gives records; the runner adds the study, the commit, the encoder and the date. Tables and
figures of README and docs are rendered from these files alone (`studies.render`).
"""

from __future__ import annotations

import csv
import hashlib
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
from studies.reached import ENCODER, ROOT, git

RESULTS = ROOT / "results"
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


def _cell(value: object) -> object:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else value


def _result(row: dict[str, str]) -> Result:
    given = {name: row[name] for name in COLUMNS if name not in NUMBERS}
    numbers = {name: float(row[name]) if row[name] else None for name in NUMBERS}
    return Result(**given, **numbers)  # type: ignore[arg-type]
