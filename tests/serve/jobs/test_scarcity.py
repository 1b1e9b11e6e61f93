"""Jobs while something lacks: the disk's space, memory, time, or the database's attention."""

from __future__ import annotations

import sqlite3
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from elfslam.serve.jobs.executors import DISK_FULL
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from tests.disks import mounted
from tests.serve.jobs.conftest import start
from tests.waiting import until

pytestmark = pytest.mark.real

Json = dict[str, Any]
Remember = Callable[[TestClient, str], str]
Wait = Callable[[TestClient, str], Json]
MEBIBYTE = 2**20
LONGER_S = 12.0
"""SQLite waits for 10 s for somebody who writes."""


@pytest.fixture(params=[2, 5], ids=["for what is given", "for what is made"])
def small_work(settings: ServerSettings, request: pytest.FixtureRequest) -> Iterator[Path]:
    """The folder of scratch on a disk too small for a job; skips the test where none is made."""
    with mounted(settings.work_folder, size=request.param * MEBIBYTE) as place:
        yield place


def allow(services: Services, **limits: float) -> None:
    """Change the limits of a server that runs."""
    allowed = replace(services.settings.limits, **limits)  # type: ignore[arg-type]
    object.__setattr__(services.settings, "limits", allowed)


def left_over(services: Services) -> list[str]:
    return [item.name for item in services.settings.work_folder.iterdir()]


def test_a_full_disk_fails_the_job_until_there_is_room(
    small_work: Path, owner: TestClient, remember: Remember, ended: Wait, services: Services
) -> None:
    job_id = start(owner, kind="map", recording=remember(owner, "one"))
    job = ended(owner, job_id)
    assert (job["state"], job["problem"], job["gave"]) == ("failed", DISK_FULL, {})
    until(lambda: left_over(services) == [], "an empty folder of work")
    subprocess.run(["umount", str(small_work)], check=True)
    owner.post(f"/api/jobs/{job_id}/retry")
    assert ended(owner, job_id)["state"] == "done"


def test_a_database_that_is_busy_for_long_stops_no_job(
    owner: TestClient, remember: Remember, ended: Wait, services: Services
) -> None:
    job_id = start(owner, kind="map", recording=remember(owner, "mute"))
    other = sqlite3.connect(services.settings.data_folder / "elfslam.sqlite", isolation_level=None)
    while owner.get(f"/api/jobs/{job_id}").json()["state"] == "queued":
        time.sleep(0.02)
    other.execute("BEGIN IMMEDIATE")
    time.sleep(LONGER_S)
    assert owner.get(f"/api/jobs/{job_id}").json()["state"] == "running"
    other.execute("ROLLBACK")
    other.close()
    job = ended(owner, job_id)
    assert (job["state"], job["attempts"]) == ("done", 1)


def test_a_job_that_takes_too_much_memory_fails_alone(
    owner: TestClient, remember: Remember, ended: Wait, services: Services
) -> None:
    allow(services, job_bytes=MEBIBYTE)
    job = ended(owner, start(owner, kind="map", recording=remember(owner, "one")))
    assert job["state"] == "failed"
    assert "than the 0.00098 GiB" in job["problem"] or "ended in the middle" in job["problem"]
    until(lambda: left_over(services) == [], "an empty folder of work")


def test_a_job_that_takes_too_long_is_stopped(
    owner: TestClient, remember: Remember, ended: Wait, services: Services
) -> None:
    allow(services, job_s=0.01)
    job = ended(owner, start(owner, kind="map", recording=remember(owner, "mute")))
    assert job["state"] == "failed"
    assert "took longer" in job["problem"]
