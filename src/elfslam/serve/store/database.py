"""The server's SQL database: opened with patience, read, and written in turns."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

from sqlalchemy import ColumnElement, Engine, create_engine, event, func, select
from sqlalchemy.engine import URL, Connection, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import DeclarativeBase, Session, sessionmaker

from elfslam.base.errors import InputError, StoreError
from elfslam.base.urls import shown_url, without_secrets
from elfslam.serve.problems import is_locked

Sessions = sessionmaker[Session]
POSTGRESQL, SQLITE = "postgresql", "sqlite"
LIBPQ = ("psycopg", "psycopg2")
WAIT_S = 5.0
"""How long a request waits for the database; then it is refused, and may come again."""
WAITS = "wait_s"
TURN = "turn"
"""Under this name a session knows what whoever writes must hold."""
EACH_ALONE = {"isolation_level": "AUTOCOMMIT"}
"""What PostgreSQL reads is committed as of each statement anyway: two messages fewer."""
CONNECTIONS = 20
"""As many are kept open, and ten more are opened when those are in use."""


def open_database(url: str) -> Engine:
    """The database at an SQLAlchemy URL; which tables it has is the caller's to look at.

    SQLite writes ahead and syncs every commit, so that what was acknowledged survives a kill.
    Nobody waits for more than `WAIT_S` for a connection or for what others have locked.
    Raises InputError for a URL that is none, StoreError where the database does not answer.
    """
    shown = shown_url(url)
    try:
        told = make_url(url)
        if "@" in (told.host or ""):
            raise ValueError("write an @ in a user or password as %40, a / as %2F")
        engine = create_engine(
            told,
            pool_pre_ping=True,
            pool_size=CONNECTIONS,
            pool_timeout=WAIT_S,
            connect_args=_patience(told),
        )
    except (ArgumentError, ModuleNotFoundError, TypeError, ValueError) as error:
        raise InputError(
            f"database {shown}: {without_secrets(first_line(error), url)}; wanted such as "
            "postgresql+psycopg://USER@HOST/NAME"
        ) from error
    if engine.dialect.name == SQLITE:
        event.listen(engine, "connect", _as_careful_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    elif engine.dialect.name == POSTGRESQL:
        event.listen(engine, "connect", _as_impatient_postgresql)
    with answering(engine), engine.connect() as connection:
        connection.exec_driver_sql("SELECT 1")
    return engine


@contextmanager
def answering(engine: Engine) -> Iterator[None]:
    """Raise StoreError, in one line, where a database does not answer or is damaged."""
    try:
        yield
    except (DBAPIError, PoolTimeout, UnicodeDecodeError) as error:
        if is_locked(error):
            raise StoreError(
                f"database {shown_database(engine)}: another program keeps it locked; end that "
                "one, or wait for it and start again"
            ) from error
        whole = engine.url.render_as_string(hide_password=False)
        said = without_secrets(first_line(error), whole)
        raise StoreError(
            f"database {shown_database(engine)}: cannot be read ({said}); is it there, whole, and "
            "may you write to it?"
        ) from error


def shown_database(engine: Engine) -> str:
    """The URL of a database without what is secret in it."""
    return shown_url(engine.url.render_as_string(hide_password=False))


def first_line(error: BaseException) -> str:
    """The first line of what a database said."""
    said = str(getattr(error, "orig", None) or error).strip()
    return said.partition("\n")[0][:200]


def _patience(url: URL) -> dict[str, Any]:
    """What PostgreSQL's drivers are told, where the URL does not say it."""
    libpq = url.get_backend_name() == POSTGRESQL and url.get_driver_name() in LIBPQ
    said = "connect_timeout" in url.query
    return {"connect_timeout": round(WAIT_S)} if libpq and not said else {}


def _as_careful_sqlite(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # transactions begin where _begin_sqlite says so
    for pragma in ("synchronous=FULL", "foreign_keys=ON", f"busy_timeout={round(1000 * WAIT_S)}"):
        connection.execute(f"PRAGMA {pragma}")


def write_ahead(engine: Engine) -> None:
    """Let SQLite's readers wait for no writer; its file remembers that, and is changed."""
    if engine.dialect.name == SQLITE:
        with engine.connect() as connection:
            mode = "PRAGMA journal_mode=WAL"
            try:
                connection.connection.cursor().execute(mode)  # within no transaction
            except sqlite3.OperationalError as refused:
                raise OperationalError(mode, None, refused) from refused


def _as_impatient_postgresql(connection: Any, _record: object) -> None:
    with connection.cursor() as cursor:
        cursor.execute(f"SET lock_timeout = {round(1000 * WAIT_S)}")
    connection.commit()


def _begin_sqlite(connection: Connection) -> None:
    """A transaction that will write waits for its turn now: later it could only fail."""
    wait_s = connection.get_execution_options().get(WAITS, WAIT_S)
    writes = connection.get_execution_options().get("writes", False)
    connection.connection.cursor().execute(f"PRAGMA busy_timeout={round(1000 * wait_s)}")
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


@contextmanager
def transaction(sessions: Sessions) -> Iterator[Session]:
    """A session that may write: committed at the end, or rolled back whole.

    Writers of one process take turns: SQLite would let some of many wait for ever. Raises
    OperationalError where nobody gives way for `WAIT_S`.
    """
    until_s = time.monotonic() + WAIT_S
    with _in_turn(sessions.kw["info"][TURN]), sessions.begin() as session:
        left_s = max(0.0, until_s - time.monotonic())
        session.connection(execution_options={"writes": True, WAITS: left_s})
        yield session


@contextmanager
def _in_turn(turn: Lock | None) -> Iterator[None]:
    if turn is None:
        yield
        return
    if not turn.acquire(timeout=WAIT_S):
        raise OperationalError("BEGIN IMMEDIATE", None, TimeoutError("database is locked"))
    try:
        yield
    finally:
        turn.release()


@contextmanager
def reading(sessions: Sessions) -> Iterator[Session]:
    """A session that only reads, and never waits for one that writes."""
    with sessions() as session:
        if session.get_bind().dialect.name == POSTGRESQL:
            session.connection(execution_options=EACH_ALONE)
        yield session


@contextmanager
def looking(engine: Engine) -> Iterator[Connection]:
    """A connection that only reads."""
    alone = EACH_ALONE if engine.dialect.name == POSTGRESQL else {}
    with engine.connect().execution_options(**alone) as connection:
        yield connection


def sessions_of(engine: Engine) -> Sessions:
    """Makes sessions; what they loaded stays readable after the commit."""
    turn = Lock() if engine.dialect.name == SQLITE else None
    return sessionmaker(engine, expire_on_commit=False, info={TURN: turn})


def count_rows(session: Session, table: type[DeclarativeBase], *where: ColumnElement[bool]) -> int:
    """How many rows of a table are so."""
    return session.scalar(select(func.count()).select_from(table).where(*where)) or 0
