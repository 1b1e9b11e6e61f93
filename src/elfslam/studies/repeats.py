"""The repeats of a long study: several at a time, each kept in a file as soon as it is done."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Protocol, TypeVar

from elfslam.base.errors import StoreError
from elfslam.data.folders import new_file
from elfslam.studies.finding import Announce

Task = TypeVar("Task")
Numbers = dict[str, float]


class Placed(Protocol):
    """A task in a world."""

    @property
    def world(self) -> str:
        """Its name."""


def finished(
    measure: Callable[[Task], Numbers],
    tasks: Sequence[Task],
    announce: Announce,
    *,
    kept: Path | None,
    workers: int,
) -> list[Numbers]:
    """What `measure` makes of every task, `workers` of them at a time.

    A task is known by its repr; what the file `kept` has of a run that was cut off is not made
    again. Raises StoreError where the file is damaged or of other tasks.
    """
    names = [repr(task) for task in tasks]
    found = _read(kept, names)
    pool = ThreadPoolExecutor(workers)
    try:
        waiting = {
            pool.submit(measure, task): name
            for name, task in zip(names, tasks, strict=True)
            if name not in found
        }
        _announce(announce, len(found), len(names))
        for future in as_completed(waiting):
            found[waiting[future]] = future.result()
            _write(kept, found)
            _announce(announce, len(found), len(names))
    finally:
        pool.shutdown(cancel_futures=True)
    return [found[name] for name in names]


def by_world(tasks: Sequence[Placed], numbers: Sequence[Numbers]) -> dict[str, list[Numbers]]:
    """The numbers of each world's tasks, in the order of the tasks."""
    found: dict[str, list[Numbers]] = {}
    for task, each in zip(tasks, numbers, strict=True):
        found.setdefault(task.world, []).append(each)
    return found


def _announce(announce: Announce, done: int, of: int) -> None:
    announce(f"{done} of {of} repeats", done / of)


def _write(kept: Path | None, found: dict[str, Numbers]) -> None:
    if kept is not None:
        with new_file(kept) as partial:
            partial.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _read(kept: Path | None, names: Sequence[str]) -> dict[str, Numbers]:
    if kept is None or not kept.exists():
        return {}
    try:
        found: dict[str, Numbers] = dict(json.loads(kept.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as cause:
        raise StoreError(f"{kept}: cannot be read ({cause}); delete it to start over") from cause
    strange = set(found) - set(names)
    if strange:
        raise StoreError(f"{kept}: has {min(strange)} of another run; delete it to start over")
    return found
