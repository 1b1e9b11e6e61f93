"""Ways in a building or a map on disk, between places as people tell them."""

import difflib
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from elfslam.base.arguments import checked
from elfslam.base.arrays import F64
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.building import Passage
from elfslam.base.errors import NoAnswerError, ParameterError
from elfslam.base.values import PointOfInterest
from elfslam.data.building_files import floor_folder, is_building, read_building
from elfslam.data.map_files import read_map
from elfslam.data.named_places import read_points
from elfslam.data.tables import number_or_nan
from elfslam.stages.ways import LevelPosition, Route, way, way_graph, without_steps

TOLD = re.compile(r"(?:(?P<level>[+-]?\d{1,3}):)?(?P<where>.*)", re.S)
METRES = re.compile(r"\s*([+-]?[\d.]+)\s*,\s*([+-]?[\d.]+)\s*")


@dataclass(frozen=True, eq=False)
class WayFloor:
    """What was walked on a floor (n, 2), and its named places."""

    walked_m: F64
    points: tuple[PointOfInterest, ...] = ()


@checked
def find_way(place: Path | str, start: str, goal: str, *, stairs: bool = True) -> Route:
    """The quickest way in a building, or in a map of one floor, whose level is 0.

    Places are a name, LEVEL:NAME or LEVEL:X,Y. Raises ParameterError, StoreError, NoAnswerError.
    """
    folder = Path(place)
    folders: dict[int, Path] = {0: folder}
    passages: tuple[Passage, ...] = ()
    if is_building(folder):
        building = read_building(folder)
        folders = {level: floor_folder(folder, level) for level in building.levels}
        passages = building.passages
    floors = {
        level: WayFloor(read_map(each).xy_m, read_points(each)) for level, each in folders.items()
    }
    ends = position_of(start, floors), position_of(goal, floors)
    return route_between(floors, passages, *ends, stairs=stairs)


def route_between(
    floors: Mapping[int, WayFloor],
    passages: Sequence[Passage],
    start: LevelPosition,
    goal: LevelPosition,
    *,
    stairs: bool,
) -> Route:
    """The quickest way, by lifts alone without `stairs`. Raises NoAnswerError where none leads."""
    walked_m = {level: floor.walked_m for level, floor in floors.items()}
    used = passages if stairs else without_steps(passages)
    found = way(way_graph(walked_m, used), start, goal)
    if found is not None:
        return found
    between = f"from level {start.level} to {goal.level}" if start.level != goal.level else "there"
    if not stairs and way(way_graph(walked_m, passages), start, goal) is not None:
        raise NoAnswerError(f"way: the only way {between} has steps; walk one by a lift and map it")
    raise NoAnswerError(f"way: nobody walked all the way {between}; walk it once and map that")


def position_of(
    text: str, floors: Mapping[int, WayFloor], here: int | None = None
) -> LevelPosition:
    """Where a place is that is told as a name, LEVEL:NAME or LEVEL:X,Y.

    `here` is the level of X,Y alone. Raises ParameterError.
    """
    told = TOLD.fullmatch(text.strip())
    assert told is not None
    level = None if told["level"] is None else int(told["level"])
    if level is not None and level not in floors:
        known = ", ".join(map(str, sorted(floors)))
        raise ParameterError(f"way: got {text!r:.90}, wanted a level of {known}; choose one")
    if metres := METRES.fullmatch(told["where"]):
        return LevelPosition(_level(text, level, here, floors), _xy_m(text, *metres.groups()))
    return _named(told["where"], floors if level is None else {level: floors[level]})


def _level(text: str, told: int | None, here: int | None, floors: Collection[int]) -> int:
    only = next(iter(floors)) if len(floors) == 1 else None
    level = next((each for each in (told, here, only) if each is not None), None)
    if level is None:
        raise ParameterError(f"way: {text!r:.90} has no level, wanted LEVEL:X,Y; say the floor")
    return level


def _xy_m(text: str, *cells: str) -> tuple[float, float]:
    x_m, y_m = map(number_or_nan, cells)
    # NaN fails the comparison.
    if not (abs(x_m) <= FARTHEST_M and abs(y_m) <= FARTHEST_M):
        raise ParameterError(
            f"way: got {text!r:.90}, wanted LEVEL:X,Y in metres, such as 1:3.5,-2; correct it"
        )
    return x_m, y_m


def _named(name: str, floors: Mapping[int, WayFloor]) -> LevelPosition:
    found = [
        LevelPosition(level, (each.x_m, each.y_m))
        for level, floor in floors.items()
        for each in floor.points
        if each.name.casefold() == name.strip().casefold()
    ]
    if len(found) == 1:
        return found[0]
    if found:
        levels = ", ".join(str(each.level) for each in found)
        raise ParameterError(
            f"way: {len(found)} places are called {name!r:.90}, on levels {levels}; "
            "say LEVEL:NAME or LEVEL:X,Y"
        )
    known = [each.name for floor in floors.values() for each in floor.points]
    near = difflib.get_close_matches(name, known, n=1)
    wanted = f"did you mean {near[0]!r}?" if near else "name another, or say LEVEL:X,Y"
    raise ParameterError(f"way: no place is called {name!r:.90}; {wanted}")
