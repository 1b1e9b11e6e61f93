"""What somebody who has the frames of a walk could do to hear what was said near the phone."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy import signal

from elfslam.base.arrays import F64
from elfslam.data.baseband import Baseband, from_baseband

C128 = npt.NDArray[np.complex128]
OUT_HZ = 10_000
"""At which intelligibility is measured; it hears up to 4.3 kHz."""
MIX_HZ = 20_000
PLACES_HZ = (-3000, -2000, -1000, 0, 300, 1000, 2000, 3000)
"""Where the lower edge of the band is put."""
SPEECH_EDGES_HZ = (150, 550, 1100, 2200, 4400)
SLICES = 32
STEP = 16
LEAST_LEFT = 0.03
LOUDEST = 0.9
"""Share of the samples that a limiter leaves alone."""


def as_sent(baseband: Baseband) -> dict[str, F64]:
    """Played as it is: its sound, and the sound as if the band had been folded up from 0 Hz."""
    sound = from_baseband(baseband)
    played = signal.resample_poly(sound.samples[0].astype(np.float64), OUT_HZ, sound.rate_hz)
    line, kept = line_of(baseband), baseband.kept
    turn = np.exp(2j * np.pi * kept.centre_hz * np.arange(len(line)) / kept.rate_hz)
    unfolded = signal.resample_poly((line * turn).real, OUT_HZ, kept.rate_hz)
    return {"played": np.asarray(played), "unfolded": np.asarray(unfolded)}


def shifted(baseband: Baseband) -> dict[str, F64]:
    """The band moved down to where speech lives, to many places, the right way up and mirrored."""
    kept = baseband.kept
    line = signal.resample_poly(line_of(baseband), MIX_HZ, kept.rate_hz)
    t_s = np.arange(len(line)) / MIX_HZ
    made = {}
    for place_hz in PLACES_HZ:
        turn = np.exp(2j * np.pi * (place_hz + kept.rate_hz / 2) * t_s)
        for way, band in (("up", line), ("mirrored", line.conj())):
            sound = signal.resample_poly((band * turn).real, 1, MIX_HZ // OUT_HZ)
            made[f"{way} at {place_hz} Hz"] = np.asarray(sound)
    return made


def vocoded(baseband: Baseband) -> dict[str, F64]:
    """Noise that is as loud as the band: all of it, and four parts of it in four parts of speech.

    As a vocoder does (Shannon et al. 1995), whose listeners understand speech from four bands.
    """
    line, rate_hz = line_of(baseband), baseband.kept.rate_hz
    edges_hz = np.linspace(-rate_hz / 2, rate_hz / 2, len(SPEECH_EDGES_HZ))
    loud = [_loudness(_part(line, rate_hz, *pair)) for pair in _pairs(edges_hz)]
    one = _loudness(line)
    return {
        "one band": sum(_noises(len(one))) * one,
        "four bands": _sum(loud),
        "four bands, mirrored": _sum(loud[::-1]),
    }


FORMS: Mapping[str, Callable[[Baseband], dict[str, F64]]] = {
    "as sent": as_sent,
    "shifted down": shifted,
    "envelope": vocoded,
}
"""What is made of the frames; of several ways the best counts."""


def enhanced(baseband: Baseband) -> Baseband:
    """Frames without what all of them have in common, the chirp and its echoes, and limited.

    Spectral subtraction (Boll 1979) at each moment of the frame, of the median over the frames.
    """
    frames = baseband.iq[..., 0] + 1j * baseband.iq[..., 1]
    frames = frames * baseband.scale[:, None]
    overlap = SLICES - STEP
    _, _, spectrum = signal.stft(frames, nperseg=SLICES, noverlap=overlap, return_onesided=False)
    size = np.abs(spectrum)
    common = np.median(size, axis=0)
    left = np.maximum(1 - 1.5 * common / np.maximum(size, 1e-30), LEAST_LEFT)
    spectrum = spectrum * left
    _, clean = signal.istft(spectrum, nperseg=SLICES, noverlap=overlap, input_onesided=False)
    clean = clean[:, : frames.shape[1]]
    limit = max(float(np.quantile(np.abs(clean), LOUDEST)), 1e-12)
    clean = clean / np.maximum(np.abs(clean) / limit, 1)
    parts = np.stack([clean.real, clean.imag], axis=-1) / limit * 32_767
    scale = np.full(len(frames), limit / 32_767)
    return replace(baseband, iq=np.round(parts).astype(np.int16), scale=scale)


def line_of(baseband: Baseband) -> C128:
    """The frames at their times on the grid of the rate, silence between."""
    size = baseband.kept.frame_samples
    line = np.zeros(int(baseband.first[-1]) + size, dtype=np.complex128)
    for first, frame, scale in zip(baseband.first, baseband.iq, baseband.scale, strict=True):
        line[first : first + size] = scale * (frame[:, 0] + 1j * frame[:, 1])
    return line


def _loudness(band: C128) -> F64:
    """How loud it is by and by, at the rate of what comes out."""
    smooth = signal.butter(2, 60, fs=6300, output="sos")
    loud = signal.sosfiltfilt(smooth, np.abs(band))
    return np.asarray(np.maximum(signal.resample_poly(loud, OUT_HZ, 6300), 0))


def _part(line: C128, rate_hz: int, low_hz: float, high_hz: float) -> C128:
    spectrum, hz = np.fft.fft(line), np.fft.fftfreq(len(line), 1 / rate_hz)
    return np.asarray(np.fft.ifft(np.where((hz >= low_hz) & (hz < high_hz), spectrum, 0)))


def _noises(count: int) -> list[F64]:
    white = np.random.default_rng(1).standard_normal(count)
    made = []
    for pair in _pairs(np.array(SPEECH_EDGES_HZ, dtype=np.float64)):
        sections = signal.butter(4, pair, "bandpass", fs=OUT_HZ, output="sos")
        made.append(np.asarray(signal.sosfilt(sections, white)))
    return made


def _sum(loud: list[F64]) -> F64:
    noises = _noises(len(loud[0]))
    return np.asarray(np.sum([a * b for a, b in zip(loud, noises, strict=True)], axis=0))


def _pairs(edges: F64) -> list[tuple[float, float]]:
    return [(float(low), float(high)) for low, high in pairwise(edges)]
