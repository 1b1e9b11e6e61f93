"""What a server clears away: what a kill left over is set aside, what was abandoned goes in time.

Nothing is deleted at a start but scratch, and positions whose time is over by the clock. Files that
no row names are put into a quarantine, and back if a row names them. All other deadlines count the
time that the server ran: a clock that is put forward by a year must not make everything a year old.
"""

from __future__ import annotations

import json
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import select

from elfslam.data.atomic_files import replaced_file
from elfslam.serve.positions.routes import forget_old_positions
from elfslam.serve.problems import LOG, Problem
from elfslam.serve.receiving.completing import SCRATCH
from elfslam.serve.receiving.uploads import forget_upload
from elfslam.serve.services import Services
from elfslam.serve.store import blobs
from elfslam.serve.store.blobs import SHA256, blob_path, put_at
from elfslam.serve.store.database import reading
from elfslam.serve.store.quota import is_named, named_blobs, upload_bytes
from elfslam.serve.store.tables import Upload

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
        lost = sum(
            not blob_path(settings.blobs_folder, each).is_file() for each in named_blobs(session)
        )
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


AGES = "ages.json"


@dataclass(frozen=True)
class Age:
    """For how long a thing has been as it is, which its size tells."""

    size_bytes: int
    untouched_s: float = 0.0


Ages = Mapping[str, Age]


def grown(before: Ages, sizes_bytes: Mapping[str, int], passed_s: float) -> dict[str, Age]:
    """The ages of things after some time: what is new or another size begins anew."""
    known = {name: age for name, age in before.items() if age.size_bytes == sizes_bytes.get(name)}
    fresh = {name: Age(size_bytes) for name, size_bytes in sizes_bytes.items()}
    older = {name: Age(age.size_bytes, age.untouched_s + passed_s) for name, age in known.items()}
    return fresh | older


def older_than(ages: Ages, days: float) -> list[str]:
    """What has lain untouched for longer."""
    return [name for name, age in ages.items() if age.untouched_s > days * 86_400]


def read_ages(folder: Path) -> dict[str, Age]:
    """The ages that a folder keeps; none where they are missing or damaged: all begin anew."""
    try:
        told = json.loads((folder / AGES).read_text(encoding="utf-8"))
        return {str(name): Age(int(size), float(age_s)) for name, (size, age_s) in told.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {}


def write_ages(folder: Path, ages: Ages) -> None:
    """Keep ages in a folder. Raises StoreError."""
    with replaced_file(folder / AGES) as partial:
        told = {name: [age.size_bytes, age.untouched_s] for name, age in ages.items()}
        partial.write_text(json.dumps(told), encoding="utf-8")


IsNamed = Callable[[str], bool]


def set_aside(files: list[Path], quarantine: Path) -> int:
    """Move files into a quarantine by their names; how many those were."""
    for file in files:
        os.replace(file, quarantine / file.name)
    return len(files)


def unnamed_blobs(blobs: Path, is_named: IsNamed) -> list[Path]:
    """What lies among the blobs and is named by nobody, or was left half-written."""
    return [
        file
        for file in blobs.glob("*/*")
        if not (SHA256.fullmatch(file.name) and is_named(file.name))
    ]


def put_back(quarantine: Path, blobs: Path, is_named: IsNamed) -> int:
    """Move those blobs back that a row names after all; how many those were."""
    wanted = [
        file for file in quarantine.iterdir() if SHA256.fullmatch(file.name) and is_named(file.name)
    ]
    for file in wanted:
        kept = blob_path(blobs, file.name)
        kept.parent.mkdir(exist_ok=True, mode=0o700)
        put_at(file, kept)
    return len(wanted)
