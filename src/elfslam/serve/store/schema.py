"""Schema versions of the database: backed up, upgraded by migrations (Alembic), checked.

Databases made before versions were kept have the tables of the first one.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from enum import Enum, auto
from functools import cache
from pathlib import Path
from typing import Any

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, MetaData, create_engine, event, insert, inspect, select
from sqlalchemy.engine import Connection

from elfslam.base.errors import StoreError
from elfslam.data.atomic_files import replaced_file
from elfslam.serve.store.database import SQLITE, answering, shown_database, write_ahead
from elfslam.serve.store.tables import Base

MIGRATIONS = Path(__file__).parent / "migrations"
VERSION_TABLE = "schema_version"
OURS = {"users", "recordings", "uploads"}
"""Tables that every version has."""


class State(Enum):
    """What a database holds."""

    EMPTY = auto()
    CURRENT = auto()
    OLDER = auto()


@cache
def newest_version() -> str:
    """The version that this program writes."""
    head = ScriptDirectory(str(MIGRATIONS)).get_current_head()
    assert head is not None
    return head


def version_of(connection: Connection) -> str | None:
    """The version of a database; None where none was kept. Raises StoreError for several."""
    context = MigrationContext.configure(connection, opts={"version_table": VERSION_TABLE})
    told = context.get_current_heads()
    if len(told) > 1:
        raise StoreError(
            f"database {shown_database(connection.engine)}: has {len(told)} versions at once "
            f"({', '.join(sorted(told)):.60}); it was changed by hand, restore a backup"
        )
    return next(iter(told), None)


def state_of(engine: Engine) -> State:
    """What a database holds. Raises StoreError for tables that are not ours, or of later."""
    with answering(engine), engine.connect() as connection:
        tables, version = set(inspect(connection).get_table_names()), version_of(connection)
    if not tables:
        return State.EMPTY
    if not tables >= OURS:
        others = tables - {VERSION_TABLE, *Base.metadata.tables}
        raise StoreError(
            f"database {shown_database(engine)}: holds tables of another program "
            f"({min(others or tables)}); give an empty one, or that of this server"
        )
    if version == newest_version():
        return State.CURRENT
    if version is not None and version not in _known_versions():
        raise StoreError(
            f"database {shown_database(engine)}: has version {version:.20}, this program knows up "
            f"to {newest_version()}; install the newer elfslam that wrote it"
        )
    return State.OLDER


def upgrade(engine: Engine, backups: Path) -> Path | None:
    """Bring a database to the newest version, whole or not at all; where its backup lies.

    An empty one has no backup. Raises StoreError where its tables are none of ours.
    """
    backup = None if state_of(engine) is State.EMPTY else back_up(engine, backups)
    write_ahead(engine)
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    try:
        with answering(engine), _writing(engine) as connection:
            config.attributes["connection"] = connection
            command.upgrade(config, "head")
            check_tables(connection)
    except BaseException:
        if backup is not None:  # of a database that stayed as it was
            backup.unlink()
        raise
    return backup


@contextmanager
def _writing(engine: Engine) -> Iterator[Connection]:
    """A connection in one transaction, tables and all."""
    with engine.connect().execution_options(writes=True) as connection, connection.begin():
        yield connection


def check_tables(connection: Connection) -> None:
    """Raise StoreError where a table, a column or a row is not there that this program reads."""
    _check_columns(connection)
    if connection.engine.dialect.name == SQLITE:
        _check_rows(connection)


def _check_columns(connection: Connection) -> None:
    inspector = inspect(connection)
    for table in Base.metadata.sorted_tables:
        found = inspector.get_columns(table.name) if inspector.has_table(table.name) else []
        lacks = {column.name for column in table.columns} - {each["name"] for each in found}
        if lacks:
            raise StoreError(
                f"database {shown_database(connection.engine)}: table {table.name} lacks "
                f"{min(lacks)}; it was changed by hand or is of an unknown version, restore a "
                "backup"
            )


def _check_rows(connection: Connection) -> None:
    """Rows of a SQLite file whose pages are whole may still hold what no column can.

    Numbers alone cannot be told from others: tables of nothing else are passed over.
    """
    for table in Base.metadata.sorted_tables:
        if all(column.type.python_type in (int, float) for column in table.columns):
            continue
        try:
            for _ in connection.execute(select(table)).partitions(ROWS):
                pass
        except (ValueError, TypeError) as error:
            raise StoreError(
                f"database {shown_database(connection.engine)}: a row of table {table.name} is "
                f"damaged ({type(error).__name__}); restore a backup"
            ) from error


def _known_versions() -> set[str]:
    script = ScriptDirectory(str(MIGRATIONS))
    return {each.revision for each in script.walk_revisions()}


ROWS = 1000
"""So many are copied at once."""


def back_up(engine: Engine, folder: Path) -> Path:
    """A copy of every table, as it is now, in a new file of a folder. Raises StoreError.

    `elfslam serve --database sqlite:///FILE` starts with it.
    """
    folder.mkdir(exist_ok=True, mode=0o700)
    file = folder / f"{datetime.now(UTC):%Y-%m-%dT%H%M%S.%f}.sqlite"
    with replaced_file(file) as partial:
        partial.unlink(missing_ok=True)
        _copy(engine, create_engine(f"sqlite:///{partial}"))
        os.chmod(partial, 0o600)
    return file


def _copy(source: Engine, target: Engine) -> None:
    """Every table and row of one database put into an empty one."""
    tables = MetaData()
    event.listen(tables, "column_reflect", _as_any_database_has_it)
    with answering(source), source.connect() as given, target.begin() as made:
        tables.reflect(given)
        tables.create_all(made)
        for table in tables.sorted_tables:
            for rows in given.execute(select(table)).mappings().partitions(ROWS):
                made.execute(insert(table), [dict(row) for row in rows])
    target.dispose()


def _as_any_database_has_it(_inspector: Any, _table: Any, column: dict[str, Any]) -> None:
    """Types and defaults that are one database's own are left behind."""
    column["type"] = column["type"].as_generic()
    column.pop("default", None)
