"""Every way to start a server with something wrong, and what it says.

Usage, from the root of the project:

    python -m studies.benchmarks.wrong_starts [NAME...]

Each row is `elfslam serve` on a store with a recording and an unfinished upload: what was wanted,
its exit status (or that it serves), how many of the store's files are still there, whether its keys
are those of before, and whether a refused start changed nothing in the data folder. Clocks are set
with faketime (Debian: apt-get install faketime), without which those rows are left out.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import urlsplit

from elfslam.app.console import print_rows
from elfslam.serve.network.addresses import LAST_URL
from elfslam.serve.network.authority import AUTHORITY, AUTHORITY_KEY
from elfslam.serve.network.running import OWNER_TOKEN
from elfslam.serve.people.users import set_owner_token
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import put
from elfslam.serve.store.database import transaction
from elfslam.serve.store.holding import STORE, files_of
from elfslam.serve.store.opening import alone_with
from elfslam.serve.store.schema import VERSION_TABLE
from elfslam.serve.store.tables import Recording, RecordingFile, Upload, new_id
from studies.benchmarks import wrong_situations as wrong
from studies.benchmarks.own_postgresql import Postgresql, initdb, own_postgresql
from studies.benchmarks.wrong_situations import PASSWORD, SERVES, Situation, Start

NOWHERE = f"postgresql+psycopg://me:{PASSWORD}@127.0.0.1:1/d"
SITUATIONS: dict[str, Situation] = {
    "nothing wrong": wrong.as_it_was,
    "database removed": wrong.removed,
    "database of no bytes": wrong.emptied,
    "database removed, all files in quarantine": wrong.set_aside,
    "--database of a new path": wrong.of_another_path,
    "--database of another store": wrong.of_another_store,
    "--database that nobody answers": wrong.of_database(NOWHERE),
    "--database, password in the query": wrong.of_database(
        f"postgresql+psycopg://127.0.0.1:1/d?user=me&password={PASSWORD}"
    ),
    "--database, a password with an @": wrong.of_database(
        f"postgresql+psycopg://me:a@{PASSWORD}@127.0.0.1:1/d"
    ),
    "--database of an unknown kind": wrong.of_database(f"cassandra://me:{PASSWORD}@host/d"),
    "--data of a new folder": wrong.in_a_new_folder,
    "--data is a file": wrong.data_is_a_file,
    "--data that cannot be made": wrong.data_cannot_be_made,
    "database cut off": wrong.cut_off,
    "database overwritten": wrong.overwritten,
    "database is a folder": wrong.replaced(wrong.SQLITE, Path.mkdir),
    "database is a pipe": wrong.replaced(wrong.SQLITE, os.mkfifo),
    "database locked by another program": wrong.locked,
    "version 0.1.0, upgraded": wrong.released,
    "version 0.1.0, and a damaged key": wrong.upgrade_refused,
    "newer version": wrong.by_hand(f"UPDATE {VERSION_TABLE} SET version_num = '0099'"),
    "two versions at once": wrong.by_hand(f"INSERT INTO {VERSION_TABLE} VALUES ('0005')"),
    "column renamed": wrong.by_hand("ALTER TABLE jobs RENAME COLUMN doing TO done"),
    "table dropped": wrong.by_hand("DROP TABLE map_parts"),
    "tables of another program": wrong.by_hand("ALTER TABLE uploads RENAME TO cakes"),
    "a path in place of a SHA-256": wrong.by_hand(
        "UPDATE recording_files SET sha256 = '../../etc/passwd' WHERE name = '3'"
    ),
    "a time that is none": wrong.by_hand("UPDATE recordings SET created_utc = 'yesterday'"),
    "a blob is a folder": wrong.blob_is_a_folder,
    "identity deleted": wrong.file_gone(STORE, wanted=SERVES),
    "identity damaged": wrong.file_damaged(STORE),
    "identity is a folder": wrong.replaced(STORE, Path.mkdir),
    ".lock is a folder": wrong.replaced(".lock", Path.mkdir),
    "jobs.lock is a folder": wrong.replaced("jobs.lock", Path.mkdir),
    "blobs/.lock is a folder": wrong.replaced("blobs/.lock", Path.mkdir),
    "quarantine is a file": wrong.replaced("quarantine", Path.touch),
    "work is a link to nowhere": wrong.replaced("work", wrong.link_to("nowhere")),
    "owner.token deleted": wrong.file_gone(wrong.TOKEN),
    "owner.token deleted, --new-token": wrong.file_gone(wrong.TOKEN, "--new-token", wanted=SERVES),
    "owner.token of another": wrong.file_damaged(wrong.TOKEN, b"another-token"),
    "owner.token damaged": wrong.file_damaged(wrong.TOKEN),
    "owner.token is a pipe": wrong.replaced(wrong.TOKEN, os.mkfifo),
    "signing.key deleted": wrong.file_gone(wrong.KEY),
    "signing.key deleted, --new-key": wrong.file_gone(wrong.KEY, "--new-key", wanted=SERVES),
    "signing.key damaged": wrong.file_damaged(wrong.KEY),
    "signing.key is a pipe": wrong.replaced(wrong.KEY, os.mkfifo),
    "signing.key is a folder": wrong.replaced(wrong.KEY, Path.mkdir),
    "signing.key is a socket": wrong.replaced(wrong.KEY, wrong.make_socket),
    "signing.key is /dev/zero": wrong.replaced(wrong.KEY, wrong.link_to("/dev/zero")),
    "signing.key is a link to nowhere": wrong.replaced(wrong.KEY, wrong.link_to("nowhere")),
    "authority.pem deleted": wrong.replaced(f"authority/{AUTHORITY}", lambda _: None),
    "authority.pem damaged": wrong.file_damaged(f"authority/{AUTHORITY}"),
    "authority.key damaged": wrong.file_damaged(f"authority/{AUTHORITY_KEY}"),
    "clock 400 days ahead": wrong.at_time("+400d"),
    "clock 3 years back": wrong.at_time("-1095d"),
    "12 open files": wrong.few_files,
    "port taken": wrong.port_taken,
    "served already": wrong.served_already,
    "a copy, its original there": wrong.copied,
    "a copy, its original served": wrong.copied_and_served,
    "a copy, its original served elsewhere": wrong.held_elsewhere,
    "its server elsewhere was killed": wrong.killed_elsewhere,
    "folder moved": wrong.moved,
    "folder restored from a backup": wrong.restored,
    "--address javascript:": wrong.said("--address", "javascript:alert(1)", secure=True),
    "--address of half a bracket": wrong.said("--address", "https://[::1", secure=True),
    "--host of others, plain HTTP": wrong.said("--host", "192.0.2.1"),
    "--files of an unknown kind": wrong.said("--files", "gopher://bucket/prefix", says="s3://"),
    "--files with a password": wrong.said("--files", f"s3://me:{PASSWORD}@bucket/p"),
    "--on ray:// that nobody answers": wrong.said(
        "--on", "ray://127.0.0.1:1", wanted=SERVES, says="Jobs wait until a Ray cluster answers"
    ),
    "--on ray:// of no host": wrong.said("--on", "ray://:x"),
    "--mqtt with a password and no topic": wrong.said("--mqtt", f"mqtt://me:a@{PASSWORD}@h"),
}  # fmt: skip
"""On SQLite."""
ON_POSTGRESQL: dict[str, Situation] = {
    "PostgreSQL: nothing wrong": wrong.as_it_was,
    "PostgreSQL: --database forgotten": wrong.forgotten,
    "PostgreSQL: --database of another store": wrong.of_another_store,
    "PostgreSQL: a copy, its original there": wrong.copied,
    "PostgreSQL: a copy, its original served": wrong.copied_and_served,
    "PostgreSQL: locked by another program": wrong.table_locked,
}
FILES = 20
LONGEST_S = 120.0
QUIET = ("elfslam.sqlite-wal", "elfslam.sqlite-shm", ".lock")
"""What SQLite and a lock leave behind where nothing was changed."""


def main() -> None:
    """Print what is said in each situation, and last how many went as wanted."""
    rows, chosen = [], sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        whole = filled(ServerSettings(Path(folder) / "data"))
        for name, situation in SITUATIONS.items():
            if not chosen or name in chosen:
                rows.append(told(name, situation, whole))
    if initdb() is not None:
        with own_postgresql() as database:
            for number, (name, situation) in enumerate(ON_POSTGRESQL.items()):
                if not chosen or name in chosen:
                    rows.append(on_postgresql(name, situation, database, f"store{number}"))
    print_rows(rows, title="Starts", as_json=False)
    print(f"{sum(row['as wanted'] == 'yes' for row in rows)} of {len(rows)} as wanted")


def on_postgresql(
    name: str, situation: Situation, database: Postgresql, store: str
) -> dict[str, object]:
    """The row of a start with a database of its own."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        filled(ServerSettings(data, new_database(database, store)))
        return told(name, situation, ServerSettings(data, new_url(database, store)), moved=False)


def new_url(server: Postgresql, name: str) -> str:
    """The URL of a database of that name."""
    return server.url.replace("/elfslam?", f"/{name}?")


def new_database(server: Postgresql, name: str) -> str:
    """The URL of an empty database, made now."""
    import psycopg

    with psycopg.connect(server.told, autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}")
    return new_url(server, name)


def told(
    name: str, situation: Situation, whole: ServerSettings, *, moved: bool = True
) -> dict[str, object]:
    """The row of one start of a copy of a store; what it said is printed at once."""
    with tempfile.TemporaryDirectory() as folder:
        elsewhere, settings = Path(folder), whole
        if moved:
            shutil.copytree(whole.data_folder, elsewhere / "data")
            settings = ServerSettings(elsewhere / "data")
        files = files_of(settings)
        start = situation(settings, elsewhere)
        if start.clock and shutil.which("faketime") is None:
            said, status = "left out: faketime is missing", start.wanted
        kept = start.kept or settings
        with start.meanwhile():
            before = content_of(kept.data_folder)
            begun_s = time.monotonic()
            said, status = served(start)
            took_s = time.monotonic() - begun_s
            after = content_of(kept.data_folder)
        left = len(files_of(kept) & files)
    said = said.replace(folder, "").replace(str(whole.data_folder), "/data")
    keys = {path for path in before if path.startswith("authority/")} - start.renewed
    row = {
        "files": f"{left} of {len(files)}",
        "keys": "kept" if all(before[key] == after.get(key) for key in keys) else "CHANGED",
        "folder": "-" if status == SERVES else "same" if before == after else "CHANGED",
    }
    good = status == start.wanted and left == len(files) and "CHANGED" not in row.values()
    good = good and "Traceback" not in said and PASSWORD not in said and start.says in said
    verdict = "as wanted" if good else "NOT AS WANTED"
    print(f"{name}: {status}, {verdict} ({took_s:.1f} s)\n    {said}", flush=True)
    return {
        "situation": name,
        "wanted": start.wanted,
        "got": status,
        **row,
        "as wanted": "yes" if good else "NO",
    }


def content_of(folder: Path) -> Mapping[str, str]:
    """What lies in a folder: of files the SHA-256, of other things the kind."""
    found = {}
    for path in sorted(folder.rglob("*")) if folder.is_dir() else []:
        name, mode = str(path.relative_to(folder)), path.lstat().st_mode
        if path.name not in QUIET and not stat.S_ISDIR(mode):
            plain = stat.S_ISREG(mode)
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest() if plain else str(mode)
    return found


def filled(settings: ServerSettings) -> ServerSettings:
    """A store that was served once, with a recording of many files and an upload on its way."""
    first, _ = served(Start(settings, secure=True))
    with alone_with(settings):
        services = open_services(settings, alone=True)
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
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(
            command(start),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=errors,
            env={**os.environ, "FAKETIME_DONT_FAKE_MONOTONIC": "1"},
            start_new_session=True,
        )
        serves = begun(process, out.fileno())
        if serves:
            os.killpg(process.pid, signal.SIGINT)
        elif process.poll() is None:
            process.kill()
        process.wait(LONGEST_S)
        out.seek(0)
        errors.seek(0)
        lines = [line for line in out if line.startswith("Jobs wait")] + list(errors)
    said = " | ".join(line.strip() for line in lines) or "-"
    return said, SERVES if serves else f"exit {process.returncode}"


def command(start: Start) -> Sequence[str]:
    """What starts the server."""
    settings = start.settings
    words = ["elfslam.cli", "serve", "--port", "0", "--data", str(settings.data_folder)]
    words += ["--host", "127.0.0.1"] if start.secure else ["--http"]
    words += [] if "--on" in start.words else ["--no-jobs"]
    words += ["--database", settings.database_url] if settings.database_url else []
    code = "import sys; sys.argv = sys.argv[1:]; from elfslam.cli import main; main()"
    clock = ["faketime", "-f", start.clock] if start.clock else []
    limit = ["bash", "-c", f'ulimit -n {start.most_files}; exec "$@"', "-"]
    return [
        *(limit if start.most_files else []),
        *(clock if shutil.which("faketime") else []),
        *(sys.executable, "-c", code),
        *(*words, *start.words),
    ]


def begun(process: subprocess.Popen[bytes], out: int) -> bool:
    """Whether a server that was started answers at last, and has said all that it says."""
    until_s = time.monotonic() + LONGEST_S
    while process.poll() is None and time.monotonic() < until_s:
        said = os.pread(out, 100_000, 0).decode(errors="replace")
        place = urlsplit(said.partition("\n")[0])
        if place.port and answers(place.hostname or "", place.port):
            return True
        time.sleep(0.1)
    return False


def answers(host: str, port: int) -> bool:
    """Whether somebody who listens says anything to a request, with TLS or without."""
    try:
        with socket.create_connection((host, port), timeout=LONGEST_S) as knock:
            knock.sendall(b"GET /api/version HTTP/1.0\r\n\r\n")
            knock.recv(1)
    except ConnectionResetError:
        return True
    except OSError:
        return False
    return True


if __name__ == "__main__":
    main()
