"""Ways over HTTP: through the floors that one may see, and refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from elfslam.data.building_files import passage_facts
from elfslam.data.map_files import MAP, write_map
from elfslam.serve.maps.package import sources_of
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.tables import Map
from tests.app.test_way import STAIRS, corridor
from tests.serve.planting import plant_files

LetIn = Callable[[str], TestClient]
DATABASES = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)
Plant = Callable[..., list[str]]


@pytest.fixture
def plant_building(services: Services, tmp_path: Path) -> Plant:
    """Puts two corridors above each other among the maps of a client's user; their ids."""

    def plant(client: TestClient) -> list[str]:
        user_id, ids = client.get("/api/me").json()["id"], list[str]()
        for level in (0, 1):
            folder = tmp_path / str(level)
            folder.mkdir()
            write_map(corridor(3.0 * level), folder / MAP)
            facts: Any = {"level": level, "passages": [passage_facts(STAIRS)]}
            row = Map(user_id=user_id, name="Hall", kind="run", floor=str(level), facts=facts)
            ids.append(plant_files(services, row, folder))
        with transaction(services.sessions) as session:
            for each in ids:
                row = session.get_one(Map, each)
                row.facts = {**row.facts, "frame": ids[0]}
        return ids

    return plant


def ask(client: TestClient, map_id: str, start: str, goal: str, **told: Any) -> Any:
    params = {"start": start, "goal": goal, **told}
    return client.get(f"/api/maps/{map_id}/way", params=params)


def name(client: TestClient, map_id: str, called: str, x_m: float, y_m: float) -> None:
    point = {"name": called, "kind": "room", "x_m": x_m, "y_m": y_m}
    told = {"version": "", "points": [point]}
    client.put(f"/api/maps/{map_id}/points-of-interest", json=told).raise_for_status()


def test_a_package_tells_its_floor_and_the_others(
    services: Services, let_in: LetIn, plant_building: Plant
) -> None:
    low, high = plant_building(let_in("Ada"))
    with reading(services.sessions) as session:
        told = sources_of(session, session.get_one(Map, high), services.settings).place
    assert (told["level"], told["floors"]) == (1, [{"level": 0, "map": low}])
    assert told["passages"] == [passage_facts(STAIRS)]


@DATABASES
def test_a_way_leads_through_the_floors_of_the_building(
    let_in: LetIn, plant_building: Plant
) -> None:
    ada = let_in("Ada")
    low, high = plant_building(ada)
    name(ada, high, "Room 5", 29, 3)
    told = ask(ada, low, "0,0", "room 5").raise_for_status().json()
    assert told["length_m"] == pytest.approx(32, abs=0.5)
    assert [(leg["level"], leg["map"]) for leg in told["legs"]] == [(0, low), (1, high)]
    assert [leg["leaves_by"] for leg in told["legs"]] == ["stairs", None]
    assert [(each["level"], each["after"]) for each in told["moves"]] == [
        (0, "start"),
        (1, "stairs"),
    ]
    back = ask(ada, high, "29,3", "0:0,0").raise_for_status().json()
    assert back["duration_s"] == pytest.approx(told["duration_s"])


def test_who_sees_one_floor_alone_finds_ways_on_it_alone(
    let_in: LetIn, plant_building: Plant
) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    low, _ = plant_building(ada)
    assert ask(eve, low, "0,0", "5,0").status_code == 404
    user_id = eve.get("/api/me").json()["id"]
    ada.put(f"/api/maps/{low}/shares/{user_id}", json={"may": "read"}).raise_for_status()
    assert ask(eve, low, "0,0", "5,0").json()["length_m"] == pytest.approx(5, abs=0.3)
    refused = ask(eve, low, "0,0", "1:5,3")
    assert (refused.status_code, refused.json()["detail"]) == (
        422, "way: got '1:5,3', wanted a level of 0; choose one",
    )  # fmt: skip


def test_what_leads_nowhere_is_refused_in_one_line(let_in: LetIn, plant_building: Plant) -> None:
    ada = let_in("Ada")
    low, _ = plant_building(ada)
    refused = ask(ada, low, "0,0", "1:5,3", without_stairs=True)
    assert refused.status_code == 404
    assert refused.json()["detail"].startswith("way: the only way from level 0 to 1 has steps")
    for start in ("", "Nowhere", "1e9,0", "9" * 130):
        assert ask(ada, low, start, "1:5,3").status_code == 422, start
