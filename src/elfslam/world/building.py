"""Buildings as TOML files: a world on each floor, and the stairs, lifts and escalators between.

All floors share one plan. A stairwell or a lift has a door on each floor, at the same place, from
which it reaches into the building by its heading; an escalator has a foot and a head.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources
from itertools import pairwise
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64, Value, array
from elfslam.base.errors import InputError
from elfslam.base.text_files import MOST_TOML_BYTES, read_text
from elfslam.base.values import LevelPassage
from elfslam.world.room import in_the_way, standing_room
from elfslam.world.toml_tables import (
    Table,
    check_keys,
    number,
    points,
    read_table,
    rows,
    tables,
    text,
    vector,
    whole,
)
from elfslam.world.world_file import (
    World,
    in_state,
    load_world,
    parse_world,
    walked_room,
    world_names,
)

APPROACH_M = 0.6
"""Before a door or a foot: so far off people go straight to it."""
INCLINE_RAD = np.deg2rad(30.0)
"""Of escalators (EN 115-1, which allows 35 degrees for low ones)."""
TALLEST_M = 300.0
LEVELS = (-20, 100)
PROBE_M = 0.25


@dataclass(frozen=True, eq=False)
class Storey(Value):
    """A floor of a building: its ordinal, how high it lies, and what is on it."""

    level: int
    height_m: float
    world: World


@dataclass(frozen=True, eq=False)
class FloorLink(Value):
    """What joins floors: a door at `at_m` and the heading into it, or a foot and a head `to_m`.

    `levels` are sorted; `speed_mps` is that of a lift.
    """

    name: str
    kind: LevelPassage
    levels: tuple[int, ...]
    at_m: F64 = array(2)
    to_m: F64 = array(2)
    speed_mps: float = 1.0

    @property
    def heading_rad(self) -> float:
        """From the door or the foot inward."""
        return float(np.arctan2(*(self.to_m - self.at_m)[::-1]))

    def place(self, local_m: F64) -> F64:
        """Points (n, 2), so far inward and to the left of the door, in plan."""
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        return np.asarray(local_m @ np.array([[cos, sin], [-sin, cos]]) + self.at_m)

    def approach_m(self, level: int) -> F64:
        """Where people on this floor head for (2)."""
        is_head = self.kind is LevelPassage.ESCALATOR and level == self.levels[1]
        length_m = float(np.linalg.norm(self.to_m - self.at_m))
        inward_m = length_m + APPROACH_M if is_head else -APPROACH_M
        return self.place(np.array([inward_m, 0.0]))


@dataclass(frozen=True, eq=False)
class MultiFloorWorld(Value):
    """Floors, what joins them, and the order in which they are walked.

    `entrances_m` (n, 2) are doors to the open on the floor of level 0, where wind blows in.
    """

    name: str
    storeys: tuple[Storey, ...]
    links: tuple[FloorLink, ...]
    plan: tuple[int, ...]
    entrances_m: F64 = array("n", 2)

    def storey(self, level: int) -> Storey:
        """The floor of this level. Raises InputError for one that is not there."""
        for storey in self.storeys:
            if storey.level == level:
                return storey
        known = ", ".join(str(storey.level) for storey in self.storeys)
        raise InputError(f"level {level}: building {self.name!r} has {known}; choose among them")

    def between(self, level: int, other: int) -> list[FloorLink]:
        """What joins two floors. Raises InputError where nothing does."""
        both = {level, other}
        if joining := [each for each in self.links if both <= set(each.levels)]:
            return joining
        raise InputError(
            f"plan: nothing in building {self.name!r} leads from level {level} to {other}; "
            "pass by a level between them"
        )


def building_names() -> list[str]:
    """Names of the built-in buildings."""
    return ["mall_floors", "tower"]


def load_place(name: Path | str) -> World | MultiFloorWorld:
    """A world or a building, by its built-in name or of a TOML file. Raises InputError."""
    if str(name) in building_names():
        folder = Path(str(resources.files("elfslam.world").joinpath("buildings")))
        return parse_building(read_text(folder / f"{name}.toml"), f"buildings/{name}.toml", folder)
    path = Path(name)
    if path.is_file() and str(name) not in world_names():
        content = read_text(path, MOST_TOML_BYTES)
        if "floor" in read_table(content, str(path)).values:
            return parse_building(content, str(path), path.parent)
    elif str(name) not in world_names():
        known = ", ".join(world_names() + building_names())
        raise InputError(f"world {str(name)!r}: wanted {known} or a TOML file; no such world")
    return load_world(name)


def parse_building(content: str, file: str, folder: Path) -> MultiFloorWorld:
    """The building that a TOML text describes; files that it names lie in the folder."""
    top = read_table(content, file)
    check_keys(top, ("name", "plan", "entrances_m", "floor", "passage"))
    storeys = tuple(_storey(given, folder) for given in tables(top, "floor", "world"))
    levels = [storey.level for storey in storeys]
    if len(storeys) < 2 or (np.diff(levels) != 1).any():
        raise top.refusal(
            f"floors have levels {levels}, wanted two or more, one above the other; correct them"
        )
    heights_m = np.array([storey.height_m for storey in storeys])
    if (np.diff(heights_m) < 2.0).any():
        raise top.refusal(
            f"floors lie {heights_m.tolist()} m high, wanted each 2 m above the last; raise them"
        )
    by_level = {storey.level: storey for storey in storeys}
    entrances = rows(top, "entrances_m")
    building = MultiFloorWorld(
        text(top, "name"),
        storeys,
        tuple(_link(given, by_level) for given in tables(top, "passage")),
        parse_plan(rows(top, "plan") or levels),
        points(top, "entrances_m", entrances) if entrances else np.zeros((0, 2)),
    )
    try:
        check_plan(building, building.plan)
    except InputError as cause:
        raise top.refusal(str(cause), "plan") from cause
    return building


def parse_plan(given: Sequence[object] | str) -> tuple[int, ...]:
    """Levels in the order of a walk, such as "0,1,0"; none in an empty one. Raises InputError."""
    parts = [part for part in given.split(",") if part.strip()] if isinstance(given, str) else given
    try:
        return tuple(int(str(part)) for part in parts)
    except ValueError as cause:
        raise InputError(f"plan {given!r:.60}: wanted levels such as 0,1,0; correct it") from cause


def check_plan(building: MultiFloorWorld, plan: Sequence[int]) -> None:
    """Raises InputError for floors and ways that are not there."""
    for level in plan:
        building.storey(level)
    for here, there in pairwise(plan):
        if here == there:
            raise InputError(f"plan: level {here} follows itself; name it once and add rounds")
        building.between(here, there)


def _storey(given: Table, folder: Path) -> Storey:
    check_keys(given, ("level", "height_m", "world", "state", "seed"))
    world = _world_of(text(given, "world"), folder)
    if "state" in given.values:
        world = in_state(world, text(given, "state"))
    if "seed" in given.values:
        seed = whole(given, "seed", low=0, high=2**32 - 1)
        world = replace(world, room=replace(world.room, seed=seed))
    level = whole(given, "level", low=LEVELS[0], high=LEVELS[1])
    return Storey(level, number(given, "height_m", low=-TALLEST_M, high=TALLEST_M), world)


def _world_of(name: str, folder: Path) -> World:
    if not name.endswith(".toml"):
        return load_world(name)
    if not (folder / name).is_file():
        raise InputError(f"world {name!r}: no such file beside the building; correct its name")
    return parse_world(read_text(folder / name, MOST_TOML_BYTES), name)


def _link(given: Table, storeys: dict[int, Storey]) -> FloorLink:
    check_keys(given, ("name", "kind", "levels", "at_m", "to_m", "heading_deg", "speed_mps"))
    kind = text(given, "kind")
    if kind not in list(LevelPassage):
        raise given.refusal(f"kind is {kind!r:.40}, wanted {', '.join(LevelPassage)}", "kind")
    levels = tuple(sorted(parse_plan(rows(given, "levels"))))
    if len(set(levels)) < 2 or not set(levels) <= set(storeys):
        raise given.refusal(f"levels are {levels}, wanted two or more of {list(storeys)}", "levels")
    at_m = vector(given, "at_m", 2)
    if kind == LevelPassage.ESCALATOR:
        to_m = vector(given, "to_m", 2)
    else:
        angle = np.deg2rad(number(given, "heading_deg", low=-360.0, high=360.0))
        to_m = at_m + np.array([np.cos(angle), np.sin(angle)])
    speed_mps = number(given, "speed_mps", 1.0, low=0.2, high=10.0)
    made = FloorLink(text(given, "name"), LevelPassage(kind), levels, at_m, to_m, speed_mps)
    _check_link(given, made, storeys)
    return made


def _check_link(given: Table, made: FloorLink, storeys: dict[int, Storey]) -> None:
    """Refuse escalators that are too steep, and ways to doors that nobody can go."""
    if made.kind is LevelPassage.ESCALATOR:
        climb_m = storeys[made.levels[-1]].height_m - storeys[made.levels[0]].height_m
        needed_m = climb_m / np.tan(INCLINE_RAD)
        if len(made.levels) > 2 or np.linalg.norm(made.to_m - made.at_m) < needed_m:
            raise given.refusal(
                f"an escalator joins two levels and is {needed_m:.1f} m long or more; move to_m",
                "to_m",
            )
    for level in made.levels:
        try:
            nearest_on_route(storeys[level], made, storeys[level].world.route_m)
        except InputError as cause:
            raise given.refusal(str(cause), "at_m") from cause


def nearest_on_route(storey: Storey, link: FloorLink, route_m: F64) -> int:
    """From which point of the closed route (k, 2), finely sampled, one goes to a door.

    Raises InputError where none of them sees it.
    """
    door_m, room = link.approach_m(storey.level), walked_room(storey.world)
    lap = sampled(np.vstack([route_m, route_m[:1]]))
    order = np.argsort(np.linalg.norm(lap - door_m, axis=1))[:: round(PROBE_M / 0.01)]
    if standing_room(room, door_m[None])[0]:
        for k in order[:200]:
            if in_the_way(room, lap[k], door_m) is None:
                return int(k)
    raise InputError(
        f"{link.name!r}: from the route of level {storey.level} nobody gets straight to "
        f"{door_m.round(2).tolist()}, before its door; move it or what stands there"
    )


def sampled(line_m: F64) -> F64:
    """Points (k, 2) about a centimetre apart on an open line (n, 2), both ends included."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line_m, axis=0), axis=1)))
    at = np.linspace(0.0, along[-1], max(round(along[-1] / 0.01), 1) + 1)
    return np.column_stack([np.interp(at, along, line_m[:, k]) for k in range(2)])
