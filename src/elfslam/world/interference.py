"""Other sounds in the room, and what the phone's recorder makes of it all.

Levels are of the recorded stream, whose full scale is 1. Speech and music are rough imitations:
what counts is when they sound and how much of them lies in the chirp's band.
"""

import numba
import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.world.device import Device

RUMBLE_LEVEL = 3e-4
"""White noise before the low-pass: ventilation, handling; 1.3e-4 are left after it."""

FORMANTS_HZ = ((300.0, 800.0), (900.0, 2200.0), (2300.0, 3000.0))
FORMANT_WIDTH_HZ = 90.0
FRICATIVE_BAND_HZ = (4_000.0, 9_000.0)
FRICATIVE_SHARE = 0.45
"""Share of the syllables that begin with a fricative."""
FRICATIVE_GAIN = 0.3
"""Amplitude beside the vowel: an estimate that puts 15 to 20 kHz 42 to 48 dB under the whole."""

HARMONICS = 8
PERCUSSION_GAIN = 0.12
"""Amplitude beside a note: an estimate that puts 15 to 20 kHz 32 dB under the whole."""
CYMBAL_LOW_HZ = 6_000.0

CLICK_BAND_HZ = (13_000.0, 21_000.0)
CLICK_MODES = 4
CLICK_LONGEST_S = 0.03

TAPS = 64
PHASES = 512


def speech_like(count: int, rate_hz: int, generator: np.random.Generator, level: float) -> F32:
    """Syllables of one talker (count) with an rms of `level`, pauses included.

    Vowels of a talker's pitch between 100 and 220 Hz, nearly half of them after a fricative.
    """
    out = np.zeros(count)
    pitch_hz = generator.uniform(100.0, 220.0)
    start = 0
    while start < count:
        sound = _syllable(rate_hz, pitch_hz * generator.uniform(0.85, 1.15), generator)
        _add(out, start, generator.uniform(0.5, 1.0) * sound)
        pause_s = generator.uniform(0.2, 0.6) if generator.uniform() < 0.15 else 0.02
        start += len(sound) + round(pause_s * rate_hz)
    return _with_rms(out, level)


def music_like(count: int, rate_hz: int, generator: np.random.Generator, level: float) -> F32:
    """Decaying notes of a five-tone scale over cymbals (count) with an rms of `level`."""
    out = np.zeros(count)
    beat = round(rate_hz * 30.0 / generator.uniform(90.0, 140.0))
    scale = np.array([0, 2, 4, 7, 9, 12, 14, 16, 19, 21])
    for start in range(0, count, beat):
        if generator.uniform() < 0.8:
            note_hz = 220.0 * 2 ** (generator.choice(scale) / 12)
            _add(out, start, generator.uniform(0.4, 1.0) * _note(rate_hz, note_hz))
        strike = PERCUSSION_GAIN * generator.uniform(0.3, 1.0)
        _add(out, start, strike * _cymbal(rate_hz, generator))
    return _with_rms(out, level)


def clicks(
    count: int, rate_hz: int, generator: np.random.Generator, level: float, *, per_s: float = 2.0
) -> F32:
    """Keys and dishes (count): clicks in the band at random times, `per_s` of them on average.

    `level` is the median of their peaks; one in six is more than twice as loud.
    """
    out = np.zeros(count)
    times = generator.integers(0, count, generator.poisson(per_s * count / rate_hz))
    for start in np.sort(times):
        loudness = level * np.exp(0.7 * generator.standard_normal())
        _add(out, int(start), loudness * _click(rate_hz, generator))
    return out.astype(np.float32)


def rumble(count: int, rate_hz: int, generator: np.random.Generator) -> F32:
    """Noise of the room (count): white noise after a low-pass at 4 kHz."""
    low_pass = signal.butter(2, 4_000, fs=rate_hz, output="sos")
    noise = RUMBLE_LEVEL * signal.sosfilt(low_pass, generator.standard_normal(count))
    return np.asarray(noise, dtype=np.float32)


def record(stream: F32, device: Device, generator: np.random.Generator) -> F32:
    """What the phone's recorder makes of the sound at its microphone (n), as many samples.

    With a positive `clock_skew_ppm` the recorder's clock runs fast against the player's: what was
    played at sample k stands at k (1 + skew) of the recording, and its end is cut off. With a
    negative one the recording ends in silence. Then comes the noise floor, and clipping last.
    """
    skew = 1e-6 * device.clock_skew_ppm
    heard = stream if skew == 0 else _resampled(stream.astype(np.float32), 1 + skew, _sinc_table())
    noise = generator.standard_normal(len(stream), dtype=np.float32)
    loud = heard + np.float32(device.noise_rms) * noise
    return np.asarray(np.clip(loud, -device.clip_level, device.clip_level), dtype=np.float32)


def _syllable(rate_hz: int, pitch_hz: float, generator: np.random.Generator) -> F64:
    """Perhaps a fricative, then a vowel whose own rms is 1."""
    vowel = _vowel(round(generator.uniform(0.10, 0.22) * rate_hz), rate_hz, pitch_hz, generator)
    if generator.uniform() >= FRICATIVE_SHARE:
        return vowel
    noise = generator.standard_normal(round(generator.uniform(0.05, 0.12) * rate_hz))
    band_pass = signal.butter(2, FRICATIVE_BAND_HZ, "bandpass", fs=rate_hz, output="sos")
    fricative = signal.sosfilt(band_pass, noise) * np.hanning(len(noise))
    return np.concatenate([FRICATIVE_GAIN * fricative / _rms(fricative), vowel])


def _vowel(size: int, rate_hz: int, pitch_hz: float, generator: np.random.Generator) -> F64:
    """A train of pulses at the pitch through three resonances; its rms is 1."""
    glide = np.linspace(1.0, generator.uniform(0.85, 1.1), size)
    periods = np.floor(np.cumsum(pitch_hz * glide / rate_hz))
    pulses = np.diff(periods, prepend=-1.0)
    formants = [_resonance(generator.uniform(*limits), rate_hz) for limits in FORMANTS_HZ]
    sound = signal.sosfilt(np.array(formants), pulses - pulses.mean()) * np.hanning(size)
    return np.asarray(sound / _rms(sound))


def _resonance(frequency_hz: float, rate_hz: int) -> list[float]:
    """A section with two poles and a gain of 1 at 0 Hz."""
    radius = np.exp(-np.pi * FORMANT_WIDTH_HZ / rate_hz)
    first = -2 * radius * np.cos(2 * np.pi * frequency_hz / rate_hz)
    return [1 + first + radius**2, 0.0, 0.0, 1.0, first, radius**2]


def _note(rate_hz: int, note_hz: float) -> F64:
    t_s = np.arange(round(0.8 * rate_hz)) / rate_hz
    order = np.arange(1, HARMONICS + 1)[:, None]
    tones = np.sin(2 * np.pi * note_hz * order * t_s) * np.exp(-(3 + order) * t_s) / order**1.2
    return np.asarray(tones.sum(axis=0))


def _cymbal(rate_hz: int, generator: np.random.Generator) -> F64:
    size = round(0.15 * rate_hz)
    high_pass = signal.butter(2, CYMBAL_LOW_HZ, "highpass", fs=rate_hz, output="sos")
    noise = signal.sosfilt(high_pass, generator.standard_normal(size))
    return np.asarray(noise * np.exp(-np.arange(size) / (0.03 * rate_hz)))


def _click(rate_hz: int, generator: np.random.Generator) -> F64:
    """A few modes that ring for 1 to 5 ms; the peak is 1."""
    t_s = np.arange(round(CLICK_LONGEST_S * rate_hz)) / rate_hz
    frequency_hz = generator.uniform(*CLICK_BAND_HZ, CLICK_MODES)[:, None]
    phase = generator.uniform(0, 2 * np.pi, CLICK_MODES)[:, None]
    ringing_s = generator.uniform(1e-3, 5e-3, CLICK_MODES)[:, None]
    modes = np.sin(2 * np.pi * frequency_hz * t_s + phase) * np.exp(-t_s / ringing_s)
    sound = modes.sum(axis=0)
    return np.asarray(sound / np.abs(sound).max())


def _add(out: F64, start: int, sound: F64) -> None:
    kept = sound[: len(out) - start]
    out[start : start + len(kept)] += kept


def _rms(sound: F64) -> float:
    return float(np.sqrt(np.mean(sound**2)))


def _with_rms(sound: F64, level: float) -> F32:
    rms = _rms(sound)
    return np.asarray(sound * (level / rms if rms else 0.0), dtype=np.float32)


def _sinc_table() -> F32:
    """Windowed sincs (PHASES + 1, TAPS) for a delay of phase / PHASES; off by 0.001 at 20 kHz."""
    x = np.arange(TAPS)[None, :] - (TAPS // 2 - 1) - np.arange(PHASES + 1)[:, None] / PHASES
    window = np.i0(6.0 * np.sqrt(np.maximum(1 - (x / (TAPS / 2)) ** 2, 0.0))) / np.i0(6.0)
    return (np.sinc(x) * window).astype(np.float32)


@numba.njit(cache=True, fastmath=True, nogil=True)
def _resampled(stream, ratio, table):  # type: ignore[no-untyped-def]
    """The stream (n) at the times n / ratio, zero beyond its ends."""
    out = np.zeros(len(stream), dtype=np.float32)
    for n in range(len(stream)):
        position = n / ratio
        whole = int(position)
        phase = (position - whole) * PHASES
        row = min(int(phase), PHASES - 1)
        share = np.float32(phase - row)
        first = whole - (TAPS // 2 - 1)
        total = np.float32(0.0)
        for tap in range(max(0, -first), min(TAPS, len(stream) - first)):
            weight = table[row, tap] + share * (table[row + 1, tap] - table[row, tap])
            total += weight * stream[first + tap]
        out[n] = total
    return out
