"""A building on disk: `building.json`, and each floor as a map folder in `floors/<level>`."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from elfslam import __version__
from elfslam.base.building import Building, BuildingFloor, Passage
from elfslam.base.errors import InputError, StoreError
from elfslam.base.text_files import read_json
from elfslam.base.values import LevelPassage

BUILDING = "building.json"
FLOORS = "floors"
FORMAT_VERSION = 1


def is_building(path: Path) -> bool:
    """Whether a folder holds a building."""
    return (path / BUILDING).is_file()


def floor_folder(building: Path, level: int) -> Path:
    """The map folder of a floor in that of a building."""
    return building / FLOORS / str(level)


def write_building(building: Building, folder: Path) -> None:
    """building.json, into a folder that is there."""
    content = {
        "format_version": FORMAT_VERSION,
        "name": building.name,
        "floors": [
            {"level": each.level, "height_m": each.height_m, "folder": f"{FLOORS}/{each.level}"}
            for each in building.floors
        ],
        "passages": [passage_facts(each) for each in building.passages],
        "software": f"elfslam {__version__}",
    }
    text = json.dumps(content, indent=2, ensure_ascii=False)
    (folder / BUILDING).write_text(text + "\n", encoding="utf-8")


def read_building(folder: Path) -> Building:
    """The building in a folder, its floors not read. Raises StoreError."""
    file = folder / BUILDING
    try:
        content = read_json(file)
        if not isinstance(content, dict) or content.get("format_version") != FORMAT_VERSION:
            raise InputError(f"wanted an object of format_version {FORMAT_VERSION}")
        floors = tuple(
            BuildingFloor(_whole(each["level"]), float(each["height_m"]))
            for each in content["floors"]
        )
        passages = tuple(map(passage_of, content["passages"]))
        return Building(str(content["name"]), floors, passages)
    except (InputError, KeyError, TypeError, ValueError, AttributeError) as cause:
        raise StoreError(f"{file}: is no building ({cause!s:.120}); map it again") from cause


def passage_facts(passage: Passage) -> dict[str, object]:
    """A passage as building.json has it."""
    return {
        "kind": passage.kind,
        "from_level": passage.from_level,
        "to_level": passage.to_level,
        "from_xy_m": [round(metres, 3) for metres in passage.from_xy_m],
        "to_xy_m": [round(metres, 3) for metres in passage.to_xy_m],
        "duration_s": round(passage.duration_s, 1),
    }


def passage_of(facts: Mapping[str, Any]) -> Passage:
    """A passage of building.json. Raises KeyError, TypeError, ValueError."""
    (from_x_m, from_y_m), (to_x_m, to_y_m) = facts["from_xy_m"], facts["to_xy_m"]
    return Passage(
        LevelPassage(facts["kind"]),
        _whole(facts["from_level"]),
        _whole(facts["to_level"]),
        (float(from_x_m), float(from_y_m)),
        (float(to_x_m), float(to_y_m)),
        float(facts["duration_s"]),
    )


def _whole(number: object) -> int:
    if not isinstance(number, int) or isinstance(number, bool):
        raise ValueError(f"level is {number!r:.30}, wanted a whole number")
    return number
