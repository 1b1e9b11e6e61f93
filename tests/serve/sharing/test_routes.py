"""Sharing over HTTP: with people, with everyone who has the link, and what may not be done."""

import json
from typing import Any

import pytest

from elfslam.serve.problems import Problem
from elfslam.serve.services import Services
from elfslam.serve.sharing import routes
from elfslam.serve.sharing.rights import WITHDRAWN
from elfslam.serve.store.database import reading
from elfslam.serve.store.quota import delete_user
from elfslam.serve.store.tables import GroupMember, MapGroupShare, UserGroup
from tests.serve.conftest import DATABASES, LetIn, Maps, Somebody, allow
from tests.serve.planting import picture, plant_floor_map, put_plan


@DATABASES
def test_a_shared_map_is_listed_with_whose_it_is(ada: Somebody, eve: Somebody) -> None:
    map_id = ada.put_map("Hall", sources=["0" * 32], venue="Mall", floor="Floor 2")
    ada.put_map("not for Eve")
    told = ada.share(map_id, eve).json()
    assert told == {
        "people": [{"user": eve.id, "name": "Eve", "may": "read"}],
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
    assert ada.share(map_id, eve, "edit").json()["people"][0]["may"] == "edit"
    assert eve.get(f"/api/maps/{map_id}").json()["right"] == "edit"
    assert ada.delete(f"/api/maps/{map_id}/shares/{eve.id}").status_code == 204
    assert eve.get("/api/maps").json() == []
    assert ada.delete(f"/api/maps/{map_id}/shares/{eve.id}").status_code == 404


def test_whom_a_map_is_shared_with_may_leave_it_and_nobody_else(
    ada: Somebody, eve: Somebody, bob: Somebody
) -> None:
    map_id = ada.put_map()
    for each in (eve, bob):
        ada.share(map_id, each)
    assert eve.delete(f"/api/maps/{map_id}/shares/{bob.id}").status_code == 403
    assert eve.delete(f"/api/maps/{map_id}/shares/{eve.id}").status_code == 204
    assert eve.get(f"/api/maps/{map_id}").status_code == 404
    assert bob.get(f"/api/maps/{map_id}").status_code == 200


@DATABASES
def test_sharing_that_makes_no_sense_is_refused(ada: Somebody, eve: Somebody) -> None:
    mine, theirs = ada.put_map(), eve.put_map()
    assert ada.share(mine, ada).status_code == 409
    for nobody in ("0" * 32, "x", "%2e%2e", "a" * 300):
        wanted = f"/api/maps/{mine}/shares/{nobody}"
        assert ada.put(wanted, json={"may": "read"}).status_code == 404
    assert ada.share(theirs, ada).status_code == 404
    for may in ("own", "none", "", None):
        assert ada.share(mine, eve, may).status_code == 422
    assert ada.get(f"/api/maps/{mine}/shares").json() == {"people": [], "groups": [], "link": None}
    assert ada.delete(f"/api/maps/{mine}/link").status_code == 404


def test_nobody_shares_without_end(ada: Somebody, services: Services, let_in: LetIn) -> None:
    allow(services, shares=3)
    maps, people = [ada.put_map() for _ in range(2)], [let_in(f"P{k}") for k in range(3)]
    answers = [ada.share(map_id, person).status_code for map_id in maps for person in people]
    assert answers == [200, 200, 200, 409, 409, 409]
    assert ada.share(maps[0], people[0], "edit").status_code == 200, "that is none more"


@DATABASES
def test_a_link_opens_its_map_without_an_account_until_it_is_withdrawn(
    ada: Somebody, visitor: Somebody
) -> None:
    map_id, other = ada.put_map("Hall"), ada.put_map("Yard")
    link = ada.link(map_id)
    assert ada.link(map_id) == link, "it can be shown again"
    answer = visitor.open_link(link)
    assert answer.json() == {"map": map_id, "name": "Hall", "may": "read"}
    told = answer.headers["set-cookie"]
    for words in (f"Path=/api/maps/{map_id}", "HttpOnly", "SameSite=strict"):
        assert words in told
    seen = visitor.get(f"/api/maps/{map_id}").json()
    assert (seen["right"], seen["owner"], seen["has_link"]) == ("read", "Ada", False)
    assert visitor.get(f"/api/maps/{map_id}/report.html").status_code == 200
    assert visitor.get(f"/api/maps/{other}").status_code == 401
    for path in ("/api/maps", "/api/me", "/api/people", "/api/recordings"):
        assert visitor.get(path).status_code == 401, path
    assert ada.get(f"/api/maps/{map_id}").json()["has_link"] is True
    ada.delete(f"/api/maps/{map_id}/link").raise_for_status()
    gone = visitor.get(f"/api/maps/{map_id}")
    assert (gone.status_code, gone.json()["detail"]) == (404, WITHDRAWN)
    assert visitor.open_link(link).status_code == 404
    again = ada.link(map_id)
    assert again != link
    assert visitor.get(f"/api/maps/{map_id}").status_code == 404, "the next link is another"


def test_no_link_is_made_that_leads_others_to_themselves(
    ada: Somebody, monkeypatch: pytest.MonkeyPatch
) -> None:
    def reaches_nobody(asked: str, settings: object) -> str:
        raise Problem(409, "no other device reaches this server")

    first, second = ada.put_map(), ada.put_map()
    link = ada.link(first)
    monkeypatch.setattr(routes, "url_for_others", reaches_nobody)
    assert ada.put(f"/api/maps/{second}/link", json={"may": "read"}).status_code == 409
    assert ada.get(f"/api/maps/{second}/shares").json()["link"] is None
    told = ada.get(f"/api/maps/{first}/shares").json()["link"]
    assert told["url"].startswith(f"http://127.0.0.1/desk#link={link}&key=")


def test_what_is_no_link_opens_nothing(ada: Somebody, visitor: Somebody) -> None:
    map_id, without = ada.put_map(), ada.put_map()
    link = ada.link(map_id)
    secret = link.partition(".")[2]
    for wrong in (
        "", ".", map_id, f"{map_id}.", f"{map_id}.{secret[:-1]}", f"{without}.{secret}",
        f"{map_id}.{secret}x", f"{'0' * 32}.{secret}", "%00.%00",
    ):  # fmt: skip
        answer = visitor.open_link(wrong)
        assert answer.status_code == 404, wrong
        assert "set-cookie" not in answer.headers
    for wrong in (b'{"link": "' + b"x" * 300 + b'"}', b'{"link": "\\ud800"}', b"{}", b"null"):
        headers = {"Content-Type": "application/json"}
        answer = visitor.post("/api/links/open", content=wrong, headers=headers)
        assert answer.status_code == 422, wrong


def test_a_link_makes_up_for_a_token_that_is_not_known_any_more(
    ada: Somebody, visitor: Somebody
) -> None:
    map_id = ada.put_map()
    visitor.cookies.set("elfslam_token", "of somebody who was deleted")
    assert visitor.get(f"/api/maps/{map_id}").status_code == 401
    visitor.open_link(ada.link(map_id)).raise_for_status()
    assert visitor.get(f"/api/maps/{map_id}").status_code == 200


def test_visitors_of_one_link_ask_no_more_often_than_a_user(
    ada: Somebody, services: Services, visitor: Somebody
) -> None:
    map_id = ada.put_map()
    visitor.open_link(ada.link(map_id)).raise_for_status()
    while services.token_rates.take(f"link {map_id}") == 0:
        pass
    assert visitor.get(f"/api/maps/{map_id}").status_code == 429
    assert ada.get(f"/api/maps/{map_id}").status_code == 200


def test_a_phone_is_located_in_a_map_that_is_shared(
    owner: Somebody, eve: Somebody, visitor: Somebody, maps: Maps
) -> None:
    """The package and its parts: by name, and by link, where the key is public as well."""
    map_id = plant_floor_map(owner.services.settings.data_folder, maps[0])
    owner.share(map_id, eve)
    visitor.open_link(owner.link(map_id)).raise_for_status()
    known = owner.get("/api/key").json()
    for client in (eve, visitor):
        told = client.get(f"/api/maps/{map_id}/package").raise_for_status().json()
        assert told["manifest"] == owner.get(f"/api/maps/{map_id}/package").json()["manifest"]
        tile = json.loads(told["manifest"])["tiles"][0]["sha256"]
        assert client.get(f"/api/maps/{map_id}/package/{tile}").status_code == 200
        assert client.get("/api/key").json() == known
    owner.delete(f"/api/maps/{map_id}/shares/{eve.id}")
    owner.delete(f"/api/maps/{map_id}/link")
    for client in (eve, visitor):
        assert client.get(f"/api/maps/{map_id}/package").status_code == 404
        assert client.get(f"/api/maps/{map_id}/package/{tile}").status_code == 404


def test_a_floor_plan_counts_for_the_owner_of_the_map(ada: Somebody, eve: Somebody) -> None:
    allow(ada.services, user_bytes=1)
    map_id = ada.put_map()
    ada.share(map_id, eve, "edit")
    assert put_plan(eve, map_id, picture()).status_code == 413
    assert eve.get("/api/me").json()["used_bytes"] == 0


def test_people_are_told_by_name_alone(ada: Somebody, eve: Somebody) -> None:
    assert ada.get("/api/people").json() == [{"id": eve.id, "name": "Eve"}]
    eve.patch("/api/me", json={"name": "Evelyn"}).raise_for_status()
    assert ada.get("/api/people").json() == [{"id": eve.id, "name": "Evelyn"}]
    assert eve.patch("/api/me", json={"name": " "}).status_code == 422


def make(ada: Somebody, name: str, *members: Somebody) -> Any:
    given = {"name": name, "members": [each.id for each in members]}
    return ada.post("/api/groups", json=given)


def share_with_group(ada: Somebody, map_id: str, group_id: str, may: str = "read") -> Any:
    return ada.put(f"/api/maps/{map_id}/groups/{group_id}", json={"may": may})


def ids(client: Somebody) -> list[str]:
    return [each["id"] for each in client.get("/api/maps").json()]


@DATABASES
def test_who_comes_into_a_group_sees_its_maps_and_who_goes_does_not(
    ada: Somebody, eve: Somebody, bob: Somebody
) -> None:
    hall = ada.put_map("Hall")
    ada.put_map("not for them")
    group = make(ada, "Guards", eve).json()
    told = share_with_group(ada, hall, group["id"]).json()
    assert told["groups"] == [{"group": group["id"], "name": "Guards", "may": "read"}]
    assert (ids(eve), ids(bob)) == ([hall], [])
    path = f"/api/groups/{group['id']}"
    changed = ada.put(path, json={"name": "Night guards", "members": [bob.id]}).json()
    assert [each["name"] for each in changed["members"]] == ["Bob"]
    assert (ids(eve), ids(bob)) == ([], [hall])
    assert bob.get("/api/maps").json()[0]["right"] == "read"
    share_with_group(ada, hall, group["id"], "edit")
    assert bob.get("/api/maps").json()[0]["right"] == "edit"
    assert ada.delete(f"/api/maps/{hall}/groups/{group['id']}").status_code == 204
    assert ids(bob) == []
    assert ada.delete(f"/api/maps/{hall}/groups/{group['id']}").status_code == 404


def test_people_are_counted_once_however_they_come_by_a_map(
    ada: Somebody, eve: Somebody, bob: Somebody
) -> None:
    hall = ada.put_map("Hall")
    ada.put(f"/api/maps/{hall}/shares/{eve.id}", json={"may": "read"}).raise_for_status()
    for name in ("Guards", "Friends"):
        share_with_group(ada, hall, make(ada, name, ada, eve, bob).json()["id"])
    assert ada.get(f"/api/maps/{hall}").json()["shared_with"] == 2
    assert ids(eve) == [hall]


def test_a_group_is_its_owners_alone(ada: Somebody, eve: Somebody) -> None:
    group = make(ada, "Guards", eve).json()
    path = f"/api/groups/{group['id']}"
    assert eve.get("/api/groups").json() == []
    assert eve.delete(path).status_code == 404
    assert eve.put(path, json={"name": "Mine", "members": []}).status_code == 404
    assert share_with_group(eve, eve.put_map("Yard"), group["id"]).status_code == 404
    assert ada.get("/api/groups").json() == [group]


def test_a_deleted_group_shares_nothing_any_more(ada: Somebody, eve: Somebody) -> None:
    hall = ada.put_map("Hall")
    group = make(ada, "Guards", eve).json()
    share_with_group(ada, hall, group["id"])
    assert ada.delete(f"/api/groups/{group['id']}").status_code == 204
    assert ids(eve) == []
    with reading(ada.services.sessions) as session:
        for table in (UserGroup, GroupMember, MapGroupShare):
            assert session.query(table).count() == 0


def test_who_is_deleted_leaves_groups_and_takes_their_own_along(
    ada: Somebody, eve: Somebody, services: Services
) -> None:
    share_with_group(ada, ada.put_map("Hall"), make(ada, "Guards", eve).json()["id"])
    make(eve, "Friends", ada)
    delete_user(services, eve.id)
    [left] = ada.get("/api/groups").json()
    assert (left["name"], left["members"]) == ("Guards", [])
    with reading(services.sessions) as session:
        assert session.query(UserGroup).count() == 1


def test_who_takes_a_map_off_their_list_leaves_its_groups(ada: Somebody, eve: Somebody) -> None:
    hall = ada.put_map("Hall")
    for name in ("Guards", "Friends"):
        share_with_group(ada, hall, make(ada, name, eve).json()["id"])
    mine = f"/api/maps/{hall}/shares/{eve.id}"
    assert eve.delete(mine).status_code == 204
    assert ids(eve) == []
    assert eve.delete(mine).status_code == 404
    assert all(each["members"] == [] for each in ada.get("/api/groups").json())


def test_bad_groups_are_refused(ada: Somebody, monkeypatch: pytest.MonkeyPatch) -> None:
    nobody = ada.post("/api/groups", json={"name": "Ghosts", "members": ["0" * 32]})
    assert (nobody.status_code, ada.get("/api/groups").json()) == (404, [])
    for wrong in ({"name": " "}, {"name": "A", "members": ["x"]}, {"name": "A\nB"}):
        assert ada.post("/api/groups", json={"members": [], **wrong}).status_code == 422
    monkeypatch.setattr("elfslam.serve.sharing.routes.MOST_GROUPS", 1)
    assert make(ada, "One").status_code == 201
    full = make(ada, "Two")
    assert (full.status_code, len(ada.get("/api/groups").json())) == (409, 1)
