"""The direct arrivals of chirps, found anew in every frame: playing and recording may shift.

Chirps come once per period, or when a schedule says that they were played. With a schedule, sound
takes its time from playing to hearing, the same for all chirps until something jumps. Where most
chirps of a stretch arrive after one and the same time, that is it: a schedule that is random within
the period fits its own chirps alone, and only whole periods apart where it is regular.
"""

from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F32, F64, I64, Bool
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.values import ECHO_RATE_HZ, Audio, Chirp
from elfslam.stages.echo.sound import EchoParameters, check_audio, matched_envelope, to_echo_rate

LULL_S = (0.070, 0.005)
"""Behind a direct arrival its echoes are over after the first, and the next chirp is not yet
due the second before the period ends: nothing as loud as a chirp belongs there."""
SILENT_SHARE = 1e-6
"""Of the loudest; what the matched filter leaves of a chirp in digital silence is less."""


@dataclass(frozen=True)
class Arrivals:
    """Direct arrivals as sample indices, and jumps: (index of the arrival behind it, samples)."""

    samples: I64
    jumps: tuple[tuple[int, int], ...]


def find_arrivals(envelope: F32, period: int, parameters: EchoParameters) -> Arrivals:
    """Sample indices of the direct arrivals, followed from frame to frame."""
    slack = round(parameters.slack_s * ECHO_RATE_HZ)
    early = round(parameters.early_s * ECHO_RATE_HZ)
    check_search(slack + early, len(envelope), period)
    level = _direct_level(envelope, period, parameters)
    found: list[int] = []
    jumps: list[tuple[int, int]] = []
    expected = strongest(envelope, 0, period)
    while expected < len(envelope):
        peak = strongest(envelope, expected - slack, expected + slack + 1)
        if envelope[peak] < level:
            peak = strongest(envelope, expected - period // 2, expected + period // 2)
            if envelope[peak] < level:
                expected += period
                continue
            if found:
                jumps.append((len(found), (expected - peak) % period))
        direct = earliest(envelope, peak, early, parameters.early_share)
        found.append(direct)
        expected = direct + period
    silent = int(np.sum(~sounding(envelope, period)))
    _check_found(len(found), len(envelope) / period - silent, parameters)
    arrivals = Arrivals(np.array(found, dtype=np.int64), tuple(jumps))
    _check_beat(arrivals, envelope, period, parameters)
    return arrivals


def sounding(envelope: F32, period: int) -> Bool:
    """Which whole periods (n) hold any sound: where a phone kept none there is digital silence."""
    loudest = _by_period(envelope, period).max(axis=1, initial=0.0)
    return np.asarray(loudest >= SILENT_SHARE * loudest.max(initial=0.0))


def _by_period(envelope: F32, period: int) -> F32:
    return envelope[: len(envelope) // period * period].reshape(-1, period)


def check_search(reach: int, count: int, period: int) -> None:
    """The search goes on to the next chirp only while it reaches back less than half a period."""
    if reach >= period // 2:
        raise ParameterError(
            f"echo.slack_s + echo.early_s: wanted less than half of chirp.period_s, "
            f"{period / ECHO_RATE_HZ / 2:g} s, got {reach / ECHO_RATE_HZ:g} s; lower one"
        )
    if count < 2 * period:
        raise InputError(
            f"audio: wanted at least two periods of {period / ECHO_RATE_HZ:g} s, "
            f"got {count / ECHO_RATE_HZ:.2f} s; record longer, or check chirp.period_s"
        )


def _direct_level(envelope: F32, period: int, parameters: EchoParameters) -> float:
    frames = _by_period(envelope, period)[sounding(envelope, period)]
    peak = float(np.median(frames.max(axis=1)))
    floor = float(np.median(np.median(frames, axis=1)))
    if peak < parameters.contrast * max(floor, 1e-9):
        raise InputError(
            "audio: no chirps in the 15-20 kHz band; turn echo cancellation and noise suppression "
            "off, the media volume up, and record again, or by another microphone or phone"
        )
    return parameters.level_share * peak


def _check_found(found: int, frames: float, parameters: EchoParameters) -> None:
    if found < max(parameters.found_share * frames, 1):
        raise InputError(
            f"audio: chirps in {found} of {frames:.0f} frames, "
            f"wanted {parameters.found_share:.0%}; check that the loudspeaker played all the time"
        )


def _check_beat(arrivals: Arrivals, envelope: F32, period: int, parameters: EchoParameters) -> None:
    """Refuse chirps that come at another rate than the period says, or several to a period."""
    beat = _beat(arrivals.samples, envelope, period)
    unsteady = len(arrivals.jumps) > parameters.jump_share * len(arrivals.samples)
    if unsteady or not 0.75 * period < beat < 1.5 * period:
        raise InputError(
            f"audio: chirps come every {beat / ECHO_RATE_HZ * 1000:.1f} ms, "
            "not at the period of the chirp; "
            "check the rate that the file claims, and chirp.period_s"
        )


def _beat(found: I64, envelope: F32, period: int) -> float:
    """Samples from a typical chirp to the next one that is heard, found or not."""
    whole = found[found + period <= len(envelope)]
    between = np.arange(round(LULL_S[0] * ECHO_RATE_HZ), period - round(LULL_S[1] * ECHO_RATE_HZ))
    if not len(whole) or not len(between):
        return period
    behind = envelope[whole[:, None] + between]
    if np.median(behind.max(axis=1)) > 0.5 * np.median(envelope[whole]):
        return float(between[0] + np.median(behind.argmax(axis=1)))
    return float(np.median(np.diff(found))) if len(found) > 1 else period


def strongest(envelope: F32, start: int, stop: int) -> int:
    """Sample of the greatest value from `start` to `stop`, without the last."""
    start = max(start, 0)
    return start + int(np.argmax(envelope[start:stop]))


def earliest(envelope: F32, peak: int, early: int, share: float) -> int:
    """The first peak at most `early` samples before `peak` that has a `share` of it, or `peak`."""
    start = max(peak - early, 1)
    window = envelope[start - 1 : peak + 1]
    rising = (window[1:-1] >= window[:-2]) & (window[1:-1] > window[2:])
    strong = np.flatnonzero(rising & (window[1:-1] >= share * envelope[peak]))
    return start + int(strong[0]) if len(strong) else peak


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


EXCERPTS, EXCERPT_S = 24, 1.0
"""Looked at all along the sound: what the choice needs does not grow with the walk."""
HEARD_QUANTILE = 0.9
"""Of the frames of a period; a chirp need not be in each of them."""


def best_channel(audio: Audio, chirp: Chirp) -> Audio:
    """The one channel (1, n) in which the matched filter's peaks stand out most from its floor."""
    if len(audio.samples) == 1:
        return audio
    length = round(EXCERPT_S * audio.rate_hz)
    last = max(audio.samples.shape[1] - length, 0)
    starts = np.unique(np.linspace(0, last, EXCERPTS).astype(np.int64))
    contrasts = [
        _contrast([row[start : start + length] for start in starts], audio.rate_hz, chirp)
        for row in audio.samples
    ]
    best = int(np.argmax(contrasts))
    return replace(audio, samples=audio.samples[best : best + 1])


def _contrast(excerpts: list[F32], rate_hz: int, chirp: Chirp) -> float:
    period = round(chirp.period_s * ECHO_RATE_HZ)
    envelopes = (
        matched_envelope(to_echo_rate(Audio(each[None], rate_hz)), chirp) for each in excerpts
    )
    frames = np.concatenate([each[: len(each) // period * period] for each in envelopes])
    frames = frames.reshape(-1, period)[sounding(frames, period)]
    if not len(frames):
        return 0.0
    peak = np.quantile(frames.max(axis=1), HEARD_QUANTILE)
    return float(peak / max(np.median(frames), 1e-9))


@dataclass(frozen=True, eq=False)
class Frames:
    """The sound (n) at 44.1 kHz, its matched envelope (n), and the direct arrivals (f) in it.

    `due` (m) is the sample at which each chirp was due, found or not, and `found` (m) the row of
    its direct arrival, -1 where there is none. `scheduled` says whether a schedule told that.
    """

    samples: F32
    envelope: F32
    arrivals: Arrivals
    due: I64
    found: I64
    period_s: float
    scheduled: bool


def find_frames(
    audio: Audio, chirp: Chirp, parameters: EchoParameters, played_t_s: F64 | None = None
) -> Frames:
    """The frames of the channel that hears the chirps best.

    `played_t_s` (m) says when each chirp was played. Raises InputError and ParameterError as
    `cut_echoes`.
    """
    audio = best_channel(audio, chirp)
    check_audio(audio, parameters)
    samples = to_echo_rate(audio)
    envelope = matched_envelope(samples, chirp)
    period = round(chirp.period_s * ECHO_RATE_HZ)
    if played_t_s is not None:
        arrivals, due, found = find_scheduled(envelope, played_t_s, period, parameters)
    else:
        arrivals = find_arrivals(envelope, period, parameters)
        due, found = _due_by_period(arrivals, period)
    scheduled = played_t_s is not None
    return Frames(samples, envelope, arrivals, due, found, chirp.period_s, scheduled)


def _due_by_period(arrivals: Arrivals, period: int) -> tuple[I64, I64]:
    """Chirps are due one period after the one before, or where the first one arrived."""
    due, found = [int(arrivals.samples[0])], [0]
    for k, (last, arrival) in enumerate(
        zip(arrivals.samples[:-1], arrivals.samples[1:], strict=True), start=1
    ):
        periods = max(round((int(arrival) - int(last)) / period), 1)
        due += [int(last) + period * step for step in range(1, periods + 1)]
        found += [-1] * (periods - 1) + [k]
    return np.array(due, dtype=np.int64), np.array(found, dtype=np.int64)
