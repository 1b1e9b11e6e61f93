"""Work in this process, one task after the other."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator

from elfslam.app.workers.interface import News, Result, Task
from elfslam.app.workers.units import by_one_thread


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
