"""What is cleared away: leftovers of a kill, and uploads that were abandoned."""

from __future__ import annotations

import base64
import logging
import os
import time
from pathlib import Path

import pytest
from sqlalchemy import select
from starlette.testclient import TestClient

from elfslam.serve.jobs.queue import queue_job
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import Blob, blob_path, put
from elfslam.serve.store.database import transaction
from elfslam.serve.store.sweeps import (
    AGES,
    Age,
    expire,
    grown,
    older_than,
    put_back,
    read_ages,
    set_aside,
    tidy,
    unnamed_blobs,
    write_ages,
)
from elfslam.serve.store.tables import JobFile, JobKind, User

DATABASES = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)

TUS = {"Tus-Resumable": "1.0.0"}
DAY_S = 86_400.0


def begun(client: TestClient) -> str:
    made = client.post("/api/recordings", json={"name": "walk"}).json()["id"]
    told = [
        f"{k} {base64.b64encode(v.encode()).decode()}"
        for k, v in {"recording": made, "filename": "wifi.csv"}.items()
    ]
    headers = {**TUS, "Upload-Metadata": ",".join(told), "Upload-Length": "9"}
    place = client.post("/api/uploads", headers=headers).headers["location"]
    return str(place).rpartition("/")[2]


def unnamed(services: Services, content: bytes = b"no row") -> Blob:
    file = services.settings.work_folder / "content"
    file.write_bytes(content)
    return put(services.settings.blobs_folder, file)


def aside(services: Services) -> set[str]:
    return {file.name for file in services.settings.quarantine_folder.iterdir()}


@DATABASES
def test_leftovers_of_a_kill_are_set_aside_and_uploads_stay(
    owner: TestClient, services: Services, caplog: pytest.LogCaptureFixture
) -> None:
    upload, settings = begun(owner), services.settings
    (settings.uploads_folder / ("0" * 32)).write_bytes(b"no row")
    (settings.uploads_folder / f"{upload}.piece").write_bytes(b"unchecked")
    (settings.work_folder / "reading-00").mkdir()
    blob = unnamed(services)
    with caplog.at_level(logging.WARNING):
        tidy(services)
    assert [file.name for file in settings.uploads_folder.iterdir()] == [upload]
    assert not (settings.work_folder / "reading-00").exists()
    assert list(settings.blobs_folder.glob("*/*")) == []
    assert aside(services) == {"0" * 32, f"{upload}.piece", blob.sha256}
    assert "3 files that nobody names were set aside" in caplog.text


@DATABASES
def test_what_is_named_again_is_put_back(owner: TestClient, services: Services) -> None:
    blob = unnamed(services)
    tidy(services)
    job_id = _job_that_names(services, blob)
    tidy(services)
    kept = blobs.blob_path(services.settings.blobs_folder, blob.sha256)
    assert kept.read_bytes() == b"no row"
    assert aside(services) == set()
    assert job_id


def _job_that_names(services: Services, blob: Blob) -> str:
    with transaction(services.sessions) as session:
        user = session.scalars(select(User)).first()
        assert user is not None
        job = queue_job(session, user.id, JobKind.MAP, {})
        row = JobFile(job_id=job.id, name="f", sha256=blob.sha256, size_bytes=blob.size_bytes)
        session.add(row)
        return job.id


@DATABASES
def test_what_is_named_and_gone_is_said(
    owner: TestClient, services: Services, caplog: pytest.LogCaptureFixture
) -> None:
    blob = unnamed(services)
    _job_that_names(services, blob)
    blobs.blob_path(services.settings.blobs_folder, blob.sha256).unlink()
    tidy(services)
    assert "1 files that recordings and maps name are missing" in caplog.text


@DATABASES
def test_a_quarantine_ends_after_its_days_of_running(owner: TestClient, services: Services) -> None:
    unnamed(services)
    tidy(services)
    days = services.settings.limits.quarantine_days
    expire(services, 0.0)
    expire(services, (days - 1) * DAY_S)
    assert len(aside(services)) == 1
    expire(services, 2 * DAY_S)
    assert aside(services) == set()


@DATABASES
def test_abandoned_uploads_expire_by_the_time_that_the_server_ran(
    owner: TestClient, services: Services
) -> None:
    kept, left, days = begun(owner), begun(owner), services.settings.limits.upload_days
    assert expire(services, 0.0) == []
    assert expire(services, (days - 1) * DAY_S) == []
    (services.settings.uploads_folder / kept).write_bytes(b"more")
    with services.busy.alone([left]):
        assert expire(services, 2 * DAY_S) == []
    assert expire(services, 0.0) == [left]
    assert owner.head(f"/api/uploads/{left}", headers=TUS).status_code == 404
    assert owner.head(f"/api/uploads/{kept}", headers=TUS).status_code == 200


@DATABASES
def test_a_clock_that_is_set_forward_makes_nothing_old(
    owner: TestClient, services: Services, monkeypatch: pytest.MonkeyPatch
) -> None:
    upload = begun(owner)
    unnamed(services)
    tidy(services)
    expire(services, 0.0)
    old_s = time.time() - 1000 * DAY_S
    for file in (services.settings.uploads_folder / upload, *_files(services)):
        os.utime(file, (old_s, old_s))
    assert expire(services, 3600.0) == []
    assert len(aside(services)) == 1


def _files(services: Services) -> list[Path]:
    return list(services.settings.quarantine_folder.iterdir())


def test_ages_grow_begin_anew_and_go() -> None:
    before = {"same": Age(3, 10.0), "grew": Age(3, 10.0), "gone": Age(1, 10.0)}
    after = grown(before, {"same": 3, "grew": 4, "new": 0}, 5.0)
    assert after == {"same": Age(3, 15.0), "grew": Age(4, 0.0), "new": Age(0, 0.0)}


def test_only_what_is_older_is_found() -> None:
    ages = {"old": Age(1, 86_401.0), "young": Age(1, 86_400.0)}
    assert older_than(ages, 1.0) == ["old"]


def test_ages_are_kept(tmp_path: Path) -> None:
    write_ages(tmp_path, {"upload a": Age(5, 7.5)})
    assert read_ages(tmp_path) == {"upload a": Age(5, 7.5)}


@pytest.mark.parametrize("content", [b"", b"[1]", b'{"a": 3}', b"\xff", b"[" * 100_000])
def test_damaged_ages_begin_anew(tmp_path: Path, content: bytes) -> None:
    (tmp_path / AGES).write_bytes(content)
    assert read_ages(tmp_path) == {}


NAMED, UNNAMED = "a" * 64, "b" * 64


def test_what_is_named_stays_and_the_rest_is_moved_whole(tmp_path: Path) -> None:
    blobs, quarantine = tmp_path / "blobs", tmp_path / "quarantine"
    quarantine.mkdir()
    for name in (NAMED, UNNAMED):
        blob_path(blobs, name).parent.mkdir(parents=True)
        blob_path(blobs, name).write_text(name)
    (blobs / "aa" / "0123.partial").write_text("half")
    found = unnamed_blobs(blobs, lambda sha256: sha256 == NAMED)
    assert set_aside(found, quarantine) == 2
    assert {file.name for file in blobs.glob("*/*")} == {NAMED}
    assert (quarantine / UNNAMED).read_text() == UNNAMED
    assert put_back(quarantine, blobs, lambda sha256: True) == 1
    assert blob_path(blobs, UNNAMED).read_text() == UNNAMED
    assert [file.name for file in quarantine.iterdir()] == ["0123.partial"]
