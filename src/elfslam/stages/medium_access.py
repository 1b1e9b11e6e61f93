"""Slotted medium access: which phone chirps when, and how others are heard.

Listening right before a chirp tells little, as a phone hears 12 to 500 ms late. But turns repeat
from round to round, so what was heard in a slot some rounds ago tells who will chirp in it. A phone
alone has all slots. It keeps silent in one now and then and listens, more often once others were
heard: two that chirp at once mostly hear themselves first. Where two are heard in one slot each
may give it up, sooner who has more of them; where nobody is heard for some rounds each may take it,
sooner who has fewer. That is reservation ALOHA (Crowther et al., 1973) with chances that even out
the shares. Slots have no common clock: each phone moves its own towards the others' it hears.

Interference is sound like a direct arrival where no chirp of ours is due. Before a direct arrival
and once its echoes are over nothing of ours is heard: what is loud there is somebody else's. As all
play at random moments of their slots, the second of two that chirp in one slot hears the first
there. Within a frame its own echoes are loud, too, but change little from frame to frame: what
stands out over the same moment of the frames around is somebody else's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy import ndimage

from elfslam.base.arrays import F32, I64, Bool
from elfslam.base.parameters import parameter
from elfslam.base.values import ECHO_RATE_HZ


@dataclass(frozen=True)
class MediumAccessParameters:
    """Rounds of slots, of which each phone keeps its share; a slot is a period of the chirp."""

    jitter_s: float = parameter(
        0.025, "s", "a chirp is played at a random moment of so much of its slot", 0.0, 0.03
    )
    softer_db: float = parameter(
        4.0, "dB", "a chirp is by chance as loud as can be or so much softer", 0.0, 20.0
    )
    slots: int = parameter(8, "", "slots of a round, after which turns repeat", 1, 64)
    listen: int = parameter(8, "", "slots to listen before the first chirp", 1, 100)
    forget: int = parameter(
        100, "", "slots without another phone after which one is alone", 1, 10_000
    )
    check: float = parameter(
        0.3, "", "chance to keep silent in an own slot and listen, when it is new", 0.0, 1.0
    )
    check_least: float = parameter(
        0.08, "", "the same for one in which nobody was heard time and again", 0.0, 1.0
    )
    check_alone: float = parameter(
        0.05,
        "",
        "the same for who heard nobody for long: that is how a newcomer is noticed",
        0.0,
        1.0,
    )
    free_after: int = parameter(
        2, "", "rounds without another phone after which a slot is free", 1, 20
    )
    claim: float = parameter(
        0.5, "", "chance to take a free slot for who has none; less for who has more", 0.01, 1.0
    )
    keep: float = parameter(
        0.5,
        "",
        "of m slots one is given up with chance m / (m + keep) where it is disputed",
        0.1,
        100.0,
    )
    challenge: float = parameter(
        0.05, "", "chance of who has no slot to take one that is not free", 0.0, 1.0
    )
    stir: float = parameter(
        0.01,
        "",
        "chance to give up a slot for nothing, for who has all: it evens out the shares",
        0.0,
        1.0,
    )
    follow: float = parameter(
        0.05, "", "share of another phone's lead that the own slots follow", 0.0, 1.0
    )
    contrast: float = parameter(
        3.0, "", "another's chirp over the same moment of the frames around", 1.0, 1000.0
    )
    share: float = parameter(
        0.006, "", "another's chirp over the own direct sound, at the least", 1e-4, 1.0
    )
    frames: int = parameter(2, "", "frames before and behind that say what is usual", 1, 20)


Value = TypeVar("Value")


@dataclass(frozen=True)
class SlotSchedule:
    """Whose turn it is, by slot of the round, and what it was learnt from.

    `mine`: whether the slot is ours; `quiet`: rounds since another phone was heard in it; `sure`:
    how often we kept silent in it, as it is ours, and heard nobody. `alone` counts slots since
    another was heard at all; `shift_s` is how far the own slots have moved.
    """

    mine: tuple[bool, ...]
    quiet: tuple[int, ...]
    sure: tuple[int, ...]
    alone: int
    shift_s: float = 0.0


def initial_schedule(parameters: MediumAccessParameters) -> SlotSchedule:
    """Where everybody begins: listening."""
    nothing = (0,) * parameters.slots
    return SlotSchedule(
        (False,) * parameters.slots, nothing, nothing, parameters.forget - parameters.listen
    )


def is_played(
    schedule: SlotSchedule, slot: int, draw: float, parameters: MediumAccessParameters
) -> bool:
    """Whether to chirp in a slot, counted from the beginning; `draw` is uniform in [0, 1)."""
    if schedule.alone >= parameters.forget:
        return draw >= parameters.check_alone
    k = slot % parameters.slots
    silent = max(parameters.check / (1 + schedule.sure[k]), parameters.check_least)
    return schedule.mine[k] and draw >= silent


def after_slot(
    schedule: SlotSchedule,
    slot: int,
    others_s: Sequence[float],
    draw: float,
    parameters: MediumAccessParameters,
    *,
    played: bool,
) -> SlotSchedule:
    """What is known once a slot has been heard.

    `others_s` are the moments of other phones' chirps in it, counted from the middle of where the
    own would be played; `played` whether there was an own one. `draw` is uniform in [0, 1).
    """
    k, met = slot % parameters.slots, len(others_s) > 0
    now = replace(
        schedule,
        quiet=_with(schedule.quiet, k, 0 if met else schedule.quiet[k] + 1),
        alone=0 if met else schedule.alone + 1,
        shift_s=schedule.shift_s + parameters.follow * float(np.sum(others_s)),
    )
    if now.alone >= parameters.forget:
        every = (True,) * parameters.slots
        return replace(now, mine=every, sure=(0,) * parameters.slots)
    kept = _is_kept(now, k, draw, parameters)
    checked = schedule.mine[k] and kept and not met and not played
    sure = schedule.sure[k] + 1 if checked else schedule.sure[k] * int(kept and not met)
    return replace(now, mine=_with(now.mine, k, kept), sure=_with(now.sure, k, sure))


def _is_kept(
    schedule: SlotSchedule, k: int, draw: float, parameters: MediumAccessParameters
) -> bool:
    """Whether a slot that was just heard is ours from now on."""
    own = sum(schedule.mine)
    if schedule.mine[k]:
        if schedule.quiet[k] == 0:
            return draw >= own / (own + parameters.keep)
        return draw >= parameters.stir * own / parameters.slots
    if schedule.quiet[k] >= parameters.free_after:
        return draw < parameters.claim / (1 + own)
    return own == 0 and draw < parameters.challenge


def _with(values: tuple[Value, ...], k: int, value: Value) -> tuple[Value, ...]:
    return (*values[:k], value, *values[k + 1 :])


BIN = 16
"""Samples of the envelope of which the largest stands for all."""
GUARD = 12
"""Bins before a direct arrival in which the matched filter hears it already, 4.4 ms."""
DIRECT = 6
"""Bins behind a direct arrival in which nothing else is heard, 2.2 ms."""
FRAME = 178
"""Bins behind a direct arrival in which its echoes are kept, 64.6 ms."""
LULL = 193
"""Bins behind a direct arrival after which its echoes are over, 70 ms."""
QUIET = 55
"""Bins before a direct arrival: another's chirp there still sounds in its echoes, 20 ms."""
WIDER = 3
"""Bins by which an echo may move from frame to frame, 1.1 ms: the walker goes on."""
NEAR_S = 0.45
"""Frames further apart are too different to be compared."""
FEWEST = 2
"""Frames before one can tell what is usual."""
SAME = 165
"""Bins in which another's chirp echoes, 60 ms."""
LOUDEST_ECHO, FADES = 2.0, 0.05
"""An echo over the direct sound of another's chirp, at first; and how much is left at the end."""

Loud = tuple[int, float]
"""Where another's chirp begins, and its level."""


def pooled(envelope: F32, first: int, bins: int) -> F32:
    """The largest of every 16 samples from `first` on (bins); zero beyond the ends."""
    out = np.zeros(max(bins, 0) * BIN, dtype=np.float32)
    low, high = max(first, 0), min(first + len(out), len(envelope))
    if low < high:
        out[low - first : high - first] = envelope[low:high]
    return np.asarray(out.reshape(-1, BIN).max(axis=1))


def beginnings(bins: F32, least: float, before: Sequence[Loud] = ()) -> list[Loud]:
    """Where others' chirps begin in bins (b) where none of ours is heard: bin and level of each.

    `before` are those that were heard before, their bins counted from the first of these. What is
    no louder than their echoes may be is one.
    """
    found = list(before)
    for k in np.flatnonzero(bins > least).tolist():
        level = float(bins[k])
        if len(found) > len(before) and k - found[-1][0] <= DIRECT:
            found[-1] = (k, level) if level > found[-1][1] else found[-1]
        elif level > max((_echo(loud, k) for loud in found), default=0.0):
            found.append((k, level))
    return found[len(before) :]


def _echo(chirp: Loud, k: int) -> float:
    """How loud another's chirp may still echo at bin k."""
    begin, level = chirp
    return float(LOUDEST_ECHO * level * FADES ** ((k - begin) / SAME)) if k - begin < SAME else 0.0


def spoiled_frames(envelope: F32, arrivals: I64, parameters: MediumAccessParameters) -> Bool:
    """Which frames (n) other phones chirped into, by what is heard before them and in them."""
    frames = [pooled(envelope, int(each) + DIRECT * BIN, FRAME - DIRECT) for each in arrivals]
    wide = [widened(frame) for frame in frames]
    spoiled = np.zeros(len(arrivals), dtype=np.bool_)
    for k, arrival in enumerate(arrivals.tolist()):
        direct = float(envelope[arrival])
        near = [wide[each] for each in _near(arrivals, k, parameters.frames)]
        over = len(near) >= FEWEST and stands_out(frames[k], near, direct, parameters)
        last = int(arrivals[k - 1]) if k else arrival - 10 * LULL * BIN
        begin = max(arrival - QUIET * BIN, last + LULL * BIN)
        quiet = pooled(envelope, begin, (arrival - begin) // BIN - GUARD)
        spoiled[k] = over or bool((quiet > parameters.share * direct).any())
    return spoiled


def widened(bins: F32) -> F32:
    """The largest of the bins around each: what may be heard there in the next frame."""
    return np.asarray(ndimage.maximum_filter1d(bins, 2 * WIDER + 1, mode="nearest"))


def stands_out(
    frame: F32, near: list[F32], direct: float, parameters: MediumAccessParameters
) -> bool:
    """Whether a frame (b) has what the widened frames around it have not."""
    usual = np.median(np.stack(near), axis=0)
    loud = (frame > parameters.contrast * usual) & (frame > parameters.share * direct)
    return bool(loud.any())


def _near(arrivals: I64, k: int, count: int) -> list[int]:
    """The frames before and behind that are close in time, so many at most each way."""
    others = [*range(max(k - count, 0), k), *range(k + 1, min(k + 1 + count, len(arrivals)))]
    reach = NEAR_S * ECHO_RATE_HZ
    return [each for each in others if abs(int(arrivals[each]) - int(arrivals[k])) < reach]


SLACK = 88
"""Samples about where a direct arrival is due, 2 ms."""
LATE = round(0.0625 * ECHO_RATE_HZ)
"""What is heard later than that behind the beginning of a slot belongs to the next."""


NOISE = 6.0
"""Another's chirp over the noise, which is the typical level of the quietest of some stretches."""
STRETCHES = 16
LOST = 1e-6
"""A stretch more silent than that beside the own direct sound was lost, and tells of no noise."""
REMEMBERED = 8


@dataclass(frozen=True)
class CarrierSense:
    """How loud the own direct sound was last; up to which sample all was listened to.

    `others` are the last chirps of others, sample and level; those from `limit` on belong to the
    next slot. `noises` are the typical levels of the last stretches.
    """

    direct: float = 0.0
    until: int | None = None
    limit: int = 0
    others: tuple[Loud, ...] = ()
    noises: tuple[float, ...] = ()


@dataclass(frozen=True)
class Slot:
    """A slot on the axis of samples: where it begins and ends.

    `due` is where the direct sound of the own chirp is due in it, `following` where that of the
    next slot is; None where there is none.
    """

    start: int
    end: int
    due: int | None
    following: int | None


def hear_slot(
    listening: CarrierSense,
    envelope: F32,
    first: int,
    slot: Slot,
    parameters: MediumAccessParameters,
) -> tuple[tuple[int, ...], CarrierSense]:
    """Samples at which others' chirps arrived in a slot, where the own one leaves silence.

    `first` is the sample at which the envelope (n) begins; it has to reach back to what was not
    listened to yet, and forward to the end of the slot.
    """
    now = listening if listening.until is not None else replace(listening, until=slot.start)
    if slot.due is not None:
        arrival = _arrival(envelope, slot.due - first) + first
        now = replace(now, direct=float(envelope[arrival - first]))
        now = _in_silence(now, envelope, first, arrival - GUARD * BIN, parameters)
        now = replace(now, until=arrival + LULL * BIN)
    end = slot.end if slot.following is None else slot.following - SLACK - GUARD * BIN
    now = _in_silence(now, envelope, first, min(end, slot.end), parameters)
    limit = slot.start + LATE
    here = tuple(sample for sample, _ in now.others if listening.limit <= sample < limit)
    return here, replace(now, limit=limit)


def _in_silence(
    now: CarrierSense, envelope: F32, first: int, end: int, parameters: MediumAccessParameters
) -> CarrierSense:
    """Listens up to a sample; nothing of ours is heard until then."""
    assert now.until is not None
    begin = now.until
    bins = pooled(envelope, begin - first, (end - begin) // BIN)
    if not len(bins):
        return now
    level = float(np.median(bins))
    noises = (*now.noises, level)[-STRETCHES:] if level > LOST * now.direct else now.noises
    least = max(parameters.share * now.direct, NOISE * min(noises, default=0.0))
    before = [((sample - begin) // BIN, level) for sample, level in now.others]
    found = beginnings(bins, least, before)
    others = (*now.others, *((begin + k * BIN, level) for k, level in found))[-REMEMBERED:]
    return replace(now, until=begin + len(bins) * BIN, others=others, noises=noises)


def _arrival(envelope: F32, due: int) -> int:
    low = max(due - SLACK, 0)
    return low + int(np.argmax(envelope[low : due + SLACK + 1]))
