"""A PostgreSQL of one's own: it ends with the block."""

import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.waiting import until


def initdb() -> str | None:
    """The program that makes a PostgreSQL, where it is installed."""
    found = sorted(map(str, Path("/usr/lib/postgresql").glob("*/bin/initdb")))
    return shutil.which("initdb") or next(iter(found), None)


@contextmanager
def own_postgresql(program: str) -> Iterator[str]:
    """Starts it, by its `initdb`; gives the folder of its socket. Its data go with it."""
    binaries, folder = Path(program).resolve().parent, tempfile.mkdtemp(prefix="pg")
    user = "postgres" if os.getuid() == 0 else None
    if user is not None:
        shutil.chown(folder, user)
    data = Path(folder) / "data"
    make = f"{binaries}/initdb -A trust -U elfslam -E UTF8 -D {data}".split()
    subprocess.run(make, check=True, stdout=subprocess.DEVNULL, user=user, cwd=folder)
    told = ("-c", "listen_addresses=", "-c", "fsync=off")
    command = [binaries / "postgres", "-D", data, "-k", folder, *told]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, user=user, cwd=folder)
    try:
        until(lambda: answers(folder), "PostgreSQL")
        yield folder
    finally:
        process.send_signal(signal.SIGQUIT)
        process.wait()
        shutil.rmtree(folder)


def answers(folder: str) -> bool:
    """Whether it has started."""
    import psycopg

    try:
        psycopg.connect(f"host={folder} user=elfslam dbname=postgres").close()
    except psycopg.OperationalError:
        return False
    return True
