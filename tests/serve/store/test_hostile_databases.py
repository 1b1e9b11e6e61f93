"""Databases with changed bytes, disks that are full: refused in one line, and no file is gone."""

import os
import random
import re
import shutil
import sqlite3
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from damage import Change, cut_off, emptied, flipped, inserted, lost, twice, zeroed
from hypothesis import HealthCheck, Phase, core, given, settings
from hypothesis import strategies as st

from elfslam.base.errors import StoreError
from elfslam.serve.app import create_app
from elfslam.serve.people.users import set_owner_token
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import put
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.opening import alone_with, files_of
from elfslam.serve.store.tables import Job, Map, Recording, RecordingFile, Upload, User
from tests.disks import mounted
from tests.serve.conftest import asking

pytestmark = pytest.mark.hostile
CASES = int(os.environ.get("HOSTILE_CASES", "200"))
ROUTES = ("me", "users", "recordings", "uploads", "jobs", "maps")
SQLITE = "elfslam.sqlite"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with a row of every kind, at rest."""
    given_settings = ServerSettings(tmp_path_factory.mktemp("whole") / "data", run_jobs=False)
    with alone_with(given_settings):
        services = open_services(given_settings, alone=True)
    user = set_owner_token(services, "token")
    file = given_settings.work_folder / "content"
    file.write_bytes(b"a walk")
    blob = put(given_settings.blobs_folder, file)
    file.unlink()
    with transaction(services.sessions) as session:
        for number in range(30):
            facts: dict[str, Any] = {"duration_s": 12.5, "bytes": number}
            walk = Recording(user_id=user.id, name=f"walk {number}", state="ready", facts=facts)
            session.add(walk)
            session.flush()
            session.add(
                RecordingFile(
                    recording_id=walk.id, name="f", sha256=blob.sha256, size_bytes=blob.size_bytes
                )
            )
            session.add(Job(user_id=user.id, kind="map", given={"recording": walk.id}))
            session.add(Map(user_id=user.id, name="Hall", kind="run", sources=[walk.id]))
            session.add(Upload(user_id=user.id, recording_id=walk.id, file_name="wifi.csv"))
    services.engine.dispose()
    return given_settings.data_folder


def a_page(content: bytes, chance: random.Random) -> bytes:
    """One page holds anything; the first has the header."""
    start = chance.choice((0, chance.randrange(len(content)) // 4096 * 4096))
    size = chance.choice((100, 4096))
    return content[:start] + chance.randbytes(size) + content[start + size :]


def a_text(content: bytes, chance: random.Random) -> bytes:
    """What stands in a row is no text any more."""
    words = (b"walk ", b"duration_s", b"2026-", b"ready", b'["', b'{"recording"', b"map")
    at = chance.choice(
        [found.start() for found in re.finditer(re.escape(chance.choice(words)), content)]
    )
    return content[:at] + b"\xff\xfe" + content[at + 2 :]


DAMAGES = (cut_off, emptied, flipped, inserted, lost, zeroed, twice, a_page, a_page, a_text, a_text)


@settings(
    max_examples=max(10, CASES // 4),
    deadline=None,
    derandomize=core.global_force_seed is None,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)
@given(damage=st.sampled_from(DAMAGES), seed=st.integers(0, 2**32))
def test_a_damaged_database(whole: Path, damage: Change, seed: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "data"
        shutil.copytree(whole, folder)
        for left in folder.glob(f"{SQLITE}-*"):
            left.unlink()
        file = folder / SQLITE
        file.write_bytes(damage(file.read_bytes(), random.Random(seed)))
        store = ServerSettings(folder, run_jobs=False)
        before, said = files_of(store), ""
        try:
            with alone_with(store):
                services = open_services(store, alone=True)
        except StoreError as error:
            said = str(error)
        else:
            answers_honestly(services)
        assert "\n" not in said
        assert files_of(store) == before


def answers_honestly(services: Any) -> None:
    """A store that opens answers, or says that its database is damaged."""
    bearer = {"Authorization": "Bearer token"}
    client = asking(create_app(services), headers=bearer, raise_server_exceptions=False)
    for route in ROUTES:
        answer = client.get(f"/api/{route}")
        assert answer.status_code < 500 or answer.status_code == 503, answer.text
    services.engine.dispose()


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
