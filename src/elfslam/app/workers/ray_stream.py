"""A stream of results in order from a Ray cluster, by Ray Data."""

from __future__ import annotations

import logging
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any, Generic

from elfslam.app.workers.interface import Result, Task
from elfslam.app.workers.processes import MOST_TRIES
from elfslam.app.workers.versions import Environment, done_by_the_same, own_version
from elfslam.base.errors import InputError, WorkerError
from elfslam.base.extras import installing

ASKED_AHEAD = 2
"""Results that are on their way from the cluster while one is worked on."""
STORE_BYTES = 64 * 2**20
"""What results may take in the cluster's memory for each processor before no more are made."""


@dataclass(frozen=True)
class TaskResult(Generic[Result]):
    """What came of a task. Ray Data would turn a bare number or array into one of its own kind."""

    result: Result | None
    error: Exception | None = None


def streamed(
    ray: Any, do: Callable[[Task], Result], tasks: Sequence[Task], processors: int
) -> Generator[Result]:
    """What `do` makes of the tasks, in order, as `Workers.in_order` says.

    Whoever hands the results on is an actor in the cluster, so that it makes no difference
    whether the driver is in it too or only knows its address. One that dies is replaced, and the
    stream goes on where it was.
    """
    taken, tries = 0, count(1)
    while taken < len(tasks):
        source = _source(ray, do, tasks[taken:], processors)
        try:
            for result in _handed_on(ray, source, len(tasks) - taken):
                taken += 1
                yield result
        except ray.exceptions.RayActorError as cause:
            if next(tries) == MOST_TRIES:
                raise WorkerError(
                    f"stream: its source in the cluster died {MOST_TRIES} times, "
                    "wanted it to live; look for a lack of memory"
                ) from cause
        finally:
            ray.kill(source)


def _handed_on(ray: Any, source: Any, left: int) -> Iterator[Any]:
    """The results of a source, a few of them asked for ahead."""
    waiting: deque[Any] = deque()
    for number in range(left):
        while len(waiting) <= ASKED_AHEAD and number + len(waiting) < left:
            waiting.append(source.next.remote())
        try:
            made = ray.get(waiting.popleft())
        except ray.exceptions.RayTaskError as error:
            raise WorkerError(
                f"stream: workers of the cluster died over one task or could not make it "
                f"({str(error).strip().splitlines()[-1]}); look for a lack of memory"
            ) from error
        if made.error is not None:
            raise made.error
        yield made.result


def _source(ray: Any, do: Callable[[Task], Result], tasks: Sequence[Task], processors: int) -> Any:
    """An actor that hands on what the cluster makes of the tasks."""
    actor = ray.remote(num_cpus=0)(_Source)
    return actor.remote(ray.put(do), ray.put(list(tasks)), own_version(), processors)


class _Source:
    """Lives in the cluster and reads the stream there."""

    def __init__(
        self, do: Callable[[Any], Any], tasks: list[Any], wanted: Environment, processors: int
    ) -> None:
        self._rows = _rows(do, tasks, wanted, processors)

    def next(self) -> Any:
        """The next result, as `TaskResult`."""
        return next(self._rows)


def _rows(
    do: Callable[[Any], Any], tasks: list[Any], wanted: Environment, processors: int
) -> Iterator[Any]:
    """Results in the order of the tasks: a block for each, so that no more wait than fit."""
    data = _ray_data()
    context = data.DataContext.get_current()
    context.enable_progress_bars = False
    context.execution_options.preserve_order = True
    context.execution_options.resource_limits = data.ExecutionResources(
        object_store_memory=STORE_BYTES * processors
    )

    def make(row: dict[str, Any]) -> dict[str, Any]:
        try:
            return {"made": TaskResult(done_by_the_same(wanted, do, tasks[int(row["id"])]))}
        except Exception as error:
            return {"made": TaskResult(None, error)}

    numbers = data.range(len(tasks), override_num_blocks=len(tasks))
    stream = numbers.map(make, num_cpus=1, max_retries=MOST_TRIES - 1)
    for batch in stream.iter_batches(batch_size=None, prefetch_batches=1):
        yield from batch["made"]


def _ray_data() -> Any:
    """Ray Data, which warns of its own settings when it is imported."""
    logging.getLogger("ray.data").setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import ray.data

            ray.data.DataContext.get_current()
            return ray.data
    except ImportError as cause:
        raise InputError(
            f"--on ray: Ray Data is not installed; {installing('scale')} of every node"
        ) from cause
