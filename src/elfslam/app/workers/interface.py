"""What all workers have in common, units of work, and this process as the simplest worker."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from functools import partial
from typing import Any, Protocol, TypeVar

from elfslam.base.errors import WorkerError
from elfslam.base.values import Announce

Task = TypeVar("Task")
Result = TypeVar("Result")
News = TypeVar("News")


class Workers(Protocol):
    """They do the same to many tasks."""

    @property
    def count(self) -> int:
        """How many tasks are worked on at once."""

    def each(
        self, do: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """The number of each task and what `do` makes of it, as they get done.

        Tasks are taken as they are needed, a few ahead, and results are not kept, so memory does
        not grow with their number. Where the work is done elsewhere, `do`, tasks and results are
        pickled. What `do` raises is raised here, once what is under way has been given up.
        Raises WorkerError where workers die again and again over one task, or are of another
        version.
        """

    def in_order(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[Result]:
        """What `do` makes of the tasks, in their order, whoever of the workers is done first.

        A few are made ahead of whoever takes them, and no more, however slowly they are taken.
        Otherwise as `each`; the tasks must come to an end where the workers are a cluster.
        """


class Watchers(Protocol):
    """They do one long thing at a time, and say how it goes."""

    @property
    def count(self) -> int:
        """How many may be watched at once, each by a thread of its own."""

    def watch(self, do: Callable[[Task], Iterator[News]], task: Task) -> Iterator[News | None]:
        """What `do` says of a task as it comes, and nothing every while.

        Whoever closes it ends the work. Where that is done elsewhere, `do`, the task and what is
        said are pickled. Raises WorkerDiedError where the worker died in the middle,
        WorkersAwayError where all of them are gone, WorkerError where it is of another version,
        and what `do` raises.
        """


class WorkerDiedError(WorkerError):
    """A worker died in the middle of its work, which can be done again."""


class WorkersAwayError(WorkerError):
    """Whoever had the workers is gone; they have to be opened again."""


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


class SerialWorkers:
    """This process."""

    count = 1

    def each(
        self, do: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """As `Workers` says; in the order of the tasks."""
        for index, task in enumerate(tasks):
            yield index, by_one_thread(do, task)

    def in_order(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[Result]:
        """As `Workers` says; each when it is asked for."""
        for task in tasks:
            yield do(task)

    def watch(self, do: Callable[[Task], Iterator[News]], task: Task) -> Iterator[News]:
        """As `Watchers` says; `do` itself says nothing every while."""
        return do(task)
