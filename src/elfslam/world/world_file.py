"""Worlds as TOML files: a room, a route in it, and everything else that belongs to a place."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from importlib import resources
from pathlib import Path
from types import MappingProxyType

import numpy as np

from elfslam.base.arrays import F64, Value, array
from elfslam.base.errors import InputError
from elfslam.base.text_files import MOST_TOML_BYTES, read_text
from elfslam.world.doors import HingedDoor, room_to_walk_in
from elfslam.world.magnetic import Magnetism, PowerLine
from elfslam.world.room import HALF_WIDTH_M, Room, fault_of_route, standing_room
from elfslam.world.room_file import ROOM_KEYS, read_doors, read_room, read_states
from elfslam.world.sensors import Surroundings, read_surroundings
from elfslam.world.toml_tables import (
    Table,
    check_keys,
    number,
    points,
    read_table,
    rows,
    table,
    tables,
    text,
    vector,
)
from elfslam.world.wifi import AccessPoint

SPOTS_AT_ONCE = 1000
"""As many take the time of one leg."""
MOST_SPOTS = 100_000
MOST_MEETINGS = 1_000_000
"""Of a leg of some route with a piece of furniture in some state of it; each is looked at."""


@dataclass(frozen=True)
class Climate:
    """The air of a place; where no temperature is told, people who live there have their own."""

    temperature_c: float | None = None
    humidity_percent: float = 50.0


@dataclass(frozen=True, eq=False)
class People(Value):
    """Where others walk: open routes, each (n, 2), at one speed."""

    routes_m: tuple[F64, ...] = ()
    speed_mps: float = 1.1


def _no_spots() -> F64:
    return np.zeros((0, 2))


@dataclass(frozen=True, eq=False)
class World(Value):
    """A furnished room, the closed route that is walked in it, and what else a phone finds there.

    `states` are the same room with furniture moved, by name; `spots_m` are marked places.
    """

    name: str
    room: Room
    route_m: F64 = array("k", 2)
    surroundings: Surroundings | None = None
    states: Mapping[str, Room] = field(default_factory=lambda: MappingProxyType({}))
    spots_m: F64 = field(default_factory=_no_spots, metadata=array("s", 2).metadata)
    people: People = People()
    climate: Climate = Climate()
    doors: tuple[HingedDoor, ...] = ()

    @property
    def ways_m(self) -> tuple[F64, ...]:
        """The route with its way home, and the routes of people, each (n, 2)."""
        return np.vstack([self.route_m, self.route_m[:1]]), *self.people.routes_m


def walked_room(world: World, room: Room | None = None) -> Room:
    """A room of the world, by default the usual one, as walkers find it whatever the day."""
    return room_to_walk_in(room or world.room, world.doors, world.ways_m)


def in_state(world: World, state: str) -> World:
    """The world with its furniture in this state. Raises InputError for one that it has not."""
    if state not in world.states:
        known = ", ".join(world.states) or "none"
        raise InputError(f"state {state!r}: world {world.name!r} has {known}; choose one of them")
    return replace(world, room=world.states[state])


def world_names() -> list[str]:
    """Names of the built-in worlds."""
    folder = resources.files("elfslam.world").joinpath("worlds")
    return sorted(
        item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml")
    )


def load_world(name: Path | str) -> World:
    """A built-in world by name, or one described in a TOML file.

    Raises InputError of one line that names the file, the line in it and the element.
    """
    built_in = resources.files("elfslam.world").joinpath("worlds", f"{name}.toml")
    path = Path(name)
    if not built_in.is_file() and not path.is_file():
        raise InputError(
            f"world {name!r}: wanted {', '.join(world_names())} or a TOML file; no such world"
        )
    if built_in.is_file():
        return parse_world(built_in.read_text(encoding="utf-8"), f"worlds/{name}.toml")
    return parse_world(read_text(path, MOST_TOML_BYTES), str(path))


def parse_world(content: str, file: str) -> World:
    """The world that a TOML text describes; `file` is what errors call it."""
    top = read_table(content, file)
    own = ("name", "route_m", "spots", "people", "climate", "access_point", "magnetic", "door")
    check_keys(top, (*own, "power_line", *ROOM_KEYS))
    room = read_room(top)
    world = World(
        text(top, "name"),
        room,
        points(top, "route_m", top.values.get("route_m")),
        _surroundings(top, room),
        read_states(top, room),
        _spots(top),
        _people(top),
        _climate(top),
        read_doors(top, room),
    )
    _check_walks(top, world)
    return world


def _surroundings(top: Table, room: Room) -> Surroundings:
    """What sensors other than the microphone find; their own refusals get a line."""
    kinds = {"access_point": ("bssid", AccessPoint), "power_line": ("name", PowerLine)}
    labelled: list[tuple[str, Table]] = []
    for kind, (name, made) in kinds.items():
        for k, given in enumerate(tables(top, kind, name), 1):
            row = replace(given, label=f"{kind} {given.values.get(name, k)!r}")
            check_keys(row, [item.name for item in fields(made)])
            labelled.insert(0, (f"{row.label}: ", row))
    magnetic = table(top, "magnetic")
    check_keys(magnetic, [item.name for item in fields(Magnetism)])
    try:
        return read_surroundings(top.values, room, room.seed)
    except InputError as cause:
        complaint = str(cause)
        for label, row in [*labelled, ("magnetic: ", magnetic)]:
            if complaint.startswith(label):
                raise row.refusal(complaint.removeprefix(label)) from cause
        raise top.refusal(complaint) from cause


def _spots(top: Table) -> F64:
    """Marked places (s, 2): listed one by one, or one or more grids of them."""
    given = top.values.get("spots", [])
    grids = [given] if isinstance(given, dict) else rows(top, "spots", MOST_SPOTS)
    if grids and isinstance(grids[0], list):
        return points(top, "spots", grids, MOST_SPOTS)
    labels = tables(top, "spots") if isinstance(given, list) else [table(top, "spots")]
    spots_m = np.vstack([_no_spots(), *[_grid(grid) for grid in labels]])
    if len(spots_m) > MOST_SPOTS:
        raise top.refusal(f"{len(spots_m)} spots, wanted {MOST_SPOTS} at most", "spots")
    return spots_m


def _grid(grid: Table) -> F64:
    check_keys(grid, ("from_m", "to_m", "spacing_m"))
    spacing_m = number(grid, "spacing_m", low=0.01)
    start, end = vector(grid, "from_m", 2), vector(grid, "to_m", 2)
    if (end < start).any():
        raise grid.refusal("ends before it begins; swap from_m and to_m", "to_m")
    counts = np.floor((end - start) / spacing_m + 1e-6).astype(int) + 1
    if counts.prod() > MOST_SPOTS:
        raise grid.refusal(f"{counts.prod()} spots, wanted {MOST_SPOTS} at most", "spacing_m")
    y, x = np.meshgrid(np.arange(counts[1]), np.arange(counts[0]), indexing="ij")
    return start + spacing_m * np.column_stack([x.ravel(), y.ravel()])


def _people(top: Table) -> People:
    people = table(top, "people")
    check_keys(people, ("routes_m", "speed_mps"))
    routes = [points(people, "routes_m", route) for route in rows(people, "routes_m")]
    return People(tuple(routes), number(people, "speed_mps", 1.1, low=0.1, high=3.0))


def _climate(top: Table) -> Climate:
    climate = table(top, "climate")
    check_keys(climate, ("temperature_c", "humidity_percent"))
    told = "temperature_c" in climate.values
    return Climate(
        number(climate, "temperature_c", low=-20.0, high=50.0) if told else None,
        number(climate, "humidity_percent", 50.0, low=1.0, high=100.0),
    )


def _check_walks(top: Table, world: World) -> None:
    """Refuse routes and spots where nobody can go, in every state of the furniture."""
    legs = sum(map(len, (world.route_m, *world.people.routes_m)))
    pieces = len(world.room.blocks) + 4 * len(world.doors)
    meetings = legs * (1 + len(world.states)) * (1 + pieces)
    if meetings + len(world.spots_m) * len(world.room.blocks) / SPOTS_AT_ONCE > MOST_MEETINGS:
        raise top.refusal(
            f"{legs} legs of routes, {len(world.room.blocks)} pieces of furniture and "
            f"{len(world.states)} states are too many together; take some out"
        )
    usual = walked_room(world)
    if fault := fault_of_route(usual, world.route_m, closed=True):
        raise top.refusal(f"route_m: {fault}", "route_m")
    for k, route_m in enumerate(world.people.routes_m, 1):
        if fault := fault_of_route(usual, route_m, closed=False):
            raise table(top, "people").refusal(f"route {k}: {fault}", "routes_m")
    for state, changed in zip(tables(top, "state"), world.states.values(), strict=True):
        room = walked_room(world, changed)
        if fault := fault_of_route(room, world.route_m, closed=True):
            raise state.refusal(f"route_m: {fault}")
        for k, route_m in enumerate(world.people.routes_m, 1):
            if fault := fault_of_route(room, route_m, closed=False):
                raise state.refusal(f"people, route {k}: {fault}")
    taken = np.flatnonzero(~standing_room(usual, world.spots_m))
    if len(taken):
        spot = world.spots_m[taken[0]].round(3).tolist()
        raise top.refusal(
            f"spots: spot {taken[0] + 1} at {spot} is in a wall or furniture, or within "
            f"{HALF_WIDTH_M} m of it; move it (so are {len(taken) - 1} more)", "spots",
        )  # fmt: skip
