"""One long thing at a time on a cluster, watched: whoever works there can be asked and stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

from elfslam.app.workers.interface import News, Task, WorkerDiedError, WorkersAwayError
from elfslam.app.workers.versions import Environment, check_version, own_version

ASK_S = 0.25
"""How often a desk is asked what there is to say."""
STOP_S = 5.0
"""A desk that was told to stop and has not by then is killed."""
AT_ONCE = 3
"""Calls to a desk at once: one works, the others ask and stop it."""


class TaskMonitor:
    """Lives on the cluster, in a process of its own."""

    def __init__(self) -> None:
        self._said: list[Any] = []
        self._lock, self._stopped = threading.Lock(), threading.Event()

    def work(self, wanted: Environment, do: Callable[[Any], Any], task: Any) -> None:
        """Do it, until it is done or stopped. Raises WorkerError where this is another version."""
        check_version(wanted, own_version())
        self._stopped.clear()
        with closing(do(task)) as news:
            for said in news:
                if self._stopped.is_set():
                    return
                if said is not None:
                    with self._lock:
                        self._said.append(said)

    def heard(self) -> list[Any]:
        """What was said since it was asked last."""
        with self._lock:
            said, self._said = self._said, []
        return said

    def stop(self) -> None:
        """End the work as soon as it says anything, be it nothing."""
        self._stopped.set()


def watched(
    ray: Any, desk: Any, do: Callable[[Task], Iterator[News]], task: Task
) -> Iterator[News | None]:
    """What a desk says of a task. It is gone afterwards where this raises or is closed."""
    done, over = None, False
    try:
        done = desk.work.remote(own_version(), do, task)
        while not over:
            over = bool(ray.wait([done], timeout=ASK_S)[0])
            if over:
                ray.get(done)
            yield from ray.get(desk.heard.remote()) or [None]
    except ray.exceptions.RayTaskError as error:
        over = True
        raise error.cause if isinstance(error.cause, Exception) else error from error
    except ray.exceptions.RayActorError as cause:
        over = True
        raise WorkerDiedError(
            "worker: one of the cluster died in the middle; do it again"
        ) from cause
    except (ray.exceptions.RaySystemError, ConnectionError) as cause:
        over = True
        raise WorkersAwayError(
            f"cluster: is gone ({str(cause).splitlines()[0]}); start it again"
        ) from cause
    finally:
        if not over and done is not None:
            _stop(ray, desk, done)


def _stop(ray: Any, desk: Any, done: Any) -> None:
    """Have it end in order, so that it leaves nothing behind; or else end it."""
    try:
        desk.stop.remote()
        ray.wait([done], timeout=STOP_S)
        ray.kill(desk)
    except (ray.exceptions.RayError, ConnectionError):
        return
