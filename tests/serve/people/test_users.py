"""Who may do what."""

from __future__ import annotations

import hashlib
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from fastapi import FastAPI
from sqlalchemy import select
from starlette.testclient import TestClient

from elfslam.serve.network.addresses import remember_url
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import User

DATABASES = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


@DATABASES
def test_without_a_token_there_is_a_version_and_nothing_else(anyone: TestClient) -> None:
    assert anyone.get("/api/version").json()["chirp"]["band_hz"] == [15_000.0, 20_000.0]
    for path in ("/api/me", "/api/users"):
        answer = anyone.get(path)
        assert answer.status_code == 401
        assert answer.headers["content-type"] == "application/problem+json"
        assert "pairing token" in answer.json()["detail"]


@DATABASES
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


@DATABASES
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


@DATABASES
def test_the_owner_cannot_be_deleted(owner: TestClient, guest: TestClient) -> None:
    mine = owner.get("/api/me").json()["id"]
    answer = owner.delete(f"/api/users/{mine}")
    assert answer.status_code == 409
    assert "delete the data folder instead" in answer.json()["detail"]
    assert guest.delete(f"/api/users/{mine}").status_code == 403
    assert owner.get("/api/me").json()["is_owner"] is True


def code_in(url: str) -> str:
    return parse_qs(urlsplit(url).fragment)["code"][0]


def test_a_code_pairs_another_device_once(guest: TestClient, anyone: TestClient) -> None:
    made = guest.post("/api/pairing")
    assert made.status_code == 201
    code = code_in(made.json()["url"])
    key = guest.get("/api/key").json()["key"]
    assert made.json()["url"].endswith(f"&key={key}")
    answer = anyone.post("/api/session/code", json={"code": code})
    assert answer.status_code == 204
    assert "HttpOnly" in answer.headers["set-cookie"]
    assert anyone.get("/api/me").json()["name"] == "guest"
    again = anyone.post("/api/session/code", json={"code": code})
    assert (again.status_code, "make another" in again.json()["detail"]) == (401, True)


def test_who_is_nobody_makes_no_code(anyone: TestClient) -> None:
    assert anyone.post("/api/pairing").status_code == 401
    assert anyone.post("/api/session/code", json={"code": "x" * 101}).status_code == 422


def test_the_code_of_who_was_deleted_opens_nothing(
    owner: TestClient, guest: TestClient, anyone: TestClient
) -> None:
    code = code_in(guest.post("/api/pairing").json()["url"])
    owner.delete(f"/api/users/{guest.get('/api/me').json()['id']}")
    anyone.post("/api/session/code", json={"code": code})
    assert anyone.get("/api/me").status_code == 401


def test_the_address_is_the_one_that_others_reach(owner: TestClient, services: Services) -> None:
    remember_url(services.settings, "https://10.0.0.7:8443/")
    for path, given in (("/api/pairing", None), ("/api/users", {"name": "Zoë"})):
        assert owner.post(path, json=given).json()["url"].startswith("https://10.0.0.7:8443/#")


@pytest.mark.parametrize("given", [None, {"name": "Zoë"}])
def test_no_code_leads_a_device_to_itself(app: FastAPI, owner: TestClient, given: Any) -> None:
    from dataclasses import replace

    services: Services = app.state.services
    alone = replace(services, settings=replace(services.settings, secure_cookie=True))
    remember_url(alone.settings, "https://127.0.0.1:8443/")
    app.state.services = alone
    before = len(owner.get("/api/users").json())
    answer = owner.post("/api/pairing" if given is None else "/api/users", json=given)
    assert (answer.status_code, "--address" in answer.json()["detail"]) == (409, True)
    assert len(owner.get("/api/users").json()) == before
