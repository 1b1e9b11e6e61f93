"""Phones that chirp in one room, each by what it has heard so far: what they hear in the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.values import ECHO_RATE_HZ, Audio
from elfslam.line.echo import matched_envelope
from elfslam.line.medium_access import (
    CarrierSense,
    MediumAccessParameters,
    Slot,
    SlotSchedule,
    after_slot,
    hear_slot,
    initial_schedule,
    is_played,
)
from elfslam.world.interference import rumble
from studies.crowd import Crowd, heard_by_all

STEP_S = 0.025
AHEAD_S = 0.06
"""A chirp is put on the clock so long before it leaves the loudspeaker's queue."""
TAIL_S = 0.15
"""Of a slot that has to be heard behind its end."""
JOIN_S = 2.0
"""Phones begin within so long of each other."""


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
