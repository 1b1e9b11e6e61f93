"""Ways in a building on disk: places by name and by metres, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from elfslam.app.way import find_way
from elfslam.base.building import Building, BuildingFloor, Passage
from elfslam.base.errors import NoAnswerError, ParameterError
from elfslam.base.values import FloorMap, LevelPassage, PointKind, PointOfInterest
from elfslam.cli.app import run
from elfslam.data.building_files import floor_folder, write_building
from elfslam.data.map_files import MAP, write_map
from elfslam.data.named_places import write_points

STAIRS = Passage(LevelPassage.STAIRS, 0, 1, (10.0, 0.0), (10.0, 3.0), 15.0)


def corridor(y_m: float, count: int = 200) -> FloorMap:
    """Spots along 30 m of x."""
    xy_m = np.column_stack([np.linspace(0, 30, count), np.full(count, y_m)])
    walk, order = np.zeros(count, dtype=np.int64), np.arange(count)
    covariance = np.tile(np.eye(2) * 0.01, (count, 1, 1))
    return FloorMap(xy_m, np.zeros(count), walk, order, covariance, (), "digest", ("walk",))


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two corridors above each other, joined by stairs."""
    folder = tmp_path_factory.mktemp("ways") / "building"
    places = {
        0: [PointOfInterest("Entrance", PointKind.DOOR, 0.0, 0.0)],
        1: [PointOfInterest("Room 5", PointKind.ROOM, 29.0, 3.0)],
    }
    for level, points in places.items():
        floor = floor_folder(folder, level)
        floor.mkdir(parents=True)
        write_map(corridor(3.0 * level), floor / MAP)
        toilet = PointOfInterest("Toilet", PointKind.ROOM, 15.0, 3.0 * level)
        write_points([*points, toilet], floor)
    floors = (BuildingFloor(0, 0.0), BuildingFloor(1, 3.2))
    write_building(Building("Hall", floors, (STAIRS,)), folder)
    return folder


def test_a_way_leads_by_names_and_by_metres(building: Path) -> None:
    by_name = find_way(building, "entrance", "Room 5")
    assert by_name.length_m == pytest.approx(10 + 3 + 19, abs=0.5)
    by_metres = find_way(building, "0:0,0", "1:29,3.0")
    assert by_metres.length_m == by_name.length_m
    assert find_way(building, "0:Toilet", "1:Toilet").length_m == pytest.approx(13, abs=0.5)
    one = find_way(floor_folder(building, 1), "0,3", "Room 5")
    assert one.length_m == pytest.approx(29, abs=0.3)


@pytest.mark.parametrize(
    ("start", "refused"),
    [
        ("Entrence", "no place is called 'Entrence'; did you mean 'Entrance'?"),
        ("Toilet", "2 places are called 'Toilet', on levels 0, 1; say LEVEL:NAME"),
        ("3:1,1", "wanted a level of 0, 1"),
        ("1,1", "has no level, wanted LEVEL:X,Y"),
        ("0:1.2.3,1", "wanted LEVEL:X,Y in metres"),
        ("", "no place is called ''; name another, or say LEVEL:X,Y"),
    ],
)
def test_places_that_are_not_known_are_refused(building: Path, start: str, refused: str) -> None:
    with pytest.raises(ParameterError, match="way: ") as error:
        find_way(building, start, "Room 5")
    assert refused in str(error.value)


def test_who_avoids_steps_is_told_that_the_way_has_them(building: Path) -> None:
    with pytest.raises(NoAnswerError, match="the only way from level 0 to 1 has steps"):
        find_way(building, "Entrance", "Room 5", stairs=False)


def test_the_command_tells_length_turns_and_passages(
    building: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["way", str(building), "Entrance", "Room 5"]) == 0
    told = capsys.readouterr().out
    assert "32 m, about 39 s" in told
    assert run(["way", str(building), "Entrance", "Room 5", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["floor"], row["after"]) for row in rows] == [(0, "start"), (1, "stairs")]
    assert [row["m"] for row in rows] == pytest.approx([10, 19], abs=0.3)
    assert run(["way", str(building), "Entrance", "Room 5", "--without-stairs"]) == 1
