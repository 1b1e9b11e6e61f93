"""Several phones in one room: what each hears of every chirp, and what they record in the end.

Each chirps by what it has heard so far, or at will.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.values import ECHO_RATE_HZ, Audio, Chirp, Truth
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import matched_envelope
from elfslam.stages.medium_access import (
    CarrierSense,
    MediumAccessParameters,
    Slot,
    SlotSchedule,
    after_slot,
    hear_slot,
    initial_schedule,
    is_played,
)
from elfslam.world.circumstances import Circumstances, air_on, room_on
from elfslam.world.device import Device, built_in_device
from elfslam.world.interference import rumble
from elfslam.world.paths import Reach
from elfslam.world.phone import (
    Poses,
    Transducers,
    ends_of,
    image_echoes,
    render_frames,
    room_responses,
)
from elfslam.world.pulses import Air
from elfslam.world.recorder import phone_poses
from elfslam.world.scene import Scene, scene_of
from elfslam.world.simulate import truth_of
from elfslam.world.walker import Motion, Walker, random_walker, walk
from elfslam.world.world_file import World

LATENCY_S = (0.012, 0.300)
"""From playing to hearing, constant within a run, another in each phone."""
CLOCK_PPM = 30.0
LEVELS_DB = 3.0
NOISES_RMS = (5e-6, 1e-4)
STEP_S = 0.025
AHEAD_S = 0.06
"""A chirp is put on the clock so long before it leaves the loudspeaker's queue."""
TAIL_S = 0.15
"""Of a slot that has to be heard behind its end."""
JOIN_S = 2.0
"""Phones begin within so long of each other."""


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


def crowd_in(world: World, count: int, seed: int, *, rounds: int = 1) -> Crowd:
    """People who walk the world's route from anywhere on it, each at their own pace.

    Their phones are of one model. The first ones are the same however many follow.
    """
    phones = tuple(
        _walking(world, np.random.default_rng([seed, 9, k]), rounds) for k in range(count)
    )
    return Crowd(
        world, phones, scene_of(room_on(world, Circumstances())), air_on(world, 0),
        make_chirp(ChirpParameters(), ECHO_RATE_HZ), Reach(),
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


def _between(theirs: Transducers, ours: Transducers) -> Transducers:
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


# --- what they record ---


@dataclass
class Phone:
    """One phone while the crowd goes on: its clocks, its slots and its sound so far."""

    generator: np.random.Generator
    begins_s: float
    own: F32
    others: F32
    schedule: SlotSchedule
    listening: CarrierSense
    starts_s: list[float] = field(default_factory=list)
    played_s: dict[int, float] = field(default_factory=dict)
    heard: int = 0


@dataclass(frozen=True, eq=False)
class Overheard:
    """What a phone recorded: its own sound with noise, the others' (n), and when it played (m)."""

    own: F32
    others: F32
    played_t_s: F64
    latency_s: float

    @property
    def audio(self) -> Audio:
        """What the microphone heard."""
        return Audio((self.own + self.others)[None], ECHO_RATE_HZ)


def overhear(
    crowd: Crowd, parameters: MediumAccessParameters, seed: int, *, slotted: bool, seconds: float
) -> list[Overheard]:
    """What each phone of a crowd records, `slotted` by reservation or chirping at will."""
    phones = [_begin(crowd, k, parameters, seed, seconds) for k in range(len(crowd.phones))]
    steps = np.arange(0.0, seconds, STEP_S)
    queue: list[tuple[int, float]] = []
    for now_s in steps:
        for k, phone in enumerate(phones):
            queue += [
                (k, at_s) for at_s in _play(crowd, phone, k, parameters, now_s, slotted=slotted)
            ]
        if slotted or now_s == steps[-1]:
            _sound(crowd, phones, queue)
            queue = []
        if slotted:
            for k, phone in enumerate(phones):
                _listen(crowd, phone, k, parameters, now_s)
    return [
        Overheard(
            phone.own, phone.others, np.array(list(phone.played_s.values())),
            crowd.phones[k].out_s + crowd.phones[k].in_s,
        )
        for k, phone in enumerate(phones)
    ]  # fmt: skip


def _begin(
    crowd: Crowd, k: int, parameters: MediumAccessParameters, seed: int, seconds: float
) -> Phone:
    generator = np.random.default_rng([seed, 10, k])
    count = round((seconds + 1.0) * ECHO_RATE_HZ)
    noise = rumble(count, ECHO_RATE_HZ, generator)
    hiss = crowd.phones[k].device.noise_rms * generator.standard_normal(count, dtype=np.float32)
    silence = np.zeros(count, dtype=np.float32)
    begins_s = float(generator.uniform(0.1, JOIN_S))
    return Phone(
        generator, begins_s, (noise + hiss).astype(np.float32), silence,
        initial_schedule(parameters), CarrierSense(),
    )  # fmt: skip


def _play(
    crowd: Crowd,
    phone: Phone,
    k: int,
    parameters: MediumAccessParameters,
    now_s: float,
    *,
    slotted: bool,
) -> list[float]:
    """When the chirps leave the loudspeaker that are put on the clock now."""
    sounding: list[float] = []
    walking = crowd.phones[k]
    while True:
        slot = len(phone.starts_s)
        start_s = phone.begins_s + slot * crowd.chirp.period_s + phone.schedule.shift_s
        if start_s - AHEAD_S > now_s:
            return sounding
        phone.starts_s.append(start_s)
        if not slotted or is_played(phone.schedule, slot, phone.generator.uniform(), parameters):
            played_s = start_s + phone.generator.uniform(0.0, parameters.jitter_s)
            phone.played_s[slot] = played_s
            sounding.append(played_s / (1 + walking.clock_ppm * 1e-6) + walking.out_s)


def _sound(crowd: Crowd, phones: Sequence[Phone], queue: Sequence[tuple[int, float]]) -> None:
    """Lays what all hear of these chirps into what they recorded."""
    for source in sorted({k for k, _ in queue}):
        at_s = np.array([at for k, at in queue if k == source])
        frames = heard_by_all(crowd, source, at_s)
        for k, phone in enumerate(phones):
            walking = crowd.phones[k]
            stream = phone.own if k == source else phone.others
            heard_s = at_s * (1 + walking.clock_ppm * 1e-6) + walking.in_s
            for start, frame in zip(
                np.round(heard_s * ECHO_RATE_HZ).astype(int), frames[:, k], strict=True
            ):
                room = max(len(stream) - start, 0)
                stream[start : start + len(frame)] += frame[:room]


def _listen(
    crowd: Crowd, phone: Phone, k: int, parameters: MediumAccessParameters, now_s: float
) -> None:
    """What the phone makes of the slots that it has heard whole by now."""
    walking = crowd.phones[k]
    latency_s = walking.out_s + walking.in_s
    period_s = crowd.chirp.period_s
    while phone.heard < len(phone.starts_s):
        slot = phone.heard
        start_s = phone.starts_s[slot] + latency_s
        if start_s + period_s + TAIL_S > now_s:
            return
        due, following = (
            _sample(phone.played_s[each] + latency_s) if each in phone.played_s else None
            for each in (slot, slot + 1)
        )
        there = Slot(_sample(start_s), _sample(start_s + period_s), due, following)
        first = max(there.start - _sample(0.1), 0)
        span = slice(first, there.end + _sample(TAIL_S))
        envelope = matched_envelope(phone.own[span] + phone.others[span], crowd.chirp)
        found, phone.listening = hear_slot(phone.listening, envelope, first, there, parameters)
        middle = there.start + _sample(parameters.jitter_s / 2)
        others_s = [(each - middle) / ECHO_RATE_HZ for each in found]
        draw = phone.generator.uniform()
        phone.schedule = after_slot(
            phone.schedule, slot, others_s, draw, parameters, played=due is not None
        )
        phone.heard += 1


def _sample(t_s: float) -> int:
    return round(t_s * ECHO_RATE_HZ)
