"""IMDF archives: ours pass the rules and a second geometry engine; broken ones do not."""

from __future__ import annotations

import copy
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapely.geometry import shape

from elfslam.base.errors import InputError
from elfslam.base.values import PointKind, PointOfInterest
from elfslam.data.geographic import Origin
from elfslam.data.imdf import Venue, imdf_archive, read_imdf, read_place, write_imdf
from elfslam.data.imdf_rules import POLYGONAL, crosses_itself, faults_of

ORIGIN = Origin(47.3769, 8.5417, 20.0)
PLACE = Venue("Studio", "businesscampus", "Hauptstrasse 1", "Zürich", "CH", "Ground floor", 0)
NOON = datetime(2026, 1, 2, 12, tzinfo=UTC)
LAP = np.array([[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]], dtype=float)
APART = np.array([[8.0, 0.0], [9.0, 2.0]])
POINTS = (
    PointOfInterest("Tür", PointKind.DOOR, 0.1, 1.0),
    PointOfInterest("Lift", PointKind.LIFT, 9.5, 2.5),
)
TOML = """
name = "Studio"
category = "businesscampus"
address = "Hauptstrasse 1"
locality = "Zürich"
country = "CH"
level = "Ground floor"
ordinal = 0
"""


@pytest.fixture(scope="module")
def archive() -> dict[str, Any]:
    return dict(imdf_archive([LAP, APART], PLACE, ORIGIN, NOON, POINTS))


def test_the_archive_is_read_as_it_was_made(tmp_path: Path, archive: dict[str, Any]) -> None:
    write_imdf(tmp_path / "a.zip", [LAP, APART], PLACE, ORIGIN, NOON, POINTS)
    read = read_imdf(tmp_path / "a.zip")
    assert read == archive
    assert faults_of(read) == []
    names = zipfile.ZipFile(tmp_path / "a.zip").namelist()
    kinds = ("address", "venue", "building", "footprint", "level", "unit", "amenity")
    assert names == ["manifest.json", *(f"{kind}.geojson" for kind in kinds)]
    write_imdf(tmp_path / "b.zip", [LAP, APART], PLACE, ORIGIN, NOON, POINTS)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


def test_points_of_interest_are_amenities_of_the_nearest_walked_ground(
    archive: dict[str, Any],
) -> None:
    door, lift = archive["amenity"]["features"]
    told = [(each["properties"]["category"], each["properties"]["name"]) for each in (door, lift)]
    assert told == [("entry", {"en": "Tür"}), ("elevator", {"en": "Lift"})]
    units = {each["id"]: shape(each["geometry"]) for each in archive["unit"]["features"]}
    for each in (door, lift):
        away = {name: unit.distance(shape(each["geometry"])) for name, unit in units.items()}
        assert each["properties"]["unit_ids"] == [min(away, key=lambda name: away[name])]
    assert door["properties"]["unit_ids"] != lift["properties"]["unit_ids"]


def test_another_geometry_engine_agrees(archive: dict[str, Any]) -> None:
    shapes = {
        kind: [shape(each["geometry"]) for each in archive[kind]["features"]] for kind in POLYGONAL
    }
    units, (level,) = shapes["unit"], shapes["level"]
    assert len(units) == 2
    assert sorted(len(unit.interiors) for unit in units) == [0, 1]
    for kind, made in shapes.items():
        for each, geometry in zip(archive[kind]["features"], made, strict=True):
            assert geometry.is_valid
            assert geometry.exterior.is_ccw
            assert level.covers(geometry)
            shown = each["properties"].get("display_point")
            assert shown is None or geometry.contains(shape(shown))


def edit(kind: str, name: str, value: object) -> Callable[[dict[str, Any]], None]:
    def change(archive: dict[str, Any]) -> None:
        archive[kind]["features"][0]["properties"][name] = value

    return change


def drop(kind: str, name: str) -> Callable[[dict[str, Any]], None]:
    return lambda archive: archive[kind]["features"][0]["properties"].pop(name)


def with_unit(change: Callable[[dict[str, Any]], None]) -> Callable[[dict[str, Any]], None]:
    return lambda archive: change(archive["unit"]["features"][0])


def reverse(unit: dict[str, Any]) -> None:
    unit["geometry"]["coordinates"][0].reverse()


def shift(unit: dict[str, Any]) -> None:
    rings = unit["geometry"]["coordinates"]
    unit["geometry"]["coordinates"] = (np.array(rings[0]) + 0.01).tolist(), *rings[1:]
    unit["properties"]["display_point"] = None


def knot(unit: dict[str, Any]) -> None:
    ring = unit["geometry"]["coordinates"][0]
    ring[2], ring[3] = ring[3], ring[2]


BROKEN: dict[str, Callable[[dict[str, Any]], Any]] = {
    "version": lambda archive: archive["manifest"].update(version="2.0"),
    "language": lambda archive: archive["manifest"].update(language="English please"),
    "created": lambda archive: archive["manifest"].pop("created"),
    "level.geojson is missing": lambda archive: archive.pop("level"),
    "kiosk.geojson": lambda archive: archive.update(kiosk={}),
    "wanted one, got 2": lambda a: a["venue"]["features"].append(a["venue"]["features"][0]),
    "no UUID": with_unit(lambda unit: unit.update(id="unit-1")),
    "feature_type 'unit'": with_unit(lambda unit: unit.update(feature_type="room")),
    "geometry is not null": lambda a: a["address"]["features"][0].update(geometry={}),
    "wanted a Polygon": with_unit(lambda unit: unit.update(geometry=None)),
    "wrong way round": with_unit(reverse),
    "not closed": with_unit(lambda unit: unit["geometry"]["coordinates"][0].pop()),
    "crosses or touches itself": with_unit(knot),
    "beyond its level": with_unit(shift),
    "property short_name is missing": drop("level", "short_name"),
    "property name cannot be": edit("venue", "name", "Studio"),
    "property country": edit("address", "country", "Switzerland"),
    "property locality": edit("address", "locality", " "),
    "property ordinal": edit("level", "ordinal", True),
    "category 'shop'": edit("venue", "category", "shop"),
    "category 'corridor'": edit("unit", "category", "corridor"),
    "which is no level": edit("unit", "level_id", "11111111-1111-1111-1111-111111111111"),
    "which is no building": edit("footprint", "building_ids", ["1"]),
    "display point lies outside": edit(
        "venue", "display_point", {"type": "Point", "coordinates": [0, 0]}
    ),
    "category 'shelf'": edit("amenity", "category", "shelf"),
    "geometry is no Point": lambda a: a["amenity"]["features"][0].update(geometry=None),
    "which is no unit": edit("amenity", "unit_ids", ["11111111-1111-1111-1111-111111111111"]),
    "share an id": lambda a: a["unit"]["features"][1].update(id=a["unit"]["features"][0]["id"]),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_every_broken_rule_is_found(archive: dict[str, Any], fault: str) -> None:
    broken = copy.deepcopy(archive)
    BROKEN[fault](broken)
    assert any(fault in each for each in faults_of(broken)), faults_of(broken)


def test_ids_are_the_place_s_and_the_level_s() -> None:
    upstairs = imdf_archive([LAP], Venue(**{**vars(PLACE), "ordinal": 1}), ORIGIN, NOON)
    again = imdf_archive([LAP + 1], PLACE, ORIGIN, NOON)
    first = imdf_archive([LAP], PLACE, ORIGIN, NOON)

    def id_of(archive: Any, kind: str) -> str:
        return str(archive[kind]["features"][0]["id"])

    assert id_of(first, "unit") == id_of(again, "unit") != id_of(upstairs, "unit")
    assert id_of(first, "venue") == id_of(upstairs, "venue")


def test_a_place_is_read_and_nothing_is_guessed(tmp_path: Path) -> None:
    file = tmp_path / "place.toml"
    file.write_text(TOML, encoding="utf-8")
    assert read_place(file) == PLACE
    for line, what in (("country", "country is missing"), ("level", "level is missing")):
        kept = [each for each in TOML.splitlines() if not each.startswith(line)]
        file.write_text("\n".join(kept), encoding="utf-8")
        with pytest.raises(InputError, match=what):
            read_place(file)
    for more, what in (("storey = 1", "storey is unknown"), ("language = 4", "wanted a str")):
        file.write_text(TOML + more, encoding="utf-8")
        with pytest.raises(InputError, match=what):
            read_place(file)


def test_a_place_that_breaks_a_rule_writes_nothing(tmp_path: Path) -> None:
    wrong = Venue(**{**vars(PLACE), "category": "home"})
    with pytest.raises(InputError, match="category 'home' is none of airport"):
        write_imdf(tmp_path / "a.zip", [LAP], wrong, ORIGIN, NOON)
    assert list(tmp_path.iterdir()) == []


def test_a_ring_that_crosses_itself_is_seen() -> None:
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    assert not crosses_itself(square)
    assert crosses_itself(square[[0, 2, 1, 3]])
    assert crosses_itself(square[[0, 1, 0, 2]])
