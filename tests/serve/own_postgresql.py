"""A PostgreSQL of one's own: it ends with the block."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

PATIENCE_S = 120.0


@dataclass(frozen=True)
class Postgresql:
    """A database that runs."""

    process: subprocess.Popen[bytes]
    folder: str

    @property
    def url(self) -> str:
        """SQLAlchemy's."""
        return f"postgresql+psycopg://elfslam@/elfslam?host={self.folder}"

    @property
    def told(self) -> str:
        """How psycopg connects."""
        return f"host={self.folder} user=elfslam dbname=elfslam"


def initdb() -> str | None:
    """The program that makes a PostgreSQL, where it is installed."""
    found = sorted(map(str, Path("/usr/lib/postgresql").glob("*/bin/initdb")))
    return shutil.which("initdb") or next(iter(found), None)


@contextmanager
def own_postgresql(**settings: str) -> Iterator[Postgresql]:
    """Starts it with its default settings but for those given; ends it at once afterwards.

    Its data go with it. Raises SystemExit where it is not installed.
    """
    program = initdb()
    if program is None:
        raise SystemExit("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    binaries, folder = Path(program).resolve().parent, tempfile.mkdtemp(prefix="pg")
    user = "postgres" if os.getuid() == 0 else None
    if user is not None:
        shutil.chown(folder, user)
    data = Path(folder) / "data"
    make = f"{binaries}/initdb -A trust -U elfslam -E UTF8 -D {data}".split()
    subprocess.run(make, check=True, stdout=subprocess.DEVNULL, user=user, cwd=folder)
    told = {"listen_addresses": "", **settings}
    more = [word for name, value in told.items() for word in ("-c", f"{name}={value}")]
    command = [binaries / "postgres", "-D", data, "-k", folder, *more]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, user=user, cwd=folder)
    try:
        _make_database(folder)
        yield Postgresql(process, folder)
    finally:
        process.send_signal(signal.SIGQUIT)
        process.wait()
        shutil.rmtree(folder)


def _make_database(folder: str) -> None:
    import psycopg

    until_s = time.monotonic() + PATIENCE_S
    whole = f"host={folder} user=elfslam dbname=postgres"
    while True:
        try:
            with psycopg.connect(whole, autocommit=True) as connection:
                connection.execute("CREATE DATABASE elfslam")
        except psycopg.errors.DuplicateDatabase:
            return
        except psycopg.OperationalError as error:
            if time.monotonic() > until_s:
                raise SystemExit("PostgreSQL does not start") from error
            time.sleep(0.05)
        else:
            return
