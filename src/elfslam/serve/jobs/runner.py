"""What works through the queue: one job after the other, each in a process of its own.

Those processes are where `open_executor` has them: on this machine, or on a cluster.

One server alone works on the jobs of a data folder: it holds the lock on a file there, and so do
the processes of its jobs. Whoever gets the lock knows that nobody works on anything, and queues
again what was interrupted.
"""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from sqlalchemy.exc import OperationalError

from elfslam.app.workers import WorkerDiedError, WorkersAwayError
from elfslam.base.errors import InputError, WorkerError
from elfslam.serve.jobs import queue
from elfslam.serve.jobs.executors import (
    DISK_FULL,
    Events,
    Executor,
    Progress,
    Result,
    open_executor,
)
from elfslam.serve.jobs.executors import LOG as CHILD_LOG
from elfslam.serve.jobs.results import keep
from elfslam.serve.jobs.tasks import lay_out
from elfslam.serve.problems import is_disk_full
from elfslam.serve.services import Services
from elfslam.serve.store.database import transaction
from elfslam.serve.store.opening import locked_now

LOG = logging.getLogger("elfslam.serve")
LOCK = "jobs.lock"
FOLDERS = "job-"
"""How the names of jobs' folders begin."""
POLL_S = 1.0
"""Jobs that another server queued are found after this long."""
AWAY_S = 5.0
"""How long until a cluster that was away is asked for again."""
MISTAKE = "the server made a mistake over this job; its log says which"
LOG_CHARACTERS = 4000
T = TypeVar("T")


@dataclass(frozen=True)
class WorkerContext:
    """What the threads that work on jobs have in common."""

    services: Services
    stopping: threading.Event
    lock: int
    executor: Executor
    away: threading.Event
    """Set where the workers of the executor are gone."""
    since_s: float
    """When the server began to work on jobs, by the monotonic clock."""


@contextmanager
def run_jobs(services: Services) -> Iterator[None]:
    """Work on jobs as long as the server runs. What is unfinished at the end is queued again."""
    if not services.settings.run_jobs:
        yield
        return
    stopping = threading.Event()
    thread = threading.Thread(target=_work_alone, args=(services, stopping), name="jobs")
    thread.start()
    try:
        yield
    finally:
        stopping.set()
        services.jobs_wanted.set()
        thread.join()


def _work_alone(services: Services, stopping: threading.Event) -> None:
    with (services.settings.data_folder / LOCK).open("w") as file:
        while not locked_now(file.fileno()):
            if stopping.wait(POLL_S):
                return
        for left in services.settings.work_folder.glob(f"{FOLDERS}*"):
            shutil.rmtree(left, ignore_errors=True)
        _patiently(stopping, partial(queue.queue_interrupted, services.sessions))
        since_s = time.monotonic()
        while not stopping.is_set():
            try:
                _work_there(services, stopping, file.fileno(), since_s)
            except (InputError, WorkerError) as error:
                LOG.warning("jobs wait: %s", error)
                stopping.wait(AWAY_S)


def _work_there(services: Services, stopping: threading.Event, lock: int, since_s: float) -> None:
    """Work until the server stops, or those who work are gone. Raises InputError, WorkerError."""
    settings = services.settings
    with open_executor(settings.on, settings.job_workers) as executor:
        bench = WorkerContext(services, stopping, lock, executor, threading.Event(), since_s)
        workers = [threading.Thread(target=_work, args=(bench,)) for _ in range(executor.count)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        if bench.away.is_set():
            raise WorkersAwayError("the cluster is gone; asking for it again")


def _work(bench: WorkerContext) -> None:
    services = bench.services
    while not bench.stopping.is_set() and not bench.away.is_set():
        services.jobs_wanted.clear()
        begun = queue.begun_at_most(time.monotonic() - bench.since_s)
        held = _patiently(bench.stopping, partial(queue.claim, services.sessions, begun))
        if held is None:
            services.jobs_wanted.wait(POLL_S)
        else:
            _work_on(bench, held)


def _work_on(bench: WorkerContext, held: queue.Claim) -> None:
    services = bench.services
    folder = services.settings.work_folder / f"{FOLDERS}{held.job_id}-{held.token[:8]}"
    problem = None
    try:
        folder.mkdir()
        _attempt(bench, held, folder)
    except InputError as error:
        problem = str(error)
    except WorkerError as error:
        _put_back(bench, held, error)
    except Exception as error:
        LOG.exception("job %s failed", held.job_id)
        problem = DISK_FULL if is_disk_full(error) else MISTAKE
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if problem is not None:
        _patiently(bench.stopping, partial(_fail, services, held, problem))


def _attempt(bench: WorkerContext, held: queue.Claim, folder: Path) -> None:
    services = bench.services
    lay_out(services, held, folder)
    longest_s = services.settings.limits.job_s
    result = _result(bench, held, bench.executor.work(folder, longest_s, bench.lock))
    if result is None:
        if bench.stopping.is_set():
            queue.give_back(services.sessions, held)
        return
    if result.problem is not None:
        _log(folder, held, result.problem)
    if result.died and held.attempt < bench.executor.tries:
        _patiently(bench.stopping, partial(queue.begin_again, services.sessions, held))
    else:
        _patiently(bench.stopping, partial(keep, services, held, folder, result))


def _result(bench: WorkerContext, held: queue.Claim, events: Events) -> Result | None:
    """What came of a job, nothing where it was given up before; its progress is told meanwhile."""
    with closing(events):  # type: ignore[type-var]
        try:
            for event in events:
                if isinstance(event, Result):
                    return event
                if not _goes_on(bench, held, event):
                    return None
        except WorkerDiedError as error:
            return Result(None, str(error), died=True)
    raise WorkersAwayError("the cluster stopped in the middle; asking for it again")


def _put_back(bench: WorkerContext, held: queue.Claim, error: WorkerError) -> None:
    """Nobody there can do a job that is not at fault: it waits."""
    LOG.warning("job %s waits: %s", held.job_id, error)
    if isinstance(error, WorkersAwayError):
        bench.away.set()
    _patiently(bench.stopping, partial(queue.give_back, bench.services.sessions, held))
    bench.stopping.wait(POLL_S)


def _goes_on(bench: WorkerContext, held: queue.Claim, progress: Progress | None) -> bool:
    """Pass progress on; whether to go on. A database that is away stops nobody."""
    if bench.stopping.is_set():
        return False
    sessions = bench.services.sessions
    try:
        return (
            queue.holds(sessions, held)
            if progress is None
            else queue.tell(sessions, held, progress)
        )
    except OperationalError as error:
        LOG.warning("job %s: %s", held.job_id, error)
        return True


def _fail(services: Services, held: queue.Claim, problem: str) -> None:
    with transaction(services.sessions) as session:
        queue.finish(session, held, {}, problem)


def _patiently(stopping: threading.Event, act: Callable[[], T]) -> T | None:
    """What `act` gives, tried again while the database is away; nothing if the server stops."""
    while True:
        try:
            return act()
        except OperationalError as error:
            LOG.warning("the database does not answer, trying again: %s", error)
        if stopping.wait(POLL_S):
            return None


def _log(folder: Path, held: queue.Claim, problem: str) -> None:
    """What the work's own process said of its failure, where it said anything."""
    file = folder / CHILD_LOG
    said = file.read_text(encoding="utf-8", errors="replace") if file.exists() else ""
    said = said[-LOG_CHARACTERS:]
    LOG.info("job %s: %s\n%s", held.job_id, problem, said.strip())
