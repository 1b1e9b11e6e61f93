"""A walk through a building: laps on a floor, to a passage, over it, laps on the next; one motion.

Stairs are climbed at 1.5 steps/s and descended at 1.8, give or take a person.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from elfslam.base.arrays import F64, I64
from elfslam.base.values import Levels
from elfslam.world.building import (
    FloorLink,
    MultiFloorWorld,
    nearest_on_route,
    sampled,
)
from elfslam.world.passages import (
    DOORS_S,
    ESCALATOR_MPS,
    TREAD_M,
    Gait,
    WalkLeg,
    WalkPlace,
    ways_over,
)
from elfslam.world.stroll import (
    Way,
    astray,
    by_uneven_steps,
    free_beside,
    leg,
    narrowed,
    stroller_velocity,
)
from elfslam.world.walker import (
    CORNER_RADIUS_M,
    KINEMATICS_RATE_HZ,
    TYPICAL_CADENCE_HZ,
    TYPICAL_SPEED_MPS,
    Motion,
    Walker,
    keeping_to_the_line,
    motion_on,
)
from elfslam.world.world_file import walked_room

CADENCE_HZ = {Gait.UP: 1.5, Gait.DOWN: 1.8, Gait.RIDE_WALKING: 1.4}
"""Steps take longer up than down (Verlaan, Journal of Case Studies 2021, of 100 people); the young
take 0.97 s for two down (a data set of 101 people, Gait and Posture 2021), the old longer."""
AMBLE_MPS = 0.65
TIGHT_RADIUS_M = 0.25
"""Of corners on landings and in cabins."""
STANDING_S = 2.0
BOUNCE = {Gait.UP: 1.8, Gait.DOWN: 1.4}
"""Against a level walk as slow: upward the hip halts between steps, going down the range of the
vertical acceleration is the largest of the three (Weiss et al., Medical Engineering and Physics 38,
2016)."""
PADDING: tuple[Literal["constant", "edge"], ...] = ("constant", "constant", "edge", "edge", "edge")
"""Before and after: of velocity, pace, turn, ground and bounce."""
LIFT_MPS2 = 0.8
"""As lifts for persons accelerate."""
SMOOTH_S = 0.25
PROBED = 10
"""So many centimetres apart people look how far they can go aside."""


class Path(NamedTuple):
    """A line in plan (k, 2) with corners rounded, evenly sampled: its heading and length (k).

    `ends_m` is where each stretch ends on it.
    """

    xy_m: F64
    heading_rad: F64
    along_m: F64
    ends_m: F64


class BuildingWalk(NamedTuple):
    """The motion, with heights above the entrance, and where it is at each moment.

    `ground_m` (n) is the height of the ground under the walker, `stretch` (n) the number of the
    stretch.
    """

    motion: Motion
    ground_m: F64
    stretch: I64
    stretches: tuple[WalkLeg, ...]


def course_of(
    building: MultiFloorWorld,
    plan: Sequence[int],
    rounds: int,
    generator: np.random.Generator,
    *,
    reverse: bool = False,
) -> list[WalkLeg]:
    """The stretches of a walk over levels in this order, with so many laps on each."""
    taken = _passages(building, plan, generator)
    course: list[WalkLeg] = []
    for k, level in enumerate(plan):
        storey = building.storey(level)
        route_m = storey.world.route_m[::-1] if reverse else storey.world.route_m
        comes, goes = (taken[k - 1] if k else None), (taken[k] if k < len(taken) else None)
        first = nearest_on_route(storey, comes, route_m) if comes else 0
        last = nearest_on_route(storey, goes, route_m) if goes else first
        way_m = _laps(route_m, first, last, rounds)
        doors_m = [each.approach_m(level)[None] for each in (comes, goes) if each]
        ways = [*doors_m[: comes is not None], way_m, *doors_m[comes is not None :]]
        corners_m = np.vstack(ways)
        ground_m = np.full(len(corners_m), storey.height_m)
        course.append(WalkLeg(WalkPlace(storey.world, level), Gait.WALK, corners_m, ground_m))
        if goes:
            course += ways_over(building, goes, level, plan[k + 1], generator)
    return course


def _passages(
    building: MultiFloorWorld, plan: Sequence[int], generator: np.random.Generator
) -> list[FloorLink]:
    """What is taken from floor to floor: by chance, but not the last one again if others do."""
    taken: list[FloorLink] = []
    for here, there in pairwise(plan):
        joining = building.between(here, there)
        others = [each for each in joining if not taken or each is not taken[-1]] or joining
        taken.append(others[int(generator.integers(len(others)))])
    return taken


def _laps(route_m: F64, first: int, last: int, rounds: int) -> F64:
    """Laps of a closed route, sampled each centimetre, from one of its points, then on to one."""
    lap = sampled(np.vstack([route_m, route_m[:1]]))[:-1]
    first, last = first % len(lap), last % len(lap)
    count = rounds * len(lap) + (last - first) % len(lap)
    return lap[(first + np.arange(count + 1)) % len(lap)]


def path_of(course: Sequence[WalkLeg]) -> Path:
    """The path through all stretches, with wide corners on floors and tight ones between."""
    ends_m = [course[0].corners_m[:1], *[stretch.corners_m[-1:] for stretch in course]]
    parts = [
        sampled(np.vstack([before_m, stretch.corners_m]))[1:]
        for before_m, stretch in zip(ends_m, course, strict=False)
    ]
    rough, counts = np.vstack(parts), np.cumsum([len(part) for part in parts])
    tight = np.repeat(
        [stretch.gait is not Gait.WALK for stretch in course], [len(p) for p in parts]
    )
    share = gaussian_filter1d(tight.astype(np.float64), 30.0, mode="nearest")[:, None]
    wide_xy, tight_xy = (
        gaussian_filter1d(rough, radius_m / 0.01, axis=0, mode="nearest")
        for radius_m in (CORNER_RADIUS_M, TIGHT_RADIUS_M)
    )
    xy_m = (1 - share) * wide_xy + share * tight_xy
    uneven_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(xy_m, axis=0), axis=1)))
    along_m = np.linspace(0.0, uneven_m[-1], round(uneven_m[-1] / 0.01) + 1)
    even_m = np.column_stack([np.interp(along_m, uneven_m, column) for column in xy_m.T])
    tangent = np.gradient(uniform_filter1d(even_m, 11, axis=0, mode="nearest"), axis=0)
    heading_rad = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    return Path(even_m, heading_rad, along_m, uneven_m[counts - 1])


def walk_through(
    walker: Walker, course: Sequence[WalkLeg], generator: np.random.Generator
) -> BuildingWalk:
    """The motion of somebody along a course, who stands still before and after.

    People stray on floors, as `stroll`, and keep to the middle on stairs and the like.
    """
    path = path_of(course)
    lengths_m = np.diff(path.ends_m, prepend=0.0)
    timed = [
        _timed(stretch, float(length_m), walker, generator)
        for stretch, length_m in zip(course, lengths_m, strict=True)
    ]
    rest = round(STANDING_S * KINEMATICS_RATE_HZ)
    stretch = np.repeat(np.arange(len(course)), [each.shape[1] for each in timed])
    rows = [
        gaussian_filter1d(np.pad(row, rest, mode=mode), SMOOTH_S * KINEMATICS_RATE_HZ)
        for row, mode in zip(np.hstack(timed), PADDING, strict=True)
    ]
    velocity, pace, turned, ground, bounce = rows
    line = replace(keeping_to_the_line(pace), turned_rad=turned, ground_m=ground, bounce=bounce)
    stretch = np.pad(stretch, rest, mode="edge")
    if walker.lane_m:
        way = Way(path.xy_m, float(path.along_m[-1]), *_room_beside(path, course))
        velocity, line, at = astray(walker, way, velocity, line, generator)
        stretch = stretch[np.minimum(at.round().astype(int), len(stretch) - 1)]
    motion = motion_on(walker, *_on_path(path, velocity), line, generator)
    return BuildingWalk(motion, line.ground_m, stretch, tuple(course))


def _room_beside(path: Path, course: Sequence[WalkLeg]) -> tuple[F64, F64]:
    """How the path bends (k), and how far beside it one can go (k, 2): not at all off floors."""
    bend_pm = np.gradient(path.heading_rad, path.along_m)
    free_m = np.zeros((len(bend_pm), 2))
    ends = np.searchsorted(path.along_m, path.ends_m, side="right")
    for stretch, start, end in zip(course, [0, *ends], ends, strict=False):
        if stretch.gait is Gait.WALK:
            at = np.arange(start, end, PROBED)
            room = walked_room(stretch.place.world)
            beside_m = free_beside(path.xy_m[at], path.heading_rad[at], bend_pm[at], room)
            free_m[start:end] = np.repeat(beside_m, PROBED, axis=0)[: end - start]
    return bend_pm, narrowed(free_m)


def _on_path(path: Path, velocity: F64) -> tuple[F64, F64]:
    """Places (n, 2) and headings (n) of somebody who goes at a velocity (n)."""
    at_m = np.cumsum(velocity) / KINEMATICS_RATE_HZ
    xy_m = np.column_stack([np.interp(at_m, path.along_m, column) for column in path.xy_m.T])
    return xy_m, np.interp(at_m, path.along_m, path.heading_rad)


def _timed(
    stretch: WalkLeg, length_m: float, walker: Walker, generator: np.random.Generator
) -> F64:
    """Along a stretch (5, n): velocity in plan, pace of the feet, turn, ground and bounce."""
    if stretch.gait is Gait.LIFT:
        ground = _lift_ride(stretch)
        return _rows(ground=ground, velocity=np.zeros(len(ground)))
    if stretch.gait is Gait.STAND:
        none = np.zeros(round(stretch.stands_s * KINEMATICS_RATE_HZ))
        return _rows(ground=none + stretch.ground_m[0], velocity=none)
    if stretch.gait is Gait.WALK:
        return _walked(stretch, length_m, walker, generator)
    climb_m = float(stretch.ground_m[-1] - stretch.ground_m[0])
    speed_mps, pace_mps = _speed_and_pace(stretch.gait, walker, generator)
    is_riding = stretch.gait in (Gait.RIDE, Gait.RIDE_WALKING)
    along_m = np.hypot(length_m, climb_m) if is_riding else length_m
    count = max(round(along_m / speed_mps * KINEMATICS_RATE_HZ), 1)
    return _rows(
        ground=stretch.ground_m[0] + climb_m * np.arange(1, count + 1) / count,
        velocity=np.full(count, length_m * KINEMATICS_RATE_HZ / count),
        pace=np.full(count, pace_mps),
        bounce=BOUNCE.get(stretch.gait, 1.0),
    )


def _walked(
    stretch: WalkLeg, length_m: float, walker: Walker, generator: np.random.Generator
) -> F64:
    ground_m = stretch.ground_m[0]
    if not walker.lane_m:
        speed = leg(walker, length_m, generator)
        return _rows(ground=np.full(len(speed), ground_m), velocity=speed, pace=speed)
    pace, turned = stroller_velocity(walker, length_m, generator)
    velocity = by_uneven_steps(walker, pace, generator)
    velocity = velocity * (length_m * KINEMATICS_RATE_HZ / velocity.sum())
    ground = np.full(len(pace), ground_m)
    return _rows(ground=ground, velocity=velocity, pace=np.abs(pace), turned=turned)


def _rows(
    *,
    ground: F64,
    velocity: F64,
    pace: F64 | None = None,
    turned: F64 | None = None,
    bounce: float = 1.0,
) -> F64:
    none = np.zeros(len(ground))
    pace, turned = (none if each is None else each for each in (pace, turned))
    return np.stack([velocity, pace, turned, ground, np.full(len(ground), bounce)])


def _speed_and_pace(
    gait: Gait, walker: Walker, generator: np.random.Generator
) -> tuple[float, float]:
    """How fast one gets on, and the pace on flat ground at which the feet go as fast."""
    if gait is Gait.AMBLE:
        return AMBLE_MPS, AMBLE_MPS
    if gait is Gait.RIDE:
        return ESCALATOR_MPS, 0.0
    brisk = np.sqrt(walker.speed_mps / TYPICAL_SPEED_MPS) * generator.uniform(0.93, 1.07)
    cadence_hz = CADENCE_HZ[gait] * brisk
    relative = cadence_hz / TYPICAL_CADENCE_HZ
    pace_mps = walker.step_factor * TYPICAL_SPEED_MPS * relative**2
    if gait is Gait.RIDE_WALKING:
        return ESCALATOR_MPS + cadence_hz * 0.35, pace_mps
    return cadence_hz * TREAD_M, pace_mps


def _lift_ride(stretch: WalkLeg) -> F64:
    """Heights (n) of a cabin whose doors close, which rides, and whose doors open."""
    start_m, end_m = stretch.ground_m
    way_m, dt_s = abs(end_m - start_m), 1 / KINEMATICS_RATE_HZ
    top_mps = min(stretch.speed_mps, np.sqrt(LIFT_MPS2 * way_m))
    total_s = way_m / top_mps + top_mps / LIFT_MPS2
    t_s = np.arange(0.0, total_s, dt_s)
    speed = np.minimum(np.minimum(t_s, total_s - t_s) * LIFT_MPS2, top_mps)
    gone_m = np.cumsum(speed) * dt_s
    ride = start_m + np.sign(end_m - start_m) * gone_m * way_m / gone_m[-1]
    doors = round(DOORS_S * KINEMATICS_RATE_HZ)
    return np.concatenate([np.full(doors, start_m), ride, np.full(doors, end_m)])


def place_changes(walk: BuildingWalk) -> list[tuple[float, WalkPlace]]:
    """From when on one is in which place."""
    changes: list[tuple[float, WalkPlace]] = []
    for row in np.flatnonzero(np.diff(walk.stretch, prepend=-1)):
        place = walk.stretches[walk.stretch[row]].place
        if not changes or changes[-1][1] != place:
            changes.append((float(walk.motion.t_s[row]), place))
    return changes


def levels_of(walk: BuildingWalk) -> Levels:
    """On which floor the walk was, and what it took between them."""
    rows: list[tuple[float, WalkPlace]] = []
    for t_s, place in place_changes(walk):
        if not (rows and place.passage and rows[-1][1].passage is place.passage):
            rows.append((t_s, place))
    return Levels(
        np.array([t_s for t_s, _ in rows]),
        np.array([place.level for _, place in rows]),
        tuple(place.passage for _, place in rows),
    )
