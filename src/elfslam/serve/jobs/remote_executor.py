"""A job on a cluster: its folder travels as bytes, is filled there, and what was made comes back.

Nodes need no folder in common. The work there is a process of its own with the same limits.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from elfslam.app.workers.interface import Watchers
from elfslam.serve.jobs.child import LOG, Progress, Result, child_news
from elfslam.serve.jobs.folder import GIVEN, OUT, TASK
from elfslam.serve.jobs.preforked import Loaded
from elfslam.serve.store.blobs import place_in

SCRATCH, NEW, LOCK = "elfslam-job-", "elfslam-new-", "lock"
Files = Mapping[str, bytes]
"""Contents by path within a folder."""


@dataclass(frozen=True)
class Parcel:
    """A job's folder on its way, and how long the work may take."""

    files: Files
    longest_s: float


@dataclass(frozen=True)
class Made:
    """What came of a job, and the files that it left."""

    result: Result
    files: Files


def news_from(
    workers: Watchers, folder: Path, longest_s: float, lock: int
) -> Iterator[Progress | Result]:
    """Do the task of a folder on a cluster, and leave there what was made, as `child_news` does.

    `lock` stays here: whoever works elsewhere for a server that is gone can keep nothing.
    """
    parcel = Parcel(packed(folder, (TASK, GIVEN)), longest_s)
    with closing(workers.watch(work_on_parcel, parcel)) as news:  # type: ignore[type-var]
        for said in news:
            if isinstance(said, Made):
                unpack(said.files, folder)
                yield said.result
                return
            yield Progress() if said is None else said


def work_on_parcel(parcel: Parcel) -> Iterator[Progress | Made]:
    """Unpack a job's folder here, do its task, and give what was made."""
    with _scratch() as (folder, lock):
        unpack(parcel.files, folder)
        begin = _loaded().begin
        news = child_news(folder, longest_s=parcel.longest_s, lock=lock, begin=begin)
        with closing(news):  # type: ignore[type-var]
            for said in news:
                yield Made(said, packed(folder, (OUT, LOG))) if isinstance(said, Result) else said


def packed(folder: Path, names: tuple[str, ...]) -> dict[str, bytes]:
    """The files of these names and in the folders of these names, where there are any."""
    found = [
        file for name in names for file in [folder / name, *sorted((folder / name).rglob("*"))]
    ]
    return {
        file.relative_to(folder).as_posix(): file.read_bytes() for file in found if file.is_file()
    }


def unpack(files: Files, folder: Path) -> None:
    """Write files into a folder. Raises ValueError for a name that leads out of it, OSError."""
    for name, content in files.items():
        place_in(folder, name).write_bytes(content)


@cache
def _loaded() -> Loaded:
    """Of this process, which works on one job at a time; it ends with it."""
    return Loaded()


@contextmanager
def _scratch() -> Iterator[tuple[Path, int]]:
    """A folder for one job, and the lock that says that somebody works there.

    What was left by those who were killed is removed.
    """
    for left in Path(tempfile.gettempdir()).glob(f"{SCRATCH}*"):
        _remove_left(left)
    new = Path(tempfile.mkdtemp(prefix=NEW))
    folder = new.with_name(new.name.replace(NEW, SCRATCH, 1))
    try:
        with (new / LOCK).open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            new.rename(folder)
            yield folder, lock.fileno()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _remove_left(folder: Path) -> None:
    with suppress(OSError):
        lock = os.open(folder / LOCK, os.O_RDWR)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(lock)
