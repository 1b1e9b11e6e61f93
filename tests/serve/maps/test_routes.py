"""Names, venues and floors of maps, many deleted at once, and ways through the floors of one."""

import json
from pathlib import Path
from typing import Any

import pytest

from elfslam.base.enums import Format
from elfslam.base.errors import ParameterError
from elfslam.data.building_files import passage_facts
from elfslam.data.geographic import Origin
from elfslam.data.map_files import MAP, write_map
from elfslam.serve.jobs.runner import _common_place
from elfslam.serve.maps.bodies import floor_name, level_of
from elfslam.serve.maps.package import sources_of
from elfslam.serve.maps.routes import ExportOptions, context_of
from elfslam.serve.positions.values import MapOrigin
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading, transaction
from elfslam.serve.store.tables import Map
from tests.app.test_way import STAIRS, corridor
from tests.serve.conftest import DATABASES, Maps, Somebody
from tests.serve.planting import plant_files, plant_floor_map


def change(client: Somebody, map_id: str, **told: Any) -> Any:
    return client.patch(f"/api/maps/{map_id}", json=told)


def places(client: Somebody) -> set[tuple[str, str | None, str | None]]:
    return {(each["name"], each["venue"], each["floor"]) for each in client.get("/api/maps").json()}


@DATABASES
def test_a_map_is_renamed_and_laid_on_a_floor(ada: Somebody) -> None:
    map_id = ada.put_map("2026-11-24 walk")
    assert change(ada, map_id, name=" Café ").json()["name"] == "Café"
    told = change(ada, map_id, venue="North Mall", floor="Basement 2").json()
    assert (told["venue"], told["floor"], told["level"]) == ("North Mall", "Basement 2", -2)
    assert change(ada, map_id, name="Cinema").json()["floor"] == "Basement 2", "what is left out"
    assert change(ada, map_id).json()["name"] == "Cinema"
    assert change(ada, map_id, floor=None).json()["venue"] == "North Mall"
    change(ada, map_id, floor="Floor 1").raise_for_status()
    nowhere = change(ada, map_id, venue=None).json()
    assert (nowhere["venue"], nowhere["floor"]) == (None, None), "no floor without its venue"


def test_names_that_are_none_are_refused(ada: Somebody) -> None:
    map_id = ada.put_map()
    for told in (
        {"name": None}, {"name": " "}, {"name": "a\nb"}, {"name": "x" * 121}, {"name": 7},
        {"floor": "Floor 1"}, {"venue": ""}, {"venue": "a\u202eb"}, {"venue": None, "floor": "1"},
    ):  # fmt: skip
        answer = change(ada, map_id, **told)
        assert answer.status_code == 422, told
        assert answer.headers["content-type"] == "application/problem+json"
    assert places(ada) == {("Hall", None, None)}


@DATABASES
def test_a_venue_or_a_floor_is_renamed_on_all_maps_that_one_may_edit(
    ada: Somebody, eve: Somebody
) -> None:
    for name, venue, floor in (("a", "Mall", "1"), ("b", "Mall", "1"), ("c", "Mall", "2")):
        ada.put_map(name, venue=venue, floor=floor)
    ada.put_map("d", venue="Office", floor="1")
    for name, may in (("edited", "edit"), ("seen", "read")):
        eve.share(eve.put_map(name, venue="Mall", floor="1"), ada, may)
    eve.put_map("hidden", venue="Mall", floor="1")
    answer = ada.patch("/api/places", json={"venue": "Mall", "floor": "1", "name": "Ground"})
    assert answer.json() == {"maps": 3}
    answer = ada.patch("/api/places", json={"venue": "Mall", "name": "North Mall"})
    assert answer.json() == {"maps": 4}
    assert places(ada) == {
        ("a", "North Mall", "Ground"), ("b", "North Mall", "Ground"), ("c", "North Mall", "2"),
        ("d", "Office", "1"), ("edited", "North Mall", "Ground"), ("seen", "Mall", "1"),
    }  # fmt: skip
    assert ("hidden", "Mall", "1") in places(eve)


def test_a_place_that_is_not_there_or_not_yours_is_not_renamed(
    ada: Somebody, eve: Somebody
) -> None:
    eve.share(eve.put_map("seen", venue="Mall"), ada, "read")
    assert ada.patch("/api/places", json={"venue": "Mall", "name": "x"}).status_code == 403
    wanted = {"venue": "Mall", "floor": "9", "name": "x"}
    assert ada.patch("/api/places", json=wanted).status_code == 404
    assert ada.patch("/api/places", json={"venue": "None", "name": "x"}).status_code == 404
    assert places(eve) == {("seen", "Mall", None)}


@DATABASES
def test_many_maps_are_deleted_at_once(
    ada: Somebody, eve: Somebody, services: Services, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("elfslam.serve.store.quota.AT_ONCE", 2)
    mine, theirs = [ada.put_map(f"map {k}") for k in range(4)], eve.put_map()
    wanted = {"ids": [*mine[:3], mine[0], "0" * 32, theirs]}
    assert ada.post("/api/maps/delete", json=wanted).json() == {"count": 3}
    assert {each["id"] for each in ada.get("/api/maps").json()} == {mine[3]}
    assert {each["id"] for each in eve.get("/api/maps").json()} == {theirs}
    assert len(list(services.settings.blobs_folder.glob("*/*"))) == 2
    assert ada.post("/api/maps/delete", json=wanted).json() == {"count": 0}


def test_none_is_deleted_where_one_is_somebody_elses(ada: Somebody, eve: Somebody) -> None:
    mine, theirs = ada.put_map(), eve.put_map()
    eve.share(theirs, ada, "edit")
    answer = ada.post("/api/maps/delete", json={"ids": [mine, theirs]})
    assert answer.status_code == 403
    assert {each["id"] for each in ada.get("/api/maps").json()} == {mine, theirs}
    for ids in ([], ["x"], ["0" * 32] * 2001, "0" * 32, None):
        assert ada.post("/api/maps/delete", json={"ids": ids}).status_code == 422


def test_phones_are_told_where_a_map_lies(owner: Somebody, maps: Maps) -> None:
    map_id = plant_floor_map(owner.services.settings.data_folder, maps[0])

    def manifest() -> Any:
        return json.loads(owner.get(f"/api/maps/{map_id}/package").json()["manifest"])

    before = manifest()
    assert "venue" not in before
    change(owner, map_id, venue="Mall", floor="Floor 2").raise_for_status()
    after = manifest()
    assert (after["venue"], after["floor"]) == ("Mall", "Floor 2")
    assert after["revision"] > before["revision"]
    assert after["tiles"] == before["tiles"]
    change(owner, map_id, venue=None).raise_for_status()
    assert "venue" not in manifest()


def test_what_is_known_of_a_map_need_not_be_told_to_an_export() -> None:
    found, known = Map(venue="Mall", floor="Basement"), MapOrigin(latitude_deg=4, longitude_deg=-8)
    needed = {"category": "retail", "address": "a", "locality": "b", "country": "CH"}
    told = context_of(ExportOptions(**needed), Format.IMDF, found, known)
    assert told.place is not None
    assert (told.place.name, told.place.level, told.place.ordinal) == ("Mall", "Basement", -1)
    assert told.origin == Origin(4, -8)
    asked = ExportOptions(**needed, name="Other", level="Top", ordinal=9, origin="1,2,3")
    told = context_of(asked, Format.IMDF, found, known)
    assert told.place is not None
    assert (told.place.name, told.place.level, told.place.ordinal) == ("Other", "Top", 9)
    assert told.origin == Origin(1, 2, 3)
    assert context_of(ExportOptions(), Format.TUM, Map(), None).origin is None
    with pytest.raises(ParameterError, match="--name: imdf asks for name, "):
        context_of(ExportOptions(), Format.IMDF, Map(), None)


def test_maps_of_one_floor_are_merged_on_it() -> None:
    here, there = Map(venue="Mall", floor="1"), Map(venue="Mall", floor="2")
    assert _common_place([here, here]) == {"venue": "Mall", "floor": "1"}
    assert _common_place([here, there]) == {"venue": "Mall", "floor": None}
    assert _common_place([here, Map()]) == {"venue": None, "floor": None}


@pytest.mark.parametrize(
    ("name", "level"),
    [
        ("Ground floor", 0), ("ground", 0), ("Lobby", 0), ("EG", 0), ("0", 0),
        ("Floor 2", 2), ("2nd floor", 2), ("12", 12), ("Level 3, east", 3), ("Hall-2", 2),
        ("-1", -1), ("\u22122", -2), ("Level -3", -3), ("Basement", -1), ("Basement 2", -2),
        ("B1", -1), ("UG2", -2), ("Underground 3", -3), ("Building 7, ground floor", 0),
        ("Mezzanine", None), ("Room 1024", None), ("Aground", None), (None, None),
    ],
)  # fmt: skip
def test_a_name_says_how_high_a_floor_lies(name: str | None, level: int | None) -> None:
    assert level_of(name) == level


def test_floors_of_published_buildings_lie_where_they_say() -> None:
    for level in (-3, -1, 0, 1, 42):
        assert level_of(floor_name(level)) == level


@pytest.fixture
def floors(ada: Somebody, tmp_path: Path) -> list[str]:
    """Two corridors above each other, among Ada's maps."""
    ids = list[str]()
    for level in (0, 1):
        (folder := tmp_path / str(level)).mkdir()
        write_map(corridor(3.0 * level), folder / MAP)
        facts: Any = {"level": level, "passages": [passage_facts(STAIRS)]}
        row = Map(user_id=ada.id, name="Hall", kind="run", floor=str(level), facts=facts)
        ids.append(plant_files(ada.services, row, folder))
    with transaction(ada.services.sessions) as session:
        for each in ids:
            row = session.get_one(Map, each)
            row.facts = {**row.facts, "frame": ids[0]}
    return ids


def ask(client: Somebody, map_id: str, start: str, goal: str, **told: Any) -> Any:
    params = {"start": start, "goal": goal, **told}
    return client.get(f"/api/maps/{map_id}/way", params=params)


def name(client: Somebody, map_id: str, called: str, x_m: float, y_m: float) -> None:
    point = {"name": called, "kind": "room", "x_m": x_m, "y_m": y_m}
    told = {"version": "", "points": [point]}
    client.put(f"/api/maps/{map_id}/points-of-interest", json=told).raise_for_status()


def test_a_package_tells_its_floor_and_the_others(services: Services, floors: list[str]) -> None:
    low, high = floors
    with reading(services.sessions) as session:
        told = sources_of(session, session.get_one(Map, high), services.settings).place
    assert (told["level"], told["floors"]) == (1, [{"level": 0, "map": low}])
    assert told["passages"] == [passage_facts(STAIRS)]


@DATABASES
def test_a_way_leads_through_the_floors_of_the_building(ada: Somebody, floors: list[str]) -> None:
    low, high = floors
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
    ada: Somebody, eve: Somebody, floors: list[str]
) -> None:
    low, _ = floors
    assert ask(eve, low, "0,0", "5,0").status_code == 404
    ada.share(low, eve)
    assert ask(eve, low, "0,0", "5,0").json()["length_m"] == pytest.approx(5, abs=0.3)
    refused = ask(eve, low, "0,0", "1:5,3")
    assert (refused.status_code, refused.json()["detail"]) == (
        422, "way: got '1:5,3', wanted a level of 0; choose one",
    )  # fmt: skip


def test_what_leads_nowhere_is_refused_in_one_line(ada: Somebody, floors: list[str]) -> None:
    low, _ = floors
    refused = ask(ada, low, "0,0", "1:5,3", without_stairs=True)
    assert refused.status_code == 404
    assert refused.json()["detail"].startswith("way: the only way from level 0 to 1 has steps")
    for start in ("", "Nowhere", "1e9,0", "9" * 130):
        assert ask(ada, low, start, "1:5,3").status_code == 422, start
