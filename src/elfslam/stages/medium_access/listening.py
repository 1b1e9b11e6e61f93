"""Carrier sensing slot by slot: when other phones chirped, from what was heard so far."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F32
from elfslam.base.values import ECHO_RATE_HZ
from elfslam.stages.medium_access.foreign import BIN, GUARD, LULL, Loud, beginnings, pooled
from elfslam.stages.medium_access.parameters import MediumAccessParameters

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
