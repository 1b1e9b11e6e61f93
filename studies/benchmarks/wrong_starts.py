"""Every way to start a server with a wrong, new, empty, older, newer or damaged database or key.

Usage, from the root of the project:

    python -m studies.benchmarks.wrong_starts

Each row is `elfslam serve` on a store with a recording and an unfinished upload: what it says, its
exit status (or that it serves), and how many of the store's files are still there. Clocks are set
with faketime (Debian: apt-get install faketime), without which those rows are left out.
"""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from elfslam.app.console import print_rows
from elfslam.serve.network.credentials import OWNER_TOKEN
from elfslam.serve.network.reach import LAST_URL
from elfslam.serve.network.signing import SIGNING_KEY
from elfslam.serve.people.users import set_owner_token
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import put
from elfslam.serve.store.database import Recording, RecordingFile, Upload, new_id, transaction
from elfslam.serve.store.identity import STORE, files_of
from elfslam.serve.store.schema import VERSION_TABLE
from studies.benchmarks.own_postgresql import Postgresql, initdb, own_postgresql

RELEASED = Path(__file__).parents[2] / "tests" / "serve" / "store" / "released"
FILES = 20
LONGEST_S = 120.0
SQLITE = "elfslam.sqlite"


@dataclass(frozen=True)
class Start:
    """How a server is started: where, with which clock, and what else is said."""

    settings: ServerSettings
    words: tuple[str, ...] = ()
    clock: str = ""


Situation = Callable[[ServerSettings, Path], Start]


def main() -> None:
    """Print what is said in each situation."""
    rows = [told(name, situation, "") for name, situation in SITUATIONS.items()]
    if initdb() is not None:
        with own_postgresql() as database:
            for number, (name, situation) in enumerate(ON_POSTGRESQL.items()):
                url = new_database(database, f"store{number}")
                rows.append(told(f"PostgreSQL: {name}", situation, url))
    print_rows(rows, title="Starts", as_json=False)


def told(name: str, situation: Situation, url: str) -> dict[str, object]:
    """The row of one start; what it said is printed at once."""
    row = tried(name, situation, url)
    print(f"{name}\n    {row.pop('said')}", flush=True)
    return row


def new_database(server: Postgresql, name: str) -> str:
    """The URL of an empty database."""
    import psycopg

    with psycopg.connect(server.told, autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}")
    return server.url.replace("/elfslam?", f"/{name}?")


def tried(name: str, situation: Situation, url: str) -> dict[str, object]:
    """One start of a store of its own."""
    with tempfile.TemporaryDirectory() as folder:
        elsewhere = Path(folder)
        settings = filled(ServerSettings(elsewhere / "data", url))
        before = files_of(settings)
        start = situation(settings, elsewhere)
        if start.clock and shutil.which("faketime") is None:
            return {"situation": name, "said": "left out", "status": "-", "files": "-"}
        said, status = served(start)
        left = files_of(settings) & before
        return {"situation": name, "said": said.replace(folder, ""), "status": status,
                "files": f"{len(left)} of {len(before)}"}  # fmt: skip


def filled(settings: ServerSettings) -> ServerSettings:
    """A store that was served once, with a recording of many files and an upload on its way."""
    first, _ = served(Start(settings))
    services = open_services(settings)
    token = (settings.authority_folder / OWNER_TOKEN).read_text().strip()
    user, upload_id = set_owner_token(services, token), new_id()
    with transaction(services.sessions) as session:
        recording = Recording(user_id=user.id, name="walk", state="ready")
        session.add(recording)
        session.flush()
        for number in range(FILES):
            file = settings.work_folder / "content"
            file.write_text(f"{first} {number}")
            blob = put(settings.blobs_folder, file)
            file.unlink()
            told = {"sha256": blob.sha256, "size_bytes": blob.size_bytes}
            session.add(RecordingFile(recording_id=recording.id, name=str(number), **told))
        session.add(Upload(id=upload_id, user_id=user.id, file_name="walk.zip"))
        (settings.uploads_folder / upload_id).write_bytes(b"came" * 1000)
    services.engine.dispose()
    (settings.authority_folder / LAST_URL).unlink()
    return settings


def served(start: Start) -> tuple[str, str]:
    """What a server says that is started, and how it ended; one that serves is stopped."""
    settings = start.settings
    command = ["elfslam.cli", "serve", "--http", "--port", "0", "--no-jobs"]
    command += ["--data", str(settings.data_folder), *start.words]
    command += ["--database", settings.database_url] if settings.database_url else []
    code = "import sys; sys.argv = sys.argv[1:]; from elfslam.cli import main; main()"
    clock = ["faketime", "-f", start.clock] if start.clock else []
    process = subprocess.Popen(
        [*clock, sys.executable, "-c", code, *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "FAKETIME_DONT_FAKE_MONOTONIC": "1"},
        start_new_session=True,
    )
    watch = threading.Timer(LONGEST_S, process.kill)
    watch.start()
    assert process.stdout is not None
    serves = bool(process.stdout.readline())
    if serves:
        while "Scan this" not in process.stdout.readline():
            pass
        os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate()
    watch.cancel()
    return " | ".join(said.strip().splitlines()) or "-", (
        "serves" if serves else f"exit {process.returncode}"
    )


def as_it_was(settings: ServerSettings, _elsewhere: Path) -> Start:
    return Start(settings)


def removed(settings: ServerSettings, _elsewhere: Path) -> Start:
    for file in settings.data_folder.glob(f"{SQLITE}*"):
        file.unlink()
    return Start(settings)


def emptied(settings: ServerSettings, elsewhere: Path) -> Start:
    removed(settings, elsewhere)
    (settings.data_folder / SQLITE).touch()
    return Start(settings)


def of_another_path(settings: ServerSettings, elsewhere: Path) -> Start:
    return Start(replace(settings, database_url=f"sqlite:///{elsewhere / 'new.sqlite'}"))


def of_another_store(settings: ServerSettings, elsewhere: Path) -> Start:
    other = filled(ServerSettings(elsewhere / "other"))
    return Start(replace(settings, database_url=other.url))


def in_a_new_folder(settings: ServerSettings, elsewhere: Path) -> Start:
    return Start(ServerSettings(elsewhere / "new", settings.url))


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
        connection = sqlite3.connect(settings.data_folder / SQLITE)
        for statement in statements:
            connection.execute(statement)
        connection.commit()
        connection.close()
        return Start(settings)

    return changed


def released(settings: ServerSettings, elsewhere: Path) -> Start:
    """A store as version 0.1.0 left it: its database alone, which names none of these files."""
    removed(settings, elsewhere)
    (settings.data_folder / STORE).unlink()
    connection = sqlite3.connect(settings.data_folder / SQLITE)
    connection.executescript((RELEASED / "0.1.0.sqlite.sql").read_text())
    for number, name in enumerate(sorted(files_of(settings))):
        row = ("3" * 32, f"file {number}", name, 1)
        connection.execute("INSERT INTO recording_files VALUES (?, ?, ?, ?)", row)
    connection.execute("UPDATE users SET is_owner = 0")
    connection.commit()
    connection.close()
    return Start(settings)


def file_gone(name: str, *words: str) -> Situation:
    """A file of the data folder was deleted."""

    def gone(settings: ServerSettings, _elsewhere: Path) -> Start:
        (settings.data_folder / name).unlink()
        return Start(settings, words)

    return gone


def file_damaged(name: str, content: bytes = b"\xff\x00nonsense") -> Situation:
    """A file of the data folder was overwritten."""

    def damaged(settings: ServerSettings, _elsewhere: Path) -> Start:
        (settings.data_folder / name).write_bytes(content)
        return Start(settings)

    return damaged


def at_time(clock: str) -> Situation:
    """The clock of the machine was set."""
    return lambda settings, _elsewhere: Start(settings, (), clock)


SITUATIONS: dict[str, Situation] = {
    "nothing wrong": as_it_was,
    "database removed": removed,
    "database of no bytes": emptied,
    "--database of a new path": of_another_path,
    "--database of another store": of_another_store,
    "--data of a new folder": in_a_new_folder,
    "database cut off": cut_off,
    "database overwritten": overwritten,
    "version 0.1.0, upgraded": released,
    "newer version": by_hand(f"UPDATE {VERSION_TABLE} SET version_num = '0099'"),
    "column renamed": by_hand("ALTER TABLE jobs RENAME COLUMN doing TO done"),
    "table dropped": by_hand("DROP TABLE map_parts"),
    "identity deleted": file_gone(STORE),
    "identity damaged": file_damaged(STORE),
    "owner.token deleted": file_gone(f"authority/{OWNER_TOKEN}"),
    "owner.token deleted, --new-token": file_gone(f"authority/{OWNER_TOKEN}", "--new-token"),
    "owner.token of another": file_damaged(f"authority/{OWNER_TOKEN}", b"another-token"),
    "owner.token damaged": file_damaged(f"authority/{OWNER_TOKEN}"),
    "signing.key deleted": file_gone(f"authority/{SIGNING_KEY}"),
    "signing.key deleted, --new-key": file_gone(f"authority/{SIGNING_KEY}", "--new-key"),
    "signing.key damaged": file_damaged(f"authority/{SIGNING_KEY}"),
    "clock 400 days ahead": at_time("+400d"),
    "clock 3 years back": at_time("-1095d"),
}
ON_POSTGRESQL: dict[str, Situation] = {
    "nothing wrong": as_it_was,
    "--database forgotten": forgotten,
    "--database of another store": of_another_store,
}


if __name__ == "__main__":
    main()
