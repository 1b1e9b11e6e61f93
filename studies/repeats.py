"""The repeats of a long study: done by whoever is asked, each kept in a file once it is done."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean
from typing import Any, TypeVar

from elfslam.app.workers import SerialWorkers, unit_key
from elfslam.base.errors import StoreError
from elfslam.data.atomic_files import replaced_file
from studies.results import Record
from studies.study import StudyContext

Task = TypeVar("Task")
Units = dict[str, dict[str, Any]]
"""By key: the `task` as it is shown, and its `records`."""


@dataclass
class SampledError(Exception):
    """What some repeats of a long study took, twice each, and how many it has; nothing is kept."""

    first_s: float
    again_s: float
    repeats: int


def finished(
    measure: Callable[[Task], Sequence[Record]], tasks: Sequence[Task], context: StudyContext
) -> list[list[Record]]:
    """What `measure` makes of every task, by the workers given (this process where there are none).

    A unit is known by the digest of its inputs; what the kept file has of a run that was cut off
    is not made again. Raises StoreError where the file is damaged or of other tasks, SampledError
    where the context asks for no more than the time of some.
    """
    if context.sample is not None:
        raise _sampled(measure, tasks, context.sample)
    keys = [unit_key(measure, task) for task in tasks]
    found = _read(context.kept, keys)
    waiting = {key: task for key, task in zip(keys, tasks, strict=True) if key not in found}
    left = list(waiting)
    _announce(context, len(found), len(set(keys)))
    for index, records in (context.workers or SerialWorkers()).each(measure, waiting.values()):
        units = [asdict(record) for record in records]
        found[left[index]] = {"task": repr(waiting[left[index]]), "records": units}
        _write(context.kept, found)
        _announce(context, len(found), len(set(keys)))
    return [[Record(**each) for each in found[key]["records"]] for key in keys]


def _sampled(
    measure: Callable[[Task], Sequence[Record]], tasks: Sequence[Task], count: int
) -> SampledError:
    """The seconds of tasks spread over all: with the cache as it was, and with what that left."""
    chosen = [tasks[(2 * k + 1) * len(tasks) // (2 * count)] for k in range(count)]
    first_s, again_s = _mean_s(measure, chosen), _mean_s(measure, chosen)
    return SampledError(first_s, again_s, len(tasks))


def _mean_s(measure: Callable[[Task], Sequence[Record]], tasks: Sequence[Task]) -> float:
    def seconds(task: Task) -> float:
        begun_s = time.monotonic()
        measure(task)
        return time.monotonic() - begun_s

    return mean(seconds(task) for task in tasks)


def _announce(context: StudyContext, done: int, of: int) -> None:
    context.announce(f"{done} of {of} repeats", done / of)


def _write(kept: Path | None, found: Units) -> None:
    if kept is not None:
        with replaced_file(kept) as partial:
            partial.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _read(kept: Path | None, keys: Sequence[str]) -> Units:
    if kept is None or not kept.exists():
        return {}
    try:
        found: Units = dict(json.loads(kept.read_text(encoding="utf-8")))
        strange = sorted(found[key]["task"] for key in set(found) - set(keys))
    except (OSError, ValueError, TypeError, KeyError) as cause:
        raise StoreError(f"{kept}: cannot be read ({cause}); delete it to start over") from cause
    if strange:
        raise StoreError(f"{kept}: has {strange[0]} of another run; delete it to start over")
    return found
