"""How a data folder and its database are opened: lock, identity, version, and then the rest.

Both know one id, and nothing is done if they differ: a server that took another database for its
own would find that nobody names its files. The row of the store names the folder that was last used
with it, and carries a beat, which whoever serves the folder changes again and again. Another folder
listens before it takes the database over: so clocks need not agree, and what a killed server left
behind is silent.
"""

import fcntl
import json
import os
import re
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from sqlalchemy import Engine, inspect, select, text
from sqlalchemy.engine import Connection, make_url
from sqlalchemy.exc import SQLAlchemyError

from elfslam.base.errors import StoreError
from elfslam.base.urls import shown_url
from elfslam.data.atomic_files import replaced_file
from elfslam.serve.problems import LOG
from elfslam.serve.settings import ServerSettings, prepare_folders
from elfslam.serve.store.blobs import SHA256
from elfslam.serve.store.database import (
    SQLITE,
    Sessions,
    answering,
    open_database,
    sessions_of,
    shown_database,
    transaction,
    write_ahead,
)
from elfslam.serve.store.schema import State, check_tables, state_of, upgrade
from elfslam.serve.store.tables import Store, new_id

STORE = "store.json"
ID = re.compile(r"[0-9a-f]{32}")
NAMING = {
    "recording_files": ("sha256", SHA256),
    "map_files": ("sha256", SHA256),
    "map_parts": ("sha256", SHA256),
    "job_files": ("sha256", SHA256),
    "uploads": ("id", ID),
}
"""Columns whose values are the names of files in the data folder, in every version."""
ANOTHER = "name the right one, or the right data folder"
ARGUMENT = "database"


@dataclass(frozen=True)
class Identity:
    """What a data folder knows of its store: its id, and the database it was last used with."""

    id: str
    database: str


def read_identity(folder: Path) -> Identity | None:
    """The identity of a data folder; None where it has none yet. Raises StoreError."""
    file = folder / STORE
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
        return Identity(str(told["id"]), str(told["database"]))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise StoreError(
            f"{file}: cannot be read ({type(error).__name__}); restore it from a backup, or delete "
            "it: it is made anew if the database names files of this folder"
        ) from error


def write_identity(folder: Path, identity: Identity) -> None:
    """Keep the identity of a data folder, if it is another than before."""
    if read_identity(folder) == identity:
        return
    with replaced_file(folder / STORE) as partial:
        told = {"id": identity.id, "database": identity.database}
        partial.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def files_of(settings: ServerSettings) -> set[str]:
    """The names of all blobs and uploads in a data folder, those that were set aside among them."""
    kept = {file.name for file in settings.blobs_folder.glob("*/*") if SHA256.fullmatch(file.name)}
    others = (settings.uploads_folder, settings.quarantine_folder)
    return kept | {file.name for folder in others for file in folder.glob("*")}


def refuse_lost_database(settings: ServerSettings, *, is_empty: bool) -> None:
    """Raise StoreError where a database without any table meets a folder with files."""
    count = len(files_of(settings)) if is_empty else 0
    if not count:
        return
    known = read_identity(settings.data_folder)
    before = f"; the folder was last used with {shown_url(known.database)}" if known else ""
    raise StoreError(
        f"database {shown_url(settings.url)}: is missing or empty, and {settings.data_folder} "
        f"holds {count} files that it should name{before}; {ANOTHER}, or restore it from "
        f"{settings.backups_folder}",
        argument=ARGUMENT,
    )


def refuse_another(engine: Engine, settings: ServerSettings) -> None:
    """Raise StoreError where a database with tables is not that of the folder.

    Where one of the two has no id yet, they belong together if the database names files that lie
    there, or neither has any.
    """
    folder, known = settings.data_folder, read_identity(settings.data_folder)
    with answering(engine), engine.connect() as connection:
        theirs, named = _id_in(connection), _named_in(connection)
    shown, files = shown_database(engine), files_of(settings)
    before = f", which was last used with {shown_url(known.database)}" if known else ""
    if theirs and not (known.id == theirs if known else named & files):
        raise StoreError(
            f"database {shown}: belongs to another data folder than {folder}{before}; {ANOTHER}",
            argument=ARGUMENT,
        )
    if not theirs and (named or files) and not named & files:
        raise StoreError(
            f"database {shown}: names {len(named)} files, none of the {len(files)} that lie in "
            f"{folder}{before}; {ANOTHER}",
            argument=ARGUMENT,
        )


def introduce(sessions: Sessions, settings: ServerSettings) -> None:
    """Let a folder and its database know each other, the folder first."""
    folder = settings.data_folder
    known = read_identity(folder)
    with transaction(sessions) as session:
        row = session.scalar(select(Store))
        store_id = row.id if row else known.id if known else new_id()
        write_identity(folder, Identity(store_id, shown_url(settings.url)))
        if row is None:
            session.add(Store(id=store_id))


def _id_in(connection: Connection) -> str | None:
    if Store.__tablename__ not in inspect(connection).get_table_names():
        return None
    return connection.execute(select(Store.id)).scalar()


def _named_in(connection: Connection) -> set[str]:
    """Every file that a database of whatever version names. Raises StoreError for a bad name."""
    tables, named = set(inspect(connection).get_table_names()), set[str]()
    for table, (column, pattern) in NAMING.items():
        query = text(f"SELECT {column} FROM {table}")
        told = set(connection.execute(query).scalars()) if table in tables else set()
        if wrong := [name for name in told if not pattern.fullmatch(str(name))]:
            raise StoreError(
                f"database {shown_database(connection.engine)}: a row of table {table} names "
                f"{str(wrong[0])!r:.60}, which is no name of a file here; restore a backup"
            )
        named |= told
    return named


BOOT = Path("/proc/sys/kernel/random/boot_id")
BEAT_S = 5.0
LISTEN_S = 3 * BEAT_S
LOOK_S = 0.5
Wait = Callable[[float], object]


@dataclass(frozen=True)
class Holder:
    """A data folder as no copy of it has it, that of a cloned machine not either."""

    host: str
    folder: str
    inode: str
    boot: str = ""


@dataclass(frozen=True)
class Held:
    """What a database says of who holds it."""

    holder: Holder | None = None
    beat: str | None = None


def holder_of(folder: Path) -> Holder:
    """The data folder of this machine, since it was started."""
    place = folder.resolve()
    told, boot = place.stat(), BOOT.read_text("utf-8").strip() if BOOT.is_file() else ""
    return Holder(socket.gethostname(), str(place), f"{told.st_dev}:{told.st_ino}", boot)


def read_held(engine: Engine) -> Held:
    """Who holds a database of whatever version."""
    with answering(engine), engine.connect() as connection:
        inspector = inspect(connection)
        if not inspector.has_table(Store.__tablename__):
            return Held()
        if Store.holder.key not in {each["name"] for each in inspector.get_columns("stores")}:
            return Held()
        row = connection.execute(select(Store.holder, Store.beat)).first()
    return Held() if row is None else _held_of(row.holder, row.beat)


def _held_of(told: Mapping[str, str] | None, beat: str | None) -> Held:
    """What a row says. Raises StoreError."""
    try:
        return Held(None if told is None else Holder(**told), beat)
    except TypeError as error:
        raise StoreError(
            f"database: says {told!r:.60} of who holds it, wanted host and folder; restore a backup"
        ) from error


def free_to_take(engine: Engine, settings: ServerSettings, wait: Wait = time.sleep) -> Held:
    """Who held a database that this folder may take now. Raises StoreError where another has it.

    A folder that was moved takes its database along, once nobody serves it where it was.
    """
    held, mine = read_held(engine), holder_of(settings.data_folder)
    if held.holder is None or held.holder == mine:
        return held
    if not _lies_in(engine, settings.data_folder) and _is_there(held.holder, mine, settings):
        raise _held_by(engine, held.holder, settings, "is there as well: one of them is a copy")
    listened_s = 0.0
    while held.beat is not None and listened_s < LISTEN_S:
        wait(LOOK_S)
        listened_s += LOOK_S
        if read_held(engine) != held:
            raise _held_by(engine, held.holder, settings, "is being served")
    return held


def take(sessions: Sessions, settings: ServerSettings, before: Held) -> None:
    """Let a folder hold its database. Raises StoreError where another was quicker."""
    with transaction(sessions) as session:
        row = session.scalars(select(Store).with_for_update()).one()
        if _held_of(row.holder, row.beat) != before:
            raise StoreError(
                f"database {shown_url(settings.url)}: another server begins with it at this "
                "moment; choose one"
            )
        row.holder, row.beat = asdict(holder_of(settings.data_folder)), None


@contextmanager
def holding(
    sessions: Sessions,
    settings: ServerSettings,
    *,
    lost: Callable[[], None] = lambda: signal.raise_signal(signal.SIGTERM),
    beat_s: float = BEAT_S,
) -> Iterator[None]:
    """Tell others, as long as this lasts, that the folder is served.

    `lost` is called where another folder has taken the database. Raises StoreError where one did
    so already. A database inside the folder is held by the folder's lock.
    """
    if _lies_in(sessions.kw["bind"], settings.data_folder):
        yield
        return
    mine, stop = holder_of(settings.data_folder), threading.Event()
    if not _beats(sessions, mine, new_id()):
        raise StoreError(
            f"database {shown_url(settings.url)}: was taken by another folder just now; choose one"
        )
    thread = threading.Thread(target=_beat_on, args=(sessions, mine, stop, lost, beat_s))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        try:
            _beats(sessions, mine, None)
        except SQLAlchemyError as error:
            LOG.warning("the database was not told that nobody serves it any more: %s", error)


def _beat_on(
    sessions: Sessions, mine: Holder, stop: threading.Event, lost: Callable[[], None], beat_s: float
) -> None:
    while not stop.wait(beat_s):
        try:
            if not _beats(sessions, mine, new_id()):
                LOG.error("another data folder was given this database; stopping")
                lost()
                return
        except SQLAlchemyError as error:
            LOG.warning("the database was not told that this folder is served: %s", error)


def _beats(sessions: Sessions, mine: Holder, beat: str | None) -> bool:
    """Whether the folder still holds the database, which then has its next beat."""
    with transaction(sessions) as session:
        row = session.scalars(select(Store).with_for_update()).one()
        if row.holder != asdict(mine):
            return False
        row.beat = beat
        return True


def _lies_in(engine: Engine, folder: Path) -> bool:
    """Whether a database is a file of the folder, which is copied with it."""
    file = engine.url.database if engine.dialect.name == "sqlite" else None
    return bool(file) and Path(os.path.realpath(str(file))).parent == folder.resolve()


def _is_there(holder: Holder, mine: Holder, settings: ServerSettings) -> bool:
    """Whether the folder of a holder lies on this machine, and is not where we are."""
    if holder.host != mine.host or holder.folder == mine.folder:
        return False
    try:
        theirs, ours = read_identity(Path(holder.folder)), read_identity(settings.data_folder)
    except StoreError:
        return True
    return theirs is not None and ours is not None and theirs.id == ours.id


def _held_by(engine: Engine, holder: Holder, settings: ServerSettings, why: str) -> StoreError:
    return StoreError(
        f"database {shown_database(engine)}: belongs to the data folder {holder.folder} on "
        f"{holder.host}, which {why}; serve that one, or to hand the database over to "
        f"{settings.data_folder} stop it and move or delete it first"
    )


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


def open_store(settings: ServerSettings, examine: Examine | None = None) -> Engine:
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
        if examine is not None:
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
