"""A simulated walk with every chirp where a schedule puts it, and an attacker's loudspeaker in it.

The sound of the walk is kept apart from what an attacker adds, so that many attacks are laid over
one walk. The room, its kernels and the phones are those of the simulator.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.values import Audio, Chirp, Imu, Truth
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.world.circumstances import SOUNDS, Circumstances, air_on, device_of, reach_of, room_on
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, BMI160, Device
from elfslam.world.imu import read_imu
from elfslam.world.interference import record, rumble
from elfslam.world.paths import Reach
from elfslam.world.phone import (
    Poses,
    Transducers,
    ends_of,
    image_echoes,
    render_frames,
    room_responses,
)
from elfslam.world.pulses import C64, Air
from elfslam.world.recorder import LATENCY_S, louder, loudness_of_chirps, phone_poses
from elfslam.world.scene import Scene, scene_of
from elfslam.world.simulate import truth_of
from elfslam.world.walker import random_walker, walk
from elfslam.world.world_file import World

RATE_HZ = 44_100
PERIOD = 4_410
PLACED_M = 1.2
"""How high a loudspeaker stands."""


@dataclass(frozen=True, eq=False)
class Walked:
    """One walk: what its phone alone would hear (n samples), and what an attacker needs to know.

    `played` (k) are the samples at which its chirps began; `poses` the phone then. `gain_db` (k) is
    how loud they were against the loudest, None where they were all alike.
    """

    seed: int
    circumstances: Circumstances
    scene: Scene
    air: Air
    reach: Reach
    device: Device
    chirp: Chirp
    played: I64
    gain_db: F64 | None
    poses: Poses
    own: F32
    imu: Imu
    truth: Truth

    @property
    def played_t_s(self) -> F64:
        """When each chirp began to be played (k), up to a constant."""
        return np.asarray(self.played / RATE_HZ)


def walked(
    world: World,
    seed: int,
    rounds: int,
    jitter_s: float,
    circumstances: Circumstances | None = None,
) -> Walked:
    """A walk of so many laps with each chirp at random in the first `jitter_s` of its period.

    By chance chirps are softer where the circumstances say so.
    """
    today = circumstances or Circumstances()
    generator = np.random.default_rng([seed, 1])
    walker = random_walker(generator)
    motion = walk(walker, world.route_m, rounds, generator)
    imu = read_imu(motion, BMI160, generator)
    total = int(motion.t_s[-1] * RATE_HZ)
    latency = round(generator.uniform(*LATENCY_S) * RATE_HZ)
    periods = np.arange(latency, total - 2 * PERIOD, PERIOD)
    offset = np.random.default_rng([seed, 8]).uniform(0.0, jitter_s * RATE_HZ, len(periods))
    played = periods + np.round(offset).astype(np.int64)
    scene, air = scene_of(room_on(world, today)), air_on(world, today.day, lived_in=today.lived_in)
    device, chirp = device_of(today), make_chirp(ChirpParameters(), RATE_HZ)
    poses = phone_poses(walker, motion, world, today.people, seed, played / RATE_HZ)
    heard = room_responses(scene, device, poses, air, reach_of(today))
    uneven_s = device.jitter_s * np.random.default_rng([seed, 6]).standard_normal(len(played))
    frames = render_frames(heard, chirp, device, uneven_s)
    gain_db = loudness_of_chirps(today.softer_db, len(played), seed) if today.softer_db else None
    own = laid(frames if gain_db is None else louder(frames, gain_db), played, total)
    return Walked(
        seed, today, scene, air, reach_of(today), device, chirp, played, gain_db, poses, own, imu,
        truth_of(motion),
    )  # fmt: skip


def laid(sounds: F32, starts: I64, total: int) -> F32:
    """Sounds (k, n) laid down one over the other where each starts, as one stream (total)."""
    stream = np.zeros(total, dtype=np.float32)
    for sound, start in zip(sounds, starts.tolist(), strict=True):
        first, last = max(start, 0), min(start + len(sound), total)
        if first < last:
            stream[first:last] += sound[first - start : last - start]
    return stream


def recorded(
    walked: Walked, added: F32 | None = None, *, own_gain: float = 1.0, since: int = 0
) -> Audio:
    """What the phone records of its own sound, of what was `added` (n), and of the room's noise.

    Its own sound is heard `own_gain` times as loud from sample `since` on.
    """
    generator = np.random.default_rng([walked.seed, 9])
    gain = np.where(np.arange(len(walked.own)) < since, 1.0, own_gain)
    stream = gain * walked.own + rumble(len(walked.own), RATE_HZ, generator)
    if added is not None:
        stream = stream + added
    for k, (name, sound_of) in enumerate(SOUNDS.items()):
        if name in walked.circumstances.sounds:
            noise = np.random.default_rng([walked.seed, 7, k])
            stream = stream + sound_of(len(stream), RATE_HZ, noise)
    return Audio(record(np.asarray(stream, np.float32), walked.device, generator)[None], RATE_HZ)


def to_the_phone(walked: Walked, speaker_m: F64) -> C64:
    """Envelopes (k, 630) of what the phone hears of an impulse at a loudspeaker that stands."""
    ends, count = ends_of(walked.device, walked.poses), len(walked.played)
    ends = ends._replace(
        speaker=np.tile(speaker_m, (count, 1)), speaker_directivity=0.0,
        speaker_velocity=np.zeros((count, 3)), held=False,
    )  # fmt: skip
    return _echoes(walked, ends)


def from_the_phone(walked: Walked, microphone_m: F64) -> C64:
    """Envelopes (k, 630) of what a microphone that stands hears of an impulse at the phone."""
    ends, count = ends_of(walked.device, walked.poses), len(walked.played)
    ends = ends._replace(
        microphone=np.tile(microphone_m, (count, 1)), microphone_directivity=0.0,
        microphone_velocity=np.zeros((count, 3)), held=False,
    )  # fmt: skip
    return _echoes(walked, ends)


def _echoes(walked: Walked, ends: Transducers) -> C64:
    return image_echoes(walked.scene, ends, walked.poses.people_m, walked.air, walked.reach)


def through_room(walked: Walked, sent: F32, envelopes: C64) -> F32:
    """What is heard (n) of a stream that is sent (n) by a way that each chirp finds changed.

    The band of 14.35 to 20.65 kHz alone passes.
    """
    heard = np.zeros(len(sent) + 2 * PERIOD, dtype=np.float32)
    for k, start in enumerate(range(0, len(sent) - PERIOD, PERIOD)):
        block = sent[start : start + PERIOD]
        if block.any():
            now = min(k, len(envelopes) - 1)
            heard[start : start + 2 * PERIOD] += _passed(block, impulse_response(envelopes[now]))
    return heard[: len(sent)]


def _passed(block: F32, response: F32) -> F32:
    size = 2 * PERIOD
    return np.asarray(fft.irfft(fft.rfft(block, size) * fft.rfft(response, size), size))


def impulse_response(envelope: C64) -> F32:
    """The response (4410) at 44.1 kHz that an envelope (630) about 17.5 kHz stands for."""
    spectrum = np.zeros(PERIOD // 2 + 1, dtype=np.complex64)
    first = round(BAND_LOW_HZ / BIN_HZ)
    spectrum[first : first + BAND_BINS] = fft.fftshift(fft.fft(envelope))
    return np.asarray(fft.irfft(spectrum, PERIOD), dtype=np.float32)
