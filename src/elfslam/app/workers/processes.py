"""Work in processes of this machine. One that dies costs the task that it was working on."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial

from elfslam.app.workers.interface import Result, Task
from elfslam.app.workers.units import by_one_thread
from elfslam.base.errors import WorkerError

MOST_TRIES = 3
"""A task over which so many processes died is given up."""
AHEAD = 2
"""Results in order that may wait for each process: none idles, and few are held."""
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
        stopping, alone = threading.Event(), partial(by_one_thread, do)

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
                        put((given[0], process.result(alone, given[1]), None))
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

    def in_order(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[Result]:
        """As `Workers` says."""
        idle: queue.SimpleQueue[_Process] = queue.SimpleQueue()

        def done(task: Task) -> Result:
            process = idle.get()
            try:
                return process.result(do, task)
            finally:
                idle.put(process)

        waiting: deque[Future[Result]] = deque()
        with ExitStack() as stack:
            for _ in range(self.count):
                idle.put(stack.enter_context(_Process()))
            threads = ThreadPoolExecutor(self.count)
            stack.callback(threads.shutdown, cancel_futures=True)
            for task in tasks:
                waiting.append(threads.submit(done, task))
                if len(waiting) > AHEAD * self.count:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()


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
        """What `do` makes of the task. Raises WorkerError where processes die over it.

        Ctrl-C is the driver's: what this thread starts does not hear it.
        """
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
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
        1, mp_context=multiprocessing.get_context("spawn"), initializer=end_with_the_driver
    )


def end_with_the_driver() -> None:
    """Have this process end once the one that started it has ended, however that came.

    Whoever goes on after a kill does the unit again; two at once would be in each other's way. A
    process of a pool does not notice by itself: it holds both ends of its pipe.
    """
    driver = multiprocessing.parent_process()
    if driver is not None:
        threading.Thread(target=_follow, args=(driver.join,), daemon=True).start()


def _follow(wait: Callable[[], object]) -> None:
    wait()
    os._exit(1)
