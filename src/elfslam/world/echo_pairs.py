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
from elfslam.world.acoustics import image_sources, render_frames, room_responses
from elfslam.world.air import SPEED_OF_SOUND_MPS
from elfslam.world.device import Device, smooth_response
from elfslam.world.room import Furniture, Room, furnish

POSITIVE_DISTANCE_M = 0.20
"""Echoes closer than this are positives (paper, section 5.3, pre-training)."""


WALL_MARGIN_M = 0.4
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


def random_room(generator: np.random.Generator) -> Room:
    """A room of random size and material with random furniture."""
    area_m2 = np.exp(generator.uniform(np.log(9.0), np.log(400.0)))
    aspect = generator.uniform(1.0, 2.2)
    size_m = np.array(
        [np.sqrt(area_m2 * aspect), np.sqrt(area_m2 / aspect), generator.uniform(2.3, 3.6)]
    )
    reflection = np.clip(
        generator.uniform(0.55, 0.95) + generator.uniform(-0.15, 0.15, 6), 0.3, 0.97
    )
    count = int(generator.integers(2, 4 + max(round(area_m2 * 0.25), 1)))
    items = tuple(_random_furniture(generator, size_m, k) for k in range(min(count, 24)))
    return furnish(size_m, reflection, items, generator)


def random_device(generator: np.random.Generator) -> Device:
    """A phone of random response, directivity, level and noise."""
    return Device(
        name="random",
        response=smooth_response(generator, generator.uniform(2.0, 25.0)),
        speaker_directivity=generator.uniform(0.2, 0.5),
        microphone_directivity=generator.uniform(0.0, 0.4),
        direct_gain=generator.uniform(0.4, 1.0),
        noise_rms=float(np.exp(generator.uniform(np.log(5e-6), np.log(1e-4)))),
    )


def _random_furniture(generator: np.random.Generator, size_m: F64, k: int) -> Furniture:
    size = generator.uniform([0.4, 0.3, 0.4], [2.2, 1.0, 2.0])
    if generator.uniform() < 0.5:
        size = size[[1, 0, 2]]
    size = np.minimum(size, 0.6 * size_m)
    corner = np.append(generator.uniform(0.0, 1.0, 2) * (size_m - size)[:2], 0.0)
    return Furniture(f"item {k}", corner, size)


def _pairs_in_room(
    generator: np.random.Generator, count: int, chirp: Chirp
) -> tuple[F32, F32, F64]:
    room, device = random_room(generator), random_device(generator)
    images = image_sources(room)
    xy, yaw = _places(generator, room, count)
    holder = _random_holder(generator)
    stranger = generator.uniform() < STRANGER_SHARE
    holders = holder, _random_holder(generator) if stranger else holder
    shifts = np.zeros((count, 2)), _within(generator, count, POSITIVE_DISTANCE_M)
    sides = []
    for shift, (height_m, pitch_rad, body_m) in zip(shifts, holders, strict=True):
        position = np.column_stack([xy + shift, height_m + generator.normal(0, 0.03, count)])
        turned = yaw + generator.normal(0, 0.12, count)
        tilted = pitch_rad + generator.normal(0, 0.06, count)
        body = np.full(count, body_m)
        responses = room_responses(room, images, device, position, turned, tilted, body)
        frames = render_frames(responses, chirp, device)
        noise = generator.standard_normal(frames.shape, dtype=np.float32)
        sides.append(_cut(generator, frames + np.float32(device.noise_rms) * noise, device))
    return sides[0], sides[1], xy


def _places(generator: np.random.Generator, room: Room, count: int) -> tuple[F64, F64]:
    """Positions and yaws; the second half is the first after half a turn of the room.

    An empty shoebox sounds the same from there: only furniture and materials tell the two apart,
    and they are what the network has to listen to.
    """
    half = (count + 1) // 2
    xy = generator.uniform(WALL_MARGIN_M, room.size_m[:2] - WALL_MARGIN_M, (half, 2))
    yaw = generator.uniform(-np.pi, np.pi) + generator.normal(0, 0.2, half)
    if generator.uniform() > ONE_HEADING_SHARE:
        yaw += generator.integers(0, 4, half) * np.pi / 2
    both = np.vstack([xy, room.size_m[:2] - xy])[:count]
    return both, np.concatenate([yaw, yaw + np.pi])[:count]


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
