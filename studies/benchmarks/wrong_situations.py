"""What can be wrong when a server starts; `wrong_starts.py` tries each."""

from __future__ import annotations

import json
import os
import shutil
import socket
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from elfslam.serve.network.authority import SIGNING_KEY
from elfslam.serve.network.running import OWNER_TOKEN
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.holding import STORE, files_of, holding
from elfslam.serve.store.opening import alone_with

RELEASED = Path(__file__).parents[2] / "tests" / "serve" / "store" / "released"
SERVES, REFUSED = "serves", "exit 2"
SQLITE, PASSWORD = "elfslam.sqlite", "hunter2"
TOKEN, KEY = f"authority/{OWNER_TOKEN}", f"authority/{SIGNING_KEY}"


@dataclass(frozen=True)
class Start:
    """How a server is started: where, what is wanted of it, and what else is said."""

    settings: ServerSettings
    wanted: str = REFUSED
    words: tuple[str, ...] = ()
    clock: str = ""
    secure: bool = False
    most_files: int = 0
    meanwhile: Callable[[], AbstractContextManager[object]] = nullcontext
    """What others do while it starts."""
    kept: ServerSettings | None = None
    """Where the store lies that must stay as it is, if not there."""
    renewed: frozenset[str] = frozenset()
    """Keys that are to be made anew."""
    says: str = ""


Situation = Callable[[ServerSettings, Path], Start]


def as_it_was(settings: ServerSettings, _elsewhere: Path) -> Start:
    return Start(settings, SERVES)


def said(*words: str, wanted: str = REFUSED, says: str = "", secure: bool = False) -> Situation:
    """Words of the command line."""
    return lambda settings, _: Start(settings, wanted, words, says=says, secure=secure)


def of_database(url: str) -> Situation:
    """Another database."""
    return lambda settings, _: Start(replace(settings, database_url=url))


def removed(settings: ServerSettings, _elsewhere: Path) -> Start:
    for file in settings.data_folder.glob(f"{SQLITE}*"):
        file.unlink()
    return Start(settings)


def emptied(settings: ServerSettings, elsewhere: Path) -> Start:
    removed(settings, elsewhere)
    (settings.data_folder / SQLITE).touch()
    return Start(settings)


def set_aside(settings: ServerSettings, elsewhere: Path) -> Start:
    """Every file lies in quarantine, and the database is gone."""
    for file in [*settings.blobs_folder.glob("*/*"), *settings.uploads_folder.iterdir()]:
        file.rename(settings.quarantine_folder / file.name)
    return removed(settings, elsewhere)


def of_another_path(settings: ServerSettings, elsewhere: Path) -> Start:
    return Start(replace(settings, database_url=f"sqlite:///{elsewhere / 'new.sqlite'}"))


def of_another_store(settings: ServerSettings, elsewhere: Path) -> Start:
    other = ServerSettings(elsewhere / "other")
    with alone_with(other):
        open_services(other, alone=True).engine.dispose()
    return Start(replace(settings, database_url=other.url))


def in_a_new_folder(settings: ServerSettings, elsewhere: Path) -> Start:
    return Start(ServerSettings(elsewhere / "new", settings.url), kept=settings)


def forgotten(settings: ServerSettings, _elsewhere: Path) -> Start:
    return Start(replace(settings, database_url=""))


def cut_off(settings: ServerSettings, _elsewhere: Path) -> Start:
    file = settings.data_folder / SQLITE
    file.write_bytes(file.read_bytes()[:-9000])
    return Start(settings)


def overwritten(settings: ServerSettings, _elsewhere: Path) -> Start:
    (settings.data_folder / SQLITE).write_bytes(b"no database at all" * 500)
    return Start(settings)


def by_hand(*statements: str) -> Situation:
    """The database changed by hand."""

    def changed(settings: ServerSettings, _elsewhere: Path) -> Start:
        execute(settings.data_folder / SQLITE, *statements)
        return Start(settings)

    return changed


def execute(file: Path, *statements: str) -> None:
    """Statements for a database of SQLite."""
    connection = sqlite3.connect(file)
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()


def released(settings: ServerSettings, elsewhere: Path) -> Start:
    """A store as version 0.1.0 left it: its database alone, which names none of these files."""
    of_release(settings, elsewhere)
    return Start(settings, SERVES)


def of_release(settings: ServerSettings, elsewhere: Path) -> None:
    removed(settings, elsewhere)
    (settings.data_folder / STORE).unlink()
    connection = sqlite3.connect(settings.data_folder / SQLITE)
    connection.executescript((RELEASED / "0.1.0.sqlite.sql").read_text())
    for number, name in enumerate(sorted(files_of(settings))):
        if len(name) == 64:
            row = ("3" * 32, f"file {number}", name, 1)
            connection.execute("INSERT INTO recording_files VALUES (?, ?, ?, ?)", row)
    connection.execute("UPDATE users SET is_owner = 0")
    connection.commit()
    connection.close()


def upgrade_refused(settings: ServerSettings, elsewhere: Path) -> Start:
    """An older database that would be brought up to date, and a signing key that is none."""
    of_release(settings, elsewhere)
    (settings.data_folder / KEY).write_bytes(b"nonsense")
    return Start(settings)


def file_gone(name: str, *words: str, wanted: str = REFUSED) -> Situation:
    """A file of the data folder was deleted; a start that serves makes it anew."""

    def gone(settings: ServerSettings, _elsewhere: Path) -> Start:
        (settings.data_folder / name).unlink()
        return Start(settings, wanted, words)

    return gone


def file_damaged(name: str, content: bytes = b"\xff\x00nonsense") -> Situation:
    """A file of the data folder was overwritten."""

    def damaged(settings: ServerSettings, _elsewhere: Path) -> Start:
        (settings.data_folder / name).write_bytes(content)
        return Start(settings, secure=True)

    return damaged


def replaced(name: str, make: Callable[[Path], object]) -> Situation:
    """Something else lies in the place of a file or a folder; HTTPS is spoken."""

    def other(settings: ServerSettings, elsewhere: Path) -> Start:
        place = settings.data_folder / name
        if os.path.lexists(place):
            place.rename(elsewhere / "taken away")
        make(place)
        return Start(settings, secure=True)

    return other


def make_socket(place: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        here = os.getcwd()
        os.chdir(place.parent)
        made.bind(place.name)
        os.chdir(here)


def link_to(target: str) -> Callable[[Path], object]:
    return lambda place: place.symlink_to(target)


def blob_is_a_folder(settings: ServerSettings, elsewhere: Path) -> Start:
    """One file less is there, and all others stay."""
    blob = next(settings.blobs_folder.glob("*/*"))
    blob.rename(elsewhere / blob.name)
    blob.mkdir()
    return Start(settings, SERVES, says="1 files that recordings and maps name are missing")


def at_time(clock: str) -> Situation:
    """The clock of the machine was set."""
    return lambda settings, _elsewhere: Start(settings, SERVES, clock=clock)


def few_files(settings: ServerSettings, _elsewhere: Path) -> Start:
    return Start(settings, most_files=12)


def data_is_a_file(settings: ServerSettings, elsewhere: Path) -> Start:
    (elsewhere / "file").touch()
    return Start(ServerSettings(elsewhere / "file"), kept=settings)


def data_cannot_be_made(settings: ServerSettings, _elsewhere: Path) -> Start:
    return Start(ServerSettings(Path("/proc/none")), kept=settings)


def port_taken(settings: ServerSettings, _elsewhere: Path) -> Start:
    taken = socket.create_server(("127.0.0.1", 0))
    return Start(
        settings, words=("--port", str(taken.getsockname()[1])), meanwhile=lambda: taken,
        says="cannot listen there",
    )  # fmt: skip


def external(settings: ServerSettings, elsewhere: Path) -> ServerSettings:
    """The store with a database outside its folder, which it holds."""
    if settings.database_url:
        return settings
    file = elsewhere / "outside.sqlite"
    shutil.move(settings.data_folder / SQLITE, file)
    execute(file, "UPDATE stores SET holder = NULL, beat = NULL")
    outside = replace(settings, database_url=f"sqlite:///{file}")
    with alone_with(outside):
        open_services(outside, alone=True).engine.dispose()
    return outside


def copied(settings: ServerSettings, elsewhere: Path) -> Start:
    """A copy of a data folder, the original beside it, and one database."""
    outside = external(settings, elsewhere)
    shutil.copytree(outside.data_folder, elsewhere / "copy")
    return Start(replace(outside, data_folder=elsewhere / "copy"), says="one of them is a copy")


def copied_and_served(settings: ServerSettings, elsewhere: Path) -> Start:
    outside = external(settings, elsewhere)
    return replace(copied(outside, elsewhere), meanwhile=partial(serving, outside))


@contextmanager
def serving(settings: ServerSettings) -> Iterator[None]:
    """As long as this lasts, a server has the store."""
    with alone_with(settings):
        services = open_services(settings, alone=True)
        with holding(services.sessions, settings, beat_s=0.2):
            yield
        services.engine.dispose()


def served_already(settings: ServerSettings, _elsewhere: Path) -> Start:
    return Start(settings, meanwhile=partial(serving, settings), says="another server is using it")


def moved(settings: ServerSettings, elsewhere: Path) -> Start:
    outside = external(settings, elsewhere)
    outside.data_folder.rename(elsewhere / "moved")
    return Start(replace(outside, data_folder=elsewhere / "moved"), SERVES, kept=_there(elsewhere))


def _there(elsewhere: Path) -> ServerSettings:
    return ServerSettings(elsewhere / "moved")


def restored(settings: ServerSettings, elsewhere: Path) -> Start:
    """A backup of the folder in its place."""
    outside = external(settings, elsewhere)
    outside.data_folder.rename(elsewhere / "broken")
    shutil.copytree(elsewhere / "broken", outside.data_folder)
    (elsewhere / "broken" / STORE).unlink()
    return Start(outside, SERVES)


def held_elsewhere(settings: ServerSettings, elsewhere: Path) -> Start:
    """Another machine serves a copy: of that one nothing is seen but its beat."""
    outside, file = external(settings, elsewhere), elsewhere / "outside.sqlite"
    told = json.dumps({"host": "elsewhere", "folder": "/srv/data", "inode": "1:1"})
    execute(file, f"UPDATE stores SET holder = '{told}', beat = '0'")
    return Start(outside, meanwhile=partial(beating, file), says="/srv/data on elsewhere")


def killed_elsewhere(settings: ServerSettings, elsewhere: Path) -> Start:
    silent = held_elsewhere(settings, elsewhere)
    return replace(silent, meanwhile=nullcontext, wanted=SERVES, says="")


@contextmanager
def beating(file: Path) -> Iterator[None]:
    """Another server holds a database as long as this lasts."""
    stop = threading.Event()

    def beat() -> None:
        count = 0
        while not stop.wait(0.3):
            count += 1
            execute(file, f"UPDATE stores SET beat = '{count}'")

    thread = threading.Thread(target=beat)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def locked(settings: ServerSettings, _elsewhere: Path) -> Start:
    """Another program writes into the database, and does not come to an end."""
    return Start(
        settings, meanwhile=partial(writing, settings.data_folder / SQLITE), says="keeps it locked"
    )


@contextmanager
def writing(file: Path) -> Iterator[None]:
    connection = sqlite3.connect(file, isolation_level=None)
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
    finally:
        connection.close()


def table_locked(settings: ServerSettings, _elsewhere: Path) -> Start:
    return Start(
        settings, meanwhile=partial(locking, settings.database_url), says="keeps it locked"
    )


@contextmanager
def locking(url: str) -> Iterator[None]:
    """Another program has a table of PostgreSQL for itself."""
    import psycopg

    with psycopg.connect(url.replace("+psycopg", "")) as connection:
        connection.execute("LOCK TABLE stores IN ACCESS EXCLUSIVE MODE")
        yield
