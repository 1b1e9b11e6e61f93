"""A stream of simulated echo pairs for contrastive training: close poses in random rooms.

The two members of a pair are of two visits to the room: walls and furniture, phone, holder,
people and air may all have changed in between, or none of them.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import ParameterError
from elfslam.base.grid import in_ring
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_RATE_HZ, ECHO_SAMPLES, Chirp, EchoPairs
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.circumstances import DIFFUSE, ENGINES, Circumstances, engine_of, room_in
from elfslam.world.device import Device, named_device, random_device
from elfslam.world.materials import Material
from elfslam.world.phone import Engine, Poses, air_at, phone_axes, render_frames, room_responses
from elfslam.world.pulses import SPEED_OF_SOUND_MPS, Air
from elfslam.world.room import Block, Room, box, shoebox
from elfslam.world.scene import Scene, scene_of

CORRIDOR_SHARE = 0.25
"""Share of the rooms that are much longer than wide."""
CORNER_SHARE = 0.3
"""Share of the rooms that have a corner cut out: an L, whose outline is no longer convex."""
LEANING_SHARE = 0.2
"""Share of the rooms with walls out of square."""
HIGH_FROM_M2 = 150.0
"""Rooms from this size on may be halls, with a ceiling up to 6 m high."""
MOST_FURNITURE = 48
MOST_PARTITIONS = 8
PILLAR_SHARE = 0.12
"""Share of the furniture that reaches up to the ceiling."""

NEW_SURFACE_SHARE = 0.4
"""Share of the walls that are of another material in a changed room."""
GONE_SHARE = 0.15
MOVED_SHARE = 0.3
"""Shares of the furniture that is gone and moved in a changed room."""
MOVED_M = 0.5
MOVED_RAD = 0.3


def random_room(generator: np.random.Generator) -> Room:
    """A room, corridor or hall of 4 to 1600 m2 with random walls, partitions and furniture."""
    size_m = _random_size(generator)
    level, scattering = generator.uniform(0.6, 0.97), generator.uniform(0.0, 0.2)
    sides = [_surface(generator, level, scattering) for _ in range(6)]
    room = shoebox(size_m, tuple(sides), seed=int(generator.integers(2**31)))
    outline = _random_outline(generator, room.outline_m)
    walls = tuple(_surface(generator, level, scattering) for _ in outline)
    blocks = _random_blocks(generator, size_m)
    blocks = tuple(block for block in blocks if in_ring(outline, block.corners_m).all())
    return Room(outline, room.height_m, walls, sides[4], sides[5], blocks, room.seed)


def changed_room(generator: np.random.Generator, room: Room) -> Room:
    """The room another time: some walls of other materials, some furniture moved or gone."""

    def surface(before: Material) -> Material:
        if generator.uniform() > NEW_SURFACE_SHARE:
            return before
        return _surface(generator, generator.uniform(0.35, 0.95), generator.uniform(0.0, 0.2))

    blocks = [_changed_block(generator, room, block) for block in room.blocks]
    return replace(
        room,
        walls=tuple(surface(wall) for wall in room.walls),
        floor=surface(room.floor),
        ceiling=surface(room.ceiling),
        blocks=tuple(block for block in blocks if block),
    )


def _changed_block(generator: np.random.Generator, room: Room, block: Block) -> Block | None:
    fate, shift = generator.uniform(), generator.normal(0, MOVED_M, 2)
    turn_rad = generator.normal(0, MOVED_RAD)
    if block.clutter_per_m2 == 0 or fate > GONE_SHARE + MOVED_SHARE:
        return block
    if fate < GONE_SHARE:
        return None
    centre_m, turned_rad = block.centre_m + shift, block.turn_rad + turn_rad
    moved = replace(block, centre_m=centre_m, turn_rad=turned_rad)
    return moved if room.holds(moved.corners_m).all() else block


def _random_size(generator: np.random.Generator) -> F64:
    if generator.uniform() < CORRIDOR_SHARE:
        width = np.exp(generator.uniform(np.log(1.8), np.log(9.0)))
        plan = np.array([width * generator.uniform(3.0, 12.0), width])
    else:
        area_m2 = np.exp(generator.uniform(np.log(9.0), np.log(1600.0)))
        aspect = generator.uniform(1.0, 2.2)
        plan = np.sqrt([area_m2 * aspect, area_m2 / aspect])
    low, high = (2.3, 3.6) if plan.prod() < HIGH_FROM_M2 else (2.5, 6.0)
    return np.append(plan, generator.uniform(low, high))


def _surface(generator: np.random.Generator, level: float, scattering: float) -> Material:
    reflection = float(np.clip(level + generator.uniform(-0.15, 0.15), 0.3, 0.98))
    return Material("random", 1.0 - reflection**2, scattering, "drawn at random")


def _random_outline(generator: np.random.Generator, rectangle_m: F64) -> F64:
    kind, outline = generator.uniform(), rectangle_m
    size = np.ptp(rectangle_m, axis=0)
    if kind < CORNER_SHARE:
        cut = size * (1.0 - generator.uniform(0.2, 0.55, 2))
        notch = [[size[0], cut[1]], cut, [cut[0], size[1]]]
        outline = np.vstack([rectangle_m[:2], notch, rectangle_m[3:]])
    elif kind < CORNER_SHARE + LEANING_SHARE:
        outline = rectangle_m + generator.uniform(0.0, 0.12, (4, 2)) * (size / 2 - rectangle_m)
    return outline


def _random_blocks(generator: np.random.Generator, size_m: F64) -> tuple[Block, ...]:
    area_m2 = float(size_m[:2].prod())
    count = min(int(generator.integers(2, 4 + max(round(area_m2 * 0.25), 1))), MOST_FURNITURE)
    walls = int(generator.integers(0, 1 + min(int(area_m2 // 15), MOST_PARTITIONS)))
    furniture = [_random_furniture(generator, size_m, k) for k in range(count)]
    return (*furniture, *[_random_partition(generator, size_m, k) for k in range(walls)])


def _random_furniture(generator: np.random.Generator, size_m: F64, k: int) -> Block:
    """A thing on the floor, at a wall in half of the cases; a pillar, or a board at 0.7 m."""
    size = generator.uniform([0.4, 0.3, 0.4], [2.2, 1.0, 2.0])
    pillar, lying = generator.uniform() < PILLAR_SHARE, generator.uniform() < 0.5
    size = np.minimum(size[[1, 0, 2]] if lying else size, [*(0.5 * size_m[:2]), size_m[2]])
    if pillar:
        size[2] = size_m[2]
    where = generator.uniform(0.0, 1.0, 2)
    if generator.uniform() < 0.5:
        where[generator.integers(2)] = generator.integers(2)
    corner = np.append(where * (size_m - size)[:2], 0.0)
    if not pillar and generator.uniform() < 0.2:
        corner[2], size[2] = 0.7, 0.05
    turn_rad = generator.uniform(-np.pi, np.pi) if generator.uniform() < 0.15 else 0.0
    surface = _surface(generator, generator.uniform(0.45, 0.95), generator.uniform(0.0, 0.6))
    return box(f"item {k}", corner, size, surface, turn_rad)


def _random_partition(generator: np.random.Generator, size_m: F64, k: int) -> Block:
    """A screen of 1.2 to 1.8 m or a wall up to the ceiling, along one of the axes."""
    full = generator.uniform() < 0.4
    high = size_m[2] if full else generator.uniform(1.2, 1.8)
    size = np.array([min(generator.uniform(1.0, 6.0), 0.6 * size_m[:2].min()), 0.08, high])
    if generator.uniform() < 0.5:
        size = size[[1, 0, 2]]
    corner = np.append(generator.uniform(0.05, 0.95, 2) * (size_m - size)[:2], 0.0)
    surface = _surface(generator, generator.uniform(0.45, 0.97), generator.uniform(0.0, 0.2))
    return box(f"partition {k}", corner, size, surface, clutter_per_m2=0.0)


POSITIVE_DISTANCE_M = 0.20
"""Echoes closer than this are positives (paper, section 5.3, pre-training)."""

WALL_MARGIN_M = 0.4
FRUITLESS_TRIES = 12
PHONE_HEIGHT_M = 0.95
"""What stands higher than this is in the way of a phone."""
ONE_HEADING_SHARE = 0.5
"""Share of rooms in which all phones point nearly the same way, as on a walk down an aisle."""
DISTRICT_M = 14.0
"""Places of one room lie in a square of this side: those far apart are easily told apart."""
TWIN_SHARE = 0.7
"""Share of rooms in which half of the places are the others after half a turn."""

STRANGER_SHARE = 0.5
"""Share of rooms in which the second echo is another holder's: other height, tilt and body."""
OTHER_PHONE_SHARE = 0.4
CHANGED_ROOM_SHARE = 0.4
PEOPLE_SHARE = 0.4
"""Share of visits with others about, `MOST_PEOPLE` at most, at 0.8 to 5 m."""
MOST_PEOPLE = 4


class Visit(NamedTuple):
    """The circumstances under which a room is heard; the holder is height, pitch and distance."""

    room: Room
    engine: str
    device: Device
    holder: tuple[float, float, float]
    air: Air
    people: int


Visits = Callable[[np.random.Generator, str], tuple[Visit, Visit]]
"""Draws two visits to a room, heard by an engine."""


class Sounding(NamedTuple):
    """A room as an engine renders it; to trace its chains of scatterings takes longest."""

    scene: Scene
    engine: Engine


def on_two_days(generator: np.random.Generator, engine: str) -> tuple[Visit, Visit]:
    """Two visits to a random room, between which anything may have changed."""
    first = _random_visit(generator, random_room(generator), engine)
    return first, _another_visit(generator, first)


def at_one_time(generator: np.random.Generator, engine: str) -> tuple[Visit, Visit]:
    """A random room by one phone of one holder, alone and at once (paper, section 5.3)."""
    room, device = random_room(generator), named_device(Circumstances().device)
    visit = Visit(room, engine, device, _random_holder(generator), air_at(), 0)
    return visit, visit


def echo_pairs(
    generator: np.random.Generator,
    pairs: int,
    rooms: int,
    engine: str = ENGINES[0],
    visits: Visits = on_two_days,
) -> EchoPairs:
    """`pairs` places with two echoes each, an equal number from each of `rooms` random rooms.

    `engine` is one of ours, and changes neither rooms nor places; `visits` draws who hears a room.
    Raises ParameterError where `pairs` is no multiple of `rooms`.
    """
    if pairs % rooms:
        raise ParameterError(
            f"pairs: wanted a multiple of rooms ({rooms}), got {pairs}; change one"
        )
    chirp = make_chirp(ChirpParameters(), ECHO_RATE_HZ)
    batch = [
        _pairs_in_room(generator, pairs // rooms, chirp, *visits(generator, engine))
        for _ in range(rooms)
    ]
    first, second, xy_m = (np.concatenate(column) for column in zip(*batch, strict=True))
    return EchoPairs(first, second, np.repeat(np.arange(rooms), pairs // rooms), xy_m)


def _pairs_in_room(
    generator: np.random.Generator, count: int, chirp: Chirp, first: Visit, second: Visit
) -> tuple[F32, F32, F64]:
    twins = generator.uniform() < TWIN_SHARE
    xy, yaw = _places(generator, first.room, count, twins=twins)
    near = xy + _within(generator, count, POSITIVE_DISTANCE_M)
    before = _sounding(first.room, first.engine)
    after = before if second.room is first.room else _sounding(second.room, second.engine)
    return (
        _heard(generator, first, before, xy, yaw, chirp),
        _heard(generator, second, after, near, yaw, chirp),
        xy,
    )


def _sounding(room: Room, engine: str) -> Sounding:
    today = Circumstances(engine=engine)
    there = room_in(room, today)
    return Sounding(scene_of(there), engine_of(today, there, 1))


def _random_visit(generator: np.random.Generator, room: Room, engine: str) -> Visit:
    people = int(generator.integers(1, MOST_PEOPLE + 1))
    return Visit(
        room,
        engine,
        random_device(generator, ordinary=engine == DIFFUSE),
        _random_holder(generator),
        air_at(*generator.uniform([15.0, 30.0], [28.0, 60.0])),
        people if generator.uniform() < PEOPLE_SHARE else 0,
    )


def _another_visit(generator: np.random.Generator, first: Visit) -> Visit:
    """The same room another time: each circumstance is as before or drawn anew."""
    drawn = _random_visit(generator, first.room, first.engine)
    changed, phone, stranger = generator.uniform(size=3)
    return Visit(
        changed_room(generator, first.room) if changed < CHANGED_ROOM_SHARE else first.room,
        first.engine,
        drawn.device if phone < OTHER_PHONE_SHARE else first.device,
        drawn.holder if stranger < STRANGER_SHARE else first.holder,
        drawn.air,
        drawn.people,
    )


def _heard(
    generator: np.random.Generator,
    visit: Visit,
    there: Sounding,
    xy_m: F64,
    yaw_rad: F64,
    chirp: Chirp,
) -> F32:
    """Echo traces (n, 2352) at places (n, 2) on a visit."""
    poses = _among_people(generator, _random_poses(generator, xy_m, yaw_rad, visit.holder), visit)
    responses = room_responses(there.scene, visit.device, poses, visit.air, engine=there.engine)
    frames = render_frames(responses, chirp, visit.device)
    return cut_frames(generator, frames, visit.device)


def _among_people(generator: np.random.Generator, poses: Poses, visit: Visit) -> Poses:
    shape = len(poses.position_m), visit.people
    distance, angle = generator.uniform(0.8, 5.0, shape), generator.uniform(-np.pi, np.pi, shape)
    offset = distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    return replace(poses, people_m=poses.position_m[:, None, :2] + offset)


def _places(
    generator: np.random.Generator, room: Room, count: int, *, twins: bool
) -> tuple[F64, F64]:
    """Positions and yaws in a district of the room; half of them may be twins of the others.

    The twins are the places after half a turn of the district. Where it is the room, an empty
    shoebox sounds the same from there: only furniture and materials tell the two apart, and they
    are what the network has to listen to.
    """
    size = np.minimum(room.size_m[:2], DISTRICT_M)
    low = room.corner_m + generator.uniform(0.0, 1.0, 2) * (room.size_m[:2] - size)
    half = (count + 1) // 2 if twins else count
    xy = _free_places(generator, room, half, low, size)
    yaw = generator.uniform(-np.pi, np.pi) + generator.normal(0, 0.2, half)
    if generator.uniform() > ONE_HEADING_SHARE:
        yaw += generator.integers(0, 4, half) * np.pi / 2
    if not twins:
        return xy, yaw
    turned = 2 * low + size - xy
    blocked = ~room.is_free(turned, PHONE_HEIGHT_M, WALL_MARGIN_M)
    turned[blocked] = _free_places(generator, room, int(blocked.sum()), low, size)
    return np.vstack([xy, turned])[:count], np.concatenate([yaw, yaw + np.pi])[:count]


def _free_places(
    generator: np.random.Generator, room: Room, count: int, low_m: F64, size_m: F64
) -> F64:
    """Places (count, 2) in a box of the room where a phone is not in or at a wall or block.

    Where the box has too few, anywhere in the room.
    """
    found, margin_m, tries = np.zeros((0, 2)), WALL_MARGIN_M, 0
    while len(found) < count:
        if tries == FRUITLESS_TRIES:
            low_m, size_m = room.corner_m, room.size_m[:2]
        tried = generator.uniform(0.0, 1.0, (4 * count + 16, 2)) * size_m + low_m
        found = np.vstack([found, tried[room.is_free(tried, PHONE_HEIGHT_M, margin_m)]])
        margin_m, tries = 0.9 * margin_m, tries + 1
    return found[:count]


def _random_poses(
    generator: np.random.Generator, xy_m: F64, yaw_rad: F64, holder: tuple[float, float, float]
) -> Poses:
    """Phones of one holder on the way: some way about the yaw, tilted and moving forward."""
    height_m, pitch_rad, body_m = holder
    count = len(xy_m)
    position = np.column_stack([xy_m, height_m + generator.normal(0, 0.03, count)])
    yaw = yaw_rad + generator.normal(0, 0.12, count)
    pitch = pitch_rad + generator.normal(0, 0.06, count)
    roll = generator.normal(0, 0.05, count)
    speed = generator.uniform(0.0, 1.5, count)
    velocity = np.column_stack([speed * np.cos(yaw), speed * np.sin(yaw), np.zeros(count)])
    return Poses(
        position, phone_axes(yaw, pitch, roll), velocity, np.full(count, body_m),
        np.zeros((count, 0, 2)),
    )  # fmt: skip


def _random_holder(generator: np.random.Generator) -> tuple[float, float, float]:
    """Height (m), pitch (rad) and distance of the body (m) of a person with a phone."""
    return generator.uniform(1.05, 1.40), generator.uniform(0.2, 0.65), generator.uniform(0.3, 0.4)


def _within(generator: np.random.Generator, count: int, radius_m: float) -> F64:
    radius = radius_m * np.sqrt(generator.uniform(0, 1, count))
    angle = generator.uniform(0, 2 * np.pi, count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def cut_frames(generator: np.random.Generator, frames: F32, device: Device) -> F32:
    """Echo traces (n, 2352) of frames (n, k) at 44.1 kHz that begin with their chirps.

    With the phone's noise, and cut as the pipeline does: with jitter of its direct-path search.
    """
    noise = generator.standard_normal(frames.shape, dtype=np.float32)
    noise *= np.float32(device.noise_rms)
    arrival = round(device.separation_m / SPEED_OF_SOUND_MPS * ECHO_RATE_HZ)
    starts = arrival + DISCARDED_SAMPLES + generator.integers(-2, 3, len(frames))
    columns = starts[:, None] + np.arange(ECHO_SAMPLES)[None, :]
    return np.take_along_axis(frames + noise, columns, axis=1)
