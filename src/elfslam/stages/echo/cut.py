"""The echo trace behind every direct arrival, when it was, and what else was heard around it."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage, signal

from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.values import (
    DISCARDED_SAMPLES,
    ECHO_RATE_HZ,
    ECHO_SAMPLES,
    Audio,
    Chirp,
    Echoes,
    FrameFacts,
)
from elfslam.stages.echo.arrivals import Arrivals, Frames, find_frames, strongest
from elfslam.stages.echo.sound import EchoParameters

SEAM_BAND_HZ = 20_800.0
"""Above the chirp; a break in the waveform reaches there, room noise hardly does."""

SLIGHTEST_JUMP = 8
"""Samples; the direct arrival, median of seven, stands still to less than that."""

SMOOTH = 45
"""Samples, a millisecond: how quiet a frame is changes no faster."""

FRAMES_THAT_TELL = 2000
"""How quiet a frame usually is: what that needs of memory does not grow with the walk."""


def _jumped_s(arrivals: Arrivals) -> float:
    return sum(jump for _, jump in arrivals.jumps) / ECHO_RATE_HZ


def _with_slight_jumps(arrivals: Arrivals, period: int) -> Arrivals:
    """Arrivals with the jumps that hide in the jitter: lasting steps against the beat.

    Nearly whole periods were lost there. A third break changes nothing: two are not told apart.
    """
    moved = np.diff(arrivals.samples, prepend=arrivals.samples[0])
    moved -= period * np.round(moved / period).astype(np.int64)
    jumps = dict(arrivals.jumps)
    moved[list(jumps)] = 0
    beat = np.cumsum(moved).astype(np.float64)
    while len(jumps) < 2:
        k, step = _greatest_step(beat)
        if abs(step) <= SLIGHTEST_JUMP:
            break
        jumps[k] = round(-step) % period
        beat[k:] -= step
    return Arrivals(arrivals.samples, tuple(sorted(jumps.items())))


def _greatest_step(beat: F64) -> tuple[int, float]:
    """Where the median of seven steps most, and by how much; the sharpest place among equals."""
    steps = [
        float(np.median(beat[k : k + 7]) - np.median(beat[max(k - 7, 0) : k]))
        for k in range(1, len(beat))
    ]
    sharpness = np.abs(steps) + np.abs(np.diff(beat))
    k = int(np.argmax(sharpness)) + 1 if steps else 0
    return k, steps[k - 1] if steps else 0.0


def _clicked(
    arrivals: Arrivals, samples: F32, period: int, parameters: EchoParameters
) -> int | None:
    """The first arrival behind a break that no jump tells of; None where there is none.

    Where whole periods are lost the beat stays, but the waveform breaks: a click above the chirp
    band, where a frame is otherwise as quiet as the frames around it. Several jumps need no click.
    """
    whole = arrivals.samples[arrivals.samples + period <= len(samples)]
    if len(arrivals.jumps) > 1 or not len(whole):
        return None
    highpass = signal.butter(8, SEAM_BAND_HZ, "highpass", fs=ECHO_RATE_HZ, output="sos")
    sharp = np.abs(signal.sosfiltfilt(highpass, samples)).astype(np.float32)
    frames = np.lib.stride_tricks.sliding_window_view(sharp, period)
    usual = np.median(frames[whole[:: len(whole) // FRAMES_THAT_TELL + 1]], axis=0)
    usual = ndimage.uniform_filter1d(usual, SMOOTH, mode="wrap") + 1e-9  # few frames scatter
    excess = np.array([float((frames[start] / usual).max()) for start in whole])
    for jump, _ in arrivals.jumps:
        excess[max(jump - 2, 0) : jump + 1] = 0.0
    excess[[0, -1]] = 0.0  # the ends of the stream are breaks of their own
    clicks = np.flatnonzero(excess > parameters.seam_contrast)
    return int(clicks[0]) if len(clicks) else None


@dataclass(frozen=True)
class Breaks:
    """Where the stream broke: the arrival behind each break, and the seconds that were lost there.

    The times of the first `certain` arrivals are known; behind a break of which nobody knows how
    much was lost they are not.
    """

    lost: tuple[tuple[int, float], ...]
    certain: int


def arrival_times(
    frames: Frames, missing_s: float | None, parameters: EchoParameters
) -> tuple[F64, F64, int]:
    """Times of the arrivals, lost stretches put back; the losses (when, seconds); how many of the
    times are certain.

    `missing_s` is how much longer than the sound the other sensors ran.
    """
    period_s = frames.period_s
    t_s = frames.arrivals.samples / ECHO_RATE_HZ
    silences = _unheard(frames) if frames.scheduled else _silences(t_s, period_s)
    breaks = put_back(frames, missing_s, parameters)
    losses, jumped = [], set()
    for k, lost_s in breaks.lost:
        losses.append((t_s[k - 1] + period_s, lost_s))
        t_s[k:] += lost_s
        jumped.add(k)
    losses += [
        (t_s[k - 1] + period_s, lost_s)
        for k, lost_s in silences
        if k not in jumped and k < breaks.certain
    ]
    return t_s, np.array(sorted(losses), dtype=np.float64).reshape(-1, 2), breaks.certain


def put_back(frames: Frames, missing_s: float | None, parameters: EchoParameters) -> Breaks:
    """The breaks of the stream, measured against the other sensors.

    Sound that is merely shorter ended early. What its jumps do not explain may have been lost at
    any of them: only what came before is certain then.
    """
    arrivals, clicked = frames.arrivals, None
    too_short = (missing_s or 0.0) - _jumped_s(arrivals) > parameters.shortfall_s
    if too_short and not frames.scheduled:
        period = round(frames.period_s * ECHO_RATE_HZ)
        arrivals = _with_slight_jumps(arrivals, period)
        clicked = _clicked(arrivals, frames.samples, period, parameters)
    breaks = _lost_at_jumps(arrivals, frames, missing_s, parameters)
    if clicked is None:
        return breaks
    certain = min(clicked, breaks.certain, *(k for k, _ in arrivals.jumps))
    return Breaks(tuple(each for each in breaks.lost if each[0] < certain), certain)


def _unheard(frames: Frames) -> list[tuple[int, float]]:
    """The arrival after chirps that were played and not heard, and for how long that was so."""
    rows = np.flatnonzero(frames.found >= 0)
    waits = [(int(frames.found[b]), b - a - 1) for a, b in pairwise(rows)]
    return [(k, missed * frames.period_s) for k, missed in waits if missed > 0]


def _lost_at_jumps(
    arrivals: Arrivals, frames: Frames, missing_s: float | None, parameters: EchoParameters
) -> Breaks:
    """What was lost at each jump.

    A jump tells what was lost up to whole periods. One jump takes the whole periods that are
    missing beyond it; among several nobody knows which, so then the jumps alone must explain what
    is missing. Where nothing is missing the jumps are no losses: playing fell behind recording.
    """
    count, jumps = len(arrivals.samples), arrivals.jumps
    lost = tuple((k, jump / ECHO_RATE_HZ) for k, jump in jumps)
    jumped_s = sum(lost_s for _, lost_s in lost)
    if missing_s is None:
        return Breaks(lost, count)
    if missing_s < jumped_s / 2:
        lost, jumped_s = tuple((k, 0.0) for k, _ in jumps), 0.0
    elif len(jumps) == 1:
        period_s = frames.period_s
        jumped_s += max(round((missing_s - jumped_s) / period_s), 0) * period_s
        lost = ((jumps[0][0], jumped_s),)
    explained = abs(missing_s - jumped_s) <= parameters.shortfall_s
    if explained or frames.scheduled or not jumps:
        return Breaks(lost, count)
    return Breaks((), jumps[0][0])


def _silences(t_s: F64, period_s: float) -> list[tuple[int, float]]:
    gaps = np.diff(t_s)
    return [(int(k) + 1, float(gaps[k]) - period_s) for k in np.flatnonzero(gaps > 1.5 * period_s)]


def cut_echoes(
    audio: Audio,
    chirp: Chirp,
    parameters: EchoParameters,
    duration_s: float | None = None,
    played_t_s: F64 | None = None,
) -> Echoes:
    """Aligned echo traces (n, 2352), one per chirp that was found in the best channel.

    `duration_s` is how long the other sensors ran: it tells how much sound was lost where the
    stream jumps, which the phase of the chirps gives only up to whole periods. `played_t_s` (m)
    says when each chirp was played, up to a constant; without it they come once per period.
    What lies behind a loss that cannot be put back is left out. Raises InputError for sound that
    is too short, silent, clipped or holds no chirps; ParameterError for a search wider than the
    period.
    """
    frames = find_frames(audio, chirp, parameters, played_t_s)
    return echoes_of(frames, parameters, duration_s)


def echoes_of(
    frames: Frames,
    parameters: EchoParameters,
    duration_s: float | None = None,
    spoiled: Bool | None = None,
) -> Echoes:
    """The echo traces of frames that were found, as `cut_echoes`; those `spoiled` (n) left out."""
    samples, arrivals = frames.samples, frames.arrivals.samples
    missing_s = None if duration_s is None else duration_s - len(samples) / ECHO_RATE_HZ
    t_s, losses_s, certain = arrival_times(frames, missing_s, parameters)
    starts = arrivals + DISCARDED_SAMPLES
    heard = np.array([_holds_echo(samples, start) for start in starts])
    if not heard.any():
        raise InputError("audio: it ends before the first echo does; record longer")
    heard[certain:] = False
    if not heard.any():
        raise InputError(
            "audio: sound was lost at its beginning and nothing tells how much, so its echoes "
            "cannot be timed; record again"
        )
    if spoiled is not None:
        heard &= ~spoiled
    if not heard.any():
        raise InputError(
            "audio: other phones chirp into every echo; record where fewer do, or wait your turn"
        )
    traces = np.stack([samples[start : start + ECHO_SAMPLES] for start in starts[heard]])
    return Echoes(t_s[heard], traces, losses_s, over_noise_db=_over_noise_db(frames))


def _holds_echo(samples: F32, start: int) -> bool:
    """Whether the stream goes on behind a direct arrival, and not in digital silence."""
    trace = samples[start : start + ECHO_SAMPLES]
    return len(trace) == ECHO_SAMPLES and bool(trace.any())


QUIET = (round(0.020 * ECHO_RATE_HZ), round(0.002 * ECHO_RATE_HZ))
"""From how long before a direct arrival to how long before it nothing should be heard."""
OVER = round(0.065 * ECHO_RATE_HZ)
"""Behind a direct arrival its echoes are over."""
FIRST_ECHOES = (round(0.011 * ECHO_RATE_HZ), round(0.020 * ECHO_RATE_HZ))
LAST_ECHOES = (round(0.055 * ECHO_RATE_HZ), round(0.064 * ECHO_RATE_HZ))
"""Behind a direct arrival."""
LATE_SHARE = 0.15
"""Of the power of the first echoes, that large halls leave of it: air alone takes 6 dB and more."""
LEAST_ECHO = 1e-3
"""Of the power of the noise; less cannot be measured."""


def _over_noise_db(frames: Frames) -> float:
    """Power of the first echoes over that of the noise, both compressed (dB).

    Noise is what is heard before the direct sound. Of frames that begin with it, digital silence
    before them, it is at least what a large hall leaves unexplained at their end. NaN where no
    frame is whole.
    """
    at, envelope = frames.arrivals.samples, frames.envelope
    at = at[(at >= FIRST_ECHOES[1]) & (at + LAST_ECHOES[1] <= len(envelope))]
    at = at[:: len(at) // FRAMES_THAT_TELL + 1, None]
    if not len(at):
        return float("nan")
    first, last = np.arange(*FIRST_ECHOES), np.arange(*LAST_ECHOES)
    heard, before, late = (
        float(np.median(np.mean(envelope[at + span] ** 2, axis=1)))
        for span in (first, -first, last)
    )
    unexplained = (late - LATE_SHARE * heard) / (1 - LATE_SHARE)
    noise = max(before, unexplained, 1e-30)
    return float(10 * np.log10(max(heard / noise - 1, LEAST_ECHO)))


FULL_SCALE = 0.999


def frame_facts(
    frames: Frames,
    parameters: EchoParameters,
    duration_s: float | None = None,
    gain_db: F64 | None = None,
) -> FrameFacts:
    """What is known of every chirp (m) that was due, heard or not.

    `duration_s` is how long the other sensors ran, as for `cut_echoes`: the times agree. `gain_db`
    (m) is how loud each was played, where a schedule says so.
    """
    rows = np.array([_row(frames, k, parameters) for k in range(len(frames.due))])
    level, before, noise, clipped = rows.T
    t_s, late = _times(frames, parameters, duration_s)
    late_s = np.where(frames.found < 0, np.nan, late)
    return FrameFacts(t_s, late_s, level, before, noise, clipped, gain_db)


def _times(frames: Frames, parameters: EchoParameters, duration_s: float | None) -> tuple[F64, F64]:
    """When each chirp was due, lost stretches put back, and how late it was against that."""
    missing_s = None if duration_s is None else duration_s - len(frames.samples) / ECHO_RATE_HZ
    breaks = put_back(frames, missing_s, parameters)
    shift_s = np.zeros(len(frames.due))
    for k, lost_s in breaks.lost:
        shift_s[int(np.flatnonzero(frames.found == k)[0]) :] += lost_s
    arrived = frames.arrivals.samples[frames.found]
    return frames.due / ECHO_RATE_HZ + shift_s, (arrived - frames.due) / ECHO_RATE_HZ


def _row(frames: Frames, k: int, parameters: EchoParameters) -> tuple[float, ...]:
    """Level, what came before over it, noise, clipped share."""
    envelope, at = frames.envelope, _moment(frames, k, parameters)
    if not 0 <= at < len(envelope):
        return 0.0, 0.0, 0.0, 0.0
    begin = max(at - QUIET[0], _moment(frames, k - 1, parameters) + OVER if k else 0)
    quiet = envelope[max(begin, 0) : max(at - QUIET[1], 0)]
    sound = frames.samples[at : at + OVER]
    level = float(envelope[at])
    return (
        level,
        float(quiet.max()) / max(level, 1e-9) if len(quiet) else 0.0,
        float(np.median(quiet)) if len(quiet) else 0.0,
        float(np.mean(np.abs(sound) >= FULL_SCALE)),
    )


def _moment(frames: Frames, k: int, parameters: EchoParameters) -> int:
    """The direct arrival, or what is loudest about where it was due."""
    if frames.found[k] >= 0:
        return int(frames.arrivals.samples[frames.found[k]])
    due, slack = int(frames.due[k]), round(parameters.slack_s * ECHO_RATE_HZ)
    if not slack <= due < len(frames.envelope) - slack:
        return due
    return strongest(frames.envelope, due - slack, due + slack + 1)
