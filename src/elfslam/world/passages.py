"""The ways between floors: flights of stairs, a lift's cabin, an escalator, and how they are taken.

Every stretch of a walk is gone in one manner, on ground whose height is given along it. Sound is
that of a small room for stairs and lifts, whose floor goes with the feet: flights above and below
are left out. On an escalator it is that of the lower floor, then that of the upper.
"""

from dataclasses import replace
from enum import StrEnum
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import LevelPassage
from elfslam.world.building import APPROACH_M, INCLINE_RAD, FloorLink, MultiFloorWorld, Storey
from elfslam.world.materials import Material, material
from elfslam.world.room import Block, Room, meets_block
from elfslam.world.world_file import World

RISE_M, TREAD_M = 0.17, 0.29
"""Of a step of stairs (DIN 18065: twice the rise and the tread are 0.59 to 0.65 m)."""
LANDING_M, LANE_M = 1.3, 0.65
"""How deep landings are, and how far from the middle of the stairwell flights run."""
SILL_M = 0.3
"""Before a door people are still on the floor, up to there."""
ESCALATOR_MPS = 0.5
"""Along the incline (EN 115-1)."""
WALKS_ON_ESCALATOR = 0.3
"""Share of rides on which people walk; an estimate."""
CABIN_M = (1.6, 1.8, 2.3)
"""Depth, width and height of a lift for ten persons or so."""
STOREY_M = 2.8
WAIT_S, DOORS_S = (3.0, 15.0), 2.5
"""For a lift, and for its doors to open or to close."""


class Gait(StrEnum):
    """How a stretch is gone."""

    WALK = "walk"
    AMBLE = "amble"
    UP = "up"
    DOWN = "down"
    RIDE = "ride"
    RIDE_WALKING = "ride, walking"
    STAND = "stand"
    LIFT = "lift"


class WalkPlace(NamedTuple):
    """Where sound is heard, and the level there, NaN between floors."""

    world: World
    level: float
    passage: LevelPassage | None = None


class WalkLeg(NamedTuple):
    """Corners in plan (n, 2), the height of the ground at each (n), and for how long one stands.

    Standing and in a lift there is one corner, and two heights.
    """

    place: WalkPlace
    gait: Gait
    corners_m: F64
    ground_m: F64
    stands_s: float = 0.0
    speed_mps: float = 0.0


def ways_over(
    building: MultiFloorWorld,
    link: FloorLink,
    start: int,
    end: int,
    generator: np.random.Generator,
) -> list[WalkLeg]:
    """The stretches from before the door on one level to before the door on another."""
    low, high = sorted((start, end))
    storeys = [storey for storey in building.storeys if low <= storey.level <= high]
    if link.kind is LevelPassage.LIFT:
        first, last = building.storey(start), building.storey(end)
        return _by_lift(link, first, last, generator.uniform(*WAIT_S))
    if link.kind is LevelPassage.STAIRS:
        way = _up_stairs(link, storeys)
    else:
        walks = generator.uniform() < WALKS_ON_ESCALATOR
        way = _up_escalator(link, storeys, Gait.RIDE_WALKING if walks else Gait.RIDE)
    return way if start < end else [_back(stretch) for stretch in way[::-1]]


def _back(stretch: WalkLeg) -> WalkLeg:
    gait = Gait.DOWN if stretch.gait is Gait.UP else stretch.gait
    corners_m, ground_m = stretch.corners_m[::-1], stretch.ground_m[::-1]
    return stretch._replace(gait=gait, corners_m=corners_m, ground_m=ground_m)


def _up_stairs(link: FloorLink, storeys: list[Storey]) -> list[WalkLeg]:
    """Two flights and a landing for each storey, in two lanes."""
    rises_m = [storey.height_m for storey in storeys]
    longest_m = max(map(flight_m, np.diff(rises_m)))
    place = WalkPlace(_stairwell(link, longest_m), np.nan, LevelPassage.STAIRS)
    parts: list[tuple[Gait, list[tuple[float, float]], float, float]] = []
    entry: list[tuple[float, float]] = [(-SILL_M, 0.0)]
    for low_m, high_m in pairwise(rises_m):
        end_m, middle_m = LANDING_M + flight_m(high_m - low_m), (low_m + high_m) / 2
        turn_m = end_m + LANDING_M / 2
        first, landing = (LANDING_M, -LANE_M), (end_m, -LANE_M)
        away, back = (turn_m, -LANE_M), (turn_m, LANE_M)
        parts += [
            (Gait.AMBLE, [*entry, (LANDING_M / 2, -LANE_M), first], low_m, low_m),
            (Gait.UP, [first, landing], low_m, middle_m),
            (Gait.AMBLE, [landing, away, back, (end_m, LANE_M)], middle_m, middle_m),
            (Gait.UP, [(end_m, LANE_M), (LANDING_M, LANE_M)], middle_m, high_m),
        ]
        entry = [(LANDING_M, LANE_M), (LANDING_M / 2, LANE_M)]
    parts.append((Gait.AMBLE, [*entry, (-SILL_M, 0.0)], rises_m[-1], rises_m[-1]))
    return [
        WalkLeg(place, gait, link.place(np.array(corners)), _sloping(corners, low_m, high_m))
        for gait, corners, low_m, high_m in parts
    ]


def _sloping(corners: list[tuple[float, float]], low_m: float, high_m: float) -> F64:
    return np.linspace(low_m, high_m, len(corners))


def flight_m(storey_m: float) -> float:
    """How long in plan each of the two flights of a storey is, in whole steps."""
    return float(max(round(storey_m / 2 / RISE_M), 1) * TREAD_M)


def _up_escalator(link: FloorLink, storeys: list[Storey], gait: Gait) -> list[WalkLeg]:
    """Flat, inclined, flat; half way up one hears the other floor."""
    low, high = storeys
    length_m = float(np.linalg.norm(link.to_m - link.at_m))
    inclined_m = (high.height_m - low.height_m) / np.tan(INCLINE_RAD)
    flat_m, middle_m = (length_m - inclined_m) / 2, (low.height_m + high.height_m) / 2
    at_m = [0.0, flat_m, length_m / 2, length_m - flat_m, length_m]
    ground_m = [low.height_m, low.height_m, middle_m, high.height_m, high.height_m]
    corners_m = link.place(np.column_stack([at_m, np.zeros(5)]))
    places = [
        WalkPlace(_without_escalator(storey.world, corners_m), np.nan, LevelPassage.ESCALATOR)
        for storey in storeys
    ]
    return [
        WalkLeg(places[k // 2], gait, corners_m[k : k + 2], np.array(ground_m[k : k + 2]))
        for k in range(4)
    ]


def _without_escalator(world: World, way_m: F64) -> World:
    """The world without what one would stand in on the way: the body of the escalator."""
    kept = tuple(
        block for block in world.room.blocks if not meets_block(block, way_m[:-1], way_m[1:]).any()
    )
    return replace(world, room=replace(world.room, blocks=kept))


def _by_lift(link: FloorLink, first: Storey, last: Storey, wait_s: float) -> list[WalkLeg]:
    """Wait, walk in, turn about, stand, walk out."""
    place = WalkPlace(_cabin(link), np.nan, LevelPassage.LIFT)
    front = WalkPlace(first.world, first.level)
    before, inside = [(-APPROACH_M, 0.0), (-SILL_M, 0.0)], (0.7, -0.3)
    turn = [(0.1, 0.2), (0.6, 0.3), (1.0, 0.3), (1.15, 0.0), (1.0, -0.3), inside]
    out = [inside, (0.1, -0.1), (-SILL_M, 0.0)]
    from_m, to_m = first.height_m, last.height_m

    def stretch(
        place: WalkPlace, gait: Gait, corners: list[tuple[float, float]], at_m: float
    ) -> WalkLeg:
        return WalkLeg(place, gait, link.place(np.array(corners)), np.full(len(corners), at_m))

    stands = link.place(np.array([inside]))
    return [
        stretch(front, Gait.STAND, before[:1], from_m)._replace(stands_s=wait_s),
        stretch(front, Gait.AMBLE, before, from_m),
        stretch(place, Gait.AMBLE, [before[1], *turn], from_m),
        WalkLeg(place, Gait.LIFT, stands, np.array([from_m, to_m]), DOORS_S, link.speed_mps),
        stretch(place, Gait.AMBLE, out, to_m),
    ]


def _stairwell(link: FloorLink, flight: float) -> World:
    """A shaft of concrete with a balustrade between its flights."""
    length_m = 2 * LANDING_M + flight
    balustrade = Block(
        "balustrade",
        material("metal"),
        link.place(np.array([[length_m / 2, 0.0]]))[0],
        np.array([flight, 0.1, 1.0]),
        link.heading_rad,
    )
    width_m = 2 * LANE_M + 1.3
    room = _small_room(link, (length_m, width_m, STOREY_M), material("concrete"), (balustrade,))
    return World(link.name, room, room.outline_m)


def _cabin(link: FloorLink) -> World:
    room = _small_room(link, CABIN_M, material("metal"), ())
    return World(link.name, room, room.outline_m)


def _small_room(
    link: FloorLink,
    size_m: tuple[float, float, float],
    walls: Material,
    blocks: tuple[Block, ...],
) -> Room:
    """Inward from the door, with the doorway before it."""
    length_m, half_m = size_m[0], size_m[1] / 2
    corners = [
        [-APPROACH_M, -half_m],
        [length_m, -half_m],
        [length_m, half_m],
        [-APPROACH_M, half_m],
    ]
    outline_m = link.place(np.array(corners))
    seed = int(abs(link.at_m).sum() * 100)
    floor = material("concrete")
    return Room(outline_m, size_m[2], (walls,) * 4, floor, walls, blocks, seed)
