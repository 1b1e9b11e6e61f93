"""Many random buildings, walked through on visits: the ELFs that maps of them would hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_RATE_HZ, ECHO_SAMPLES
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.line.feature import Encoder, load_encoder
from elfslam.world.air import SPEED_OF_SOUND_MPS
from elfslam.world.device import Device, random_device
from elfslam.world.phone import Poses, air_at, phone_axes, render_frames, room_responses
from elfslam.world.pulses import C64, Air
from elfslam.world.random_world import changed_room, random_room
from elfslam.world.room import Room
from elfslam.world.scene import scene_of

FIRST_SEED = 1000
FLOORS = 2
"""Of a building; the upper one has the rooms of the lower, with other surfaces and furniture."""
ROOMS = 4
"""Of a floor."""
STEP_M = 0.12
"""From echo to echo: 1.2 m/s at ten chirps a second."""
STEP_S = 0.1
WALL_MARGIN_M = 0.4
PHONE_HEIGHT_M = 0.95
TRIED_LEGS = 8
SHORTEST_LEG_M = 1.2
RENDERED = 512
ENCODED = 64
"""Echoes at a time: what fits into the cache is made into sound and encoded twice as fast."""
PEOPLE_SHARE = 0.4
MOST_PEOPLE = 4
ASIDE_M = 0.1
"""How far beside the way of the map another walk goes (one sigma)."""


class OneThread:
    """The shipped encoder on one thread; its threads would wait for each other by turning round."""

    def __init__(self) -> None:
        import onnxruntime

        content = resources.files("elfslam").joinpath("weights/compact.onnx").read_bytes()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.log_severity_level = 1, 3
        self.identity = load_encoder("compact").identity
        self._session: Any = onnxruntime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"]
        )

    def embed(self, samples: F32) -> F32:
        """Unit vectors (n, 128)."""
        return np.asarray(self._session.run(["elf"], {"samples": samples})[0])


class BuildingWalk(NamedTuple):
    """Where the echoes of a walk are heard (n, 2), the way it points (n), and of which leg (n)."""

    xy_m: F64
    yaw_rad: F64
    leg: I64


@dataclass(frozen=True)
class Visit:
    """The circumstances of a walk: phone, holder (height, pitch, body), air and others about."""

    device: Device
    holder: tuple[float, float, float]
    air: Air
    people: int


def floor_rooms(building: int, floor: int) -> list[Room]:
    """The rooms of a floor; the floors of a building are alike, as they are in life."""
    generator = np.random.default_rng([FIRST_SEED, building])
    rooms = [random_room(generator) for _ in range(ROOMS)]
    for level in range(floor):
        changes = np.random.default_rng([FIRST_SEED, building, level + 1])
        rooms = [changed_room(changes, room) for room in rooms]
    return rooms


def random_visit(generator: np.random.Generator) -> Visit:
    """Another phone, holder, air and number of people every time."""
    people = int(generator.integers(1, MOST_PEOPLE + 1))
    holder = generator.uniform([1.05, 0.2, 0.3], [1.40, 0.65, 0.4])
    return Visit(
        random_device(generator),
        (float(holder[0]), float(holder[1]), float(holder[2])),
        air_at(*generator.uniform([15.0, 30.0], [28.0, 60.0])),
        people if generator.uniform() < PEOPLE_SHARE else 0,
    )


def floor_walks(
    generator: np.random.Generator, rooms: list[Room], count: int
) -> list[BuildingWalk]:
    """A walk in every room, `count` echoes in all, more of them in larger rooms."""
    area = np.array([np.prod(room.size_m[:2]) for room in rooms])
    ends = np.round(np.cumsum(area) / area.sum() * count).astype(int)
    return [
        walk_in(generator, room, int(size))
        for room, size in zip(rooms, np.diff(ends, prepend=0), strict=True)
    ]


def walk_in(generator: np.random.Generator, room: Room, count: int) -> BuildingWalk:
    """Straight legs from one random place to the next, wherever nothing stands in the way."""
    legs: list[F64] = []
    at = free_place(generator, room)
    while not legs or sum(map(len, legs)) < count:
        leg = _free_leg(generator, room, at)
        if len(leg) * STEP_M < SHORTEST_LEG_M:
            at = free_place(generator, room)
            leg = at + STEP_M * np.outer(np.arange(6), _ahead(generator.uniform(-np.pi, np.pi)))
        legs.append(leg)
        at = leg[-1]
    yaw = [np.full(len(leg), np.arctan2(*(leg[-1] - leg[0])[::-1])) for leg in legs]
    number = [np.full(len(leg), k) for k, leg in enumerate(legs)]
    xy_m, yaw_rad, leg_number = map(np.concatenate, (legs, yaw, number))
    return BuildingWalk(xy_m[:count], yaw_rad[:count], leg_number[:count])


def _ahead(yaw_rad: float) -> F64:
    return np.array([np.cos(yaw_rad), np.sin(yaw_rad)])


def _free_leg(generator: np.random.Generator, room: Room, at: F64) -> F64:
    """The longest of a few straight ways from here, up to the first thing in the way."""
    best = np.zeros((0, 2))
    for _ in range(TRIED_LEGS):
        goal = room.corner_m + generator.uniform(0.0, 1.0, 2) * room.size_m[:2]
        length = float(np.linalg.norm(goal - at))
        way = at + np.outer(np.arange(1, int(length / STEP_M) + 1) * STEP_M, (goal - at) / length)
        free = room.is_free(way, PHONE_HEIGHT_M, WALL_MARGIN_M) if len(way) else np.ones(0, bool)
        way = way[: len(way) if free.all() else int(np.argmin(free))]
        best = way if len(way) > len(best) else best
    return best


def free_place(generator: np.random.Generator, room: Room) -> F64:
    """Somewhere in the room where a phone can be, by a margin that shrinks where it must."""
    margin_m = WALL_MARGIN_M
    while True:
        tried = room.corner_m + generator.uniform(0.0, 1.0, (32, 2)) * room.size_m[:2]
        free = room.is_free(tried, PHONE_HEIGHT_M, margin_m)
        if free.any():
            return np.asarray(tried[np.argmax(free)])
        margin_m *= 0.9


def beside(
    generator: np.random.Generator, walk: BuildingWalk, first: int, count: int
) -> BuildingWalk:
    """A stretch of a walk gone again: some way aside, at another pace, from another start."""
    pace = generator.uniform(0.9, 1.1)
    at = np.clip(first + generator.uniform() + pace * np.arange(count), 0, len(walk.leg) - 1)
    low = np.floor(at).astype(int)
    high = np.minimum(low + 1, len(walk.leg) - 1)
    high = np.where(walk.leg[high] == walk.leg[low], high, low)
    xy = walk.xy_m[low] + (at - low)[:, None] * (walk.xy_m[high] - walk.xy_m[low])
    yaw = walk.yaw_rad[low]
    aside = generator.normal(0, ASIDE_M) * np.column_stack([-np.sin(yaw), np.cos(yaw)])
    return BuildingWalk(xy + aside, yaw, walk.leg[low])


def heard(
    generator: np.random.Generator, room: Room, visit: Visit, walk: BuildingWalk, encoder: Encoder
) -> F32:
    """The ELF (n, 128) of every echo of a walk."""
    poses, scene = _poses(generator, visit, walk), scene_of(room)
    found = []
    for rows in _batches(len(walk.leg), RENDERED):
        part = Poses(*(getattr(poses, name)[rows] for name in Poses.__dataclass_fields__))
        responses = room_responses(scene, visit.device, part, visit.air)
        for few in _batches(len(responses), ENCODED):
            found.append(encoder.embed(_sound(generator, visit.device, responses[few])))
    return np.concatenate(found)


def _sound(generator: np.random.Generator, device: Device, responses: C64) -> F32:
    """Echo traces (n, 2352) as the line cuts them, with noise and the jitter of its search."""
    frames = render_frames(responses, make_chirp(ChirpParameters(), ECHO_RATE_HZ), device)
    arrival = round(device.separation_m / SPEED_OF_SOUND_MPS * ECHO_RATE_HZ)
    starts = arrival + DISCARDED_SAMPLES + generator.integers(-2, 3, len(frames))
    samples = np.stack([row[k : k + ECHO_SAMPLES] for row, k in zip(frames, starts, strict=True)])
    noise = generator.standard_normal(samples.shape, dtype=np.float32)
    return np.asarray(samples + np.float32(device.noise_rms) * noise)


def _batches(count: int, size: int) -> Iterator[slice]:
    return (slice(k, k + size) for k in range(0, count, size))


def _poses(generator: np.random.Generator, visit: Visit, walk: BuildingWalk) -> Poses:
    """Phones of one holder on the way: some way about the yaw, tilted and moving forward."""
    height_m, pitch_rad, body_m = visit.holder
    count = len(walk.leg)
    yaw = walk.yaw_rad + generator.normal(0, 0.07, count)
    pitch, roll = pitch_rad + generator.normal(0, 0.04, count), generator.normal(0, 0.03, count)
    ahead = np.column_stack([np.cos(walk.yaw_rad), np.sin(walk.yaw_rad), np.zeros(count)])
    position = np.column_stack([walk.xy_m, height_m + generator.normal(0, 0.015, count)])
    poses = Poses(
        position, phone_axes(yaw, pitch, roll), STEP_M / STEP_S * ahead, np.full(count, body_m),
        np.zeros((count, 0, 2)),
    )  # fmt: skip
    return _among_people(generator, poses, visit.people)


def _among_people(generator: np.random.Generator, poses: Poses, people: int) -> Poses:
    shape = len(poses.position_m), people
    distance, angle = generator.uniform(0.8, 5.0, shape), generator.uniform(-np.pi, np.pi, shape)
    offset = distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    return replace(poses, people_m=poses.position_m[:, None, :2] + offset)
