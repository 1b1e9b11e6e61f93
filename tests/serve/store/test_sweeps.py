"""What is cleared away: leftovers of a kill, and uploads that were abandoned."""

import logging
import os
import time
from pathlib import Path

import pytest
from sqlalchemy import select

from elfslam.serve.jobs.queue import queue_job
from elfslam.serve.services import Services
from elfslam.serve.store import blobs, sweeps
from elfslam.serve.store.blobs import Blob, blob_path, put
from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import JobFile, JobKind, User
from studies.benchmarks.served import TUS
from tests.serve.conftest import DATABASES, Somebody
from tests.serve.uploading import uploading

DAY_S = 86_400.0


def begun(client: Somebody) -> str:
    return uploading(client, 9).rpartition("/")[2]


def unnamed(services: Services, content: bytes = b"no row") -> Blob:
    file = services.settings.work_folder / "content"
    file.write_bytes(content)
    return put(services.settings.blobs_folder, file)


def aside(services: Services) -> set[str]:
    return {file.name for file in services.settings.quarantine_folder.iterdir()}


@DATABASES
def test_leftovers_of_a_kill_are_set_aside_and_uploads_stay(
    owner: Somebody, services: Services, caplog: pytest.LogCaptureFixture
) -> None:
    upload, settings = begun(owner), services.settings
    (settings.uploads_folder / ("0" * 32)).write_bytes(b"no row")
    (settings.uploads_folder / f"{upload}.piece").write_bytes(b"unchecked")
    (settings.work_folder / "reading-00").mkdir()
    blob = unnamed(services)
    with caplog.at_level(logging.WARNING):
        sweeps.tidy(services)
    assert [file.name for file in settings.uploads_folder.iterdir()] == [upload]
    assert not (settings.work_folder / "reading-00").exists()
    assert list(settings.blobs_folder.glob("*/*")) == []
    assert aside(services) == {"0" * 32, f"{upload}.piece", blob.sha256}
    assert "3 files that nobody names were set aside" in caplog.text


@DATABASES
def test_what_is_named_again_is_put_back(owner: Somebody, services: Services) -> None:
    blob = unnamed(services)
    sweeps.tidy(services)
    _job_that_names(services, blob)
    sweeps.tidy(services)
    kept = blobs.blob_path(services.settings.blobs_folder, blob.sha256)
    assert kept.read_bytes() == b"no row"
    assert aside(services) == set()


def _job_that_names(services: Services, blob: Blob) -> None:
    with transaction(services.sessions) as session:
        user = session.scalars(select(User)).first()
        assert user is not None
        job = queue_job(session, user.id, JobKind.MAP, {})
        row = JobFile(job_id=job.id, name="f", sha256=blob.sha256, size_bytes=blob.size_bytes)
        session.add(row)


@DATABASES
def test_what_is_named_and_gone_is_said(owner: Somebody, caplog: pytest.LogCaptureFixture) -> None:
    blob = unnamed(owner.services)
    _job_that_names(owner.services, blob)
    blobs.blob_path(owner.services.settings.blobs_folder, blob.sha256).unlink()
    sweeps.tidy(owner.services)
    assert "1 files that recordings and maps name are missing" in caplog.text


@DATABASES
def test_a_quarantine_ends_after_its_days_of_running(owner: Somebody, services: Services) -> None:
    unnamed(services)
    sweeps.tidy(services)
    days = services.settings.limits.quarantine_days
    sweeps.expire(services, 0.0)
    sweeps.expire(services, (days - 1) * DAY_S)
    assert len(aside(services)) == 1
    sweeps.expire(services, 2 * DAY_S)
    assert aside(services) == set()


@DATABASES
def test_abandoned_uploads_expire_by_the_time_that_the_server_ran(owner: Somebody) -> None:
    kept, left, days = begun(owner), begun(owner), owner.services.settings.limits.upload_days
    assert sweeps.expire(owner.services, 0.0) == []
    assert sweeps.expire(owner.services, (days - 1) * DAY_S) == []
    (owner.services.settings.uploads_folder / kept).write_bytes(b"more")
    with owner.services.busy.alone([left]):
        assert sweeps.expire(owner.services, 2 * DAY_S) == []
    assert sweeps.expire(owner.services, 0.0) == [left]
    assert owner.head(f"/api/uploads/{left}", headers=TUS).status_code == 404
    assert owner.head(f"/api/uploads/{kept}", headers=TUS).status_code == 200


@DATABASES
def test_a_clock_that_is_set_forward_makes_nothing_old(owner: Somebody, services: Services) -> None:
    upload = begun(owner)
    unnamed(services)
    sweeps.tidy(services)
    sweeps.expire(services, 0.0)
    old_s = time.time() - 1000 * DAY_S
    waiting = services.settings.quarantine_folder.iterdir()
    for file in (services.settings.uploads_folder / upload, *waiting):
        os.utime(file, (old_s, old_s))
    assert sweeps.expire(services, 3600.0) == []
    assert len(aside(services)) == 1


def test_ages_grow_begin_anew_and_go() -> None:
    before = {"same": sweeps.Age(3, 10.0), "grew": sweeps.Age(3, 10.0), "gone": sweeps.Age(1, 10.0)}
    after = sweeps.grown(before, {"same": 3, "grew": 4, "new": 0}, 5.0)
    assert after == {
        "same": sweeps.Age(3, 15.0),
        "grew": sweeps.Age(4, 0.0),
        "new": sweeps.Age(0, 0.0),
    }


def test_only_what_is_older_is_found() -> None:
    ages = {"old": sweeps.Age(1, 86_401.0), "young": sweeps.Age(1, 86_400.0)}
    assert sweeps.older_than(ages, 1.0) == ["old"]


def test_ages_are_kept(tmp_path: Path) -> None:
    sweeps.write_ages(tmp_path, {"upload a": sweeps.Age(5, 7.5)})
    assert sweeps.read_ages(tmp_path) == {"upload a": sweeps.Age(5, 7.5)}


@pytest.mark.parametrize("content", [b"", b"[1]", b'{"a": 3}', b"\xff", b"[" * 100_000])
def test_damaged_ages_begin_anew(tmp_path: Path, content: bytes) -> None:
    (tmp_path / sweeps.AGES).write_bytes(content)
    assert sweeps.read_ages(tmp_path) == {}


NAMED, UNNAMED = "a" * 64, "b" * 64


def test_what_is_named_stays_and_the_rest_is_moved_whole(tmp_path: Path) -> None:
    blobs, quarantine = tmp_path / "blobs", tmp_path / "quarantine"
    quarantine.mkdir()
    for name in (NAMED, UNNAMED):
        blob_path(blobs, name).parent.mkdir(parents=True)
        blob_path(blobs, name).write_text(name)
    (blobs / "aa" / "0123.partial").write_text("half")
    found = sweeps.unnamed_blobs(blobs, lambda sha256: sha256 == NAMED)
    assert sweeps.set_aside(found, quarantine) == 2
    assert {file.name for file in blobs.glob("*/*")} == {NAMED}
    assert (quarantine / UNNAMED).read_text() == UNNAMED
    assert sweeps.put_back(quarantine, blobs, lambda sha256: True) == 1
    assert blob_path(blobs, UNNAMED).read_text() == UNNAMED
    assert [file.name for file in quarantine.iterdir()] == ["0123.partial"]
