"""Every way to start with a wrong, new, empty, older, newer or damaged database.

Whatever is said, every file of the folder is still there.
"""

import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from sqlalchemy import select, text

from elfslam.base.errors import StoreError
from elfslam.serve.jobs.queue import queue_job
from elfslam.serve.people.users import add_user, set_owner_token
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import put
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.opening import (
    STORE,
    InUseError,
    alone_with,
    files_of,
    join_store,
    open_store,
)
from elfslam.serve.store.schema import VERSION_TABLE
from elfslam.serve.store.tables import JobFile, JobKind, User
from tests.serve.conftest import DATABASES


def filled(settings: ServerSettings) -> ServerSettings:
    """A store with a user, and a file that a row names."""
    with alone_with(settings):
        services = open_services(settings, alone=True)
    user = set_owner_token(services, "token")
    file = settings.work_folder / "content"
    file.write_bytes(b"a walk")
    blob = put(settings.blobs_folder, file)
    file.unlink()
    with transaction(services.sessions) as session:
        job = queue_job(session, user.id, JobKind.MAP, {})
        session.add(JobFile(job_id=job.id, name="f", **asdict(blob)))
    services.engine.dispose()
    return settings


@pytest.fixture
def store(settings: ServerSettings) -> ServerSettings:
    return filled(settings)


def refused(settings: ServerSettings, words: str) -> None:
    """Opening is refused in one line, and no file of the folder is gone."""
    before = files_of(settings)
    assert before
    with pytest.raises(StoreError, match=words) as said, alone_with(settings):
        open_store(settings)
    assert "\n" not in str(said.value)
    assert files_of(settings) == before


def opened(settings: ServerSettings) -> Services:
    with alone_with(settings):
        return open_services(settings, alone=True)


def changed(settings: ServerSettings, *statements: str) -> None:
    """The database changed by hand."""
    engine = join_store(settings)
    with engine.begin() as connection:
        for statement in statements:
            connection.execute(text(statement))
    engine.dispose()


@DATABASES
def test_a_store_opens_again(store: ServerSettings) -> None:
    services = opened(store)
    with reading(services.sessions) as session:
        assert session.query(User).count() == 1
    services.engine.dispose()


@DATABASES
def test_a_store_is_joined_while_somebody_has_it(store: ServerSettings) -> None:
    with alone_with(store):
        services = open_services(store)
        assert add_user(services, "guest")[0].name == "guest"
        services.engine.dispose()


@DATABASES
def test_a_store_that_somebody_has_is_not_opened(store: ServerSettings) -> None:
    with alone_with(store), pytest.raises(InUseError, match="another server"), alone_with(store):
        pass


@pytest.mark.parametrize("are_set_aside", [False, True])
def test_a_database_that_was_removed(store: ServerSettings, are_set_aside: bool) -> None:
    for file in store.blobs_folder.glob("*/*") if are_set_aside else ():
        file.rename(store.quarantine_folder / file.name)
    (store.data_folder / "elfslam.sqlite").unlink()
    refused(store, "is missing or empty, and .* holds 1 files")
    assert not (store.data_folder / "elfslam.sqlite").exists()


VERSION = f"UPDATE {VERSION_TABLE} SET version_num ="
CAKES = (f"DROP TABLE {VERSION_TABLE}", "ALTER TABLE uploads RENAME TO cakes")
NO_NAME = "a row of table job_files names .* no name of a file"
CHANGES = [
    ([f"INSERT INTO {VERSION_TABLE} VALUES ('0005')"], r"has 2 versions at once \(0005, "),
    ([f"{VERSION} '9999'"], "install the newer elfslam"),
    (["ALTER TABLE jobs RENAME COLUMN doing TO done"], "table jobs lacks doing"),
    (CAKES, "tables of another program"),
    (["UPDATE job_files SET sha256 = '../../etc/passwd'"], NO_NAME),
    (["UPDATE job_files SET sha256 = ''"], NO_NAME),
    ([f"UPDATE job_files SET sha256 = '{'A' * 64}'"], NO_NAME),
]


@DATABASES
@pytest.mark.parametrize(("statements", "words"), CHANGES)
def test_a_database_that_was_changed_by_hand(
    store: ServerSettings, statements: Sequence[str], words: str
) -> None:
    changed(store, *statements)
    refused(store, words)


def test_what_is_no_file_or_no_folder_is_not_used(store: ServerSettings) -> None:
    for name in (".lock", "jobs.lock", "blobs/.lock", STORE):
        place, aside = store.data_folder / name, store.data_folder / "aside"
        if place.exists():
            place.rename(aside)
        for make, undo in (
            (Path.mkdir, Path.rmdir),
            (os.mkfifo, Path.unlink),
            (lambda place: place.symlink_to("/zero"), Path.unlink),
        ):
            make(place)
            refused(store, "is no plain file; move it away")
            undo(place)
        if aside.exists():
            aside.rename(place)
    store.work_folder.rmdir()
    store.work_folder.symlink_to("nowhere")
    refused(store, "work: is no plain folder")


def test_a_data_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    words, wrong = "give a folder that you may write to", ServerSettings(tmp_path / "file")
    with pytest.raises(StoreError, match=words), alone_with(wrong):
        pass


def test_what_else_is_wrong_is_found_before_an_upgrade(store: ServerSettings) -> None:
    older = [f"ALTER TABLE stores DROP COLUMN {name}" for name in ("holder", "beat")]
    changed(store, f"{VERSION} '0005'", *older)
    before = {file: file.read_bytes() for file in store.data_folder.rglob("*.json")}

    def examine(_engine: object) -> None:
        raise StoreError("the key is wrong")

    with pytest.raises(StoreError, match="the key is wrong"), alone_with(store):
        open_store(store, examine)
    assert not store.backups_folder.exists()
    assert {file: file.read_bytes() for file in store.data_folder.rglob("*.json")} == before
    opened(store).engine.dispose()
    assert len(list(store.backups_folder.iterdir())) == 1


def test_a_new_database_of_another_path(store: ServerSettings, tmp_path: Path) -> None:
    elsewhere = tmp_path / "other.sqlite"
    refused(replace(store, database_url=f"sqlite:///{elsewhere}"), "last used with sqlite:///")
    assert not elsewhere.exists()
    opened(store).engine.dispose()


POSTGRESQL = pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)


@POSTGRESQL
def test_who_forgets_the_url_of_the_database(store: ServerSettings) -> None:
    refused(replace(store, database_url=""), r"last used with postgresql\+psycopg://")
    opened(store).engine.dispose()


@POSTGRESQL
def test_an_empty_database_of_a_server(store: ServerSettings) -> None:
    changed(store, "DROP SCHEMA public CASCADE", "CREATE SCHEMA public")
    refused(store, "is missing or empty")


def test_the_database_of_another_store(store: ServerSettings, tmp_path: Path) -> None:
    other = filled(ServerSettings(tmp_path / "other"))
    refused(replace(store, database_url=other.url), "belongs to another data folder")
    refused(replace(other, database_url=store.url), "belongs to another data folder")
    opened(store).engine.dispose()
    opened(other).engine.dispose()


def test_a_folder_that_forgot_its_identity_knows_its_files(store: ServerSettings) -> None:
    (store.data_folder / STORE).unlink()
    opened(store).engine.dispose()
    assert (store.data_folder / STORE).is_file()


def test_a_new_folder_and_an_old_database(store: ServerSettings, tmp_path: Path) -> None:
    new = ServerSettings(tmp_path / "new", store.url)
    with pytest.raises(StoreError, match="another data folder"), alone_with(new):
        open_store(new)


@pytest.mark.parametrize("content", [b"", b"nonsense", b"{}", b"[" * 100_000, b"\xff\xfe"])
def test_a_damaged_identity(store: ServerSettings, content: bytes) -> None:
    (store.data_folder / STORE).write_bytes(content)
    refused(store, "cannot be read")


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda content: b"", "is missing or empty"),
        (lambda content: b"not a database" * 1000, "cannot be read"),
        (lambda content: content[:-5000], "is damaged|cannot be read"),
    ],
    ids=["of no bytes", "of something else", "cut off"],
)
def test_a_file_that_is_no_whole_database(
    store: ServerSettings, damage: Callable[[bytes], bytes], words: str
) -> None:
    file = store.data_folder / "elfslam.sqlite"
    content = file.read_bytes()
    for name in ("", "-wal", "-shm"):
        file.with_name(file.name + name).unlink(missing_ok=True)
    file.write_bytes(damage(content))
    refused(store, words)


def test_a_backup_put_back(store: ServerSettings, tmp_path: Path) -> None:
    engine = join_store(store)
    engine.dispose()
    copy = tmp_path / "copy.sqlite"
    shutil.copy(store.data_folder / "elfslam.sqlite", copy)
    services = opened(replace(store, database_url=f"sqlite:///{copy}"))
    with reading(services.sessions) as session:
        assert session.scalars(select(User.name)).one()
        assert session.scalars(select(JobFile.name)).one() == "f"
    services.engine.dispose()


def test_a_server_of_another_version_is_not_joined(store: ServerSettings) -> None:
    changed(store, f"{VERSION} '0001'")
    with alone_with(store), pytest.raises(StoreError, match="another database or version"):
        join_store(store)
