"""The tables, in SQLite and in PostgreSQL alike."""

import threading
from collections.abc import Iterator
from datetime import UTC, timedelta
from pathlib import Path

import pytest
from sqlalchemy import Engine, delete, func, select, update
from sqlalchemy.exc import IntegrityError, OperationalError

from elfslam.base.errors import InputError, StoreError
from elfslam.serve.problems import is_locked
from elfslam.serve.store import database
from elfslam.serve.store.database import Sessions, open_database, reading, sessions_of, transaction
from elfslam.serve.store.schema import upgrade
from elfslam.serve.store.tables import (
    Job,
    JobState,
    Recording,
    RecordingFile,
    Upload,
    User,
    now_utc,
)
from tests.serve.conftest import DATABASES

WRITERS, ROUNDS = 6, 15


@pytest.fixture
def engine(database_url: str, tmp_path: Path) -> Iterator[Engine]:
    made = open_database(database_url or f"sqlite:///{tmp_path / 'elfslam.sqlite'}")
    upgrade(made, tmp_path / "backups")
    yield made
    made.dispose()


@pytest.fixture
def sessions(engine: Engine) -> Sessions:
    return sessions_of(engine)


def added_user(sessions: Sessions, token: str = "t") -> str:
    with transaction(sessions) as session:
        user = User(name="Zoë 🦇", token_sha256=token)
        session.add(user)
    return user.id


@DATABASES
def test_times_come_back_in_utc(sessions: Sessions) -> None:
    added = added_user(sessions)
    with reading(sessions) as session:
        user = session.get(User, added)
    assert user is not None
    assert user.name == "Zoë 🦇"
    assert user.created_utc.tzinfo is UTC
    assert abs(user.created_utc - now_utc()) < timedelta(minutes=1)


@DATABASES
def test_a_user_takes_everything_along(sessions: Sessions) -> None:
    user = added_user(sessions)
    with transaction(sessions) as session:
        recording = Recording(user_id=user, name="walk", facts={"start_pose": [1, 2, 0.5]})
        session.add(recording)
        session.flush()
        file = {"name": "wifi.csv", "sha256": "0" * 64, "size_bytes": 2**40}
        session.add(RecordingFile(recording_id=recording.id, **file))
        session.add(Upload(user_id=user, recording_id=recording.id, file_name="wifi.csv"))
        session.add(Job(user_id=user, kind="map", given={"recording": recording.id}))
    with reading(sessions) as session:
        assert session.scalar(select(RecordingFile.size_bytes)) == 2**40
        assert session.scalar(select(Recording.facts)) == {"start_pose": [1, 2, 0.5]}
        assert session.scalar(select(Job.state)) == JobState.QUEUED
    with transaction(sessions) as session:
        session.execute(delete(User))
    with reading(sessions) as session:
        for table in (Recording, RecordingFile, Upload, Job):
            assert session.scalar(select(func.count()).select_from(table)) == 0


def add_and_fail(sessions: Sessions) -> None:
    with transaction(sessions) as session:
        session.add(User(name="x", token_sha256="other"))
        session.flush()
        raise RuntimeError("too late")


@DATABASES
def test_what_fails_is_undone_whole(sessions: Sessions) -> None:
    added_user(sessions, "same")
    with pytest.raises(IntegrityError):
        added_user(sessions, "same")
    with pytest.raises(RuntimeError, match="too late"):
        add_and_fail(sessions)
    with reading(sessions) as session:
        assert session.scalar(select(func.count()).select_from(User)) == 1


@DATABASES
def test_nobody_writes_for_a_user_who_is_gone(sessions: Sessions) -> None:
    with pytest.raises(IntegrityError), transaction(sessions) as session:
        session.add(Recording(user_id="0" * 32, name="walk"))


@DATABASES
def test_writers_wait_for_each_other(sessions: Sessions) -> None:
    """Each reads a number and writes the next: none is lost, and nobody fails."""
    user, failed = added_user(sessions), []

    def write() -> None:
        try:
            for _ in range(ROUNDS):
                with transaction(sessions) as session:
                    row = session.get(User, user, with_for_update=True)
                    assert row is not None
                    count = int(row.token_sha256.removeprefix("t") or 0)
                    row.token_sha256 = f"t{count + 1}"
        except Exception as error:
            failed.append(error)

    writers = [threading.Thread(target=write) for _ in range(WRITERS)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert failed == []
    with reading(sessions) as session:
        assert session.scalar(select(User.token_sha256)) == f"t{WRITERS * ROUNDS}"


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever waits for a lock waits a moment only; asked for before the engine."""
    monkeypatch.setattr(database, "WAIT_S", 0.1)


@DATABASES
@pytest.mark.parametrize("is_ours", [False, True], ids=["another program", "their turn"])
def test_who_waits_is_told_in_time(impatient: None, engine: Engine, is_ours: bool) -> None:
    sessions = sessions_of(engine)
    added_user(sessions)
    with transaction(sessions) as session:
        session.execute(update(User).values(name="taken"))
        late = sessions if is_ours else sessions_of(engine)  # turns are taken within a process
        with pytest.raises(OperationalError) as refused, transaction(late) as other:
            other.execute(update(User).values(name="late"))
    assert is_locked(refused.value)
    with reading(sessions) as session:
        assert session.scalar(select(User.name)) == "taken"


@DATABASES
def test_a_reader_does_not_wait_for_a_writer(sessions: Sessions) -> None:
    added_user(sessions)
    with transaction(sessions) as writing:
        writing.add(User(name="x", token_sha256="x"))
        writing.flush()
        with reading(sessions) as session:
            assert session.scalar(select(func.count()).select_from(User)) == 1


@pytest.mark.parametrize(
    ("url", "error", "words"),
    [
        ("nonsense", InputError, "database nonsense"),
        ("postgresql//u:secret@host/x", InputError, "wanted such as"),
        ("postgresql+psycopg//u:secret@host/x", InputError, "wanted such as"),
        ("postgresql://u:secret@host:port/x", InputError, "wanted such as"),
        ("oracle9://x", InputError, "wanted such as"),
        ("sqlite:////nowhere/at/all.sqlite", StoreError, "cannot be read"),
        ("postgresql+psycopg://u:secret@/x?host=/nowhere", StoreError, "cannot be read"),
    ],
)
def test_a_database_that_is_none(url: str, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words) as refused:
        open_database(url)
    assert "secret" not in str(refused.value)
    assert "\n" not in str(refused.value)
