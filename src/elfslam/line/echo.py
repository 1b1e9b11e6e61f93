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
from elfslam.base.errors import InputError
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


@dataclass(frozen=True)
class EchoParameters:
    """How the direct arrival is recognised, and what is refused."""

    minimum_duration_s: float = parameter(2.0, "s", "shorter audio is refused", low=0.2)
    contrast: float = parameter(8.0, "", "direct arrival over the frame's median envelope", low=1.0)
    level_share: float = parameter(
        0.35, "", "direct arrival over its typical level", low=0.0, high=1.0
    )
    jump_share: float = parameter(
        0.2, "", "more jumps than this per chirp mean another rate or period", low=0.0, high=1.0
    )
    early_share: float = parameter(
        0.5, "", "an earlier peak this strong is the direct one", low=0.0, high=1.0
    )
    early_s: float = parameter(0.0015, "s", "how far before the strongest peak to look", low=0.0)
    slack_s: float = parameter(0.002, "s", "jitter of the direct arrival between frames", low=0.0)
    found_share: float = parameter(0.5, "", "frames that must hold a chirp", low=0.0, high=1.0)
    clipped_share: float = parameter(
        0.001, "", "more samples at full scale are refused", low=0.0, high=1.0
    )
    seam_contrast: float = parameter(
        9.0, "", "click over the usual at a break of the stream", low=1.0
    )
    shortfall_s: float = parameter(
        0.25, "s", "sound shorter than motion by more is a loss", low=0.0
    )


SEAM_BAND_HZ = 20_800.0
"""Above the chirp; a break in the waveform reaches there, room noise hardly does."""


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
    Raises InputError for sound that is too short, silent, clipped, or holds no chirps.
    """
    check_audio(audio, parameters)
    samples = to_echo_rate(audio)
    envelope = matched_envelope(samples, chirp)
    arrivals = find_arrivals(envelope, round(chirp.period_s * ECHO_RATE_HZ), parameters)
    starts = arrivals.samples + DISCARDED_SAMPLES
    heard = np.array([_holds_echo(samples, start) for start in starts])
    traces = np.stack([samples[start : start + ECHO_SAMPLES] for start in starts[heard]])
    missing_s = None if duration_s is None else duration_s - len(samples) / ECHO_RATE_HZ
    if (missing_s or 0.0) > parameters.shortfall_s and not arrivals.jumps:
        arrivals = _with_seam(arrivals, samples, round(chirp.period_s * ECHO_RATE_HZ), parameters)
    t_s, losses_s = _arrival_times(arrivals, chirp.period_s, missing_s, parameters)
    return Echoes(t_s[heard], traces, _snr_db(samples, starts[heard]), losses_s)


def _with_seam(
    arrivals: Arrivals, samples: F32, period: int, parameters: EchoParameters
) -> Arrivals:
    """Arrivals with a jump of whole periods at the seam of the stream, if one is heard.

    Where whole periods are lost the chirps keep their beat, but the waveform breaks: a click above
    the chirp band, where a frame is otherwise as quiet as the frames around it.
    """
    highpass = signal.butter(8, SEAM_BAND_HZ, "highpass", fs=ECHO_RATE_HZ, output="sos")
    sharp = np.abs(signal.sosfiltfilt(highpass, samples)).astype(np.float32)
    frames = sharp[: len(sharp) // period * period].reshape(-1, period)
    excess = frames / (np.median(frames, axis=0) + 1e-9)
    excess[[0, -1]] = 0.0  # the ends of the stream are breaks of their own
    excess = excess.ravel()
    seam = int(np.argmax(excess))
    if excess[seam] < parameters.seam_contrast:
        return arrivals
    after = int(np.searchsorted(arrivals.samples, seam))
    return Arrivals(
        arrivals.samples, ((max(after, 1), 0),) if after < len(arrivals.samples) else ()
    )


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
    filtered = signal.oaconvolve(samples, kernel, mode="full")[len(kernel) - 1 :]
    return np.asarray(np.abs(filtered), dtype=np.float32)


def find_arrivals(envelope: F32, period: int, parameters: EchoParameters) -> Arrivals:
    """Sample indices of the direct arrivals, followed from frame to frame."""
    level = _direct_level(envelope, period, parameters)
    slack = round(parameters.slack_s * ECHO_RATE_HZ)
    early = round(parameters.early_s * ECHO_RATE_HZ)
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
    _check_beat(np.array(found), len(jumps), parameters)
    return Arrivals(np.array(found, dtype=np.int64), tuple(jumps))


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
    if found < parameters.found_share * frames:
        raise InputError(
            f"audio: chirps in {found} of {frames:.0f} frames, "
            f"wanted {parameters.found_share:.0%}; check that the loudspeaker played all the time"
        )


def _check_beat(found: I64, jumps: int, parameters: EchoParameters) -> None:
    if jumps > parameters.jump_share * len(found):
        beat_ms = float(np.median(np.diff(found))) / ECHO_RATE_HZ * 1000
        raise InputError(
            f"audio: chirps come every {beat_ms:.1f} ms, not at the period of the chirp; "
            "check the rate that the file claims, and chirp.period_s"
        )


def _strongest(envelope: F32, start: int, stop: int) -> int:
    start = max(start, 0)
    return start + int(np.argmax(envelope[start:stop]))


def _earliest(envelope: F32, peak: int, early: int, share: float) -> int:
    start = max(peak - early, 1)
    window = envelope[start - 1 : peak + 1]
    rising = (window[1:-1] >= window[:-2]) & (window[1:-1] > window[2:])
    strong = np.flatnonzero(rising & (window[1:-1] >= share * envelope[peak]))
    return start + int(strong[0]) if len(strong) else peak


def _arrival_times(
    arrivals: Arrivals, period_s: float, missing_s: float | None, parameters: EchoParameters
) -> tuple[F64, F64]:
    """Times of the arrivals with lost stretches put back, and the losses (when, seconds)."""
    t_s = arrivals.samples / ECHO_RATE_HZ
    silences = _silences(t_s, period_s)
    losses = []
    for k, lost_s in _lost_at_jumps(arrivals.jumps, period_s, missing_s):
        losses.append((t_s[k - 1] + period_s, lost_s))
        t_s[k:] += lost_s
    if not arrivals.jumps and (missing_s or 0.0) > parameters.shortfall_s:
        losses.append((t_s[-1], missing_s or 0.0))
    jumped = {k for k, _ in arrivals.jumps}
    losses += [(t_s[k - 1] + period_s, gap - period_s) for k, gap in silences if k not in jumped]
    return t_s, np.array(sorted(losses), dtype=np.float64).reshape(-1, 2)


def _lost_at_jumps(
    jumps: tuple[tuple[int, int], ...], period_s: float, missing_s: float | None
) -> list[tuple[int, float]]:
    """The arrival after each jump and the seconds lost there.

    What is missing beyond the jumps is whole periods, put at the first. Where nothing is missing
    the jumps are no losses: playing fell behind recording, and the clock is as it was.
    """
    jumped_s = sum(jump for _, jump in jumps) / ECHO_RATE_HZ
    if missing_s is not None and missing_s < jumped_s / 2:
        return [(k, 0.0) for k, _ in jumps]
    whole_s = max(round(((missing_s or 0.0) - jumped_s) / period_s), 0) * period_s
    lost = [(k, jump / ECHO_RATE_HZ) for k, jump in jumps]
    return [(k, lost_s + whole_s * (index == 0)) for index, (k, lost_s) in enumerate(lost)]


def _silences(t_s: F64, period_s: float) -> list[tuple[int, float]]:
    gaps = np.diff(t_s)
    return [(int(k) + 1, float(gaps[k])) for k in np.flatnonzero(gaps > 1.5 * period_s)]


def _snr_db(samples: F32, starts: I64) -> F64:
    """Echo level over the quiet tail of the same frame, high-passed to the upper band."""
    sharpened = np.diff(samples, n=2, append=samples[-2:]).astype(np.float64)
    tail = 441
    levels = []
    for start in starts:
        echo = sharpened[start : start + ECHO_SAMPLES]
        rest = sharpened[start + ECHO_SAMPLES : start + ECHO_SAMPLES + 2 * tail][-tail:]
        levels.append((np.mean(echo**2), np.mean(rest**2) if len(rest) else np.mean(echo**2)))
    power = np.array(levels) + 1e-20
    return np.asarray(10 * np.log10(power[:, 0] / power[:, 1]))
