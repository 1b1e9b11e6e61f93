"""IMDF archives: ours pass the rules of the standard; places that break them are told."""

import copy
import re
import zipfile
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapely.geometry import shape

from elfslam.base.errors import InputError
from elfslam.base.values import PointKind, PointOfInterest
from elfslam.data.geographic import Origin
from elfslam.data.imdf import Venue, WalkedLevel, imdf_archive, read_place, write_imdf
from tests.data.imdf_rules import faults_of, read_imdf

ORIGIN = Origin(47.3769, 8.5417, 20.0)
PLACE = Venue("Studio", "businesscampus", "Hauptstrasse 1", "Zürich", "CH", "Ground floor", 0)
NOON = datetime(2026, 1, 2, 12, tzinfo=UTC)
LAP = np.array([[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]], dtype=float)
APART = np.array([[8.0, 0.0], [9.0, 2.0]])
DOOR = PointOfInterest("Tür", PointKind.DOOR, 0.1, 1.0)
POINTS = (DOOR, PointOfInterest("Lift", PointKind.LIFT, 9.5, 2.5))
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
    return dict(imdf_archive([WalkedLevel(PLACE, [LAP, APART], POINTS)], ORIGIN, NOON))


def test_the_archive_is_read_as_it_was_made(tmp_path: Path, archive: dict[str, Any]) -> None:
    write_imdf(tmp_path / "a.zip", [WalkedLevel(PLACE, [LAP, APART], POINTS)], ORIGIN, NOON)
    read = read_imdf(tmp_path / "a.zip")
    assert read == archive
    assert faults_of(read) == []
    names = zipfile.ZipFile(tmp_path / "a.zip").namelist()
    kinds = ("address", "venue", "building", "footprint", "level", "unit", "amenity")
    assert names == ["manifest.json", *(f"{kind}.geojson" for kind in kinds)]
    write_imdf(tmp_path / "b.zip", [WalkedLevel(PLACE, [LAP, APART], POINTS)], ORIGIN, NOON)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


def test_points_of_interest_are_amenities_of_the_nearest_ground(archive: dict[str, Any]) -> None:
    door, lift = archive["amenity"]["features"]
    told = [(each["properties"]["category"], each["properties"]["name"]) for each in (door, lift)]
    assert told == [("entry", {"en": "Tür"}), ("elevator", {"en": "Lift"})]
    units = {each["id"]: shape(each["geometry"]) for each in archive["unit"]["features"]}
    for each in (door, lift):
        away = {name: unit.distance(shape(each["geometry"])) for name, unit in units.items()}
        assert each["properties"]["unit_ids"] == [min(away, key=lambda name: away[name])]
    assert door["properties"]["unit_ids"] != lift["properties"]["unit_ids"]


def test_walked_ground_has_the_hole_that_was_walked_around(archive: dict[str, Any]) -> None:
    units = [shape(each["geometry"]) for each in archive["unit"]["features"]]
    assert sorted(len(unit.interiors) for unit in units) == [0, 1]


Change = Callable[[dict[str, Any]], Any]
BROKEN: dict[str, tuple[str, Change]] = {
    "no UUID": ("unit", lambda unit: unit.update(id=unit["id"].upper())),
    "wrong way round": ("unit", lambda unit: unit["geometry"]["coordinates"][0].reverse()),
    "states": ("level", lambda level: level["properties"].pop("short_name")),
    "property country": ("address", lambda each: each["properties"].update(country="Swiss")),
    "category 'corridor'": ("unit", lambda unit: unit["properties"].update(category="corridor")),
    "which is no level": ("unit", lambda unit: unit["properties"].update(level_id="1")),
}


def test_the_rules_see_what_is_broken(archive: dict[str, Any]) -> None:
    for fault, (kind, change) in BROKEN.items():
        broken = copy.deepcopy(archive)
        change(broken[kind]["features"][0])
        assert any(fault in each for each in faults_of(broken)), fault


def test_ids_are_the_place_s_and_the_level_s() -> None:
    upstairs = imdf_archive([WalkedLevel(replace(PLACE, ordinal=1), [LAP])], ORIGIN, NOON)
    again = imdf_archive([WalkedLevel(PLACE, [LAP + 1])], ORIGIN, NOON)
    first = imdf_archive([WalkedLevel(PLACE, [LAP])], ORIGIN, NOON)

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


@pytest.mark.parametrize(
    ("name", "value", "fault"),
    [
        ("category", "home", "category 'home' is none of airport"),
        ("country", "Switzerland", "address: property country cannot be 'Switzerland'"),
        ("province", "Zurich", "property province"),
        ("locality", " ", "property locality cannot be ' '"),
        ("postal_code", "", "property postal_code"),
        ("language", "English please", "language is 'English please', wanted a tag"),
        ("name", " ", "venue: property name cannot be {'en': ' '}"),
        ("level", "", "level: property name"),
    ],
)
def test_a_place_that_breaks_a_rule_writes_nothing(
    tmp_path: Path, name: str, value: str, fault: str
) -> None:
    wrong = Venue(**{**vars(PLACE), name: value})
    with pytest.raises(InputError, match=re.escape(fault)):
        write_imdf(tmp_path / "a.zip", [WalkedLevel(wrong, [LAP])], ORIGIN, NOON)
    assert list(tmp_path.iterdir()) == []


def test_a_map_across_the_date_line_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="lies across longitude 180"):
        write_imdf(tmp_path / "a.zip", [WalkedLevel(PLACE, [LAP])], Origin(0.0, 180.0), NOON)


def test_several_levels_are_one_archive(tmp_path: Path, archive: dict[str, Any]) -> None:
    upper = replace(PLACE, ordinal=1, level="Level 1", level_short_name="1")
    floors = [WalkedLevel(PLACE, [LAP, APART], POINTS), WalkedLevel(upper, [LAP + 2], POINTS[:1])]
    write_imdf(tmp_path / "a.zip", floors, ORIGIN, NOON)
    read = read_imdf(tmp_path / "a.zip")
    assert faults_of(read) == []
    levels = {each["id"]: each["properties"] for each in read["level"]["features"]}
    assert [told["ordinal"] for told in levels.values()] == [0, 1]
    units = read["unit"]["features"]
    assert [levels[unit["properties"]["level_id"]]["ordinal"] for unit in units] == [0, 0, 1]
    assert units[:2] == archive["unit"]["features"]
    assert len(read["amenity"]["features"]) == 3
