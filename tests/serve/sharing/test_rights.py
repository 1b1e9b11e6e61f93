"""Who may do what to a map: every role on every route, and jobs as well."""

import re
from collections.abc import Callable
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from elfslam.base.errors import InputError
from elfslam.serve.jobs import queue
from elfslam.serve.jobs.tasks import lay_out
from elfslam.serve.services import Services
from elfslam.serve.sharing.rights import WITHDRAWN, Principal, Right, right_to
from elfslam.serve.store.database import transaction
from elfslam.serve.store.quota import delete_user
from elfslam.serve.store.tables import Map, MapLink, MapShare
from tests.serve.conftest import DATABASES, Somebody

PNG = {"headers": {"Content-Type": "image/png"}, "content": b"no picture"}
NO_POINTS = {"json": {"version": "", "points": []}}
PLACED = {"json": {"width_m": 1, "x_m": 0, "y_m": 0}}
READ, EDIT = {"json": {"may": "read"}}, {"json": {"may": "edit"}}
SOMEBODY = "0" * 32
ROUTES: dict[tuple[str, str], tuple[Right, dict[str, Any]]] = {
    ("GET", ""): (Right.READ, {}),
    ("GET", "/view"): (Right.READ, {}),
    ("GET", "/report.html"): (Right.READ, {}),
    ("GET", "/map.zip"): (Right.READ, {}),
    ("GET", "/exports"): (Right.READ, {}),
    ("GET", "/exports/{to}"): (Right.READ, {}),
    ("GET", "/floor-plan"): (Right.READ, {}),
    ("GET", "/points-of-interest"): (Right.READ, {}),
    ("GET", "/way"): (Right.READ, {"params": {"start": "0,0", "goal": "1,0"}}),
    ("GET", "/package"): (Right.READ, {}),
    ("GET", "/package/{sha256}"): (Right.READ, {}),
    ("PATCH", ""): (Right.EDIT, {"json": {"name": "Other"}}),
    ("PUT", "/floor-plan"): (Right.EDIT, PNG),
    ("PUT", "/floor-plan/placement"): (Right.EDIT, PLACED),
    ("DELETE", "/floor-plan"): (Right.EDIT, {}),
    ("PUT", "/points-of-interest"): (Right.EDIT, NO_POINTS),
    ("GET", "/shares"): (Right.OWN, {}),
    ("PUT", "/shares/{user_id}"): (Right.OWN, READ),
    ("DELETE", "/shares/{user_id}"): (Right.OWN, {}),
    ("PUT", "/groups/{group_id}"): (Right.OWN, READ),
    ("DELETE", "/groups/{group_id}"): (Right.OWN, {}),
    ("PUT", "/link"): (Right.OWN, READ),
    ("DELETE", "/link"): (Right.OWN, {}),
    ("DELETE", ""): (Right.OWN, {}),
}
"""The right that each route wants, and what is sent to it; what deletes the map comes last."""
OF_USERS = ("/positions", "/webhooks")
"""What only users have: tested beside its code."""
ROLES = {
    "owner": Right.OWN,
    "editor": Right.EDIT,
    "reader": Right.READ,
    "link to edit": Right.EDIT,
    "link to read": Right.READ,
    "reader with a link to edit": Right.EDIT,
    "in a group that edits": Right.EDIT,
    "in groups that read and edit": Right.EDIT,
    "taken out of the group": Right.NONE,
    "in a group of another map": Right.NONE,
    "another user": Right.NONE,
    "owner of the server": Right.NONE,
    "withdrawn link": Right.NONE,
    "link of another map": Right.NONE,
    "nobody": Right.NONE,
}


def shared_with(ada: Somebody, map_id: str, other: Somebody, may: str = "read") -> Somebody:
    assert ada.share(map_id, other, may).status_code == 200
    return other


def linked(ada: Somebody, map_id: str, client: Somebody, may: str = "read") -> Somebody:
    """That client, once it has opened the link of a map."""
    told = ada.put(f"/api/maps/{map_id}/link", json={"may": may}).json()["link"]
    link = told["url"].partition("#link=")[2].partition("&")[0]
    opened = client.post("/api/links/open", json={"link": link})
    assert opened.json() == {"map": map_id, "name": "Hall", "may": may}
    return client


def was_let_in(answer: httpx.Response) -> bool:
    """Whether a route went on: what it then lacks is not what this is about."""
    if answer.status_code == 404:
        detail = answer.json()["detail"]
        return not detail.startswith("there is no such map") and detail != WITHDRAWN
    return answer.status_code not in (401, 403)


@pytest.fixture
def client_in(
    ada: Somebody, eve: Somebody, role: str, owner: Somebody, passer_by: Callable[[], Somebody]
) -> tuple[Somebody, str]:
    """Somebody in a role, and the map that it is about."""
    map_id = ada.put_map()
    clients: dict[str, Callable[[], Somebody]] = {
        "owner": lambda: ada,
        "editor": lambda: shared_with(ada, map_id, eve, "edit"),
        "reader": lambda: shared_with(ada, map_id, eve),
        "link to edit": lambda: linked(ada, map_id, passer_by(), "edit"),
        "link to read": lambda: linked(ada, map_id, passer_by()),
        "reader with a link to edit": lambda: linked(
            ada, map_id, shared_with(ada, map_id, eve), "edit"
        ),
        "in a group that edits": lambda: grouped(ada, map_id, eve, "edit"),
        "in groups that read and edit": lambda: grouped(
            ada, map_id, grouped(ada, map_id, eve, "edit")
        ),
        "taken out of the group": lambda: taken_out(ada, map_id, eve),
        "in a group of another map": lambda: grouped(ada, ada.put_map(), eve, "edit"),
        "another user": lambda: eve,
        "owner of the server": lambda: owner,
        "withdrawn link": lambda: withdrawn(ada, map_id, passer_by()),
        "link of another map": lambda: with_cookie_of(ada, ada.put_map(), map_id, passer_by()),
        "nobody": passer_by,
    }
    return clients[role](), map_id


def grouped(ada: Somebody, map_id: str, other: Somebody, may: str = "read") -> Somebody:
    """Somebody who is in a group with which a map is shared."""
    made = ada.post("/api/groups", json={"name": "Guards", "members": [other.id]}).json()
    address = f"/api/maps/{map_id}/groups/{made['id']}"
    assert ada.put(address, json={"may": may}).status_code == 200
    return other


def taken_out(ada: Somebody, map_id: str, other: Somebody) -> Somebody:
    grouped(ada, map_id, other)
    [group] = ada.get("/api/groups").json()
    ada.put(f"/api/groups/{group['id']}", json={"name": "Guards", "members": []}).raise_for_status()
    return other


def withdrawn(ada: Somebody, map_id: str, client: Somebody) -> Somebody:
    linked(ada, map_id, client)
    assert ada.delete(f"/api/maps/{map_id}/link").status_code == 204
    return client


def with_cookie_of(ada: Somebody, other_id: str, map_id: str, client: Somebody) -> Somebody:
    """A browser sends the cookie to its own map alone; who means harm sends it anywhere."""
    ada.put(f"/api/maps/{map_id}/link", **EDIT).raise_for_status()
    linked(ada, other_id, client)
    [secret] = [each.value for each in client.cookies.jar if other_id in each.path]
    client.cookies.clear()
    client.cookies.set("elfslam_link", str(secret))
    return client


@pytest.mark.parametrize("role", ROLES)
def test_every_role_on_every_route(client_in: tuple[Somebody, str], role: str) -> None:
    client, map_id = client_in
    for (method, path), (wanted, sent) in ROUTES.items():
        told = path.format(to="tum", sha256="0" * 64, user_id=SOMEBODY, group_id=SOMEBODY)
        answer = client.request(method, f"/api/maps/{map_id}{told}", **sent)
        case = role, method, path, answer.status_code, answer.text[:200]
        if ROLES[role] >= wanted:
            assert was_let_in(answer), case
        elif ROLES[role] is Right.NONE:
            assert answer.status_code == (401 if role == "nobody" else 404), case
            assert not was_let_in(answer), case
        else:
            assert answer.status_code == 403, case


NONSENSE = (b"", b"{", b"\xff\xfe", b"[" * 5_000)


@pytest.mark.parametrize("token", [None, "not-known-here"])
def test_who_is_not_known_is_told_that_first(
    app: FastAPI, passer_by: Callable[[], Somebody], token: str | None
) -> None:
    client, asked = passer_by(), 0
    headers = {"Content-Type": "application/json", "Upload-Length": "5_0"}
    headers |= {} if token is None else {"Authorization": f"Bearer {token}"}
    for path, methods in app.openapi()["paths"].items():
        told = re.sub(r"\{\w+\}", "0" * 32, path)
        for method, operation in methods.items():
            if not operation.get("security"):
                continue
            for body in NONSENSE:
                answer = client.request(method, told, content=body, headers=headers)
                assert answer.status_code in (401, 404, 412, 415), (method, path, body, answer.text)
                asked += 1
    assert asked > 200


def test_a_guest_of_a_link_is_told_what_is_wrong_with_a_body(
    ada: Somebody, visitor: Somebody
) -> None:
    client = linked(ada, map_id := ada.put_map(), visitor, "edit")
    json_type = {"Content-Type": "application/json"}
    assert client.patch(f"/api/maps/{map_id}", content=b"{", headers=json_type).status_code == 400
    other = f"/api/maps/{'0' * 32}"
    assert client.patch(other, content=b"{", headers=json_type).status_code == 401


def test_the_table_has_every_route_of_a_map(app: FastAPI) -> None:
    prefix, public = "/api/maps/{map_id}", "/plotly-{version}.min.js"
    found = {
        (method.upper(), path.removeprefix(prefix))
        for path, methods in app.openapi()["paths"].items()
        for method in methods
        if path.startswith(prefix)
        and not path.endswith(public)
        and not path.removeprefix(prefix).startswith(OF_USERS)
    }
    assert found == set(ROUTES)


def test_a_right_is_for_that_map_and_that_person_alone() -> None:
    ada, eve, hall, yard = "a" * 32, "e" * 32, "1" * 32, "2" * 32
    found = Map(id=hall, user_id=ada)
    share = MapShare(map_id=hall, user_id=eve, may="edit")
    link = MapLink(map_id=hall, secret="secret", may="read")
    assert right_to(Principal(ada), found) is Right.OWN
    assert right_to(Principal(), Map(id=hall, user_id=None)) is Right.NONE
    assert right_to(Principal(eve), found, share) is Right.EDIT
    assert right_to(Principal("0" * 32), found, share) is Right.NONE
    assert right_to(Principal(eve), Map(id=yard, user_id=ada), share, link) is Right.NONE
    assert right_to(Principal(eve), found, through=("read", "edit")) is Right.EDIT
    assert right_to(Principal(eve), found, share, through=("read",)) is Right.EDIT
    assert right_to(Principal(None, "secret"), found, None, link) is Right.READ
    assert right_to(Principal(None, "Secret"), found, None, link) is Right.NONE
    assert right_to(Principal(None, "\u017fecret\ud800"), found, None, link) is Right.NONE
    assert right_to(Principal(None, None), found, None, link) is Right.NONE


def test_jobs_ask_for_the_same_rights(ada: Somebody, eve: Somebody) -> None:
    theirs, own = ada.put_map(), eve.put_map()
    merge = {"kind": "merge", "maps": [theirs, own]}
    locate = {"kind": "locate", "recording": eve.remember("walk"), "map": theirs}
    for may, of_merge, of_locate in ((None, 404, 404), ("read", 403, 202), ("edit", 202, 202)):
        if may:
            shared_with(ada, theirs, eve, may)
        assert eve.post("/api/jobs", json=merge).status_code == of_merge, may
        assert eve.post("/api/jobs", json=locate).status_code == of_locate, may


@pytest.mark.parametrize("kind", ["merge", "locate"])
def test_a_right_that_was_withdrawn_since_ends_a_job(
    ada: Somebody, eve: Somebody, services: Services, kind: str
) -> None:
    theirs, own = ada.put_map(), eve.put_map()
    shared_with(ada, theirs, eve, "edit")
    asked = {"kind": "merge", "maps": [own, theirs]}
    if kind == "locate":
        asked = {"kind": kind, "recording": eve.remember("walk"), "map": theirs}
    eve.post("/api/jobs", json=asked).raise_for_status()
    held = queue.claim(services.sessions)
    assert held is not None
    folder = services.settings.work_folder
    for name in ("first", "second"):
        (folder / name).mkdir()
    lay_out(services, held, folder / "first")
    ada.delete(f"/api/maps/{theirs}/shares/{eve.id}").raise_for_status()
    with pytest.raises(InputError, match="shared with you no more"):
        lay_out(services, held, folder / "second")


@DATABASES
@pytest.mark.parametrize("goes", ["map", "owner"])
def test_what_others_did_with_a_map_goes_with_it(ada: Somebody, eve: Somebody, goes: str) -> None:
    theirs, own = ada.put_map(), eve.put_map()
    shared_with(ada, theirs, eve, "edit")
    ada.put(f"/api/maps/{theirs}/link", **READ)
    recording = eve.remember("walk")
    for asked in (
        {"kind": "merge", "maps": [own, theirs]},
        {"kind": "locate", "recording": recording, "map": theirs},
        {"kind": "locate", "recording": recording, "map": own},
    ):
        eve.post("/api/jobs", json=asked).raise_for_status()
    if goes == "map":
        ada.delete(f"/api/maps/{theirs}").raise_for_status()
    else:
        delete_user(ada.services, ada.id)
    assert [job["given"]["map"] for job in eve.get("/api/jobs").json()] == [own]
    assert [each["id"] for each in eve.get("/api/maps").json()] == [own]
    assert eve.get(f"/api/maps/{theirs}").status_code == 404
    with transaction(ada.services.sessions) as session:
        assert session.query(MapShare).count() == 0
        assert session.query(MapLink).count() == 0
