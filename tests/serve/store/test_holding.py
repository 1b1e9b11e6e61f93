"""One data folder holds a database: a copy is refused, a moved folder and a backup are not."""

import shutil
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import Engine, select

from elfslam.base.errors import StoreError
from elfslam.serve.services import open_services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.database import Sessions, open_database, sessions_of, transaction
from elfslam.serve.store.opening import (
    LISTEN_S,
    LOOK_S,
    STORE,
    Held,
    alone_with,
    free_to_take,
    holder_of,
    holding,
    open_store,
    read_held,
    take,
)
from elfslam.serve.store.tables import Store
from tests.serve.conftest import DATABASES

pytestmark = DATABASES
ELSEWHERE = {"host": "elsewhere", "folder": "/srv/data", "inode": "1:1"}


@pytest.fixture
def outside(settings: ServerSettings, tmp_path: Path) -> ServerSettings:
    """A store whose database lies outside its folder."""
    url = settings.database_url or f"sqlite:///{tmp_path / 'outside.sqlite'}"
    made = replace(settings, database_url=url)
    opened(made)
    return made


@pytest.fixture
def engine(outside: ServerSettings) -> Iterator[Engine]:
    """That database, as another process has it."""
    made = open_database(outside.url)
    yield made
    made.dispose()


def opened(settings: ServerSettings) -> None:
    """Opens, and says that this folder holds the database and that nobody serves it."""
    with alone_with(settings):
        engine = open_store(settings)
    held = read_held(engine)
    engine.dispose()
    assert held == Held(holder_of(settings.data_folder), None)


def refused(settings: ServerSettings, words: str) -> None:
    with pytest.raises(StoreError, match=words) as said, alone_with(settings):
        open_store(settings)
    assert "\n" not in str(said.value)


def given_to(sessions: Sessions, holder: dict[str, str], beat: str | None) -> None:
    with transaction(sessions) as session:
        row = session.scalars(select(Store)).one()
        row.holder, row.beat = holder, beat


def test_a_database_says_who_holds_it(outside: ServerSettings, engine: Engine) -> None:
    assert read_held(engine) == Held(holder_of(outside.data_folder), None)
    with holding(sessions_of(engine), outside):
        assert read_held(engine).beat is not None
    assert read_held(engine).beat is None


def test_a_copy_beside_its_original_is_refused(outside: ServerSettings, tmp_path: Path) -> None:
    copy = replace(outside, data_folder=tmp_path / "copy")
    shutil.copytree(outside.data_folder, copy.data_folder)
    refused(copy, f"belongs to the data folder {outside.data_folder}.* one of them is a copy")
    opened(outside)
    shutil.rmtree(outside.data_folder)
    opened(copy)


def test_a_moved_folder_takes_its_database_along(outside: ServerSettings, tmp_path: Path) -> None:
    moved = replace(outside, data_folder=tmp_path / "moved")
    outside.data_folder.rename(moved.data_folder)
    opened(moved)
    moved.data_folder.rename(outside.data_folder)
    opened(outside)


def test_a_backup_in_its_place_is_served(outside: ServerSettings, tmp_path: Path) -> None:
    outside.data_folder.rename(tmp_path / "broken")
    shutil.copytree(tmp_path / "broken", outside.data_folder)
    opened(outside)


def test_a_folder_that_is_served_elsewhere_is_heard(
    outside: ServerSettings, engine: Engine
) -> None:
    sessions, looks = sessions_of(engine), []

    def beats(seconds: float) -> None:
        looks.append(seconds)
        if len(looks) == 3:
            given_to(sessions, ELSEWHERE, "next")

    given_to(sessions, ELSEWHERE, "first")
    with pytest.raises(StoreError, match="/srv/data on elsewhere, which is being served"):
        free_to_take(engine, outside, beats)
    assert looks == [LOOK_S] * 3


def test_a_killed_server_elsewhere_is_silent(outside: ServerSettings, engine: Engine) -> None:
    looks = list[float]()
    given_to(sessions_of(engine), ELSEWHERE, "last")
    held = free_to_take(engine, outside, looks.append)
    assert sum(looks) >= LISTEN_S
    take(sessions_of(engine), outside, held)
    assert read_held(engine) == Held(holder_of(outside.data_folder), None)


def test_nobody_waits_for_their_own_folder(outside: ServerSettings, engine: Engine) -> None:
    mine = read_held(engine).holder
    assert mine is not None
    given_to(sessions_of(engine), mine.__dict__, "of a server that was killed")
    wait: Callable[[float], None] = lambda _: pytest.fail("waited")  # noqa: E731
    free_to_take(engine, outside, wait)


def test_a_cloned_machine_is_heard_too(outside: ServerSettings, engine: Engine) -> None:
    looks = list[float]()
    twin = replace(holder_of(outside.data_folder), boot="of another machine").__dict__
    given_to(sessions_of(engine), twin, "last")
    free_to_take(engine, outside, looks.append)
    assert sum(looks) >= LISTEN_S
    words, sessions = "was taken by another folder just now", sessions_of(engine)
    with pytest.raises(StoreError, match=words), holding(sessions, outside):
        pass


def test_of_two_that_begin_at_once_one_is_refused(outside: ServerSettings, engine: Engine) -> None:
    before = read_held(engine)
    given_to(sessions_of(engine), ELSEWHERE, None)
    with pytest.raises(StoreError, match="another server begins"):
        take(sessions_of(engine), outside, before)


def test_who_lost_a_database_is_told(outside: ServerSettings, engine: Engine) -> None:
    lost = threading.Event()
    sessions = sessions_of(engine)
    with holding(sessions, outside, lost=lost.set, beat_s=0.01):
        given_to(sessions, ELSEWHERE, "theirs")
        assert lost.wait(20)
    assert read_held(engine).beat == "theirs"


def test_a_copy_of_folder_and_database_together_is_a_store_of_its_own(
    settings: ServerSettings, tmp_path: Path
) -> None:
    if settings.database_url:
        pytest.skip("the database of a server is not copied with a folder")
    opened(settings)
    copy = ServerSettings(tmp_path / "copy")
    shutil.copytree(settings.data_folder, copy.data_folder)
    opened(copy)
    refused(replace(copy, database_url=settings.url), "one of them is a copy")
    assert (copy.data_folder / STORE).is_file()


def test_a_command_beside_a_copy_is_refused(outside: ServerSettings, tmp_path: Path) -> None:
    copy = replace(outside, data_folder=tmp_path / "copy")
    shutil.copytree(outside.data_folder, copy.data_folder)
    with pytest.raises(StoreError, match="one of them is a copy"):
        open_services(copy)
