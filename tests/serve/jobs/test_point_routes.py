"""Points of interest of maps: kept, changed by one at a time, exported, told to phones."""

from __future__ import annotations

import io
import json
import zipfile
from typing import Any

from fastapi.testclient import TestClient

from elfslam.data.named_places import LONGEST_NAME, MOST, POINTS_OF_INTEREST
from tests.serve.jobs.conftest import Remember as Keep

ROOM = {"name": "Room 5", "kind": "room", "x_m": 1.25, "y_m": -2.0}
DOOR = {"name": "Tür, links", "kind": "door", "x_m": 3.0, "y_m": 0.5}


def address(map_id: str) -> str:
    return f"/api/maps/{map_id}/points-of-interest"


def put(client: TestClient, map_id: str, version: str, *points: dict[str, Any]) -> Any:
    return client.put(address(map_id), json={"version": version, "points": list(points)})


def test_they_are_kept_in_their_order_and_taken_away(owner: TestClient, keep_map: Keep) -> None:
    map_id = keep_map(owner, "one")
    assert owner.get(address(map_id)).json() == {"version": "", "points": []}
    first = put(owner, map_id, "", ROOM, DOOR).json()
    assert first["points"] == [ROOM, DOOR]
    assert owner.get(address(map_id)).json() == first
    second = put(owner, map_id, first["version"], DOOR).json()
    assert (second["points"], second["version"] != first["version"]) == ([DOOR], True)
    assert put(owner, map_id, second["version"]).json() == {"version": "", "points": []}
    names = {file["name"] for file in owner.get(f"/api/maps/{map_id}").json()["files"]}
    assert POINTS_OF_INTEREST not in names


def test_who_changed_another_version_is_told_and_changes_nothing(
    owner: TestClient, keep_map: Keep
) -> None:
    map_id = keep_map(owner, "one")
    kept = put(owner, map_id, "", ROOM).json()
    for version in ("", "0" * 64):
        refused = put(owner, map_id, version, DOOR)
        assert refused.status_code == 409
        assert "load them again" in refused.json()["detail"]
    assert owner.get(address(map_id)).json() == kept


def test_what_cannot_be_meant_is_refused(owner: TestClient, keep_map: Keep) -> None:
    map_id = keep_map(owner, "one")
    names = (" ", "two\nlines", "x" * (LONGEST_NAME + 1), "\u0958" * LONGEST_NAME)
    for wrong in (
        *({"name": each} for each in names),
        {"kind": "gate"},
        {"x_m": "here"},
        {"y_m": 2e8},
    ):
        assert put(owner, map_id, "", {**ROOM, **wrong}).status_code == 422, wrong
    assert owner.get(address(map_id)).json()["points"] == []


def test_there_are_not_too_many(owner: TestClient, keep_map: Keep) -> None:
    map_id = keep_map(owner, "one")
    assert put(owner, map_id, "", *[ROOM] * (MOST + 1)).status_code == 422
    assert len(put(owner, map_id, "", *[ROOM] * MOST).json()["points"]) == MOST


def test_exports_and_the_folder_carry_them(owner: TestClient, keep_map: Keep) -> None:
    map_id = keep_map(owner, "one")
    put(owner, map_id, "", ROOM, DOOR).raise_for_status()
    asked = {"origin": "47.3769,8.5417"}
    told = owner.get(f"/api/maps/{map_id}/exports/geojson", params=asked).json()
    points = [
        each["properties"]["name"]
        for each in told["features"]
        if each["properties"]["kind"] == "point_of_interest"
    ]
    assert points == ["Room 5", "Tür, links"]
    venue = {
        "name": "Office", "category": "businesscampus", "address": "Street 1", "locality": "Town",
        "country": "CH", "level": "Ground floor", "ordinal": 0,
    }  # fmt: skip
    archive = owner.get(f"/api/maps/{map_id}/exports/imdf", params={**asked, **venue}).content
    with zipfile.ZipFile(io.BytesIO(archive)) as packed:
        amenities = json.loads(packed.read("amenity.geojson"))["features"]
    assert [each["properties"]["category"] for each in amenities] == ["unspecified", "entry"]
    with zipfile.ZipFile(io.BytesIO(owner.get(f"/api/maps/{map_id}/map.zip").content)) as packed:
        (table,) = (name for name in packed.namelist() if name.endswith(POINTS_OF_INTEREST))
        assert packed.read(table).decode().splitlines()[1] == "Room 5,room,1.250,-2.000"


def test_phones_are_told_and_told_anew(owner: TestClient, keep_map: Keep) -> None:
    map_id = keep_map(owner, "one")

    def manifest() -> Any:
        return json.loads(owner.get(f"/api/maps/{map_id}/package").json()["manifest"])

    first = manifest()
    assert "points_of_interest" not in first
    kept = put(owner, map_id, "", ROOM).json()
    second = manifest()
    assert second["points_of_interest"] == [ROOM]
    assert second["revision"] > first["revision"]
    assert second["tiles"] == first["tiles"]
    put(owner, map_id, kept["version"]).raise_for_status()
    assert "points_of_interest" not in manifest()
