"""Groups: maps shared with many at once, and with whoever is in the group at that time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from starlette.testclient import TestClient

from elfslam.serve.services import Services
from elfslam.serve.sharing import groups
from elfslam.serve.sharing.tables import GroupMember, MapGroupShare, UserGroup
from elfslam.serve.store.database import reading
from elfslam.serve.store.quota import delete_user

LetIn = Callable[[str], TestClient]
PutMap = Callable[..., str]
DATABASES = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


def id_of(client: TestClient) -> str:
    return str(client.get("/api/me").json()["id"])


def make(ada: TestClient, name: str, *members: TestClient) -> Any:
    given = {"name": name, "members": [id_of(each) for each in members]}
    return ada.post("/api/groups", json=given)


def share(ada: TestClient, map_id: str, group_id: str, may: str = "read") -> Any:
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
    told = share(ada, hall, group["id"]).json()
    assert told["groups"] == [{"group": group["id"], "name": "Guards", "may": "read"}]
    assert (ids(eve), ids(bob)) == ([hall], [])
    path = f"/api/groups/{group['id']}"
    changed = ada.put(path, json={"name": "Night guards", "members": [id_of(bob)]}).json()
    assert [each["name"] for each in changed["members"]] == ["Bob"]
    assert (ids(eve), ids(bob)) == ([], [hall])
    assert bob.get("/api/maps").json()[0]["right"] == "read"
    share(ada, hall, group["id"], "edit")
    assert bob.get("/api/maps").json()[0]["right"] == "edit"
    assert ada.delete(f"/api/maps/{hall}/groups/{group['id']}").status_code == 204
    assert ids(bob) == []
    assert ada.delete(f"/api/maps/{hall}/groups/{group['id']}").status_code == 404


def test_people_are_counted_once_however_they_come_by_a_map(let_in: LetIn, put_map: PutMap) -> None:
    ada, eve, bob = let_in("Ada"), let_in("Eve"), let_in("Bob")
    hall = put_map(ada, "Hall")
    ada.put(f"/api/maps/{hall}/shares/{id_of(eve)}", json={"may": "read"}).raise_for_status()
    for name in ("Guards", "Friends"):
        share(ada, hall, make(ada, name, ada, eve, bob).json()["id"])
    assert ada.get(f"/api/maps/{hall}").json()["shared_with"] == 2
    assert ids(eve) == [hall]


def test_a_group_is_its_owners_alone(let_in: LetIn, put_map: PutMap) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    group = make(ada, "Guards", eve).json()
    path = f"/api/groups/{group['id']}"
    assert eve.get("/api/groups").json() == []
    assert eve.delete(path).status_code == 404
    assert eve.put(path, json={"name": "Mine", "members": []}).status_code == 404
    assert share(eve, put_map(eve, "Yard"), group["id"]).status_code == 404
    assert ada.get("/api/groups").json() == [group]


def test_a_deleted_group_shares_nothing_any_more(
    let_in: LetIn, put_map: PutMap, services: Services
) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    hall = put_map(ada, "Hall")
    group = make(ada, "Guards", eve).json()
    share(ada, hall, group["id"])
    assert ada.delete(f"/api/groups/{group['id']}").status_code == 204
    assert ids(eve) == []
    with reading(services.sessions) as session:
        for table in (UserGroup, GroupMember, MapGroupShare):
            assert session.query(table).count() == 0


def test_who_is_deleted_leaves_groups_and_takes_their_own_along(
    let_in: LetIn, put_map: PutMap, services: Services
) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    share(ada, put_map(ada, "Hall"), make(ada, "Guards", eve).json()["id"])
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
        share(ada, hall, make(ada, name, eve).json()["id"])
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
    monkeypatch.setattr(groups, "MOST_GROUPS", 1)
    assert make(ada, "One").status_code == 201
    full = make(ada, "Two")
    assert (full.status_code, len(ada.get("/api/groups").json())) == (409, 1)
