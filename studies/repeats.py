"""The repeats of a long study: done by whoever is asked, each kept in a file once it is done."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from elfslam.app.workers import Here, unit_key
from elfslam.base.errors import StoreError
from elfslam.data.folders import replaced_file
from studies.finding import Given

Task = TypeVar("Task")
Numbers = dict[str, float]
Units = dict[str, dict[str, Any]]
"""By key: the `task` as it is shown, and its `numbers`."""


class Placed(Protocol):
    """A task in a world."""

    @property
    def world(self) -> str:
        """Its name."""


def finished(
    measure: Callable[[Task], Numbers], tasks: Sequence[Task], given: Given
) -> list[Numbers]:
    """What `measure` makes of every task, by the workers given (this process where there are none).

    A unit is known by the digest of its inputs; what the kept file has of a run that was cut off
    is not made again. Raises StoreError where the file is damaged or of other tasks.
    """
    keys = [unit_key(measure, task) for task in tasks]
    found = _read(given.kept, keys)
    waiting = {key: task for key, task in zip(keys, tasks, strict=True) if key not in found}
    left = list(waiting)
    _announce(given, len(found), len(set(keys)))
    for index, numbers in (given.workers or Here()).each(measure, waiting.values()):
        found[left[index]] = {"task": repr(waiting[left[index]]), "numbers": numbers}
        _write(given.kept, found)
        _announce(given, len(found), len(set(keys)))
    return [found[key]["numbers"] for key in keys]


def by_world(tasks: Sequence[Placed], numbers: Sequence[Numbers]) -> dict[str, list[Numbers]]:
    """The numbers of each world's tasks, in the order of the tasks."""
    found: dict[str, list[Numbers]] = {}
    for task, each in zip(tasks, numbers, strict=True):
        found.setdefault(task.world, []).append(each)
    return found


def _announce(given: Given, done: int, of: int) -> None:
    given.announce(f"{done} of {of} repeats", done / of)


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
