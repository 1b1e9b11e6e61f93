"""What works through the queue: one job after the other, each in a process of its own.

One server alone works on the jobs of a data folder: it holds the lock on a file there, and so do
the processes of its jobs. Whoever gets the lock knows that nobody works on anything, and queues
again what was interrupted.
"""

from __future__ import annotations

import fcntl
import logging
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeVar

from sqlalchemy.exc import OperationalError

from elfslam.base.errors import InputError
from elfslam.serve.jobs.child import LOG as CHILD_LOG
from elfslam.serve.jobs.child import run_child
from elfslam.serve.jobs.folder import DISK_FULL
from elfslam.serve.jobs.queue import Claim, claim, finish, give_back, holds, queue_interrupted, tell
from elfslam.serve.jobs.results import keep
from elfslam.serve.jobs.tasks import lay_out
from elfslam.serve.problems import is_disk_full
from elfslam.serve.services import Services
from elfslam.serve.store.database import transaction

LOG = logging.getLogger("elfslam.serve")
LOCK = "jobs.lock"
FOLDERS = "job-"
"""How the names of jobs' folders begin."""
POLL_S = 1.0
"""Jobs that another server queued are found after this long."""
MISTAKE = "the server made a mistake over this job; its log says which"
LOG_CHARACTERS = 4000
T = TypeVar("T")


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
        while not _locked(file.fileno()):
            if stopping.wait(POLL_S):
                return
        for left in services.settings.work_folder.glob(f"{FOLDERS}*"):
            shutil.rmtree(left, ignore_errors=True)
        _patiently(stopping, partial(queue_interrupted, services.sessions))
        arguments = services, stopping, file.fileno()
        count = services.settings.job_workers
        workers = [threading.Thread(target=_work, args=arguments) for _ in range(count)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()


def _locked(file: int) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _work(services: Services, stopping: threading.Event, lock: int) -> None:
    while not stopping.is_set():
        services.jobs_wanted.clear()
        held = _patiently(stopping, partial(claim, services.sessions))
        if held is None:
            services.jobs_wanted.wait(POLL_S)
        else:
            _work_on(services, held, stopping, lock)


def _work_on(services: Services, held: Claim, stopping: threading.Event, lock: int) -> None:
    folder = services.settings.work_folder / f"{FOLDERS}{held.job_id}-{held.token[:8]}"
    problem = None
    try:
        folder.mkdir()
        _attempt(services, held, folder, stopping, lock)
    except InputError as error:
        problem = str(error)
    except Exception as error:
        LOG.exception("job %s failed", held.job_id)
        problem = DISK_FULL if is_disk_full(error) else MISTAKE
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if problem is not None:
        _patiently(stopping, partial(_fail, services, held, problem))


def _attempt(
    services: Services, held: Claim, folder: Path, stopping: threading.Event, lock: int
) -> None:
    lay_out(services, held, folder)
    told = partial(_told, services, held, stopping)
    longest_s = services.settings.limits.job_s
    result = run_child(folder, longest_s=longest_s, told=told, lock=lock)
    if result is not None:
        if result.problem is not None:
            _log(folder, held, result.problem)
        _patiently(stopping, partial(keep, services, held, folder, result))
    elif stopping.is_set():
        give_back(services.sessions, held)


def _told(
    services: Services,
    held: Claim,
    stopping: threading.Event,
    doing: str | None,
    share: float | None,
) -> bool:
    """Pass on what is being done; whether to go on. A database that is away stops nobody."""
    if stopping.is_set():
        return False
    try:
        if doing is None:
            return holds(services.sessions, held)
        return tell(services.sessions, held, doing, share)
    except OperationalError as error:
        LOG.warning("job %s: %s", held.job_id, error)
        return True


def _fail(services: Services, held: Claim, problem: str) -> None:
    with transaction(services.sessions) as session:
        finish(session, held, {}, problem)


def _patiently(stopping: threading.Event, act: Callable[[], T]) -> T | None:
    """What `act` gives, tried again while the database is away; nothing if the server stops."""
    while True:
        try:
            return act()
        except OperationalError as error:
            LOG.warning("the database does not answer, trying again: %s", error)
        if stopping.wait(POLL_S):
            return None


def _log(folder: Path, held: Claim, problem: str) -> None:
    """What the work's own process said of its failure, where it said anything."""
    said = (folder / CHILD_LOG).read_text(encoding="utf-8", errors="replace")[-LOG_CHARACTERS:]
    LOG.info("job %s: %s\n%s", held.job_id, problem, said.strip())
