"""Work in processes of this machine. One that dies costs the task that it was working on."""

from __future__ import annotations

import multiprocessing
import os
import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import suppress
from multiprocessing.connection import wait

from elfslam.base.errors import WorkerError
from elfslam.workers.interface import Result, Task

MOST_TRIES = 3
"""A task over which so many processes died is given up."""
Outcome = tuple[int, Result | None, BaseException | None]


class Processes:
    """So many processes of this machine, each fed by a thread of its own.

    A pool of several breaks as a whole when one of its processes is killed; these are pools of
    one.
    """

    def __init__(self, count: int) -> None:
        self.count = count

    def each(
        self, do: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """As `Workers` says."""
        numbered, turn = iter(enumerate(tasks)), threading.Lock()
        found: queue.Queue[Outcome[Result] | None] = queue.Queue(maxsize=2 * self.count)
        stopping = threading.Event()

        def next_task() -> tuple[int, Task] | None:
            with turn:
                return None if stopping.is_set() else next(numbered, None)

        def put(outcome: Outcome[Result] | None) -> None:
            while not stopping.is_set():
                with suppress(queue.Full):
                    return found.put(outcome, timeout=0.1)

        def work() -> None:
            with _Process() as process:
                while (given := next_task()) is not None:
                    try:
                        put((given[0], process.result(do, given[1]), None))
                    except BaseException as error:
                        put((given[0], None, error))
            put(None)

        threads = [threading.Thread(target=work, daemon=True) for _ in range(self.count)]
        for thread in threads:
            thread.start()
        try:
            yield from _taken(found, self.count)
        finally:
            stopping.set()
            for thread in threads:
                thread.join()


def _taken(
    found: queue.Queue[Outcome[Result] | None], workers: int
) -> Iterator[tuple[int, Result]]:
    """What is found until every worker has ended; the first error is raised."""
    while workers:
        outcome = found.get()
        if outcome is None:
            workers -= 1
            continue
        index, result, error = outcome
        if error is not None:
            raise error
        yield index, result  # type: ignore[misc]


class _Process:
    """One process, made anew where it dies."""

    def __init__(self) -> None:
        self._pool = _pool()

    def __enter__(self) -> _Process:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def result(self, do: Callable[[Task], Result], task: Task) -> Result:
        """What `do` makes of the task. Raises WorkerError where processes die over it."""
        for _ in range(MOST_TRIES):
            try:
                return self._pool.submit(do, task).result()
            except BrokenExecutor:
                self._pool.shutdown()
                self._pool = _pool()
        raise WorkerError(
            f"worker: {MOST_TRIES} processes died over {task!r}, wanted a result; "
            "look for a lack of memory, or do it in this process to see why"
        )


def _pool() -> ProcessPoolExecutor:
    # A forked process would inherit threads of torch and locks that nobody opens again.
    return ProcessPoolExecutor(
        1, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_the_driver
    )


def _end_with_the_driver() -> None:
    """Whoever goes on after a kill does the unit again; two at once would be in each other's way.

    A process of a pool does not notice by itself: it holds both ends of its pipe.
    """
    driver = multiprocessing.parent_process()
    assert driver is not None

    def watch() -> None:
        wait([driver.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
