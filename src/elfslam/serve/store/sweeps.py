"""What a server clears away: what a kill left over is set aside, what was abandoned goes in time.

Nothing is deleted at a start but scratch, and positions whose time is over by the clock. All other
deadlines count the time that the server ran.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sqlalchemy import select

from elfslam.serve.positions.history import forget_old_positions
from elfslam.serve.problems import LOG, Problem
from elfslam.serve.receiving.completing import SCRATCH
from elfslam.serve.receiving.upload_store import forget_upload
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.ages import Age, grown, older_than, read_ages, write_ages
from elfslam.serve.store.database import Upload, reading
from elfslam.serve.store.quarantine import put_back, set_aside, unnamed_blobs
from elfslam.serve.store.quota import is_named, named_blobs, upload_bytes

BETWEEN_S = 3600.0
UPLOAD, ASIDE = "upload ", "aside "
"""So begin the names of things whose ages are kept."""


@contextmanager
def sweeping(services: Services) -> Iterator[None]:
    """What was left over set aside now, and once an hour a look at what was abandoned."""
    tidy(services)
    forget_old_positions(services)
    stop = threading.Event()
    thread = threading.Thread(target=_every_hour, args=(services, stop), daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def tidy(services: Services) -> None:
    """Set aside files without a row, put back those that have one again, and remove scratch."""
    settings = services.settings
    for folder in settings.work_folder.glob(f"{SCRATCH}*"):
        shutil.rmtree(folder, ignore_errors=True)
    aside = set_aside(_uploads_without_row(services), settings.quarantine_folder)
    with blobs.locked(settings.blobs_folder), reading(services.sessions) as session:

        def named(sha256: str) -> bool:
            return is_named(session, sha256)

        aside += set_aside(unnamed_blobs(settings.blobs_folder, named), settings.quarantine_folder)
        back = put_back(settings.quarantine_folder, settings.blobs_folder, named)
        lost = _lost(settings.blobs_folder, named_blobs(session))
    _say(services, aside, back, lost)


def expire(services: Services, passed_s: float) -> list[str]:
    """Delete what has lain abandoned for its time, after so much more; the uploads among it.

    An upload that is being written stays.
    """
    settings, limits = services.settings, services.settings.limits
    sizes_bytes = _sizes_bytes(services)
    ages = grown(read_ages(settings.data_folder), sizes_bytes, passed_s)
    write_ages(settings.data_folder, ages)
    for name in older_than(_of(ages, ASIDE), limits.quarantine_days):
        blobs.remove(settings.quarantine_folder / name)
    expired = []
    for upload_id in older_than(_of(ages, UPLOAD), limits.upload_days):
        with suppress(Problem), services.busy.alone([upload_id]):
            if upload_bytes(settings, upload_id) == sizes_bytes[f"{UPLOAD}{upload_id}"]:
                forget_upload(services, upload_id)
                expired.append(upload_id)
    return expired


def _uploads_without_row(services: Services) -> list[Path]:
    with reading(services.sessions) as session:
        known = set(session.scalars(select(Upload.id).filter_by(finished=False)))
    return [file for file in services.settings.uploads_folder.iterdir() if file.name not in known]


def _lost(folder: Path, named: set[str]) -> int:
    """How many blobs that rows name are not there."""
    return sum(not blobs.blob_path(folder, sha256).is_file() for sha256 in named)


def _say(services: Services, aside: int, back: int, lost: int) -> None:
    folder, days = services.settings.quarantine_folder, services.settings.limits.quarantine_days
    if aside:
        LOG.warning("%d files that nobody names were set aside in %s; they are deleted when the "
                    "server has run for %g days", aside, folder, days)  # fmt: skip
    if back:
        LOG.warning("%d files were put back from %s: they are named again", back, folder)
    if lost:
        LOG.error("%d files that recordings and maps name are missing; restore blobs/ from a "
                  "backup", lost)  # fmt: skip


def _sizes_bytes(services: Services) -> dict[str, int]:
    settings = services.settings
    with reading(services.sessions) as session:
        uploads = list(session.scalars(select(Upload.id)))
    aside = {f"{ASIDE}{file.name}": file.stat().st_size
             for file in settings.quarantine_folder.iterdir()}  # fmt: skip
    return aside | {f"{UPLOAD}{name}": upload_bytes(settings, name) for name in uploads}


def _of(ages: dict[str, Age], kind: str) -> dict[str, Age]:
    return {name[len(kind) :]: age for name, age in ages.items() if name.startswith(kind)}


def _every_hour(services: Services, stop: threading.Event) -> None:
    since_s = time.monotonic()
    while not stop.wait(BETWEEN_S):
        now_s = time.monotonic()
        try:
            forget_old_positions(services)
            expire(services, now_s - since_s)
        except Exception:
            LOG.exception("sweeping failed")
        since_s = now_s
