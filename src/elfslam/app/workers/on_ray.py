"""Work on a Ray cluster. Nothing else imports Ray."""

from __future__ import annotations

import hashlib
import logging
import platform
import socket
import threading
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache, partial
from itertools import count, islice
from pathlib import Path
from typing import Any, Generic
from urllib.parse import urlsplit

import numpy as np

import elfslam
from elfslam import __version__
from elfslam.app.workers import (
    News,
    Result,
    Task,
    WorkerDiedError,
    WorkersAwayError,
    by_one_thread,
)
from elfslam.app.workers.processes import MOST_TRIES
from elfslam.base.errors import InputError, WorkerError
from elfslam.base.extras import installing

PACKAGE = Path(elfslam.__file__).parent
CODE = ("*.py", "*.onnx", "*.toml")


@dataclass(frozen=True)
class Environment:
    """What must be the same for results to be the same: this package, Python and NumPy."""

    elfslam: str
    code: str
    python: str
    numpy: str


@cache
def own_version() -> Environment:
    """The version of this process, its code by digest."""
    return Environment(__version__, code_digest(PACKAGE), platform.python_version(), np.__version__)


def code_digest(folder: Path) -> str:
    """Digest of the names and contents of the code in a folder, weights and worlds among it."""
    digest = hashlib.sha256()
    for file in sorted(file for pattern in CODE for file in folder.rglob(pattern)):
        digest.update(f"{file.relative_to(folder).as_posix()}\0".encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]


def done_by_the_same(wanted: Environment, do: Callable[[Task], Result], task: Task) -> Result:
    """What `do` makes of the task. Raises WorkerError where this is another version than wanted."""
    check_version(wanted, own_version())
    return do(task)


def check_version(wanted: Environment, got: Environment) -> None:
    """Raise WorkerError where two versions differ: in what, and how."""
    for name, value in vars(wanted).items():
        other = getattr(got, name)
        if other != value:
            raise WorkerError(
                f"worker {platform.node()}: got {name} {other}, wanted {value}; "
                "install the same version there"
            )


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
            f"on {address or 'ray'}: no cluster answers ({str(cause).splitlines()[0]}); "
            "start one with: ray start --head, and set RAY_AUTH_MODE=token if it wants a token",
            argument="on",
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
            f"on ray: Ray is not installed; {installing('scale')}, or name a number of processes",
            argument="on",
        ) from cause
    return ray


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
    actor = ray.remote(num_cpus=0)(_Source)
    return actor.remote(ray.put(do), ray.put(list(tasks)), own_version(), processors)


class _Source:
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
            f"on ray: Ray Data is not installed; {installing('scale')} of every node", argument="on"
        ) from cause
