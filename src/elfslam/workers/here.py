"""Work in this process, one task after the other."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator

from elfslam.workers.interface import Result, Task


class Here:
    """This process."""

    count = 1

    def each(
        self, do: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """As `Workers` says; in the order of the tasks."""
        for index, task in enumerate(tasks):
            yield index, do(task)

    def in_order(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[Result]:
        """As `Workers` says; each when it is asked for."""
        for task in tasks:
            yield do(task)
