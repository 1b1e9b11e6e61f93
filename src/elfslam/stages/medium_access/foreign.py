"""Interference detection: sound like a direct arrival where no chirp of ours is due.

Before a direct arrival and once its echoes are over nothing of ours is heard: what is loud there is
somebody else's. As all play at random moments of their slots, the second of two that chirp in one
slot hears the first there. Within a frame its own echoes are loud, too, but change little from
frame to frame: what stands out over the same moment of the frames around is somebody else's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from elfslam.base.arrays import F32, I64, Bool
from elfslam.base.values import ECHO_RATE_HZ
from elfslam.stages.medium_access.parameters import MediumAccessParameters

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
