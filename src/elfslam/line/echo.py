"""Echo cutting: find the direct arrival in every frame and cut the echo trace behind it.

At 17.5 kHz one cycle is 2.5 samples, so a raw correlation peak picks the wrong cycle: the search
runs on the envelope of the analytic matched filter. The direct path is found anew in every frame,
because the offset between playing and recording differs between runs and can jump.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.parameters import parameter
from elfslam.base.values import (
    DISCARDED_SAMPLES,
    ECHO_RATE_HZ,
    ECHO_SAMPLES,
    Audio,
    Chirp,
    Echoes,
)

RESAMPLED_RATE_HZ = 48_000
FILTERED_AT_ONCE = 1 << 20
"""Samples: what the matched filter needs of memory does not grow with the walk."""


@dataclass(frozen=True)
class EchoParameters:
    """How the direct arrival is recognised, and what is refused."""

    minimum_duration_s: float = parameter(
        2.0, "s", "shorter audio is refused", low=0.2, high=3600.0
    )
    contrast: float = parameter(
        8.0, "", "direct arrival over the frame's median envelope", low=1.0, high=1000.0
    )
    level_share: float = parameter(
        0.35, "", "direct arrival over its typical level", low=0.01, high=1.0
    )
    jump_share: float = parameter(
        0.2, "", "more jumps than this per chirp mean another rate or period", low=0.0, high=1.0
    )
    early_share: float = parameter(
        0.5, "", "an earlier peak this strong is the direct one", low=0.01, high=1.0
    )
    early_s: float = parameter(
        0.0015, "s", "how far before the strongest peak to look", low=0.0, high=0.02
    )
    slack_s: float = parameter(
        0.002, "s", "jitter of the direct arrival between frames", low=0.0, high=0.02
    )
    found_share: float = parameter(0.5, "", "frames that must hold a chirp", low=0.0, high=1.0)
    clipped_share: float = parameter(
        0.001, "", "more samples at full scale are refused", low=0.0, high=1.0
    )
    seam_contrast: float = parameter(
        9.0, "", "click over the usual that may be a break of the stream", low=1.0, high=1e6
    )
    shortfall_s: float = parameter(
        0.15, "s", "sound may be this much shorter than motion, jumps put back", low=0.0, high=60.0
    )


SEAM_BAND_HZ = 20_800.0
"""Above the chirp; a break in the waveform reaches there, room noise hardly does."""

LULL_S = (0.070, 0.005)
"""Behind a direct arrival its echoes are over after the first, and the next chirp is not yet
due the second before the period ends: nothing as loud as a chirp belongs there."""


SLIGHTEST_JUMP = 8
"""Samples; the direct arrival, median of seven, stands still to less than that."""


@dataclass(frozen=True)
class Arrivals:
    """Direct arrivals as sample indices, and jumps: (index of the arrival behind it, samples)."""

    samples: I64
    jumps: tuple[tuple[int, int], ...]


def cut_echoes(
    audio: Audio, chirp: Chirp, parameters: EchoParameters, duration_s: float | None = None
) -> Echoes:
    """Aligned echo traces (n, 2352), one per chirp that was found; channel 0 is used.

    `duration_s` is how long the other sensors ran: it tells how much sound was lost where the
    stream jumps, which the phase of the chirps gives only up to whole periods.
    Raises InputError for sound that is too short, silent, clipped, holds no chirps, or lost a
    stretch that cannot be put back; ParameterError for a search wider than the period.
    """
    check_audio(audio, parameters)
    samples = to_echo_rate(audio)
    envelope = matched_envelope(samples, chirp)
    arrivals = find_arrivals(envelope, round(chirp.period_s * ECHO_RATE_HZ), parameters)
    starts = arrivals.samples + DISCARDED_SAMPLES
    heard = np.array([_holds_echo(samples, start) for start in starts])
    if not heard.any():
        raise InputError("audio: it ends before the first echo does; record longer")
    traces = np.stack([samples[start : start + ECHO_SAMPLES] for start in starts[heard]])
    missing_s = None if duration_s is None else duration_s - len(samples) / ECHO_RATE_HZ
    if (missing_s or 0.0) - _jumped_s(arrivals) > parameters.shortfall_s:
        arrivals = _with_slight_jumps(arrivals, round(chirp.period_s * ECHO_RATE_HZ))
        _check_alone(arrivals, samples, round(chirp.period_s * ECHO_RATE_HZ), parameters)
    t_s, losses_s = _arrival_times(arrivals, chirp.period_s, missing_s, parameters)
    return Echoes(t_s[heard], traces, _snr_db(samples, starts[heard]), losses_s)


def _holds_echo(samples: F32, start: int) -> bool:
    """Whether the stream goes on behind a direct arrival, and not in digital silence."""
    trace = samples[start : start + ECHO_SAMPLES]
    return len(trace) == ECHO_SAMPLES and bool(trace.any())


def check_audio(audio: Audio, parameters: EchoParameters) -> None:
    """Refuse sound in which no echo can be measured."""
    samples = audio.samples[0]
    duration_s = len(samples) / audio.rate_hz
    if duration_s < parameters.minimum_duration_s:
        raise InputError(
            f"audio: wanted at least {parameters.minimum_duration_s:g} s, "
            f"got {duration_s:.2f} s; record longer"
        )
    if float(np.abs(samples).max()) < 1e-6:
        raise InputError("audio: it is silent; check that the microphone was on and not muted")
    clipped = float(np.mean(np.abs(samples) >= 0.999))
    if clipped > parameters.clipped_share:
        raise InputError(
            f"audio: {clipped:.1%} of the samples are clipped; "
            "lower the volume or the gain and record again"
        )


def to_echo_rate(audio: Audio) -> F32:
    """Channel 0 at 44.1 kHz, resampled from 48 kHz by a long filter, flat from 15 to 20 kHz."""
    samples: F32 = audio.samples[0]
    if audio.rate_hz == ECHO_RATE_HZ:
        return samples
    if audio.rate_hz != RESAMPLED_RATE_HZ:
        raise InputError(
            f"audio: wanted {ECHO_RATE_HZ} or {RESAMPLED_RATE_HZ} Hz, got {audio.rate_hz}; "
            "record again at one of the two"
        )
    up, down = 147, 160
    taps = signal.firwin(96 * 2 * down + 1, 1.0 / down, window=("kaiser", 10.0))
    return np.asarray(signal.resample_poly(samples, up, down, window=taps), dtype=np.float32)


def matched_envelope(samples: F32, chirp: Chirp) -> F32:
    """Envelope of the analytic matched filter (n,): value k belongs to a chirp that starts at k."""
    template = chirp.samples.astype(np.float64)
    if chirp.rate_hz != ECHO_RATE_HZ:
        template = signal.resample(template, round(len(template) * ECHO_RATE_HZ / chirp.rate_hz))
    analytic = signal.hilbert(template) / np.sum(template**2)
    kernel = np.conj(analytic[::-1]).astype(np.complex64)
    envelope = np.empty(len(samples), dtype=np.float32)
    for first in range(0, len(samples), FILTERED_AT_ONCE):
        block = samples[first : first + FILTERED_AT_ONCE + len(kernel) - 1]
        filtered = signal.oaconvolve(block, kernel, mode="full")[len(kernel) - 1 :]
        envelope[first : first + FILTERED_AT_ONCE] = np.abs(filtered[:FILTERED_AT_ONCE])
    return envelope


def find_arrivals(envelope: F32, period: int, parameters: EchoParameters) -> Arrivals:
    """Sample indices of the direct arrivals, followed from frame to frame."""
    slack = round(parameters.slack_s * ECHO_RATE_HZ)
    early = round(parameters.early_s * ECHO_RATE_HZ)
    _check_search(slack + early, len(envelope), period)
    level = _direct_level(envelope, period, parameters)
    found: list[int] = []
    jumps: list[tuple[int, int]] = []
    expected = _strongest(envelope, 0, period)
    while expected < len(envelope):
        peak = _strongest(envelope, expected - slack, expected + slack + 1)
        if envelope[peak] < level:
            peak = _strongest(envelope, expected - period // 2, expected + period // 2)
            if envelope[peak] < level:
                expected += period
                continue
            if found:
                jumps.append((len(found), (expected - peak) % period))
        direct = _earliest(envelope, peak, early, parameters.early_share)
        found.append(direct)
        expected = direct + period
    _check_found(len(found), len(envelope) / period, parameters)
    arrivals = Arrivals(np.array(found, dtype=np.int64), tuple(jumps))
    _check_beat(arrivals, envelope, period, parameters)
    return arrivals


def _check_search(reach: int, count: int, period: int) -> None:
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
    frames = envelope[: len(envelope) // period * period].reshape(-1, period)
    peak = float(np.median(frames.max(axis=1)))
    floor = float(np.median(np.median(frames, axis=1)))
    if peak < parameters.contrast * max(floor, 1e-9):
        raise InputError(
            "audio: no chirps in the 15-20 kHz band; turn echo cancellation and noise suppression "
            "off, the media volume up, and record again"
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


def _strongest(envelope: F32, start: int, stop: int) -> int:
    start = max(start, 0)
    return start + int(np.argmax(envelope[start:stop]))


def _earliest(envelope: F32, peak: int, early: int, share: float) -> int:
    start = max(peak - early, 1)
    window = envelope[start - 1 : peak + 1]
    rising = (window[1:-1] >= window[:-2]) & (window[1:-1] > window[2:])
    strong = np.flatnonzero(rising & (window[1:-1] >= share * envelope[peak]))
    return start + int(strong[0]) if len(strong) else peak


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


def _check_alone(arrivals: Arrivals, samples: F32, period: int, parameters: EchoParameters) -> None:
    """Refuse a second break beside the only jump: either may have lost the whole periods.

    Where whole periods are lost the beat stays, but the waveform breaks: a click above the chirp
    band, where a frame is otherwise as quiet as the frames around it.
    """
    whole = arrivals.samples[arrivals.samples + period <= len(samples)]
    if len(arrivals.jumps) != 1 or not len(whole):
        return
    highpass = signal.butter(8, SEAM_BAND_HZ, "highpass", fs=ECHO_RATE_HZ, output="sos")
    sharp = np.abs(signal.sosfiltfilt(highpass, samples)).astype(np.float32)
    frames = np.lib.stride_tricks.sliding_window_view(sharp, period)[whole]
    excess = (frames / (np.median(frames, axis=0) + 1e-9)).max(axis=1)
    jump = arrivals.jumps[0][0]
    excess[max(jump - 2, 0) : jump + 1] = 0.0
    excess[[0, -1]] = 0.0  # the ends of the stream are breaks of their own
    clicked = int(np.argmax(excess))
    if excess[clicked] > parameters.seam_contrast:
        raise InputError(
            f"audio: sound was lost at {arrivals.samples[jump] / ECHO_RATE_HZ:.1f} s, but it "
            f"clicks at {whole[clicked] / ECHO_RATE_HZ:.1f} s too, so where how much was lost "
            "is unknown; record again, or raise echo.seam_contrast if that was a noise in the room"
        )


def _arrival_times(
    arrivals: Arrivals, period_s: float, missing_s: float | None, parameters: EchoParameters
) -> tuple[F64, F64]:
    """Times of the arrivals with lost stretches put back, and the losses (when, seconds)."""
    t_s = arrivals.samples / ECHO_RATE_HZ
    silences = _silences(t_s, period_s)
    losses = []
    for k, lost_s in _lost_at_jumps(arrivals.jumps, period_s, missing_s, parameters):
        losses.append((t_s[k - 1] + period_s, lost_s))
        t_s[k:] += lost_s
    jumped = {k for k, _ in arrivals.jumps}
    losses += [(t_s[k - 1] + period_s, gap - period_s) for k, gap in silences if k not in jumped]
    return t_s, np.array(sorted(losses), dtype=np.float64).reshape(-1, 2)


def _lost_at_jumps(
    jumps: tuple[tuple[int, int], ...],
    period_s: float,
    missing_s: float | None,
    parameters: EchoParameters,
) -> list[tuple[int, float]]:
    """The arrival after each jump and the seconds lost there.

    A jump tells what was lost up to whole periods. One jump takes the whole periods that are
    missing beyond it; among several nobody knows which, so then the jumps alone must explain what
    is missing. Where nothing is missing the jumps are no losses: playing fell behind recording.
    """
    lost = [(k, jump / ECHO_RATE_HZ) for k, jump in jumps]
    jumped_s = sum(lost_s for _, lost_s in lost)
    if missing_s is None:
        return lost
    if missing_s < jumped_s / 2:
        lost, jumped_s = [(k, 0.0) for k, _ in jumps], 0.0
    elif len(jumps) == 1:
        jumped_s += max(round((missing_s - jumped_s) / period_s), 0) * period_s
        lost = [(jumps[0][0], jumped_s)]
    _check_explained(missing_s - jumped_s, len(jumps), parameters.shortfall_s)
    return lost


def _check_explained(left_s: float, jumps: int, shortfall_s: float) -> None:
    """Refuse sound of which more was lost than its jumps tell, or of which they tell too much."""
    if -shortfall_s <= left_s <= shortfall_s or (left_s < 0 and jumps == 0):
        return
    where = f"beyond what its {jumps} breaks tell" if jumps else "and nothing tells where"
    how = "shorter" if left_s > 0 else "longer"
    raise InputError(
        f"audio: {abs(left_s):.2f} s {how} than the motion {where}, so its echoes cannot be timed; "
        "record again, or raise echo.shortfall_s if one merely ended before the other"
    )


def _silences(t_s: F64, period_s: float) -> list[tuple[int, float]]:
    gaps = np.diff(t_s)
    return [(int(k) + 1, float(gaps[k])) for k in np.flatnonzero(gaps > 1.5 * period_s)]


def _snr_db(samples: F32, starts: I64) -> F64:
    """Echo level over the quiet tail of the same frame, high-passed to the upper band."""
    tail = 441
    levels = []
    for start in starts:
        frame = samples[start : start + ECHO_SAMPLES + 2 * tail + 2]
        sharpened = np.diff(frame, n=2).astype(np.float64)
        echo, rest = sharpened[:ECHO_SAMPLES], sharpened[ECHO_SAMPLES:][-tail:]
        levels.append((np.mean(echo**2), np.mean(rest**2) if len(rest) else np.mean(echo**2)))
    power = np.array(levels) + 1e-20
    return np.asarray(10 * np.log10(power[:, 0] / power[:, 1]))
