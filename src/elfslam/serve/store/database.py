"""What the server remembers: users, recordings, uploads, jobs and maps, in one SQL database.

Files lie beside it, content-addressed (`blobs.py`); rows name them by their SHA-256.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime
from enum import StrEnum
from threading import Lock
from typing import Any

from sqlalchemy import JSON, BigInteger, DateTime, Dialect, Engine, ForeignKey, create_engine, event
from sqlalchemy.engine import URL, Connection, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError
from sqlalchemy.orm import DeclarativeBase, Mapped, Session, mapped_column, sessionmaker
from sqlalchemy.types import TypeDecorator

from elfslam.base.errors import InputError, StoreError

Sessions = sessionmaker[Session]
POSTGRESQL, SQLITE = "postgresql", "sqlite"
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

    One row. `id` is that of the folder (`identity.py`), `signing_key` the key's fingerprint.
    """

    __tablename__ = "stores"
    id: Mapped[str] = mapped_column(primary_key=True)
    signing_key: Mapped[str | None] = mapped_column(default=None)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


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
    Raises InputError for a URL that is none, StoreError where the database does not answer.
    """
    try:
        engine = create_engine(url, pool_pre_ping=True, pool_size=CONNECTIONS)
    except (ArgumentError, ModuleNotFoundError, TypeError, ValueError) as error:
        raise InputError(
            f"database {shown_url(url)}: {_without(url, error)}; wanted such as "
            "postgresql+psycopg://USER@HOST/NAME"
        ) from error
    if engine.dialect.name == SQLITE:
        event.listen(engine, "connect", _as_careful_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    with answering(engine), engine.connect() as connection:
        connection.exec_driver_sql("SELECT 1")
    return engine


@contextmanager
def answering(engine: Engine) -> Iterator[None]:
    """Raise StoreError, in one line, where a database does not answer or is damaged."""
    try:
        yield
    except (DBAPIError, UnicodeDecodeError) as error:
        raise StoreError(
            f"database {shown_url(engine.url)}: cannot be read ({first_line(error)}); is it "
            "there, whole, and may you write to it?"
        ) from error


def shown_url(url: str | URL) -> str:
    """A URL without its password; nothing of what cannot be taken apart."""
    try:
        return make_url(url).render_as_string(hide_password=True)
    except (ArgumentError, ValueError):
        return f"of {len(str(url))} characters (no URL)"


def first_line(error: BaseException) -> str:
    """The first line of what a database said."""
    said = str(getattr(error, "orig", None) or error).strip()
    return said.partition("\n")[0][:200]


def _without(url: str, error: Exception) -> str:
    """What an error says, unless it repeats the URL with its password."""
    said = first_line(error)
    return "cannot be parsed" if url in said or url[:40] in said else said


def _as_careful_sqlite(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # transactions begin where _begin_sqlite says so
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "busy_timeout=60000"):
        connection.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: Connection) -> None:
    """A transaction that will write waits for its turn now: later it could only fail."""
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


@contextmanager
def transaction(sessions: Sessions) -> Iterator[Session]:
    """A session that may write: committed at the end, or rolled back whole.

    Writers of one process take turns: SQLite would let some of many wait for ever.
    """
    with sessions.kw["info"][TURN], sessions.begin() as session:
        session.connection(execution_options={"writes": True})
        yield session


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
    turn = Lock() if engine.dialect.name == SQLITE else nullcontext()
    return sessionmaker(engine, expire_on_commit=False, info={TURN: turn})
