"""Backups of the database before it is changed: a SQLite file, whatever it lies in itself."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import Engine, MetaData, create_engine, event, insert, select

from elfslam.data.atomic_files import replaced_file
from elfslam.serve.store.database import answering

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
