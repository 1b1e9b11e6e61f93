"""Every way to start with a wrong, new, empty, older, newer or damaged database.

Whatever is said, every file of the folder is still there.
"""

from __future__ import annotations

import random
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import text

from elfslam.base.errors import StoreError
from elfslam.serve.jobs.queue import queue_job
from elfslam.serve.people.users import add_user, set_owner_token
from elfslam.serve.services import Services, open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import put
from elfslam.serve.store.database import JobFile, JobKind, User, reading, transaction
from elfslam.serve.store.identity import STORE, files_of
from elfslam.serve.store.opening import InUseError, alone_with, join_store, open_store
from elfslam.serve.store.schema import VERSION_TABLE


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
        told = {"sha256": blob.sha256, "size_bytes": blob.size_bytes}
        session.add(JobFile(job_id=job.id, name="f", **told))
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


BOTH = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


@BOTH
def test_a_store_opens_again(store: ServerSettings) -> None:
    services = opened(store)
    with reading(services.sessions) as session:
        assert session.query(User).count() == 1
    services.engine.dispose()


@BOTH
def test_a_store_is_joined_while_somebody_has_it(store: ServerSettings) -> None:
    with alone_with(store):
        services = open_services(store)
        assert add_user(services, "guest")[0].name == "guest"
        services.engine.dispose()


@BOTH
def test_a_store_that_somebody_has_is_not_opened(store: ServerSettings) -> None:
    with alone_with(store), pytest.raises(InUseError, match="another server"), alone_with(store):
        pass


def test_a_database_that_was_removed(store: ServerSettings) -> None:
    (store.data_folder / "elfslam.sqlite").unlink()
    refused(store, "is missing or empty, and .* holds 1 files")
    assert not (store.data_folder / "elfslam.sqlite").exists()


def test_a_database_of_no_bytes(store: ServerSettings) -> None:
    for name in ("elfslam.sqlite", "elfslam.sqlite-wal", "elfslam.sqlite-shm"):
        (store.data_folder / name).unlink(missing_ok=True)
    (store.data_folder / "elfslam.sqlite").touch()
    refused(store, "is missing or empty")


def test_a_new_database_of_another_path(store: ServerSettings, tmp_path: Path) -> None:
    elsewhere = tmp_path / "other.sqlite"
    refused(replace(store, database_url=f"sqlite:///{elsewhere}"), "last used with sqlite:///")
    assert not elsewhere.exists()
    opened(store).engine.dispose()


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_who_forgets_the_url_of_the_database(store: ServerSettings) -> None:
    refused(replace(store, database_url=""), r"last used with postgresql\+psycopg://")
    opened(store).engine.dispose()


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
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


@BOTH
def test_a_newer_version(store: ServerSettings) -> None:
    changed(store, f"UPDATE {VERSION_TABLE} SET version_num = '9999'")
    refused(store, "install the newer elfslam")


@BOTH
def test_a_changed_column(store: ServerSettings) -> None:
    changed(store, "ALTER TABLE jobs RENAME COLUMN doing TO done")
    refused(store, "table jobs lacks doing")


@BOTH
def test_tables_of_another_program(store: ServerSettings) -> None:
    changed(store, f"DROP TABLE {VERSION_TABLE}", "ALTER TABLE uploads RENAME TO cakes")
    refused(store, "tables of another program")


def test_no_database_at_all(store: ServerSettings) -> None:
    (store.data_folder / "elfslam.sqlite").write_bytes(b"not a database" * 1000)
    refused(store, "cannot be read")


@pytest.mark.parametrize("seed", range(12))
def test_a_database_with_changed_bytes(store: ServerSettings, seed: int) -> None:
    """It opens or is refused in one line; what is changed inside a text is nobody's to notice."""
    file = store.data_folder / "elfslam.sqlite"
    for name in ("-wal", "-shm"):
        file.with_name(file.name + name).unlink(missing_ok=True)
    content, generator = bytearray(file.read_bytes()), random.Random(seed)
    for _ in range(200):
        content[generator.randrange(len(content))] = generator.randrange(256)
    file.write_bytes(content)
    before = files_of(store)
    said = ""
    try:
        opened(store).engine.dispose()
    except StoreError as error:
        said = str(error)
    assert "\n" not in said
    assert files_of(store) == before


def test_a_database_cut_off(store: ServerSettings) -> None:
    file = store.data_folder / "elfslam.sqlite"
    file.write_bytes(file.read_bytes()[:-5000])
    refused(store, "is damaged|cannot be read")


def test_a_backup_put_back(store: ServerSettings, tmp_path: Path) -> None:
    engine = join_store(store)
    engine.dispose()
    copy = tmp_path / "copy.sqlite"
    shutil.copy(store.data_folder / "elfslam.sqlite", copy)
    opened(replace(store, database_url=f"sqlite:///{copy}")).engine.dispose()


def test_a_server_of_another_version_is_not_joined(store: ServerSettings) -> None:
    changed(store, f"UPDATE {VERSION_TABLE} SET version_num = '0001'")
    with alone_with(store), pytest.raises(StoreError, match="another database or version"):
        join_store(store)
