"""Phones ask where they are: over HTTP, in both databases."""

import re

import pytest
from sqlalchemy import event
from starlette.testclient import TestClient

from elfslam.serve.buildings.publishing import publish, withdraw
from elfslam.serve.services import Services
from tests.serve.buildings.conftest import MakeFloor, heard_on
from tests.serve.conftest import DATABASES

pytestmark = DATABASES
Town = dict[tuple[str, int], str]


@pytest.fixture
def town(services: Services, new_floor: MakeFloor) -> Town:
    """Two floors of a mall, an office a kilometre away, and a kiosk where nobody scanned."""
    ids = {}
    for building, level, changes in (
        ("Mall", 0, {}),
        ("Mall", 1, {}),
        ("Office", 0, {"at": {"latitude_deg": 47.01}, "points": None}),
        ("Kiosk", 0, {"at": {"longitude_deg": 179.9999}, "points": None}),
    ):
        ids[building, level] = publish(services, new_floor(building, level, **changes)).map_id
    return ids


def ask(client: TestClient, **question: object) -> tuple[str, list[tuple[str, int]]]:
    told = client.post("/api/find", json=question).raise_for_status().json()
    assert all(0 < each["share"] <= 1 for each in told["candidates"])
    shares = [each["share"] for each in told["candidates"]]
    assert shares == sorted(shares, reverse=True)
    return told["status"], [(each["building"], each["floor"]) for each in told["candidates"]]


def position(latitude_deg: float, longitude_deg: float, sigma_m: float) -> dict[str, float]:
    return {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg, "sigma_m": sigma_m}


@pytest.mark.parametrize("deaf_db", [0.0, 8.0])
def test_wifi_tells_the_floor(guest: TestClient, town: Town, deaf_db: float) -> None:
    for level in (0, 1):
        status, found = ask(guest, wifi=heard_on(level, deaf_db))
        assert (status, found[0]) == ("OK", ("Mall", level))
    told = guest.post("/api/find", json={"wifi": heard_on(1)}).json()["candidates"][0]
    assert told["map"] == town["Mall", 1]
    assert guest.get(f"/api/maps/{told['map']}/package").status_code == 200


def test_a_position_tells_the_building(guest: TestClient, town: Town) -> None:
    assert ask(guest, position=position(47.01, 8.0, 15.0)) == ("OK", [("Office", 0)])
    status, found = ask(guest, position=position(47.0, 8.0, 15.0))
    assert (status, set(found)) == ("AMBIGUOUS", {("Mall", 0), ("Mall", 1)})
    assert ask(guest, position=position(46.9, 8.0, 15.0)) == ("UNKNOWN_PLACE", [])
    beyond = ask(guest, position=position(47.0, -179.9999, 30.0))
    assert beyond == ("OK", [("Kiosk", 0)])


def test_senses_add_up(guest: TestClient, town: Town) -> None:
    here = position(47.0, 8.0, 50.0)
    status, found = ask(guest, wifi=heard_on(1, 5.0), position=here)
    assert (status, found[0]) == ("OK", ("Mall", 1))
    elsewhere = position(47.01, 8.0, 15.0)
    assert ask(guest, wifi=heard_on(1), position=elsewhere)[0] != "OK"


def test_what_is_withdrawn_or_moved_is_not_found(
    guest: TestClient, services: Services, new_floor: MakeFloor, town: Town
) -> None:
    publish(services, new_floor("Mall", 1, loud=0))
    assert ask(guest, wifi=heard_on(0))[0] == "AMBIGUOUS"
    withdraw(services, "Mall", 1)
    assert ask(guest, wifi=heard_on(0)) == ("OK", [("Mall", 0)])
    withdraw(services, "Mall", 0)
    assert ask(guest, wifi=heard_on(0)) == ("UNKNOWN_PLACE", [])
    assert guest.get(f"/api/maps/{town['Mall', 0]}/package").status_code == 404


def test_a_lookup_is_two_queries_without_a_scan(
    guest: TestClient, services: Services, town: Town
) -> None:
    said: list[str] = []

    def note(_connection: object, _cursor: object, statement: str, *_: object) -> None:
        said.append(statement)

    event.listen(services.engine, "before_cursor_execute", note)
    ask(guest, wifi=heard_on(1), position=position(47.0, 8.0, 15.0))
    asked = [text for text in said if "floor" in text]
    assert len(asked) == 2
    assert "floor_points" in asked[0]
    others = [text for text in said if "floor" not in text and "BEGIN" not in text]
    assert len(others) == 1  # whose token that is


def test_nothing_is_kept_of_what_a_phone_tells(
    guest: TestClient, services: Services, town: Town
) -> None:
    writes: list[str] = []

    def note(_connection: object, _cursor: object, statement: str, *_: object) -> None:
        if not re.match(r"\s*(SELECT|BEGIN|PRAGMA)", statement, re.I):
            writes.append(statement)

    event.listen(services.engine, "before_cursor_execute", note)
    ask(guest, wifi=heard_on(1), position=position(47.0, 8.0, 15.0))
    assert writes == []


def test_questions_that_are_none(anyone: TestClient, guest: TestClient) -> None:
    assert anyone.post("/api/find", json={"wifi": heard_on(0)}).status_code == 401
    for wrong in (
        {},
        {"wifi": {}},
        {"wifi": {"home": -50}},
        {"wifi": {"04:33:89:79:fc:7c": -200}},
        {"wifi": {f"00:00:00:00:{k // 256:02x}:{k % 256:02x}": -50 for k in range(1001)}},
        {"position": position(91.0, 8.0, 10.0)},
        {"position": position(47.0, 8.0, 0.0)},
        {"echoes": {"encoder": "e", "vectors": [[0.1] * 127]}},
        {"echoes": {"encoder": "e", "vectors": []}},
        {"echoes": {"encoder": "e", "vectors": [[2.0] * 128]}},
    ):
        answer = guest.post("/api/find", json=wrong)
        assert answer.status_code == 422, wrong
        assert len(answer.json()["detail"].splitlines()) == 1
