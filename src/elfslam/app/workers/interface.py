"""What all workers have in common."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Protocol, TypeVar

from elfslam.base.errors import WorkerError

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
