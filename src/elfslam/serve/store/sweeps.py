"""What a server clears away: at its start what a kill left over, later what was abandoned."""

from __future__ import annotations

import fcntl
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime

from sqlalchemy import select

from elfslam.base.errors import StoreError
from elfslam.serve.problems import LOG, Problem
from elfslam.serve.receiving.completing import SCRATCH
from elfslam.serve.receiving.upload_store import expires_utc, forget_upload
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.database import Upload, reading
from elfslam.serve.store.holdings import is_named

BETWEEN_S = 3600.0
LOCK = ".lock"


@contextmanager
def sweeping(services: Services) -> Iterator[None]:
    """Alone with the data folder: swept now, and once an hour of what was abandoned."""
    with _alone(services):
        sweep(services)
        stop = threading.Event()
        thread = threading.Thread(target=_every_hour, args=(services, stop), daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


@contextmanager
def _alone(services: Services) -> Iterator[None]:
    """Raises StoreError where another server uses the folder."""
    folder = services.settings.data_folder
    with (folder / LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise StoreError(
                f"{folder}: another server is using it; stop that one, or choose another folder"
            ) from error
        yield


def sweep(services: Services) -> None:
    """Delete files without a row, and uploads that nobody goes on with."""
    settings = services.settings
    with reading(services.sessions) as session:
        known = set(session.scalars(select(Upload.id).filter_by(finished=False)))
    for file in settings.uploads_folder.iterdir():
        if file.name not in known:
            file.unlink()
    for folder in settings.work_folder.glob(f"{SCRATCH}*"):
        shutil.rmtree(folder, ignore_errors=True)
    with blobs.locked(settings.blobs_folder), reading(services.sessions) as session:
        blobs.sweep(settings.blobs_folder, lambda sha256: is_named(session, sha256))
    expire_uploads(services, datetime.now(UTC))


def expire_uploads(services: Services, now_utc: datetime) -> list[str]:
    """Delete the uploads whose time is over; their ids. One that is being written stays."""
    with reading(services.sessions) as session:
        uploads = list(session.scalars(select(Upload)))
    expired = []
    for upload in uploads:
        try:
            with services.busy.alone([upload.id]):
                if expires_utc(services, upload) < now_utc:
                    forget_upload(services, upload.id)
                    expired.append(upload.id)
        except Problem:
            continue
    return expired


def _every_hour(services: Services, stop: threading.Event) -> None:
    while not stop.wait(BETWEEN_S):
        try:
            expire_uploads(services, datetime.now(UTC))
        except Exception:
            LOG.exception("sweeping failed")
