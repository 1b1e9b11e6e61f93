"""Recordings are renamed, and many are deleted at once."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from sqlalchemy import select
from starlette.testclient import TestClient

from elfslam.serve.services import Services
from elfslam.serve.store.database import Job, JobKind, Map, reading, transaction

DATABASES = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


def begun(client: TestClient, name: str = "walk") -> str:
    return str(client.post("/api/recordings", json={"name": name}).json()["id"])


def test_a_recording_is_renamed(owner: TestClient, guest: TestClient) -> None:
    name = begun(owner)
    address = f"/api/recordings/{name}"
    assert owner.patch(address, json={"name": " Flur "}).json()["name"] == "Flur"
    assert guest.patch(address, json={"name": "mine"}).status_code == 404
    for wrong in ({"name": ""}, {"name": None}, {}, {"name": "a\u0000b"}):
        assert owner.patch(address, json=wrong).status_code == 422
    assert owner.get(address).json()["name"] == "Flur"


@DATABASES
def test_many_recordings_are_deleted_at_once_with_what_came_of_them_alone(
    owner: TestClient,
    guest: TestClient,
    services: Services,
    put_map: Callable[..., str],
) -> None:
    mine, theirs = [begun(owner, f"walk {k}") for k in range(4)], begun(guest)
    alone = put_map(owner, "alone", sources=mine[:1])
    both = put_map(owner, "both", sources=mine[1:3])
    more = put_map(owner, "more", sources=mine[2:])
    with transaction(services.sessions) as session:
        user_id = owner.get("/api/me").json()["id"]
        for each in mine:
            session.add(Job(user_id=user_id, kind=JobKind.MAP, given={"recording": each}))
    sent = {"ids": [*mine[:3], theirs, "0" * 32]}
    assert owner.post("/api/recordings/delete", json=sent).json() == {"count": 3}
    assert [each["id"] for each in owner.get("/api/recordings").json()] == [mine[3]]
    assert [each["id"] for each in guest.get("/api/recordings").json()] == [theirs]
    with reading(services.sessions) as session:
        kept = {row.id: row.sources for row in session.scalars(select(Map))}
        jobs = [job.given["recording"] for job in session.scalars(select(Job))]
    assert kept == {more: mine[3:]}
    assert jobs == mine[3:]
    assert {alone, both}.isdisjoint(kept)
