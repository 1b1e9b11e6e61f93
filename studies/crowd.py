"""Several phones in one room: what each of them hears of every chirp, its own and the others'."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.values import Chirp, Truth
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.world.circumstances import Circumstances, air_on, room_on
from elfslam.world.device import Device, built_in_device
from elfslam.world.paths import Reach
from elfslam.world.phone import Ends, Poses, ends_of, image_echoes, render_frames, room_responses
from elfslam.world.pulses import Air
from elfslam.world.recorder import phone_poses
from elfslam.world.scene import Scene, scene_of
from elfslam.world.simulate import truth_of
from elfslam.world.walker import Motion, Walker, random_walker, walk
from elfslam.world.world_file import World


@dataclass(frozen=True, eq=False)
class Walking:
    """Somebody who walks with a phone, and what the time through it takes.

    Sound takes `out_s` from being played to leaving the loudspeaker and `in_s` from the microphone
    to being heard; the phone's clock runs fast by `clock_ppm`.
    """

    walker: Walker
    motion: Motion
    device: Device
    out_s: float
    in_s: float
    clock_ppm: float

    @property
    def truth(self) -> Truth:
        """Where they were."""
        return truth_of(self.motion)


@dataclass(frozen=True, eq=False)
class Crowd:
    """Phones in a room, and the room."""

    world: World
    phones: tuple[Walking, ...]
    scene: Scene
    air: Air
    chirp: Chirp
    reach: Reach


LATENCY_S = (0.012, 0.300)
"""From playing to hearing, constant within a run, another in each phone."""
CLOCK_PPM = 30.0
LEVELS_DB = 3.0
NOISES_RMS = (5e-6, 1e-4)


def crowd_in(
    world: World, count: int, seed: int, *, rounds: int = 1, rate_hz: int = 44_100
) -> Crowd:
    """People who walk the world's route from anywhere on it, each at their own pace.

    Their phones are of one model. The first ones are the same however many follow.
    """
    phones = tuple(
        _walking(world, np.random.default_rng([seed, 9, k]), rounds) for k in range(count)
    )
    return Crowd(
        world, phones, scene_of(room_on(world, Circumstances())), air_on(world, 0),
        make_chirp(ChirpParameters(), rate_hz), Reach(),
    )  # fmt: skip


def _walking(world: World, generator: np.random.Generator, rounds: int) -> Walking:
    walker = random_walker(generator)
    route_m = np.roll(world.route_m, int(generator.integers(len(world.route_m))), axis=0)
    motion = walk(walker, route_m, rounds, generator)
    latency_s, share = generator.uniform(*LATENCY_S), generator.uniform(0.2, 0.8)
    device = _of_one_model(generator)
    ppm = generator.uniform(-CLOCK_PPM, CLOCK_PPM)
    return Walking(walker, motion, device, share * latency_s, (1 - share) * latency_s, ppm)


def _of_one_model(generator: np.random.Generator) -> Device:
    """Phones of one model differ in level and noise."""
    usual = built_in_device("simulated phone")
    level = usual.level * 10 ** (generator.uniform(-LEVELS_DB, LEVELS_DB) / 20)
    noise_rms = float(np.exp(generator.uniform(*np.log(NOISES_RMS))))
    return replace(usual, level=level, noise_rms=noise_rms)


def alone(crowd: Crowd, phone: int) -> Crowd:
    """The same room with one of the phones."""
    return replace(crowd, phones=(crowd.phones[phone],))


def heard_by_all(crowd: Crowd, source: int, at_s: F64) -> F32:
    """What every phone hears (chirps, phones, frame) of one phone's chirps that sound at times.

    Row [k, j] begins when chirp k leaves the loudspeaker. Of its own chirps a phone hears the
    direct sound through its body, too.
    """
    poses = [
        phone_poses(phone.walker, phone.motion, crowd.world, 0, 0, at_s) for phone in crowd.phones
    ]
    return np.stack(
        [
            _own(crowd, source, poses) if j == source else _across(crowd, source, j, poses)
            for j in range(len(poses))
        ],
        axis=1,
    )


def _own(crowd: Crowd, phone: int, poses: list[Poses]) -> F32:
    device = crowd.phones[phone].device
    about = _about(poses, [phone])
    own = replace(poses[phone], people_m=about)
    heard = room_responses(crowd.scene, device, own, crowd.air, crowd.reach)
    return render_frames(heard, crowd.chirp, device)


def _across(crowd: Crowd, source: int, to: int, poses: list[Poses]) -> F32:
    """The body of who hears dampens what comes from behind; that of who chirps is left out."""
    ours, theirs = crowd.phones[to].device, crowd.phones[source].device
    ends = _between(ends_of(theirs, poses[source]), ends_of(ours, poses[to]))
    about = _about(poses, [source, to])
    heard = image_echoes(crowd.scene, ends, about, crowd.air, crowd.reach)
    # A response is that of loudspeaker and microphone together: half of each in decibels.
    response = np.sqrt(ours.response * theirs.response)
    return render_frames(heard, crowd.chirp, replace(theirs, response=response))


def _between(theirs: Ends, ours: Ends) -> Ends:
    return ours._replace(
        speaker=theirs.speaker,
        speaker_axis=theirs.speaker_axis,
        speaker_velocity=theirs.speaker_velocity,
        speaker_directivity=theirs.speaker_directivity,
        held=False,
    )


def _about(poses: list[Poses], without: list[int]) -> F64:
    """Where the others stand (n, people, 2), behind their phones."""
    count = len(poses[0].position_m)
    others = [
        pose.position_m[:, :2] - pose.body_distance_m[:, None] * _level(pose.world_from_phone)
        for k, pose in enumerate(poses)
        if k not in without
    ]
    return np.stack(others, axis=1) if others else np.zeros((count, 0, 2))


def _level(world_from_phone: F64) -> F64:
    """Which way is forward in plan (n, 2)."""
    ahead = world_from_phone[:, :2, 1]
    return np.asarray(ahead / np.linalg.norm(ahead, axis=1, keepdims=True))
