"""A server that works on several jobs at once: kills cost an attempt, three of them the job."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from tests.serve.jobs.conftest import start
from tests.waiting import until

pytestmark = pytest.mark.real
Json = dict[str, Any]
Remember = Callable[[TestClient, str], str]
Wait = Callable[[TestClient, str], Json]


@pytest.fixture
def settings(tmp_path: Path, database_url: str) -> ServerSettings:
    """Two processes of this machine work."""
    return ServerSettings(tmp_path / "data", database_url, secure_cookie=False, on="2")


def processes_of(services: Services) -> set[int]:
    """Those that work on jobs: what they say of trouble goes into the folder of one."""
    work, found = str(services.settings.work_folder), set()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if os.readlink(entry / "fd" / "2").startswith(work):
                found.add(int(entry.name))
        except OSError:
            continue
    return found


def held(services: Services) -> set[int]:
    """Those that work, each stopped where it is: none is done before another has begun."""
    working = processes_of(services)
    for process in working:
        os.kill(process, signal.SIGSTOP)
    return working


def killed(services: Services, times: int) -> None:
    """Kill the next processes that work, each once."""
    gone = set[int]()

    def enough() -> bool:
        for process in processes_of(services) - gone:
            os.kill(process, signal.SIGKILL)
            gone.add(process)
        return len(gone) >= times

    until(enough, f"{times} processes", between=lambda: time.sleep(0.005))


def test_two_jobs_at_once_and_one_killed_is_done_again(
    owner: TestClient, remember: Remember, ended: Wait, services: Services
) -> None:
    jobs = [start(owner, kind="map", recording=remember(owner, name)) for name in ("one", "two")]
    until(lambda: len(held(services)) == 2, "two processes at work")
    unlucky, lucky = sorted(processes_of(services))
    os.kill(unlucky, signal.SIGKILL)
    os.kill(lucky, signal.SIGCONT)
    found = [ended(owner, job) for job in jobs]
    assert [job["state"] for job in found] == ["done", "done"]
    assert sorted(job["attempts"] for job in found) == [1, 2]
    assert len(owner.get("/api/maps").json()) == 2
    assert list(services.settings.work_folder.iterdir()) == []


def test_a_job_whose_process_dies_three_times_is_given_up(
    owner: TestClient, remember: Remember, ended: Wait, services: Services
) -> None:
    job = start(owner, kind="map", recording=remember(owner, "one"))
    killed(services, 3)
    found = ended(owner, job)
    assert (found["state"], found["attempts"]) == ("failed", 3)
    assert "it was killed" in found["problem"]
    assert owner.get("/api/maps").json() == []
