"""Sharing over HTTP: with people, with everyone who has the link, and what may not be done."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from elfslam.base.values import FloorMap
from elfslam.serve.app import create_app
from elfslam.serve.people.users import add_user
from elfslam.serve.problems import Problem
from elfslam.serve.services import Services
from elfslam.serve.settings import Limits
from elfslam.serve.sharing import routes
from elfslam.serve.sharing.rights import WITHDRAWN
from elfslam.serve.store.database import reading
from elfslam.serve.store.quota import delete_user
from elfslam.serve.store.tables import GroupMember, MapGroupShare, UserGroup

LetIn = Callable[[str], TestClient]
PutMap = Callable[..., str]
DATABASES = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


def id_of(client: TestClient) -> str:
    return str(client.get("/api/me").json()["id"])


def client_at(app: FastAPI, token: str) -> TestClient:
    """Somebody's client at a server with limits of its own."""
    header = {"Authorization": f"Bearer {token}"}
    return TestClient(
        app, headers=header, client=("127.0.0.1", 50_002), base_url="http://127.0.0.1"
    )


def share(ada: TestClient, map_id: str, user_id: str, may: str = "read") -> Any:
    return ada.put(f"/api/maps/{map_id}/shares/{user_id}", json={"may": may})


def link_of(ada: TestClient, map_id: str, may: str = "read") -> str:
    told = ada.put(f"/api/maps/{map_id}/link", json={"may": may}).json()["link"]
    return str(told["url"].partition("#link=")[2].partition("&")[0])


@DATABASES
def test_a_shared_map_is_listed_with_whose_it_is(let_in: LetIn, put_map: PutMap) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    map_id = put_map(ada, "Hall", sources=["0" * 32], venue="Mall", floor="Floor 2")
    put_map(ada, "not for Eve")
    told = share(ada, map_id, id_of(eve)).json()
    assert told == {
        "people": [{"user": id_of(eve), "name": "Eve", "may": "read"}],
        "groups": [],
        "link": None,
    }
    assert told == ada.get(f"/api/maps/{map_id}/shares").json()
    [seen] = eve.get("/api/maps").json()
    assert (seen["id"], seen["owner"], seen["right"]) == (map_id, "Ada", "read")
    assert (seen["venue"], seen["floor"], seen["level"]) == ("Mall", "Floor 2", 2)
    assert (seen["sources"], seen["shared_with"], seen["has_link"]) == ([], 0, False)
    mine = ada.get(f"/api/maps/{map_id}").json()
    assert (mine["right"], mine["sources"], mine["shared_with"]) == ("own", ["0" * 32], 1)
    assert share(ada, map_id, id_of(eve), "edit").json()["people"][0]["may"] == "edit"
    assert eve.get(f"/api/maps/{map_id}").json()["right"] == "edit"
    assert ada.delete(f"/api/maps/{map_id}/shares/{id_of(eve)}").status_code == 204
    assert eve.get("/api/maps").json() == []
    assert ada.delete(f"/api/maps/{map_id}/shares/{id_of(eve)}").status_code == 404


def test_whom_a_map_is_shared_with_may_leave_it_and_nobody_else(
    let_in: LetIn, put_map: PutMap
) -> None:
    ada, eve, ben = let_in("Ada"), let_in("Eve"), let_in("Ben")
    map_id = put_map(ada)
    for each in (eve, ben):
        share(ada, map_id, id_of(each))
    assert eve.delete(f"/api/maps/{map_id}/shares/{id_of(ben)}").status_code == 403
    assert eve.delete(f"/api/maps/{map_id}/shares/{id_of(eve)}").status_code == 204
    assert eve.get(f"/api/maps/{map_id}").status_code == 404
    assert ben.get(f"/api/maps/{map_id}").status_code == 200


@DATABASES
def test_sharing_that_makes_no_sense_is_refused(let_in: LetIn, put_map: PutMap) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    mine, theirs = put_map(ada), put_map(eve)
    assert share(ada, mine, id_of(ada)).status_code == 409
    for nobody in ("0" * 32, "x", "%2e%2e", "a" * 300):
        assert share(ada, mine, nobody).status_code == 404
    assert share(ada, theirs, id_of(ada)).status_code == 404
    for may in ("own", "none", "", None):
        assert share(ada, mine, id_of(eve), may).status_code == 422  # type: ignore[arg-type]
    assert ada.get(f"/api/maps/{mine}/shares").json() == {"people": [], "groups": [], "link": None}
    assert ada.delete(f"/api/maps/{mine}/link").status_code == 404


def test_nobody_shares_without_end(services: Services, let_in: LetIn, put_map: PutMap) -> None:
    few = replace(services.settings, limits=Limits(shares=3))
    app = create_app(replace(services, settings=few))
    ada = client_at(app, add_user(services, "Ada")[1])
    maps, people = [put_map(ada) for _ in range(2)], [id_of(let_in(f"P{k}")) for k in range(3)]
    answers = [share(ada, map_id, person).status_code for map_id in maps for person in people]
    assert answers == [200, 200, 200, 409, 409, 409]
    assert share(ada, maps[0], people[0], "edit").status_code == 200, "that is none more"


@DATABASES
def test_a_link_opens_its_map_without_an_account_until_it_is_withdrawn(
    let_in: LetIn, put_map: PutMap, passer_by: Callable[[], TestClient]
) -> None:
    ada, guest = let_in("Ada"), passer_by()
    map_id, other = put_map(ada, "Hall"), put_map(ada, "Yard")
    link = link_of(ada, map_id)
    assert link_of(ada, map_id) == link, "it can be shown again"
    answer = guest.post("/api/links/open", json={"link": link})
    assert answer.json() == {"map": map_id, "name": "Hall", "may": "read"}
    told = answer.headers["set-cookie"]
    for words in (f"Path=/api/maps/{map_id}", "HttpOnly", "SameSite=strict"):
        assert words in told
    seen = guest.get(f"/api/maps/{map_id}").json()
    assert (seen["right"], seen["owner"], seen["has_link"]) == ("read", "Ada", False)
    assert guest.get(f"/api/maps/{map_id}/report.html").status_code == 200
    assert guest.get(f"/api/maps/{other}").status_code == 401
    for path in ("/api/maps", "/api/me", "/api/people", "/api/recordings"):
        assert guest.get(path).status_code == 401, path
    assert ada.get(f"/api/maps/{map_id}").json()["has_link"] is True
    ada.delete(f"/api/maps/{map_id}/link").raise_for_status()
    gone = guest.get(f"/api/maps/{map_id}")
    assert (gone.status_code, gone.json()["detail"]) == (404, WITHDRAWN)
    assert guest.post("/api/links/open", json={"link": link}).status_code == 404
    again = link_of(ada, map_id)
    assert again != link
    assert guest.get(f"/api/maps/{map_id}").status_code == 404, "the next link is another"


def test_no_link_is_made_that_leads_others_to_themselves(
    let_in: LetIn, put_map: PutMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    def reaches_nobody(asked: str, settings: object) -> str:
        raise Problem(409, "no other device reaches this server")

    ada = let_in("Ada")
    first, second = put_map(ada), put_map(ada)
    link = link_of(ada, first)
    monkeypatch.setattr(routes, "url_for_others", reaches_nobody)
    assert ada.put(f"/api/maps/{second}/link", json={"may": "read"}).status_code == 409
    assert ada.get(f"/api/maps/{second}/shares").json()["link"] is None
    told = ada.get(f"/api/maps/{first}/shares").json()["link"]
    assert told["url"].startswith(f"http://127.0.0.1/desk#link={link}&key=")


def test_what_is_no_link_opens_nothing(
    let_in: LetIn, put_map: PutMap, passer_by: Callable[[], TestClient]
) -> None:
    ada, guest = let_in("Ada"), passer_by()
    map_id, without = put_map(ada), put_map(ada)
    link = link_of(ada, map_id)
    secret = link.partition(".")[2]
    for wrong in (
        "", ".", map_id, f"{map_id}.", f"{map_id}.{secret[:-1]}", f"{without}.{secret}",
        f"{map_id}.{secret}x", f"{'0' * 32}.{secret}", "%00.%00",
    ):  # fmt: skip
        answer = guest.post("/api/links/open", json={"link": wrong})
        assert answer.status_code == 404, wrong
        assert "set-cookie" not in answer.headers
    for wrong in (b'{"link": "' + b"x" * 300 + b'"}', b'{"link": "\\ud800"}', b"{}", b"null"):
        headers = {"Content-Type": "application/json"}
        answer = guest.post("/api/links/open", content=wrong, headers=headers)
        assert answer.status_code == 422, wrong


def test_a_link_of_a_deleted_owner_opens_nothing(
    owner: TestClient, let_in: LetIn, put_map: PutMap, passer_by: Callable[[], TestClient]
) -> None:
    ada, guest = let_in("Ada"), passer_by()
    map_id = put_map(ada)
    link = link_of(ada, map_id)
    guest.post("/api/links/open", json={"link": link}).raise_for_status()
    owner.delete(f"/api/users/{id_of(ada)}").raise_for_status()
    assert guest.get(f"/api/maps/{map_id}").status_code == 404
    assert guest.post("/api/links/open", json={"link": link}).status_code == 404


def test_a_link_makes_up_for_a_token_that_is_not_known_any_more(
    let_in: LetIn, put_map: PutMap, passer_by: Callable[[], TestClient]
) -> None:
    ada, guest = let_in("Ada"), passer_by()
    map_id = put_map(ada)
    guest.cookies.set("elfslam_token", "of somebody who was deleted")
    assert guest.get(f"/api/maps/{map_id}").status_code == 401
    guest.post("/api/links/open", json={"link": link_of(ada, map_id)}).raise_for_status()
    assert guest.get(f"/api/maps/{map_id}").status_code == 200


def test_guests_of_one_link_ask_no_more_often_than_a_user(
    services: Services, let_in: LetIn, put_map: PutMap, passer_by: Callable[[], TestClient]
) -> None:
    ada, guest = let_in("Ada"), passer_by()
    map_id = put_map(ada)
    guest.post("/api/links/open", json={"link": link_of(ada, map_id)}).raise_for_status()
    while services.token_rates.take(f"link {map_id}") == 0:
        pass
    assert guest.get(f"/api/maps/{map_id}").status_code == 429
    assert ada.get(f"/api/maps/{map_id}").status_code == 200


def test_a_phone_is_located_in_a_map_that_is_shared(
    owner: TestClient,
    let_in: LetIn,
    passer_by: Callable[[], TestClient],
    plant: Callable[[Path], Any],
    maps: tuple[FloorMap, FloorMap],
    tmp_path: Path,
) -> None:
    """The package and its parts: by name, and by link, where the key is public as well."""
    eve, guest, map_id = let_in("Eve"), passer_by(), plant(tmp_path / "data").put(maps[0])
    share(owner, map_id, id_of(eve))
    guest.post("/api/links/open", json={"link": link_of(owner, map_id)}).raise_for_status()
    known = owner.get("/api/key").json()
    for client in (eve, guest):
        told = client.get(f"/api/maps/{map_id}/package").raise_for_status().json()
        assert told["manifest"] == owner.get(f"/api/maps/{map_id}/package").json()["manifest"]
        tile = json.loads(told["manifest"])["tiles"][0]["sha256"]
        assert client.get(f"/api/maps/{map_id}/package/{tile}").status_code == 200
        assert client.get("/api/key").json() == known
    owner.delete(f"/api/maps/{map_id}/shares/{id_of(eve)}")
    owner.delete(f"/api/maps/{map_id}/link")
    for client in (eve, guest):
        assert client.get(f"/api/maps/{map_id}/package").status_code == 404
        assert client.get(f"/api/maps/{map_id}/package/{tile}").status_code == 404


def test_a_floor_plan_counts_for_the_owner_of_the_map(
    services: Services, let_in: LetIn, put_map: PutMap
) -> None:
    full = replace(services.settings, limits=Limits(user_bytes=1))
    app = create_app(replace(services, settings=full))
    ada, eve = (client_at(app, add_user(services, name)[1]) for name in ("Ada", "Eve"))
    map_id = put_map(ada)
    share(ada, map_id, id_of(eve), "edit")
    picture = (Path(__file__).parents[3] / "docs" / "demo.png").read_bytes()
    answer = eve.put(
        f"/api/maps/{map_id}/floor-plan", content=picture, headers={"Content-Type": "image/png"}
    )
    assert answer.status_code == 413
    assert eve.get("/api/me").json()["used_bytes"] == 0


def test_people_are_told_by_name_alone(let_in: LetIn) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    assert ada.get("/api/people").json() == [{"id": id_of(eve), "name": "Eve"}]
    eve.patch("/api/me", json={"name": "Evelyn"}).raise_for_status()
    assert ada.get("/api/people").json() == [{"id": id_of(eve), "name": "Evelyn"}]
    assert eve.patch("/api/me", json={"name": " "}).status_code == 422


def make(ada: TestClient, name: str, *members: TestClient) -> Any:
    given = {"name": name, "members": [id_of(each) for each in members]}
    return ada.post("/api/groups", json=given)


def share_with_group(ada: TestClient, map_id: str, group_id: str, may: str = "read") -> Any:
    return ada.put(f"/api/maps/{map_id}/groups/{group_id}", json={"may": may})


def ids(client: TestClient) -> list[str]:
    return [each["id"] for each in client.get("/api/maps").json()]


@DATABASES
def test_who_comes_into_a_group_sees_its_maps_and_who_goes_does_not(
    let_in: LetIn, put_map: PutMap
) -> None:
    ada, eve, bob = let_in("Ada"), let_in("Eve"), let_in("Bob")
    hall = put_map(ada, "Hall")
    put_map(ada, "not for them")
    group = make(ada, "Guards", eve).json()
    told = share_with_group(ada, hall, group["id"]).json()
    assert told["groups"] == [{"group": group["id"], "name": "Guards", "may": "read"}]
    assert (ids(eve), ids(bob)) == ([hall], [])
    path = f"/api/groups/{group['id']}"
    changed = ada.put(path, json={"name": "Night guards", "members": [id_of(bob)]}).json()
    assert [each["name"] for each in changed["members"]] == ["Bob"]
    assert (ids(eve), ids(bob)) == ([], [hall])
    assert bob.get("/api/maps").json()[0]["right"] == "read"
    share_with_group(ada, hall, group["id"], "edit")
    assert bob.get("/api/maps").json()[0]["right"] == "edit"
    assert ada.delete(f"/api/maps/{hall}/groups/{group['id']}").status_code == 204
    assert ids(bob) == []
    assert ada.delete(f"/api/maps/{hall}/groups/{group['id']}").status_code == 404


def test_people_are_counted_once_however_they_come_by_a_map(let_in: LetIn, put_map: PutMap) -> None:
    ada, eve, bob = let_in("Ada"), let_in("Eve"), let_in("Bob")
    hall = put_map(ada, "Hall")
    ada.put(f"/api/maps/{hall}/shares/{id_of(eve)}", json={"may": "read"}).raise_for_status()
    for name in ("Guards", "Friends"):
        share_with_group(ada, hall, make(ada, name, ada, eve, bob).json()["id"])
    assert ada.get(f"/api/maps/{hall}").json()["shared_with"] == 2
    assert ids(eve) == [hall]


def test_a_group_is_its_owners_alone(let_in: LetIn, put_map: PutMap) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    group = make(ada, "Guards", eve).json()
    path = f"/api/groups/{group['id']}"
    assert eve.get("/api/groups").json() == []
    assert eve.delete(path).status_code == 404
    assert eve.put(path, json={"name": "Mine", "members": []}).status_code == 404
    assert share_with_group(eve, put_map(eve, "Yard"), group["id"]).status_code == 404
    assert ada.get("/api/groups").json() == [group]


def test_a_deleted_group_shares_nothing_any_more(
    let_in: LetIn, put_map: PutMap, services: Services
) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    hall = put_map(ada, "Hall")
    group = make(ada, "Guards", eve).json()
    share_with_group(ada, hall, group["id"])
    assert ada.delete(f"/api/groups/{group['id']}").status_code == 204
    assert ids(eve) == []
    with reading(services.sessions) as session:
        for table in (UserGroup, GroupMember, MapGroupShare):
            assert session.query(table).count() == 0


def test_who_is_deleted_leaves_groups_and_takes_their_own_along(
    let_in: LetIn, put_map: PutMap, services: Services
) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    share_with_group(ada, put_map(ada, "Hall"), make(ada, "Guards", eve).json()["id"])
    make(eve, "Friends", ada)
    delete_user(services, id_of(eve))
    [left] = ada.get("/api/groups").json()
    assert (left["name"], left["members"]) == ("Guards", [])
    with reading(services.sessions) as session:
        assert session.query(UserGroup).count() == 1


def test_who_takes_a_map_off_their_list_leaves_its_groups(let_in: LetIn, put_map: PutMap) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    hall = put_map(ada, "Hall")
    for name in ("Guards", "Friends"):
        share_with_group(ada, hall, make(ada, name, eve).json()["id"])
    mine = f"/api/maps/{hall}/shares/{id_of(eve)}"
    assert eve.delete(mine).status_code == 204
    assert ids(eve) == []
    assert eve.delete(mine).status_code == 404
    assert all(each["members"] == [] for each in ada.get("/api/groups").json())


def test_bad_groups_are_refused(let_in: LetIn, monkeypatch: pytest.MonkeyPatch) -> None:
    ada = let_in("Ada")
    nobody = ada.post("/api/groups", json={"name": "Ghosts", "members": ["0" * 32]})
    assert (nobody.status_code, ada.get("/api/groups").json()) == (404, [])
    for wrong in ({"name": " "}, {"name": "A", "members": ["x"]}, {"name": "A\nB"}):
        assert ada.post("/api/groups", json={"members": [], **wrong}).status_code == 422
    monkeypatch.setattr("elfslam.serve.sharing.routes.MOST_GROUPS", 1)
    assert make(ada, "One").status_code == 201
    full = make(ada, "Two")
    assert (full.status_code, len(ada.get("/api/groups").json())) == (409, 1)
