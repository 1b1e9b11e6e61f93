"""Schema versions: migrations make what the tables say, and every released version comes along."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Engine, create_engine, inspect, text
from sqlalchemy.engine import Connection

from elfslam.base.errors import StoreError
from elfslam.serve.store.database import open_database, reading, sessions_of
from elfslam.serve.store.schema import (
    VERSION_TABLE,
    State,
    newest_version,
    state_of,
    upgrade,
    version_of,
)
from elfslam.serve.store.tables import Base, Recording, User
from tests.serve.conftest import DATABASES

pytestmark = DATABASES
RELEASED = Path(__file__).parent / "released"
VERSIONS = sorted({file.name.removesuffix(".sqlite.sql") for file in RELEASED.glob("*.sqlite.sql")})


@pytest.fixture
def engine(database_url: str, tmp_path: Path) -> Iterator[Engine]:
    made = open_database(database_url or f"sqlite:///{tmp_path / 'elfslam.sqlite'}")
    yield made
    made.dispose()


def restored(engine: Engine, version: str) -> None:
    """The database of a released version, with a row or two in each table."""
    dump = (RELEASED / f"{version}.{engine.dialect.name}.sql").read_text(encoding="utf-8")
    if engine.dialect.name == "sqlite":
        with sqlite3.connect(str(engine.url.database)) as connection:
            connection.executescript(dump)
        connection.close()
        return
    with engine.begin() as connection:
        connection.connection.cursor().execute(dump)


def columns(connection: Connection) -> dict[str, str]:
    """The columns of every table, as a statement names them."""
    inspector = inspect(connection)
    names = set(inspector.get_table_names()) - {VERSION_TABLE}
    return {
        name: ", ".join(f'"{each["name"]}"' for each in inspector.get_columns(name))
        for name in names
    }


def everything(connection: Connection, known: dict[str, str]) -> dict[str, list[str]]:
    """The rows of those tables and columns, as text."""
    queries = {name: text(f"SELECT {told} FROM {name}") for name, told in known.items()}
    return {
        name: sorted(str(tuple(row)) for row in connection.execute(query))
        for name, query in queries.items()
    }


def test_migrations_make_the_tables(engine: Engine, tmp_path: Path) -> None:
    assert state_of(engine) is State.EMPTY
    assert upgrade(engine, tmp_path / "backups") is None
    assert state_of(engine) is State.CURRENT
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"version_table": VERSION_TABLE})
        assert compare_metadata(context, Base.metadata) == []


@pytest.mark.parametrize("version", VERSIONS)
def test_a_released_version_is_upgraded_with_all_its_rows_and_so_is_its_backup(
    engine: Engine, tmp_path: Path, version: str
) -> None:
    restored(engine, version)
    with engine.connect() as connection:
        known = columns(connection)
        before = everything(connection, known)
    assert all(before.values())
    assert state_of(engine) is State.OLDER
    backup = upgrade(engine, tmp_path / "backups")
    with engine.connect() as connection:
        assert everything(connection, known) == before
        assert version_of(connection) == newest_version()
        context = MigrationContext.configure(connection, opts={"version_table": VERSION_TABLE})
        assert compare_metadata(context, Base.metadata) == []
    copy = create_engine(f"sqlite:///{backup}")
    assert state_of(copy) is State.OLDER
    upgrade(copy, tmp_path / "more")
    for found in (engine, copy):
        with reading(sessions_of(found)) as session:
            owner, other = session.query(User).order_by(User.id)
            facts = session.get_one(Recording, "3" * 32).facts
        assert (owner.name, owner.token_sha256, other.name) == ("owner", "a" * 64, "Zoë 🦇")
        assert (owner.is_owner, owner.created_utc.hour) == (True, 6)
        assert facts == {"duration_s": 12.5, "bytes": 7}
    copy.dispose()


def test_an_upgrade_that_fails_leaves_everything_as_it_was(engine: Engine, tmp_path: Path) -> None:
    restored(engine, VERSIONS[0])
    with engine.begin() as connection:
        connection.execute(text("ALTER TABLE maps RENAME COLUMN facts TO claims"))
    with engine.connect() as connection:
        known = columns(connection)
        before = everything(connection, known)
    with pytest.raises(StoreError, match="table maps lacks facts"):
        upgrade(engine, tmp_path / "backups")
    with engine.connect() as connection:
        assert everything(connection, known) == before
        assert version_of(connection) is None
    assert list((tmp_path / "backups").iterdir()) == []
