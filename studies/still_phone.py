"""Echoes of a phone that somebody holds still, cut at the direct arrival."""

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_RATE_HZ, ECHO_SAMPLES, Chirp
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.device import Device, built_in_device
from elfslam.world.phone import Poses, air_at, phone_axes, render_frames, room_responses
from elfslam.world.pulses import SPEED_OF_SOUND_MPS, Air
from elfslam.world.room import Room
from elfslam.world.scene import Scene, scene_of

HAND_M = 0.01
HAND_RAD = np.deg2rad(2.0)
"""How much a hand that holds a phone still moves it from echo to echo, one standard deviation."""
HEIGHT_M = 1.2
PITCH_RAD = 0.4
BODY_M = 0.35


@dataclass(frozen=True)
class Listener:
    """A phone in a room, and what it plays."""

    scene: Scene
    air: Air
    device: Device
    chirp: Chirp


def listener_in(room: Room, *, signal: str = "chirp", air: Air | None = None) -> Listener:
    """The simulated phone in a room; the air is that of 20 degrees where none is given."""
    chirp = make_chirp(ChirpParameters(kind=signal), ECHO_RATE_HZ)
    return Listener(scene_of(room), air or air_at(), built_in_device("simulated phone"), chirp)


def held_still(
    xy_m: F64,
    count: int,
    generator: np.random.Generator,
    *,
    height_m: float = HEIGHT_M,
    yaw_rad: float = 0.0,
) -> Poses:
    """`count` poses of a phone that a hand holds still at a place (2)."""
    shift = generator.normal(0, HAND_M, (count, 3))
    turn = generator.normal(0, HAND_RAD, (3, count))
    return Poses(
        np.append(xy_m, height_m) + shift,
        phone_axes(yaw_rad + turn[0], PITCH_RAD + turn[1], turn[2]),
        np.zeros((count, 3)), np.full(count, BODY_M), np.zeros((count, 0, 2)),
    )  # fmt: skip


def visit(
    listener: Listener,
    spots_m: F64,
    count: int,
    generator: np.random.Generator,
    away_m: float = 0.0,
    turned_rad: float = 0.0,
) -> F32:
    """`count` echo traces of a phone held still at each spot, one spot after another.

    Each time it is held at a place of its own within `away_m`, and turned by `turned_rad`, one
    standard deviation.
    """
    heard = []
    for spot_m in spots_m:
        radius_m, angle = away_m * np.sqrt(generator.uniform()), generator.uniform(0, 2 * np.pi)
        place_m = spot_m + radius_m * np.array([np.cos(angle), np.sin(angle)])
        yaw_rad = turned_rad * generator.standard_normal()
        poses = held_still(place_m, count, generator, yaw_rad=yaw_rad)
        heard.append(hear_at(listener, poses, generator))
    return np.concatenate(heard)


def hear_at(listener: Listener, poses: Poses, generator: np.random.Generator) -> F32:
    """Echo traces (n, 2352) with the phone's noise, of a chirp at each of the poses."""
    device = listener.device
    responses = room_responses(listener.scene, device, poses, listener.air)
    frames = render_frames(responses, listener.chirp, device)
    noise = generator.standard_normal(frames.shape, dtype=np.float32)
    first = round(device.separation_m / SPEED_OF_SOUND_MPS * ECHO_RATE_HZ) + DISCARDED_SAMPLES
    heard = frames + np.float32(device.noise_rms) * noise
    return np.ascontiguousarray(heard[:, first : first + ECHO_SAMPLES])
