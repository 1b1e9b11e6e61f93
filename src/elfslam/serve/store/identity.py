"""Which database belongs to a data folder: both know one id, and nothing is done if they differ.

A server that took another database for its own would find that nobody names its files.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import Engine, inspect, select, text
from sqlalchemy.engine import Connection

from elfslam.base.errors import StoreError
from elfslam.base.urls import shown_url
from elfslam.data.atomic_files import replaced_file
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import SHA256
from elfslam.serve.store.database import (
    Sessions,
    Store,
    answering,
    new_id,
    shown_database,
    transaction,
)

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
ANOTHER = "name the right one with --database, or the right folder with --data"


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
        f"{settings.backups_folder}"
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
            f"database {shown}: belongs to another data folder than {folder}{before}; {ANOTHER}"
        )
    if not theirs and (named or files) and not named & files:
        raise StoreError(
            f"database {shown}: names {len(named)} files, none of the {len(files)} that lie in "
            f"{folder}{before}; {ANOTHER}"
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
