"""Errors as problem+json: one line for people, and no word too much."""

import errno
from collections.abc import Iterator

import pytest
from fastapi import FastAPI
from pydantic import BaseModel, Field, ValidationError
from sqlalchemy.exc import DatabaseError, IntegrityError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from starlette.testclient import TestClient

from elfslam.base.errors import InputError
from elfslam.serve.problems import MEDIA_TYPE, Problem, install_problems, problems
from elfslam.serve.services import Services
from elfslam.serve.store import database


class Checked(BaseModel):
    """As answers check what a row holds."""

    sha256: str = Field(pattern="^[0-9a-f]{64}$")


try:
    Checked(sha256="secret")
except ValidationError as error:
    UNLIKE = error
ERRORS: dict[str, tuple[int, Exception]] = {
    "/problem": (423, Problem(423, "wait", {"Retry-After": "1"})),
    "/input": (422, InputError("audio.flac: is cut off; copy the file again")),
    "/full": (507, OSError(errno.ENOSPC, "No space left on device")),
    "/quota": (507, OSError(errno.EDQUOT, "Disk quota exceeded")),
    "/full-database": (507, OperationalError("", {}, Exception("database or disk is full"))),
    "/away": (503, OperationalError("", {}, Exception("server closed the connection"))),
    "/waited": (503, PoolTimeout("QueuePool limit")),
    "/locked": (503, OperationalError("", {}, Exception("database is locked"))),
    "/damaged": (503, DatabaseError("", {}, Exception("database disk image is malformed"))),
    "/unlike": (503, UNLIKE),
    "/wrong": (500, IntegrityError("", {}, Exception("secret: NOT NULL constraint failed"))),
    "/bug": (500, ZeroDivisionError("secret")),
    "/file": (500, FileNotFoundError(2, "No such file", "/secret")),
}


@pytest.fixture
def client() -> Iterator[TestClient]:
    app = FastAPI()
    install_problems(app)
    for path in ERRORS:
        app.get(path)(raising(path))
    return TestClient(app, raise_server_exceptions=False)


def raising(path: str) -> object:
    def route() -> None:
        raise ERRORS[path][1]

    return route


def test_every_error_is_a_problem(client: TestClient) -> None:
    for path, (status, _) in ERRORS.items():
        answer = client.get(path)
        told = answer.json()
        assert (answer.status_code, told["status"]) == (status, status), path
        assert answer.headers["content-type"] == MEDIA_TYPE
        assert told["title"]
        assert "\n" not in told["detail"]
        assert "secret" not in answer.text
    assert client.get("/input").json()["detail"] == str(ERRORS["/input"][1])
    assert client.get("/problem").headers["retry-after"] == "1"


def test_who_meets_a_lock_is_told_so_and_when_to_come_again(client: TestClient) -> None:
    answer = client.get("/locked")
    assert "another program" in answer.json()["detail"]
    assert answer.headers["retry-after"] == "5"


def test_writing_is_refused_in_time_and_reading_goes_on(
    owner: TestClient, services: Services, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database, "WAIT_S", 0.1)
    with services.engine.connect().execution_options(writes=True) as another, another.begin():
        answer = owner.post("/api/recordings", json={"name": "walk"})
        assert (answer.status_code, answer.headers["retry-after"]) == (503, "5")
        assert owner.get("/api/recordings").json() == []
    assert owner.post("/api/recordings", json={"name": "walk"}).status_code == 201


def test_what_a_route_declares() -> None:
    declared = problems(404, 460)
    assert declared[460]["description"] == "Checksum Mismatch"
    assert list(declared[404]["content"]) == [MEDIA_TYPE]
