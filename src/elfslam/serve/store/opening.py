"""How a data folder and its database are opened: lock, identity, version, and then the rest."""

from __future__ import annotations

import fcntl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Engine, select
from sqlalchemy.engine import make_url

from elfslam.base.errors import StoreError
from elfslam.serve.problems import LOG
from elfslam.serve.settings import ServerSettings, prepare_folders
from elfslam.serve.store.backups import ROWS
from elfslam.serve.store.database import (
    SQLITE,
    Base,
    answering,
    open_database,
    sessions_of,
    shown_url,
)
from elfslam.serve.store.identity import introduce, refuse_another, refuse_lost_database
from elfslam.serve.store.schema import State, check_columns, state_of, upgrade

LOCK = ".lock"
TRIES, BETWEEN_TRIES_S = 20, 0.1
"""How long a server waits for a command that has the folder for a moment."""


class InUseError(StoreError):
    """Somebody else has the data folder."""


@contextmanager
def alone_with(settings: ServerSettings, tries: int = 1) -> Iterator[None]:
    """Alone with a data folder, which is made where it is missing. Raises InUseError."""
    prepare_folders(settings)
    with (settings.data_folder / LOCK).open("w") as lock:
        while not locked_now(lock.fileno()):
            tries -= 1
            if tries <= 0:
                raise InUseError(
                    f"{settings.data_folder}: another server is using it; stop that one, or "
                    "choose another folder"
                )
            time.sleep(BETWEEN_TRIES_S)
        yield


def locked_now(file: int) -> bool:
    """Lock an open file for this process alone; whether nobody had it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def open_store(settings: ServerSettings) -> Engine:
    """The database of a data folder that the caller has alone: theirs, whole, and up to date.

    A new folder and an empty database come together here. Raises StoreError, InputError; then
    nothing was changed.
    """
    refuse_lost_database(settings, is_empty=_has_no_file(settings.url))
    engine = open_database(settings.url)
    try:
        _check_pages(engine)
        state = state_of(engine)
        refuse_lost_database(settings, is_empty=state is State.EMPTY)
        if state is not State.EMPTY:
            refuse_another(engine, settings)
        _bring_up_to_date(engine, settings, state)
        _check_rows(engine)
        with answering(engine):
            introduce(sessions_of(engine), settings)
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
            f"than {shown_url(settings.url)}; give its --database, or stop it"
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
            f"database {shown_url(engine.url)}: is damaged ({str(told).splitlines()[-1]:.80}); "
            "restore a backup"
        )


def _check_rows(engine: Engine) -> None:
    """Raise StoreError where a row of a SQLite file cannot be read; its pages may still be whole.

    Numbers alone cannot be told from others: tables of nothing else are passed over.
    """
    if engine.dialect.name != SQLITE:
        return
    for table in Base.metadata.sorted_tables:
        if all(column.type.python_type in (int, float) for column in table.columns):
            continue
        try:
            with answering(engine), engine.connect() as connection:
                for _ in connection.execute(select(table)).partitions(ROWS):
                    pass
        except (ValueError, TypeError) as error:
            raise StoreError(
                f"database {shown_url(engine.url)}: a row of table {table.name} is damaged "
                f"({type(error).__name__}); restore a backup"
            ) from error


def _bring_up_to_date(engine: Engine, settings: ServerSettings, state: State) -> None:
    if state is State.CURRENT:
        with answering(engine), engine.connect() as connection:
            check_columns(connection)
        return
    backup = upgrade(engine, settings.backups_folder)
    if backup is not None:
        LOG.warning("the database was upgraded; as it was before it lies in %s", backup)
