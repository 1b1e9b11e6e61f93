"""A stream of simulated echo pairs for contrastive training: close poses in random rooms."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import ParameterError
from elfslam.base.values import (
    DISCARDED_SAMPLES,
    ECHO_RATE_HZ,
    ECHO_SAMPLES,
    Chirp,
    EchoPairs,
)
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.world.air import SPEED_OF_SOUND_MPS
from elfslam.world.device import Device, random_device
from elfslam.world.phone import Poses, air_at, phone_axes, render_frames, room_responses
from elfslam.world.random_world import random_room
from elfslam.world.room import Room
from elfslam.world.scene import scene_of

POSITIVE_DISTANCE_M = 0.20
"""Echoes closer than this are positives (paper, section 5.3, pre-training)."""

WALL_MARGIN_M = 0.4
PHONE_HEIGHT_M = 0.95
"""What stands higher than this is in the way of a phone."""
ONE_HEADING_SHARE = 0.5
"""Share of rooms in which all phones point nearly the same way, as on a walk down an aisle."""
STRANGER_SHARE = 0.5
"""Share of rooms in which the second echo is another holder's: other height, tilt and body."""


def echo_pairs(generator: np.random.Generator, pairs: int, rooms: int) -> EchoPairs:
    """`pairs` places with two echoes each, an equal number from each of `rooms` random rooms.

    Raises ParameterError where `pairs` is no multiple of `rooms`.
    """
    if pairs % rooms:
        raise ParameterError(
            f"pairs: wanted a multiple of rooms ({rooms}), got {pairs}; change one"
        )
    chirp = make_chirp(ChirpParameters(), ECHO_RATE_HZ)
    batch = [_pairs_in_room(generator, pairs // rooms, chirp) for _ in range(rooms)]
    first, second, xy_m = (np.concatenate(column) for column in zip(*batch, strict=True))
    return EchoPairs(first, second, np.repeat(np.arange(rooms), pairs // rooms), xy_m)


def _pairs_in_room(
    generator: np.random.Generator, count: int, chirp: Chirp
) -> tuple[F32, F32, F64]:
    room, device = random_room(generator), random_device(generator)
    scene, air = scene_of(room), air_at(*generator.uniform([15.0, 30.0], [28.0, 60.0]))
    xy, yaw = _places(generator, room, count)
    holder = _random_holder(generator)
    stranger = generator.uniform() < STRANGER_SHARE
    holders = holder, _random_holder(generator) if stranger else holder
    shifts = np.zeros((count, 2)), _within(generator, count, POSITIVE_DISTANCE_M)
    sides = []
    for shift, someone in zip(shifts, holders, strict=True):
        poses = _random_poses(generator, xy + shift, yaw, someone)
        frames = render_frames(room_responses(scene, device, poses, air), chirp, device)
        noise = generator.standard_normal(frames.shape, dtype=np.float32)
        sides.append(_cut(generator, frames + np.float32(device.noise_rms) * noise, device))
    return sides[0], sides[1], xy


def _places(generator: np.random.Generator, room: Room, count: int) -> tuple[F64, F64]:
    """Positions and yaws; the second half is the first after half a turn of the room.

    An empty shoebox sounds the same from there: only furniture and materials tell the two apart,
    and they are what the network has to listen to.
    """
    half, size = (count + 1) // 2, room.size_m[:2]
    xy = _free_places(generator, room, half)
    yaw = generator.uniform(-np.pi, np.pi) + generator.normal(0, 0.2, half)
    if generator.uniform() > ONE_HEADING_SHARE:
        yaw += generator.integers(0, 4, half) * np.pi / 2
    turned = 2 * room.corner_m + size - xy
    blocked = ~room.is_free(turned, PHONE_HEIGHT_M, WALL_MARGIN_M)
    turned[blocked] = _free_places(generator, room, int(blocked.sum()))
    return np.vstack([xy, turned])[:count], np.concatenate([yaw, yaw + np.pi])[:count]


def _free_places(generator: np.random.Generator, room: Room, count: int) -> F64:
    """Places (count, 2) in the room where a phone is not in or at a wall or block."""
    found = np.zeros((0, 2))
    margin_m = WALL_MARGIN_M
    while len(found) < count:
        tried = generator.uniform(0.0, 1.0, (4 * count + 16, 2)) * room.size_m[:2] + room.corner_m
        found = np.vstack([found, tried[room.is_free(tried, PHONE_HEIGHT_M, margin_m)]])
        margin_m *= 0.9
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
    """Shifts (count, 2) uniform in a disc."""
    radius = radius_m * np.sqrt(generator.uniform(0, 1, count))
    angle = generator.uniform(0, 2 * np.pi, count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def _cut(generator: np.random.Generator, frames: F32, device: Device) -> F32:
    """Echo traces as the line cuts them, with the jitter of its direct-path search."""
    arrival = round(device.separation_m / SPEED_OF_SOUND_MPS * ECHO_RATE_HZ)
    starts = arrival + DISCARDED_SAMPLES + generator.integers(-2, 3, len(frames))
    columns = starts[:, None] + np.arange(ECHO_SAMPLES)[None, :]
    return np.take_along_axis(frames, columns, axis=1)
