"""The direct arrivals of chirps of which it is known when they were played.

Sound takes its time from playing to hearing, the same for all chirps until something jumps. Where
most chirps of a stretch arrive after one and the same time, that is it: a schedule that is random
within the period fits its own chirps alone, and only whole periods apart where it is regular.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32, F64, I64, Bool
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_RATE_HZ
from elfslam.stages.echo.arrivals import Arrivals, check_search, earliest, sounding, strongest
from elfslam.stages.echo.parameters import EchoParameters

STRETCH = 32
"""Chirps that tell together how late they arrive."""
STRETCHES = 16
"""So many are looked at for the clearest, from which the search begins."""
RECENT = 5
"""The median of so many arrivals says when the next one is due."""
ABOUT_AS_CLEAR = 0.95
PATIENCE = 8
"""Missed chirps until the time from playing to hearing is searched anew."""


@dataclass(frozen=True)
class Search:
    """What does not change while arrivals are followed; all in samples."""

    envelope: F32
    played: I64
    slack: int
    early: int
    early_share: float
    reach: int
    level: float


def find_scheduled(
    envelope: F32, played_t_s: F64, period: int, parameters: EchoParameters
) -> tuple[Arrivals, I64, I64]:
    """Direct arrivals, when each played chirp was due (m), and the row of its arrival (m) or -1.

    `period` (samples) tells whether the search goes too far. Raises InputError where the sound
    does not hold the chirps that were played, ParameterError as `find_arrivals`.
    """
    slack = round(parameters.slack_s * ECHO_RATE_HZ)
    early = round(parameters.early_s * ECHO_RATE_HZ)
    check_search(slack + early, len(envelope), period)
    played = np.round(played_t_s * ECHO_RATE_HZ).astype(np.int64)
    reach = round(parameters.latest_s * ECHO_RATE_HZ)
    first, late, peak = _clearest_stretch(envelope, played, reach, slack)
    floor = float(np.median(envelope))
    if peak < parameters.contrast * max(floor, 1e-9):
        raise InputError(
            "audio: no chirps when the schedule says that they were played; check that chirps.csv "
            "belongs to this sound, turn the media volume up, and record again"
        )
    level = parameters.level_share * peak
    search = Search(envelope, played, slack, early, parameters.early_share, reach, level)
    behind = _follow(search, range(first, len(played)), late)
    before = _follow(search, range(first - 1, -1, -1), late)
    late_by, arrived = (np.concatenate([b[::-1], a]) for b, a in zip(before, behind, strict=True))
    due = (played + late_by)[_in_sound(played + late_by, envelope, period)]
    _check_heard(arrived, len(due), parameters)
    return _arrivals_of(played, late_by, arrived, slack)


def _clearest_stretch(envelope: F32, played: I64, reach: int, slack: int) -> tuple[int, int, float]:
    """First chirp of the stretch that shows best how late it arrives, how late, and its level."""
    firsts = np.unique(np.linspace(0, max(len(played) - STRETCH, 0), STRETCHES).astype(int))
    half = reach // 2
    seen = [
        (*_lateness(envelope, played[first : first + STRETCH], half, half, slack), int(first))
        for first in firsts
    ]
    late, peak, first = max(seen, key=lambda each: each[1])
    return first, late, peak


def _lateness(envelope: F32, played: I64, about: int, reach: int, slack: int) -> tuple[int, float]:
    """How late these chirps arrive, within `reach` of `about`, and their typical level there.

    Roots count, not levels: one loud sound does not outweigh many chirps.
    """
    begin = about - reach
    total, count = np.zeros(2 * reach + 1), len(envelope)
    for start in played + begin:
        low, high = max(start, 0), min(start + len(total), count)
        if low < high:
            total[low - start : high - start] += np.sqrt(envelope[low:high])
    # The earliest of equals: a regular schedule fits whole periods later as well.
    late = begin + int(np.argmax(total >= ABOUT_AS_CLEAR * total.max()))
    due = (played + late)[(played + late >= 0) & (played + late < count)]
    if len(due) <= len(played) // 2:
        return late, 0.0
    peaks = np.array([strongest(envelope, each - slack, each + slack + 1) for each in due])
    return late + round(float(np.median(peaks - due))), float(np.median(envelope[peaks]))


def _follow(search: Search, order: range, late: int) -> tuple[I64, I64]:
    """How late each chirp is due, and where it arrived, -1 where it did not; in that order."""
    recent = [late]
    late_by, arrived = np.empty(len(order), dtype=np.int64), np.empty(len(order), dtype=np.int64)
    missed = 0
    for row, k in enumerate(order):
        found = _arrival(search, int(search.played[k]) + late)
        if found < 0 and missed % PATIENCE == 0:
            late = _searched_anew(search, order[row : row + STRETCH // 2], late)
            found = _arrival(search, int(search.played[k]) + late)
        if found >= 0 and abs(late - recent[-1]) > search.slack:
            recent = []
        late_by[row], arrived[row] = late, found
        missed = missed + 1 if found < 0 else 0
        if found >= 0:
            recent = [*recent, found - int(search.played[k])][-RECENT:]
            late = round(float(np.median(recent)))
    return late_by, arrived


def _arrival(search: Search, due: int) -> int:
    """The direct arrival where one is due, -1 where there is none."""
    if not search.slack <= due < len(search.envelope) - search.slack:
        return -1
    peak = strongest(search.envelope, due - search.slack, due + search.slack + 1)
    if search.envelope[peak] < search.level:
        return -1
    return earliest(search.envelope, peak, search.early, search.early_share)


def _searched_anew(search: Search, chirps: range, late: int) -> int:
    """How late the next chirps are, where they say so clearly; else as before."""
    found, peak = _lateness(
        search.envelope, search.played[np.array(chirps)], late, search.reach, search.slack
    )
    return found if peak >= search.level else late


def _in_sound(due: I64, envelope: F32, period: int) -> Bool:
    """Which chirps were due while there was sound to hear them in."""
    sounds = sounding(envelope, period)
    frame = due // period
    within = (frame >= 0) & (frame < len(sounds))
    return np.asarray(within & sounds[np.clip(frame, 0, len(sounds) - 1)])


def _check_heard(arrived: I64, within: int, parameters: EchoParameters) -> None:
    found = int(np.sum(arrived >= 0))
    if found < max(parameters.found_share * within, 1):
        raise InputError(
            f"audio: {found} of {within} chirps heard that were played, wanted "
            f"{parameters.found_share:.0%}; check that the loudspeaker played all the time"
        )


def _arrivals_of(played: I64, late_by: I64, arrived: I64, slack: int) -> tuple[Arrivals, I64, I64]:
    """What was found, in the order of time; two chirps found at one place: the one due nearer."""
    heard = np.flatnonzero(arrived >= 0)
    heard = heard[np.argsort(np.abs(arrived - played - late_by)[heard], kind="stable")]
    samples, kept = np.unique(arrived[heard], return_index=True)
    heard = heard[kept]
    found = np.full(len(played), -1, dtype=np.int64)
    found[heard] = np.arange(len(heard))
    sooner = -np.diff(late_by[heard], prepend=late_by[heard[:1]])
    jumps = tuple((int(k), max(int(sooner[k]), 0)) for k in np.flatnonzero(abs(sooner) > slack))
    return Arrivals(samples, jumps), played + late_by, found
