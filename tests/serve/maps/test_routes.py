"""Names, venues and floors of maps, and many deleted at once."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from elfslam.base.enums import Format
from elfslam.base.errors import ParameterError
from elfslam.base.values import FloorMap
from elfslam.data.geographic import Origin
from elfslam.serve.jobs.runner import _common_place
from elfslam.serve.maps.routes import ExportOptions, context_of
from elfslam.serve.positions.values import MapOrigin
from elfslam.serve.services import Services
from elfslam.serve.store.tables import Map

LetIn = Callable[[str], TestClient]
PutMap = Callable[..., str]
DATABASES = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


def shared(ada: TestClient, map_id: str, eve: TestClient, may: str) -> None:
    user_id = eve.get("/api/me").json()["id"]
    ada.put(f"/api/maps/{map_id}/shares/{user_id}", json={"may": may}).raise_for_status()


def change(client: TestClient, map_id: str, **told: Any) -> Any:
    return client.patch(f"/api/maps/{map_id}", json=told)


def places(client: TestClient) -> set[tuple[str, str | None, str | None]]:
    return {(each["name"], each["venue"], each["floor"]) for each in client.get("/api/maps").json()}


@DATABASES
def test_a_map_is_renamed_and_laid_on_a_floor(let_in: LetIn, put_map: PutMap) -> None:
    ada = let_in("Ada")
    map_id = put_map(ada, "2026-11-24 walk")
    assert change(ada, map_id, name=" Café ").json()["name"] == "Café"
    told = change(ada, map_id, venue="North Mall", floor="Basement 2").json()
    assert (told["venue"], told["floor"], told["level"]) == ("North Mall", "Basement 2", -2)
    assert change(ada, map_id, name="Cinema").json()["floor"] == "Basement 2", "what is left out"
    assert change(ada, map_id).json()["name"] == "Cinema"
    assert change(ada, map_id, floor=None).json()["venue"] == "North Mall"
    change(ada, map_id, floor="Floor 1").raise_for_status()
    nowhere = change(ada, map_id, venue=None).json()
    assert (nowhere["venue"], nowhere["floor"]) == (None, None), "no floor without its venue"


def test_names_that_are_none_are_refused(let_in: LetIn, put_map: PutMap) -> None:
    ada = let_in("Ada")
    map_id = put_map(ada)
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
    let_in: LetIn, put_map: PutMap
) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    for name, venue, floor in (("a", "Mall", "1"), ("b", "Mall", "1"), ("c", "Mall", "2")):
        put_map(ada, name, venue=venue, floor=floor)
    put_map(ada, "d", venue="Office", floor="1")
    for name, may in (("edited", "edit"), ("seen", "read")):
        shared(eve, put_map(eve, name, venue="Mall", floor="1"), ada, may)
    put_map(eve, "hidden", venue="Mall", floor="1")
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
    let_in: LetIn, put_map: PutMap
) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    shared(eve, put_map(eve, "seen", venue="Mall"), ada, "read")
    assert ada.patch("/api/places", json={"venue": "Mall", "name": "x"}).status_code == 403
    wanted = {"venue": "Mall", "floor": "9", "name": "x"}
    assert ada.patch("/api/places", json=wanted).status_code == 404
    assert ada.patch("/api/places", json={"venue": "None", "name": "x"}).status_code == 404
    assert places(eve) == {("seen", "Mall", None)}


@DATABASES
def test_many_maps_are_deleted_at_once(
    let_in: LetIn, put_map: PutMap, services: Services, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("elfslam.serve.store.quota.AT_ONCE", 2)
    ada, eve = let_in("Ada"), let_in("Eve")
    mine, theirs = [put_map(ada, f"map {k}") for k in range(4)], put_map(eve)
    wanted = {"ids": [*mine[:3], mine[0], "0" * 32, theirs]}
    assert ada.post("/api/maps/delete", json=wanted).json() == {"count": 3}
    assert {each["id"] for each in ada.get("/api/maps").json()} == {mine[3]}
    assert {each["id"] for each in eve.get("/api/maps").json()} == {theirs}
    assert len(list(services.settings.blobs_folder.glob("*/*"))) == 2
    assert ada.post("/api/maps/delete", json=wanted).json() == {"count": 0}


def test_none_is_deleted_where_one_is_somebody_elses(let_in: LetIn, put_map: PutMap) -> None:
    ada, eve = let_in("Ada"), let_in("Eve")
    mine, theirs = put_map(ada), put_map(eve)
    shared(eve, theirs, ada, "edit")
    answer = ada.post("/api/maps/delete", json={"ids": [mine, theirs]})
    assert answer.status_code == 403
    assert {each["id"] for each in ada.get("/api/maps").json()} == {mine, theirs}
    for ids in ([], ["x"], ["0" * 32] * 2001, "0" * 32, None):
        assert ada.post("/api/maps/delete", json={"ids": ids}).status_code == 422


def test_phones_are_told_where_a_map_lies(
    owner: TestClient, plant: Callable[[Path], Any], maps: tuple[FloorMap, FloorMap], tmp_path: Path
) -> None:
    map_id = plant(tmp_path / "data").put(maps[0])

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
