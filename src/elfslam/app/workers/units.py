"""A unit of work: its key, and what may travel with it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from elfslam.app.workers.interface import Result, Task
from elfslam.base.values import Announce


def unit_key(do: Callable[..., Any], task: object) -> str:
    """The digest of a unit's inputs: which function, what it is given besides, and the task.

    Inputs count as they are shown (`repr`): frozen dataclasses and plain values show all of
    themselves; functions by their names. What only says how it goes (`silent_elsewhere`) does
    not count.
    """
    return hashlib.sha256(f"{_shown(do)}: {task!r}".encode()).hexdigest()[:24]


def _shown(value: object) -> str:
    if isinstance(value, partial):
        named = sorted(value.keywords.items())
        given = [*value.args, *(each for each in named if not isinstance(each[1], Announcement))]
        return f"{_shown(value.func)}({', '.join(_shown(each) for each in given)})"
    if isinstance(value, Mapping):
        return f"{{{', '.join(_shown(each) for each in value.items())}}}"
    if isinstance(value, tuple | list):
        return f"[{', '.join(_shown(each) for each in value)}]"
    if callable(value) and hasattr(value, "__qualname__"):
        return f"{value.__module__}.{value.__qualname__}"
    return repr(value)


def by_one_thread(do: Callable[[Task], Result], task: Task) -> Result:
    """What `do` makes of the task with one thread for its sums.

    How many threads share a sum decides its last bits, and workers of different kinds would differ.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        return do(task)


class Announcement:
    """Says how far the work is, where the driver runs, and nothing anywhere else."""

    def __init__(self, announce: Announce) -> None:
        self._announce = announce

    def __call__(self, text: str, share: float | None) -> None:
        """Say what is being done and how much of it is."""
        self._announce(text, share)

    def __reduce__(self) -> tuple[Callable[[Announce], Announcement], tuple[Announce]]:
        return Announcement, (_nothing,)


def silent_elsewhere(announce: Announce) -> Announcement:
    """`announce` for a unit's function: it may travel to another process, and is silent there."""
    return announce if isinstance(announce, Announcement) else Announcement(announce)


def _nothing(text: str, share: float | None) -> None:
    return None
