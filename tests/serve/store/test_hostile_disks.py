"""A full or read-only disk while a store is opened and upgraded: said, and nothing is lost."""

from __future__ import annotations

import sqlite3
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from elfslam.base.errors import StoreError
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import reading
from elfslam.serve.store.opening import alone_with
from elfslam.serve.store.tables import User
from tests.disks import mounted

pytestmark = pytest.mark.hostile
RELEASED = Path(__file__).parent / "released" / "0.1.0.sqlite.sql"
DISK_BYTES = 4 * 2**20
STEP_BYTES = 16_384


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of a few megabytes; skips the test where none may be made."""
    with mounted(tmp_path / "disk", size=DISK_BYTES) as place:
        yield place


def released(settings: ServerSettings) -> None:
    """A store as version 0.1.0 left it, without files."""
    settings.data_folder.mkdir(parents=True)
    with sqlite3.connect(settings.data_folder / "elfslam.sqlite") as connection:
        connection.executescript(RELEASED.read_text(encoding="utf-8"))
        for table in ("recording_files", "map_files", "map_parts", "job_files", "uploads"):
            connection.execute(f"DELETE FROM {table}")
    connection.close()


def opened(settings: ServerSettings) -> str:
    """What is said in place of opening a store; nothing where it opens."""
    try:
        with alone_with(settings):
            open_services(settings, alone=True).engine.dispose()
    except (StoreError, OSError) as error:
        return str(error)
    return ""


def names(settings: ServerSettings) -> list[str]:
    with alone_with(settings):
        services = open_services(settings, alone=True)
    with reading(services.sessions) as session:
        found = [user.name for user in session.query(User).order_by(User.id)]
    services.engine.dispose()
    return found


def fill(disk: Path, free_bytes: int) -> Path:
    """A file that leaves so much of a disk free."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as stream:
        try:
            while True:
                stream.write(bytes(4096))
        except OSError:
            pass
    size = filler.stat().st_size
    with filler.open("r+b") as stream:
        stream.truncate(max(0, size - free_bytes))
    return filler


def test_an_upgrade_on_a_disk_that_is_full_at_any_step(disk: Path) -> None:
    settings = ServerSettings(disk / "data")
    released(settings)
    refusals = 0
    for free_bytes in range(0, DISK_BYTES, STEP_BYTES):
        filler = fill(disk, free_bytes)
        said = opened(settings)
        filler.unlink()
        if not said:
            break
        assert "\n" not in said
        refusals += 1
    assert refusals >= 5, "the disk was never full"
    assert names(settings) == ["owner", "Zoë 🦇"]
    assert not list(settings.data_folder.glob(".*.partial"))


def test_a_disk_that_cannot_be_written(disk: Path) -> None:
    settings = ServerSettings(disk / "data")
    released(settings)
    assert opened(settings) == ""
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    said = opened(settings)
    subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
    assert "Read-only" in said
    assert names(settings) == ["owner", "Zoë 🦇"]
