"""Where the server's jobs are done: in processes of this machine, or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from elfslam.app.workers import SerialWorkers, is_ray, open_watchers
from elfslam.serve.jobs.child import Begin, Progress, Result, begin_anew, child_news
from elfslam.serve.jobs.preforked import loaded
from elfslam.serve.jobs.queue import MOST_ATTEMPTS
from elfslam.serve.jobs.remote_executor import news_from

News = Iterator[Progress | Result]


@dataclass(frozen=True)
class Executor:
    """Where jobs are done, so many at once; one that kills its process is begun `tries` times.

    `news` does the task of a folder, as `child_news` does, and leaves there what was made.
    """

    count: int
    tries: int
    news: Callable[[Path, float, int], News]


@contextmanager
def open_place(on: str | None, count: int) -> Iterator[Executor]:
    """The place that `on` means, or else a new process of this machine for each job.

    Raises InputError where that is nobody, or a cluster that does not answer.
    """
    if on is None:
        yield Executor(count, 1, partial(_here, begin_anew))
    elif is_ray(on):
        with open_watchers(on) as cluster:
            yield Executor(cluster.count, MOST_ATTEMPTS, partial(news_from, cluster))
    else:
        with ExitStack() as stack:
            ready: SimpleQueue[Begin] = SimpleQueue()
            for _ in range(int(on)):
                ready.put(stack.enter_context(loaded()).begin)
            yield Executor(int(on), MOST_ATTEMPTS, partial(_by_the_next, ready))


def _here(begin: Begin, folder: Path, longest_s: float, lock: int) -> News:
    return SerialWorkers().watch(
        partial(child_news, longest_s=longest_s, lock=lock, begin=begin), folder
    )


def _by_the_next(ready: SimpleQueue[Begin], folder: Path, longest_s: float, lock: int) -> News:
    """By one that is idle: there are as many as may work at once."""
    begin = ready.get()
    try:
        yield from _here(begin, folder, longest_s, lock)
    finally:
        ready.put(begin)
