"""Who may do what."""

from __future__ import annotations

import hashlib

import pytest
from sqlalchemy import select
from starlette.testclient import TestClient

from elfslam.serve.services import Services
from elfslam.serve.store.database import User, reading

pytestmark = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


def test_without_a_token_there_is_a_version_and_nothing_else(anyone: TestClient) -> None:
    assert anyone.get("/api/version").json()["chirp"]["band_hz"] == [15_000.0, 20_000.0]
    for path in ("/api/me", "/api/users"):
        answer = anyone.get(path)
        assert answer.status_code == 401
        assert answer.headers["content-type"] == "application/problem+json"
        assert "pairing token" in answer.json()["detail"]


def test_a_session_keeps_the_token_in_a_cookie(owner: TestClient, anyone: TestClient) -> None:
    answer = owner.post("/api/session")
    assert answer.status_code == 204
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=strict" in cookie.lower()
    anyone.cookies.set("elfslam_token", answer.cookies["elfslam_token"])
    assert anyone.get("/api/me").json()["is_owner"] is True
    assert anyone.delete("/api/session").status_code == 204
    anyone.cookies.clear()


def test_the_owner_invites_and_deletes(owner: TestClient, services: Services) -> None:
    made = owner.post("/api/users", json={"name": "Zoë"}).json()
    theirs = {"Authorization": f"Bearer {made['token']}"}
    key = owner.get("/api/key").json()["key"]
    assert made["url"].endswith(f"/#token={made['token']}&key={key}")
    assert owner.get("/api/me", headers=theirs).json()["name"] == "Zoë"
    assert owner.get("/api/users", headers=theirs).status_code == 403
    with reading(services.sessions) as session:
        kept = session.scalar(select(User.token_sha256).filter_by(id=made["id"]))
    assert kept == hashlib.sha256(made["token"].encode()).hexdigest()
    assert owner.delete(f"/api/users/{made['id']}").status_code == 204
    assert owner.get("/api/me", headers=theirs).status_code == 401


def test_the_owner_cannot_be_deleted(owner: TestClient, guest: TestClient) -> None:
    mine = owner.get("/api/me").json()["id"]
    answer = owner.delete(f"/api/users/{mine}")
    assert answer.status_code == 409
    assert "delete the data folder instead" in answer.json()["detail"]
    assert guest.delete(f"/api/users/{mine}").status_code == 403
    assert owner.get("/api/me").json()["is_owner"] is True
