"""How a data folder and its database are opened: lock, identity, version, and then the rest."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Engine
from sqlalchemy.engine import make_url

from elfslam.base.errors import StoreError
from elfslam.base.urls import shown_url
from elfslam.serve.problems import LOG
from elfslam.serve.settings import ServerSettings, prepare_folders
from elfslam.serve.store.database import (
    SQLITE,
    answering,
    open_database,
    sessions_of,
    shown_database,
    write_ahead,
)
from elfslam.serve.store.holding import (
    free_to_take,
    introduce,
    refuse_another,
    refuse_lost_database,
    take,
)
from elfslam.serve.store.schema import State, check_tables, state_of, upgrade

LOCK = ".lock"
PLAIN_FILES = ("*.lock", "*.json", "*.sqlite", "blobs/*.lock", "authority/*.*", "authority/url")
FOLDERS = ("blobs", "uploads", "work", "authority", "quarantine", "backups", "published")
Examine = Callable[[Engine], None]
TRIES, BETWEEN_TRIES_S = 20, 0.1
"""How long a server waits for a command that has the folder for a moment."""


class InUseError(StoreError):
    """Somebody else has the data folder."""


@contextmanager
def alone_with(settings: ServerSettings, tries: int = 1) -> Iterator[None]:
    """Alone with a data folder, which is made where it is missing. Raises InUseError, StoreError.

    Nothing else is changed.
    """
    folder = settings.data_folder
    try:
        _refuse_other_kinds(folder)
        prepare_folders(settings)
        descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        raise StoreError(
            f"{folder}: cannot be used ({error.strerror}); give a folder that you may write to",
            argument="data",
        ) from error
    try:
        while not locked_now(descriptor):
            tries -= 1
            if tries <= 0:
                raise InUseError(
                    f"{folder}: another server is using it; stop that one, or choose another folder"
                )
            time.sleep(BETWEEN_TRIES_S)
        yield
    finally:
        os.close(descriptor)


def _refuse_other_kinds(folder: Path) -> None:
    """Raise StoreError where something else lies in the place of a file or a folder of ours."""
    files = [file for pattern in PLAIN_FILES for file in folder.glob(pattern)]
    folders = [folder / name for name in FOLDERS]
    for kind, places, fits in (("file", files, Path.is_file), ("folder", folders, Path.is_dir)):
        for place in places:
            if not fits(place) and os.path.lexists(place):  # asked last: a server may remove it
                raise StoreError(f"{place}: is no plain {kind}; move it away, or restore a backup")


def locked_now(file: int) -> bool:
    """Lock an open file for this process alone; whether nobody had it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def look_at_nothing(_engine: Engine) -> None:
    """All is right."""


def open_store(settings: ServerSettings, examine: Examine = look_at_nothing) -> Engine:
    """The database of a data folder that the caller has alone: theirs, whole, and up to date.

    A new folder and an empty database come together here. `examine` looks at what else has to be
    right, before anything is written. Raises StoreError, InputError; then nothing was changed.
    """
    refuse_lost_database(settings, is_empty=_has_no_file(settings.url))
    engine = open_database(settings.url)
    try:
        _check_pages(engine)
        state = state_of(engine)
        refuse_lost_database(settings, is_empty=state is State.EMPTY)
        if state is not State.EMPTY:
            refuse_another(engine, settings)
        before = free_to_take(engine, settings)
        if state is State.CURRENT:
            with answering(engine), engine.connect() as connection:
                check_tables(connection)
        examine(engine)
        with answering(engine):
            write_ahead(engine)
        if state is not State.CURRENT:
            _bring_up_to_date(engine, settings)
        with answering(engine):
            introduce(sessions_of(engine), settings)
            take(sessions_of(engine), settings, before)
    except BaseException:
        engine.dispose()
        raise
    return engine


def join_store(settings: ServerSettings) -> Engine:
    """The database of a data folder that a server may be using at this moment.

    Raises StoreError also where only that server could bring it up to date.
    """
    try:
        with alone_with(settings):
            return open_store(settings)
    except InUseError:
        engine = open_database(settings.url)
    if state_of(engine) is not State.CURRENT:
        engine.dispose()
        raise StoreError(
            f"{settings.data_folder}: the server that uses it has another database or version "
            f"than {shown_url(settings.url)}; give its database, or stop it",
            argument="database",
        )
    refuse_another(engine, settings)
    return engine


def _has_no_file(url: str) -> bool:
    """Whether SQLite would have to make the file of a database."""
    try:
        told = make_url(url)
    except Exception:  # what is wrong with it `open_database` says
        return False
    if told.get_backend_name() != SQLITE or told.database in (None, "", ":memory:"):
        return False
    file = Path(told.database)
    return not file.is_file() or file.stat().st_size == 0


def _check_pages(engine: Engine) -> None:
    """Raise StoreError for a damaged SQLite file."""
    if engine.dialect.name != SQLITE:
        return
    with answering(engine), engine.connect() as connection:
        told = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar()
    if told != "ok":
        raise StoreError(
            f"database {shown_database(engine)}: is damaged ({str(told).splitlines()[-1]:.80}); "
            "restore a backup"
        )


def _bring_up_to_date(engine: Engine, settings: ServerSettings) -> None:
    backup = upgrade(engine, settings.backups_folder)
    if backup is not None:
        LOG.warning("the database was upgraded; as it was before it lies in %s", backup)
