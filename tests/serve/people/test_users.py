"""Who may do what: with a token on every route, by codes that pair, and not too often."""

import hashlib
import re
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from fastapi import FastAPI
from sqlalchemy import select
from starlette.testclient import TestClient

from elfslam.serve.network.addresses import remember_url
from elfslam.serve.people.access import admit, new_token
from elfslam.serve.people.users import add_user
from elfslam.serve.problems import Problem
from elfslam.serve.services import MOST, OneTimeCodes, Rates, Services
from elfslam.serve.store.database import looking, reading
from elfslam.serve.store.tables import User
from tests.serve.conftest import DATABASES, Somebody


@DATABASES
def test_without_a_token_there_is_a_version_and_nothing_else(anyone: TestClient) -> None:
    assert anyone.get("/api/version").json()["chirp"]["band_hz"] == [15_000.0, 20_000.0]
    for path in ("/api/me", "/api/users"):
        answer = anyone.get(path)
        assert answer.status_code == 401
        assert answer.headers["content-type"] == "application/problem+json"
        assert "pairing token" in answer.json()["detail"]


@DATABASES
def test_a_session_keeps_the_token_in_a_cookie(owner: Somebody, anyone: TestClient) -> None:
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
def test_the_owner_invites_and_deletes(owner: Somebody, services: Services) -> None:
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
def test_the_owner_cannot_be_deleted(owner: Somebody, guest: Somebody) -> None:
    mine = owner.id
    answer = owner.delete(f"/api/users/{mine}")
    assert answer.status_code == 409
    assert "delete the data folder instead" in answer.json()["detail"]
    assert guest.delete(f"/api/users/{mine}").status_code == 403
    assert owner.get("/api/me").json()["is_owner"] is True


def code_in(url: str) -> str:
    return parse_qs(urlsplit(url).fragment)["code"][0]


def test_a_code_pairs_another_device_once(guest: Somebody, anyone: TestClient) -> None:
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
    owner: Somebody, guest: Somebody, anyone: TestClient
) -> None:
    code = code_in(guest.post("/api/pairing").json()["url"])
    owner.delete(f"/api/users/{guest.get('/api/me').json()['id']}")
    anyone.post("/api/session/code", json={"code": code})
    assert anyone.get("/api/me").status_code == 401


def test_the_address_is_the_one_that_others_reach(owner: Somebody, services: Services) -> None:
    remember_url(services.settings, "https://10.0.0.7:8443/")
    for path, given in (("/api/pairing", None), ("/api/users", {"name": "Zoë"})):
        assert owner.post(path, json=given).json()["url"].startswith("https://10.0.0.7:8443/#")


@pytest.mark.parametrize("given", [None, {"name": "Zoë"}])
def test_no_code_leads_a_device_to_itself(app: FastAPI, owner: Somebody, given: Any) -> None:
    from dataclasses import replace

    services: Services = app.state.services
    alone = replace(services, settings=replace(services.settings, secure_cookie=True))
    remember_url(alone.settings, "https://127.0.0.1:8443/")
    app.state.services = alone
    before = len(owner.get("/api/users").json())
    answer = owner.post("/api/pairing" if given is None else "/api/users", json=given)
    assert (answer.status_code, "--address" in answer.json()["detail"]) == (409, True)
    assert len(owner.get("/api/users").json()) == before


class Clock:
    """A time that is told."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_a_code_gives_its_token_once() -> None:
    codes = OneTimeCodes()
    mine, theirs = codes.make("mine"), codes.make("theirs")
    assert codes.redeem(theirs) == "theirs"
    assert codes.redeem(mine) == "mine"
    assert codes.redeem(mine) is None
    assert codes.redeem("never made") is None


def test_a_code_ends() -> None:
    clock = Clock()
    codes = OneTimeCodes(lasts_s=600.0, clock=clock)
    early = codes.make("early")
    clock.now_s = 599.0
    late = codes.make("late")
    clock.now_s = 600.0
    assert codes.redeem(early) is None
    assert codes.redeem(late) == "late"


def test_the_oldest_codes_give_way() -> None:
    codes = OneTimeCodes()
    made = [codes.make(str(number)) for number in range(MOST + 1)]
    assert len(set(made)) == MOST + 1
    assert codes.redeem(made[0]) is None
    assert [codes.redeem(made[1]), codes.redeem(made[-1])] == ["1", str(MOST)]


BODIES = {"/api/find": {"wifi": {"04:33:89:79:fc:7c": -60}}}
"""What a route wants to see before it looks at the token."""


PUBLIC = {
    "/api/version",
    "/api/key",
    "/api/session/code",
    "/api/links/open",
    "/api/maps/{map_id}/plotly-{version}.min.js",
}


@pytest.mark.parametrize("token", [None, "k" * 43])
def test_every_route_but_the_public_ones_wants_a_token(
    app: FastAPI, anyone: TestClient, token: str | None
) -> None:
    header = {"Authorization": f"Bearer {token}"} if token else {}
    tried = 0
    for path, methods in app.openapi()["paths"].items():
        if not path.startswith("/api/") or path in PUBLIC:
            continue
        for method in methods:
            url = re.sub(r"\{[^}]*\}", "0" * 32, path)
            answer = anyone.request(method, url, headers=header, json=BODIES.get(path))
            assert answer.status_code == 401, (method, path, answer.text)
            tried += 1
    assert tried > 20


@DATABASES
def test_who_has_a_token_is_admitted_and_counted(services: Services) -> None:
    known = [add_user(services, name)[1] for name in ("one", "two")]
    rates = Rates(0.01, 200.0)
    with looking(services.engine) as connection:
        for token in [*known, known[0]]:
            admit(connection, token, rates)
        with pytest.raises(Problem) as haste:
            admit(connection, known[0], rates)
        admit(connection, known[1], rates)
        with pytest.raises(Problem) as unknown:
            admit(connection, new_token(), rates)
    assert (haste.value.status_code, unknown.value.status_code) == (429, 401)
    assert "Retry-After" in (haste.value.headers or {})
