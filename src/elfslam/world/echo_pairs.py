"""A stream of simulated echo pairs for contrastive training: close poses in random rooms.

The two members of a pair are of two visits to the room: walls and furniture, phone, holder,
people and air may all have changed in between, or none of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import ParameterError
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_RATE_HZ, ECHO_SAMPLES, Chirp, EchoPairs
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.circumstances import DIFFUSE, ENGINES, Circumstances, engine_of, room_in
from elfslam.world.device import Device, named_device, random_device
from elfslam.world.phone import Engine, Poses, air_at, phone_axes, render_frames, room_responses
from elfslam.world.pulses import SPEED_OF_SOUND_MPS, Air
from elfslam.world.random_world import changed_room, random_room
from elfslam.world.room import Room
from elfslam.world.scene import Scene, scene_of

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

    With the phone's noise, and as the line cuts them: with the jitter of its direct-path search.
    """
    noise = generator.standard_normal(frames.shape, dtype=np.float32)
    noise *= np.float32(device.noise_rms)
    arrival = round(device.separation_m / SPEED_OF_SOUND_MPS * ECHO_RATE_HZ)
    starts = arrival + DISCARDED_SAMPLES + generator.integers(-2, 3, len(frames))
    columns = starts[:, None] + np.arange(ECHO_SAMPLES)[None, :]
    return np.take_along_axis(frames + noise, columns, axis=1)
