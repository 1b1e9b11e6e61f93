"""Buildings and levels on disk: what was written is read, and what is none is refused."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.base.building import Building, BuildingFloor, Passage
from elfslam.base.errors import InputError, StoreError
from elfslam.base.values import LevelPassage, Levels
from elfslam.data import building_files
from elfslam.data.level_files import read_levels, write_levels

STAIRS = Passage(LevelPassage.STAIRS, 0, 1, (3.25, -4.0), (5.0, -4.0), 21.5)
LIFT = Passage(LevelPassage.LIFT, -1, 1, (9.0, 0.5), (9.0, 0.5), 14.0)
MALL = Building(
    "Möbel", (BuildingFloor(-1, -4.5), BuildingFloor(0, 0.0), BuildingFloor(1, 5.0)), (STAIRS, LIFT)
)


def test_what_was_written_is_read(tmp_path: Path) -> None:
    assert not building_files.is_building(tmp_path)
    building_files.write_building(MALL, tmp_path)
    assert building_files.is_building(tmp_path)
    assert building_files.read_building(tmp_path) == MALL
    assert MALL.levels == (-1, 0, 1)
    named = json.loads((tmp_path / building_files.BUILDING).read_text())["floors"]
    assert [tmp_path / each["folder"] for each in named] == [
        building_files.floor_folder(tmp_path, level) for level in MALL.levels
    ]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format_version": 2}, "format_version 1"),
        ({"floors": []}, "one or more, in rising order"),
        ({"floors": [{"level": 0.5, "height_m": 2}]}, "wanted a whole number"),
        ({"floors": [{"level": 0}]}, "height_m"),
        ({"floors": 3}, "not iterable"),
        ({"passages": [{"kind": "ladder", "from_xy_m": [0, 0], "to_xy_m": [0, 0]}]}, "ladder"),
        ({"passages": [{"kind": "lift", "from_xy_m": [0], "to_xy_m": [0, 0]}]}, "unpack"),
    ],
)
def test_what_is_no_building_is_refused(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    building_files.write_building(MALL, tmp_path)
    content = json.loads((tmp_path / building_files.BUILDING).read_text())
    (tmp_path / building_files.BUILDING).write_text(json.dumps({**content, **change}))
    with pytest.raises(StoreError, match=said) as refusal:
        building_files.read_building(tmp_path)
    assert "\n" not in str(refusal.value)


def test_a_folder_without_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="is no building"):
        building_files.read_building(tmp_path)


@pytest.mark.parametrize(
    ("floors", "passages", "said"),
    [
        (MALL.floors[::-1], (), "in rising order"),
        ((BuildingFloor(0, 3.0), BuildingFloor(1, 3.0)), (), "wanted them rising"),
        ((BuildingFloor(0, float("nan")),), (), "wanted at most 200 from 0"),
        ((BuildingFloor(201, 0.0),), (), "wanted at most 200 from 0"),
        (MALL.floors[:2], (STAIRS,), "from level 0 to 1, wanted two of -1, 0"),
        (MALL.floors, (replace(STAIRS, to_level=0),), "from level 0 to 0"),
        (MALL.floors, (replace(STAIRS, duration_s=-1.0),), "for -1 s"),
        (MALL.floors, (replace(STAIRS, to_xy_m=(float("inf"), 0.0)),), "wanted finite metres"),
        (MALL.floors, (STAIRS,) * 1001, "at most 1000 passages"),
    ],
)
def test_a_building_that_cannot_be_is_refused(
    floors: tuple[BuildingFloor, ...], passages: tuple[Passage, ...], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        Building("tower", floors, passages)


BY_STAIRS = Levels(
    np.array([0.0, 30.5, 41.0]), np.array([0.0, np.nan, 1.0]), (None, LevelPassage.STAIRS, None)
)


def test_levels_written_are_read(tmp_path: Path) -> None:
    write_levels(BY_STAIRS, tmp_path / "levels.csv")
    read = read_levels(tmp_path / "levels.csv")
    assert np.array_equal(read.t_s, BY_STAIRS.t_s)
    assert np.array_equal(read.level, BY_STAIRS.level, equal_nan=True)
    assert read.passages == BY_STAIRS.passages


def test_a_level_holds_until_the_next() -> None:
    at = BY_STAIRS.at(np.array([-1.0, 30.0, 31.0, 41.0, 99.0]))
    assert np.array_equal(at, [0, 0, np.nan, 1, 1], equal_nan=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t_s,level\n0,0\n", "wanted the columns"),
        ("t_s,level,passage\n", "and a row"),
        ("", "wanted the columns"),
        ("t_s,level,passage\n0,ground,\n", "row 2 is '0,ground,"),
        ("t_s,level,passage\n0,0,\n1,,ladder\n", "row 3 is '1,,ladder"),
        ("t_s,level,passage\n0,0\n", "row 2 is '0,0"),
        ("t_s,level,passage\n1,0,\n0,1,\n", "time runs backward"),
    ],
)
def test_what_is_no_level_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "levels.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        read_levels(tmp_path / "levels.csv")
