"""Buildings on disk: what was written is read, and what is no building is refused."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from elfslam.base.building import Building, BuildingFloor, Passage
from elfslam.base.errors import InputError, StoreError
from elfslam.base.values import LevelPassage
from elfslam.data.building_files import (
    BUILDING,
    floor_folder,
    is_building,
    read_building,
    write_building,
)

STAIRS = Passage(LevelPassage.STAIRS, 0, 1, (3.25, -4.0), (5.0, -4.0), 21.5)
LIFT = Passage(LevelPassage.LIFT, -1, 1, (9.0, 0.5), (9.0, 0.5), 14.0)
MALL = Building(
    "Möbel", (BuildingFloor(-1, -4.5), BuildingFloor(0, 0.0), BuildingFloor(1, 5.0)), (STAIRS, LIFT)
)


def test_what_was_written_is_read(tmp_path: Path) -> None:
    assert not is_building(tmp_path)
    write_building(MALL, tmp_path)
    assert is_building(tmp_path)
    assert read_building(tmp_path) == MALL
    assert MALL.levels == (-1, 0, 1)
    named = json.loads((tmp_path / BUILDING).read_text())["floors"]
    assert [tmp_path / each["folder"] for each in named] == [
        floor_folder(tmp_path, level) for level in MALL.levels
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
    write_building(MALL, tmp_path)
    content = json.loads((tmp_path / BUILDING).read_text())
    (tmp_path / BUILDING).write_text(json.dumps({**content, **change}))
    with pytest.raises(StoreError, match=said) as refusal:
        read_building(tmp_path)
    assert "\n" not in str(refusal.value)


def test_a_folder_without_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="is no building"):
        read_building(tmp_path)


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
