"""What the server remembers: users, recordings, uploads, jobs and maps, in one SQL database.

Files lie beside it, content-addressed (`blobs.py`); rows name them by their SHA-256.
"""

from __future__ import annotations

import sqlite3
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from enum import StrEnum
from threading import Lock
from typing import Any

from sqlalchemy import JSON, BigInteger, DateTime, Dialect, Engine, ForeignKey, create_engine, event
from sqlalchemy.engine import URL, Connection, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import DeclarativeBase, Mapped, Session, mapped_column, sessionmaker
from sqlalchemy.types import TypeDecorator

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


class RecordingState(StrEnum):
    """How far a recording has come."""

    RECEIVING = "receiving"
    READY = "ready"
    REFUSED = "refused"


class JobKind(StrEnum):
    """What a job does."""

    MAP = "map"
    MERGE = "merge"
    LOCATE = "locate"


class JobState(StrEnum):
    """How far a job has come."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class Utc(TypeDecorator[datetime]):
    """A time in UTC, also where the database keeps no zone."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """The time as it was stored."""
        if value is None or value.tzinfo is None:
            return value and value.replace(tzinfo=UTC)
        return value.astimezone(UTC)


class Base(DeclarativeBase):
    """Every table; times are UTC, ids are random and tell nothing."""

    type_annotation_map = {dict[str, Any]: JSON, list[str]: JSON, datetime: Utc}  # noqa: RUF012


def new_id() -> str:
    """An id that nobody can guess."""
    return uuid.uuid4().hex


def now_utc() -> datetime:
    """The time now."""
    return datetime.now(UTC)


class User(Base):
    """Someone with a pairing token, of which only the SHA-256 is kept."""

    __tablename__ = "users"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    name: Mapped[str]
    token_sha256: Mapped[str] = mapped_column(unique=True, index=True)
    is_owner: Mapped[bool] = mapped_column(default=False)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class Recording(Base):
    """A walk, by whoever uploaded it. `refusal` says why it cannot be read."""

    __tablename__ = "recordings"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[str] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"), index=True)
    name: Mapped[str]
    device: Mapped[str] = mapped_column(default="unknown")
    state: Mapped[str] = mapped_column(default=RecordingState.RECEIVING)
    refusal: Mapped[str | None] = mapped_column(default=None)
    facts: Mapped[dict[str, Any]] = mapped_column(default=dict)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class RecordingFile(Base):
    """One file of a recording's folder."""

    __tablename__ = "recording_files"
    recording_id: Mapped[str] = mapped_column(
        ForeignKey("recordings.id", ondelete="CASCADE"), primary_key=True
    )
    name: Mapped[str] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(index=True)
    size_bytes: Mapped[int] = mapped_column(BigInteger)


class Upload(Base):
    """A file on its way. What has come lies on disk; its length is the offset.

    A whole recording as a .zip has no recording before its last byte came; then it is `finished`
    and its file is gone.
    """

    __tablename__ = "uploads"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[str] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"), index=True)
    recording_id: Mapped[str | None] = mapped_column(
        ForeignKey("recordings.id", ondelete="CASCADE"), index=True
    )
    file_name: Mapped[str]
    length_bytes: Mapped[int | None] = mapped_column(BigInteger, default=None)
    wants_map: Mapped[bool] = mapped_column(default=True)
    finished: Mapped[bool] = mapped_column(default=False)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class Job(Base):
    """Work in the background: `given` is what it was asked, `gave` what came of it.

    `claim` is known to the one runner alone that works on it.
    """

    __tablename__ = "jobs"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[str] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"), index=True)
    kind: Mapped[str]
    state: Mapped[str] = mapped_column(default=JobState.QUEUED, index=True)
    given: Mapped[dict[str, Any]] = mapped_column(default=dict)
    gave: Mapped[dict[str, Any]] = mapped_column(default=dict)
    doing: Mapped[str] = mapped_column(default="")
    share: Mapped[float | None] = mapped_column(default=None)
    attempts: Mapped[int] = mapped_column(default=0)
    claim: Mapped[str | None] = mapped_column(default=None)
    problem: Mapped[str | None] = mapped_column(default=None)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)
    started_utc: Mapped[datetime | None] = mapped_column(default=None)
    finished_utc: Mapped[datetime | None] = mapped_column(default=None)


class JobFile(Base):
    """A file that a job made and that is part of no map."""

    __tablename__ = "job_files"
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    name: Mapped[str] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(index=True)
    size_bytes: Mapped[int] = mapped_column(BigInteger)


class Map(Base):
    """What a job made: the folder of a run, or of a floor map merged from runs.

    `sources` are the recordings that it came from, `floor_plan` the image below it. It may lie in a
    venue, and there on a floor, both by their names.
    """

    __tablename__ = "maps"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[str] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"), index=True)
    name: Mapped[str]
    kind: Mapped[str]
    sources: Mapped[list[str]] = mapped_column(default=list)
    facts: Mapped[dict[str, Any]] = mapped_column(default=dict)
    floor_plan: Mapped[dict[str, Any] | None] = mapped_column(default=None)
    venue: Mapped[str | None] = mapped_column(default=None)
    floor: Mapped[str | None] = mapped_column(default=None)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class MapFile(Base):
    """One file of a map's folder."""

    __tablename__ = "map_files"
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True)
    name: Mapped[str] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(index=True)
    size_bytes: Mapped[int] = mapped_column(BigInteger)


class Store(Base):
    """Which data folder's files this database names, and which key its phones trust.

    One row. `id` is that of the folder (`identity.py`), `signing_key` the key's fingerprint;
    `holder` and `beat` say who serves it (`holding.py`).
    """

    __tablename__ = "stores"
    id: Mapped[str] = mapped_column(primary_key=True)
    signing_key: Mapped[str | None] = mapped_column(default=None)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)
    holder: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True), default=None)
    beat: Mapped[str | None] = mapped_column(default=None)


class MapPackage(Base):
    """What phones are told of a map, which `sources_sha256` says from what it was made.

    The revision grows with every change.
    """

    __tablename__ = "map_packages"
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True)
    sources_sha256: Mapped[str]
    revision: Mapped[int] = mapped_column(BigInteger)
    manifest: Mapped[str]


class MapPart(Base):
    """A tile of a map's package."""

    __tablename__ = "map_parts"
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True)
    sha256: Mapped[str] = mapped_column(primary_key=True, index=True)
    size_bytes: Mapped[int] = mapped_column(BigInteger)


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
