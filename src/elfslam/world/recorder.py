"""The sound of a walk: every chirp's frame laid down where it was played, and all other noise."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import fft

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Chirp
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world import phone
from elfslam.world.circumstances import (
    SOUNDS,
    Circumstances,
    air_on,
    device_of,
    engine_of,
    reach_of,
    room_on,
    whereabouts,
)
from elfslam.world.device import BAND_BINS, Device
from elfslam.world.interference import record, rumble
from elfslam.world.paths import Reach
from elfslam.world.pulses import BASEBAND_HZ, C64, Air
from elfslam.world.scene import Scene, scene_of
from elfslam.world.transducers import controlled
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion, Walker
from elfslam.world.world_file import World

LATENCY_S = (0.012, 0.090)
"""Offset from playing to recording: constant within a run, another in each."""
BLOCK = 200
"""Chirps at a time."""
OTHER_CLOCK_PPM = 40.0
OTHER_HEIGHT_M = 1.2


@dataclass(frozen=True)
class Stage:
    """What the frames of one recording have in common."""

    scene: Scene
    air: Air
    device: Device
    chirp: Chirp
    engine: phone.Engine
    reach: Reach


def stage_of(world: World, circumstances: Circumstances, rate_hz: int, threads: int) -> Stage:
    """What the frames have in common that are heard in a world; rendered on so many threads."""
    room = room_on(world, circumstances)
    return Stage(
        scene_of(room), air_on(world, circumstances.day, lived_in=circumstances.lived_in),
        device_of(circumstances), make_chirp(ChirpParameters(), rate_hz),
        engine_of(circumstances, room, threads), reach_of(circumstances),
    )  # fmt: skip


class WorldVisit(NamedTuple):
    """From when on a walk is in which world, and what else is so there."""

    from_s: float
    world: World
    circumstances: Circumstances


def record_walk(
    world: World,
    circumstances: Circumstances,
    walker: Walker,
    motion: Motion,
    rate_hz: int,
    seed: int,
    generator: np.random.Generator,
    progress: Callable[[float], None],
) -> tuple[Audio, F64, F64]:
    """What the phone records on its way, as one continuous stream.

    Besides when it played each chirp (n, s), and how loud against the loudest (n, dB).
    """
    visits = [WorldVisit(0.0, world, circumstances)]
    return record_visits(visits, walker, motion, rate_hz, seed, generator, progress)


def record_visits(
    visits: Sequence[WorldVisit],
    walker: Walker,
    motion: Motion,
    rate_hz: int,
    seed: int,
    generator: np.random.Generator,
    progress: Callable[[float], None],
) -> tuple[Audio, F64, F64]:
    """What the phone records on its way from world to world, as `record_walk`.

    Phone, jitter and sounds are those of the first visit. Heights are above the floor of each.
    """
    circumstances = visits[0].circumstances
    latency = round(generator.uniform(*LATENCY_S) * rate_hz)
    total, frame = int(motion.t_s[-1] * rate_hz), round(phone.FRAME_S * rate_hz)
    starts = _within_periods(np.arange(latency, total - frame, frame), circumstances, rate_hz, seed)
    stream = np.zeros(total, dtype=np.float32)
    device = device_of(circumstances)
    jitter_s = device.jitter_s * np.random.default_rng([seed, 6]).standard_normal(len(starts))
    covered_db = covered_at(motion, starts / rate_hz)
    gain_db = loudness_of_chirps(circumstances.softer_db, len(starts), seed)
    edges = np.searchsorted(starts / rate_hz, [visit.from_s for visit in visits[1:]])
    for visit, rows in zip(visits, np.split(np.arange(len(starts)), edges), strict=True):
        stage = stage_of(visit.world, visit.circumstances, rate_hz, os.cpu_count() or 1)
        people, t_s = visit.circumstances.people, starts[rows] / rate_hz
        poses = phone_poses(walker, motion, visit.world, people, seed, t_s)
        if visit.circumstances.engine == "pyroomacoustics":
            poses = replace(poses, velocity_mps=np.zeros_like(poses.velocity_mps))
        for first in range(0, len(rows), BLOCK):
            part = slice(first, first + BLOCK)
            block = rows[part]
            heard = phone.room_responses(
                stage.scene, stage.device, _rows(poses, part), stage.air, stage.reach, stage.engine
            )
            heard = port_occlusion(heard, covered_db[block])
            sound = phone.render_frames(heard, stage.chirp, stage.device, jitter_s[block])
            _lay_down(stream, starts[block], louder(sound, gain_db[block]))
            progress((block[-1] + 1) / len(starts))
        for k in range(visit.circumstances.other_phones):
            other = np.random.default_rng([seed, 5, k])
            _add_other_phone(stream, stage, visit.world, poses, starts[rows], other)
    stream += rumble(total, rate_hz, generator)
    for k, (name, sound_of) in enumerate(SOUNDS.items()):
        if name in circumstances.sounds:
            stream += sound_of(total, rate_hz, np.random.default_rng([seed, 7, k]))
    recorded = record(stream, device, generator)
    loud = controlled(recorded, device.gain_control, rate_hz, device.clip_level)
    return Audio(loud[None, :], rate_hz), np.asarray((starts - latency) / rate_hz), gain_db


def loudness_of_chirps(softer_db: float, count: int, seed: int) -> F64:
    """How loud each chirp (count) is played (dB): by chance at full level or so much softer."""
    is_soft = np.random.default_rng([seed, 24]).uniform(size=count) < 0.5
    return np.where(is_soft, -softer_db, 0.0)


def louder(sounds: F32, gain_db: F64) -> F32:
    """Sounds (n, samples), each by so many dB (n) louder."""
    return np.asarray(sounds * (10 ** (gain_db / 20))[:, None].astype(np.float32))


def _within_periods(starts: I64, circumstances: Circumstances, rate_hz: int, seed: int) -> I64:
    """Starts at a random moment of each period, none in the last that would outlast the walk."""
    if circumstances.jitter_s == 0:
        return starts
    offsets_s = np.random.default_rng([seed, 8]).uniform(0, circumstances.jitter_s, len(starts))
    return np.asarray(starts[:-1] + np.round(offsets_s[:-1] * rate_hz).astype(np.int64))


def _lay_down(stream: F32, starts: I64, sounds: F32) -> None:
    for start, sound in zip(starts, sounds, strict=True):
        stream[start : start + len(sound)] += sound


def phone_poses(
    walker: Walker, motion: Motion, world: World, people: int, seed: int, t_s: F64
) -> phone.Poses:
    """The phone at each of the times, and who else is about."""
    at = _samples_at(motion, t_s)
    velocity = np.gradient(motion.position_m, 1 / KINEMATICS_RATE_HZ, axis=0)[at]
    axes = phone.phone_axes(motion.yaw_rad[at], motion.pitch_rad[at], motion.roll_rad[at])
    position = motion.position_m[at]
    others = whereabouts(world, people, seed, t_s, position[:, :2])
    return phone.Poses(position, axes, velocity, np.full(len(at), walker.body_distance_m), others)


def covered_at(motion: Motion, t_s: F64) -> F64:
    """What a hand takes of the sound at the loudspeaker (n, dB) at each of the times."""
    if motion.covered_db is None:
        return np.zeros(len(t_s))
    return np.asarray(motion.covered_db[_samples_at(motion, t_s)])


def _samples_at(motion: Motion, t_s: F64) -> I64:
    return np.asarray(np.minimum((t_s * KINEMATICS_RATE_HZ).astype(int), len(motion.t_s) - 1))


def _rows(poses: phone.Poses, rows: slice | I64) -> phone.Poses:
    return phone.Poses(
        poses.position_m[rows], poses.world_from_phone[rows], poses.velocity_mps[rows],
        poses.body_distance_m[rows], poses.people_m[rows],
    )  # fmt: skip


def _add_other_phone(
    stream: F32,
    stage: Stage,
    world: World,
    poses: phone.Poses,
    starts: I64,
    generator: np.random.Generator,
) -> None:
    """Adds what is heard of somebody who stands in the room and chirps by a clock of their own."""
    frame = round(phone.FRAME_S * stage.chirp.rate_hz)
    speaker = np.append(_standing_place(world, generator), OTHER_HEIGHT_M)
    offset = int(generator.integers(frame))
    drift = 1 + generator.normal(0, OTHER_CLOCK_PPM) * 1e-6
    for first in range(0, len(starts) - 1, BLOCK):
        rows = np.arange(first, min(first + BLOCK, len(starts) - 1))
        own = _rows(poses, rows)
        ends = _between(stage.device, own, speaker)
        heard = stage.engine(stage.scene, ends, own.people_m, stage.air, stage.reach)
        sounds = phone.render_frames(heard, stage.chirp, stage.device)
        for row, sound in zip(rows, sounds, strict=True):
            begin = int(starts[0] + offset + row * frame * drift)
            stream[begin : begin + frame] += sound[: max(len(stream) - begin, 0)]


def _between(device: Device, poses: phone.Poses, speaker_m: F64) -> phone.Transducers:
    """The other phone's speaker, which sounds alike in all directions, and our microphone."""
    ends, count = phone.ends_of(device, poses), len(poses.position_m)
    return ends._replace(
        speaker=np.tile(speaker_m, (count, 1)),
        speaker_directivity=0.0,
        speaker_lobe_share=0.0,
        speaker_velocity=np.zeros((count, 3)),
        held=False,
    )


def _standing_place(world: World, generator: np.random.Generator) -> F64:
    low, size = world.room.corner_m, world.room.size_m[:2]
    for _ in range(1000):
        place = low + generator.uniform(0.0, 1.0, 2) * size
        if world.room.is_free(place[None], OTHER_HEIGHT_M, 0.3)[0]:
            return np.asarray(place)
    raise InputError(f"world {world.name!r}: no free place for another phone; leave it out")


COVER_TILT_PER_HZ = 0.3 / 2_500.0
"""Of the loss in dB: 0.7 of it at 15 kHz, 1.3 at 20. An estimate: fingers and cases leave slits,
which let the longer waves pass."""


def port_occlusion(envelopes: C64, covered_db: F64) -> C64:
    """Envelopes (n, 630) of what passes a port that so much (n, dB at 17.5 kHz) is taken from.

    Without any cover they are those given.
    """
    rows = np.flatnonzero(covered_db)
    if not len(rows):
        return envelopes
    from_carrier_hz = fft.fftfreq(BAND_BINS, 1 / BASEBAND_HZ)
    loss_db = np.multiply.outer(covered_db[rows], 1 + COVER_TILT_PER_HZ * from_carrier_hz)
    gain = (10 ** (-loss_db / 20)).astype(np.float32)
    out = envelopes.copy()
    out[rows] = fft.ifft(fft.fft(envelopes[rows], axis=1) * gain, axis=1)
    return out
