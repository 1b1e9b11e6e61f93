"""Work on a Ray cluster. Nothing else imports Ray."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from typing import Any
from urllib.parse import urlsplit

from elfslam.app.workers.interface import News, Result, Task
from elfslam.app.workers.processes import MOST_TRIES
from elfslam.app.workers.ray_stream import streamed
from elfslam.app.workers.task_monitor import AT_ONCE, TaskMonitor, watched
from elfslam.app.workers.units import by_one_thread
from elfslam.app.workers.versions import done_by_the_same, own_version
from elfslam.base.errors import InputError, WorkerError
from elfslam.base.extras import installing

PORT, KNOCK_S = 10001, 5.0
AHEAD = 2
"""Tasks that wait in the cluster for each processor: none idles, and the driver holds few."""


@contextmanager
def open_cluster(address: str | None) -> Iterator[Cluster]:
    """The cluster at an address (`ray://HOST:PORT`), or one that Ray finds or starts here.

    Raises InputError where Ray is not installed or the cluster does not answer.
    """
    ray = _ray()
    try:
        if address is not None:
            knock(address)
        ray.init(address, logging_level=logging.ERROR, log_to_driver=False)
    except (OSError, RuntimeError, ValueError) as cause:
        raise InputError(
            f"--on {address or 'ray'}: no cluster answers ({str(cause).splitlines()[0]}); "
            "start one with: ray start --head, and set RAY_AUTH_MODE=token if it wants a token"
        ) from cause
    try:
        yield Cluster(ray)
    finally:
        ray.shutdown()


class Cluster:
    """The processors of a Ray cluster."""

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self.count = max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._free: list[Any] = []

    def each(
        self, do: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """As `Workers` says. A task whose worker dies is done again, elsewhere."""
        ray, wanted = self._ray, own_version()
        work = ray.remote(max_retries=MOST_TRIES - 1, num_cpus=1)(done_by_the_same)
        done = ray.put(partial(by_one_thread, do))
        waiting: dict[Any, int] = {}
        numbered = iter(enumerate(tasks))
        # Whoever stops early lets the few that wait be done in vain: Ray aborts this process
        # where a task is cancelled as its result arrives (ray-project/ray, pull request 54798).
        while True:
            for index, task in islice(numbered, AHEAD * self.count - len(waiting)):
                waiting[work.remote(wanted, done, task)] = index
            if not waiting:
                return
            for reference in ray.wait(list(waiting), num_returns=1)[0]:
                yield waiting.pop(reference), self._result(reference)

    def in_order(self, do: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[Result]:
        """As `Workers` says; by Ray Data."""
        return streamed(self._ray, do, list(tasks), self.count)

    def watch(self, do: Callable[[Task], Iterator[News]], task: Task) -> Iterator[News | None]:
        """As `Watchers` says. Who worked before works again, which costs no start."""
        kind = self._ray.remote(num_cpus=1, max_concurrency=AT_ONCE)(TaskMonitor)
        try:
            desk = self._free.pop()
        except IndexError:
            desk = kind.remote()
        yield from watched(self._ray, desk, do, task)
        self._free.append(desk)

    def _result(self, reference: Any) -> Any:
        try:
            return self._ray.get(reference)
        except self._ray.exceptions.RayTaskError as error:
            raise error.cause if isinstance(error.cause, Exception) else error from error
        except self._ray.exceptions.WorkerCrashedError as cause:
            raise WorkerError(
                f"worker: {MOST_TRIES} of the cluster died over one task, wanted a result; "
                "look for a lack of memory"
            ) from cause


def knock(address: str) -> None:
    """Raise OSError at once where nobody listens: Ray itself would try for half a minute."""
    place = urlsplit(address)
    with socket.create_connection((place.hostname or "", place.port or PORT), timeout=KNOCK_S):
        pass


def _ray() -> Any:
    try:
        import ray
    except ImportError as cause:
        raise InputError(
            f"--on ray: Ray is not installed; {installing('scale')}, or name a number of processes"
        ) from cause
    return ray
