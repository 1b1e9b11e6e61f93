"""The chirp band alone, frame by frame: a recording small enough to be sent from a phone.

What is kept of the sound x is its analytic signal in the chirp band, shifted down to zero:

    b(t) = 2 sum_n x[n] exp(-2 pi i f n / F) h(t - n / F)        F: rate of the sound, f: centre

at t = k / rate, with phase zero at the recording's time 0. h is a low-pass of unit gain, a
windowed sinc: h(t) = (rate / F) sinc(rate t) kaiser(t / T), with T = 7 ms and shape 14
(sinc(u) = sin(pi u) / (pi u), kaiser(v) = I0(14 sqrt(1 - v^2)) / I0(14), nothing beyond |v| = 1).
So at rate / 2 either side of f it is half way down; there 300 Hz of noise fold onto 300 others,
which keeps the level of the noise, and 15 to 20 kHz stay clean. Below 8 kHz it is 160 dB down:
what folds into the band from there lies deep under any microphone's noise.
A frame is a run of samples k, k+1, ... from 5 ms before a direct arrival on; between frames
nothing is kept. At 6300 samples/s and 16 bits a frame of 80 ms every 100 ms makes 161 kbit/s.
Each frame has a scale of its own, what one step of its 16 bits stands for; walks recorded before
that was so have one for all, and a filter of T = 4 ms and shape 8, which is as true in the band.

`in_band` is the same band as plain sound:

    y[n] = 2 sum_m x[m] h((n - m) / F) cos(2 pi f (n - m) / F).
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import gcd
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy import signal

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.bounds import check_claim
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_bytes
from elfslam.base.values import ECHO_RATE_HZ, Audio, Chirp
from elfslam.data.tables import read_header, read_timed_table
from elfslam.stages.chirp import ACCEPTED_RATES_HZ
from elfslam.stages.echo import EchoParameters, find_arrivals, matched_envelope, to_echo_rate

Sample = TypeVar("Sample", np.float32, np.complex64)
C64 = npt.NDArray[np.complex64]
I16 = npt.NDArray[np.int16]

KAISER_SHAPE = 14.0
"""135 dB between what passes and what does not, more the farther from the band."""
HALF_SUPPORT_S = 0.007
"""Of the filter that takes the band out."""
RESTORING_SHAPE = 8.0
"""Of the filter that puts the band back: 80 dB."""
HALF_SUPPORT = 13
"""Samples of the filter that puts the band back."""
BLOCK = 1 << 18
"""Samples filtered at once: memory does not grow with the walk."""
LARGEST_INT16 = 32767
LEAST = 1e-6
"""Silence has a scale too."""


@dataclass(frozen=True)
class BasebandFormat:
    """How the band is kept; `recording.json` says it under "baseband", field by field.

    `scale` is that of frames whose row in `baseband.csv` names none.
    """

    rate_hz: int = 6300
    centre_hz: float = 17_500.0
    frame_samples: int = 504
    scale: float = 1 / LARGEST_INT16
    source_rate_hz: int = 48_000
    lead_s: float = 0.005


@dataclass(frozen=True, eq=False)
class Baseband:
    """Frames (f, n, 2) of 16-bit I and Q, of each the grid index k of its first sample and what
    one of its steps stands for (f), and the format."""

    first: I64
    iq: I16
    scale: F64
    kept: BasebandFormat

    @property
    def t_s(self) -> F64:
        """When each frame begins (f)."""
        return np.asarray(self.first / self.kept.rate_hz)


def to_baseband(audio: Audio, starts_s: F64, scale: float | None = None) -> Baseband:
    """Frames of channel 0 that begin on the grid nearest to `starts_s` (f), none before time 0.

    Frames that the sound does not cover to their end are left out. `scale` is what one step of
    the 16 bits stands for, by default in each frame the least that clips nothing. Raises
    InputError where no frame is left.
    """
    kept = BasebandFormat(source_rate_hz=audio.rate_hz)
    line = np.concatenate(list(_band(audio, kept)))
    first = np.unique(np.maximum(np.round(starts_s * kept.rate_hz).astype(np.int64), 0))
    first = first[first + kept.frame_samples <= len(line)]
    if not len(first):
        raise InputError("audio: holds no whole frame of the chirp band; record longer")
    frames = line[first[:, None] + np.arange(kept.frame_samples)]
    parts = np.stack([frames.real, frames.imag], axis=-1).astype(np.float64)
    least = np.maximum(np.abs(parts).max(axis=(1, 2)), LEAST) / LARGEST_INT16
    steps = np.full(len(first), scale) if scale else least
    counts = np.clip(np.round(parts / steps[:, None, None]), -LARGEST_INT16, LARGEST_INT16)
    return Baseband(first, counts.astype(np.int16), steps, kept)


def in_band(audio: Audio) -> Audio:
    """The sound with everything outside the band taken out, undelayed, at the same rate.

    What the phone page keeps as `frames.wav`. True from 15 to 20 kHz.
    """
    half = round(HALF_SUPPORT_S * audio.rate_hz)
    n = np.arange(-half, half + 1)
    kept = BasebandFormat(source_rate_hz=audio.rate_hz)
    low = _low_pass(n / audio.rate_hz, kept)
    taps = 2 * low * np.cos(2 * np.pi * kept.centre_hz * n / audio.rate_hz)
    rows = [signal.oaconvolve(row.astype(np.float64), taps, mode="same") for row in audio.samples]
    return Audio(np.array(rows, dtype=np.float32), audio.rate_hz, audio.is_timed)


def frame_starts_s(audio: Audio, chirp: Chirp) -> F64:
    """Where a frame has to begin (f) for each direct arrival that is found. Raises InputError."""
    period = round(chirp.period_s * ECHO_RATE_HZ)
    envelope = matched_envelope(to_echo_rate(audio), chirp)
    arrivals = find_arrivals(envelope, period, EchoParameters())
    return np.asarray(arrivals.samples / ECHO_RATE_HZ - BasebandFormat.lead_s)


def from_baseband(baseband: Baseband) -> Audio:
    """The band as sound at the source's rate (1, n), each frame at its time, silence between.

    It is true from 15 to 20 kHz, and up to 2 ms from the ends of a frame. Frames that overlap
    are the same sound, and the later one counts.
    """
    kept = baseband.kept
    length = int(baseband.first[-1]) + kept.frame_samples
    line = np.zeros(length, dtype=np.complex64)
    frames = (baseband.iq * baseband.scale[:, None, None]).astype(np.float32)
    for k, frame in zip(baseband.first, frames, strict=True):
        line[k : k + kept.frame_samples] = frame[:, 0] + 1j * frame[:, 1]
    sound = np.concatenate(list(_sound(line, kept)))
    return Audio(sound[None], kept.source_rate_hz, is_timed=True)


def _ratio(kept: BasebandFormat) -> tuple[int, int]:
    common = gcd(kept.rate_hz, kept.source_rate_hz)
    return kept.rate_hz // common, kept.source_rate_hz // common


def _band(audio: Audio, kept: BasebandFormat) -> Iterator[C64]:
    up, down = _ratio(kept)
    half = round(HALF_SUPPORT_S * kept.source_rate_hz * up)
    t_s = np.arange(-half, half + 1) / (kept.source_rate_hz * up)
    taps = _low_pass(t_s, kept)
    for first, block, inside in _blocks(audio.samples[0], down, -(-half // up)):
        turned = block * _turns(first, len(block), -kept.centre_hz, kept.source_rate_hz)
        yield _resampled(turned, up, down, 2 * taps, inside)


def _sound(line: C64, kept: BasebandFormat) -> Iterator[F32]:
    down, up = _ratio(kept)
    half = HALF_SUPPORT * up
    taps = np.sinc(np.arange(-half, half + 1) / up) * np.kaiser(2 * half + 1, RESTORING_SHAPE)
    for first, block, inside in _blocks(line, down, HALF_SUPPORT):
        made = _resampled(block, up, down, taps, inside)
        start = (first + inside.start) // down * up
        yield np.real(made * _turns(start, len(made), kept.centre_hz, kept.source_rate_hz))


def _low_pass(t_s: F64, kept: BasebandFormat) -> F64:
    window = np.kaiser(len(t_s), KAISER_SHAPE)
    gain = kept.rate_hz / kept.source_rate_hz
    return np.asarray(gain * np.sinc(kept.rate_hz * t_s) * window)


def _blocks(
    line: npt.NDArray[Sample], multiple: int, reach: int
) -> Iterator[tuple[int, npt.NDArray[Sample], slice]]:
    """(index of its first sample, samples, the part that is not margin), on whole multiples."""
    margin = -(-reach // multiple) * multiple
    step = -(-BLOCK // multiple) * multiple
    for start in range(0, len(line), step):
        first = max(start - margin, 0)
        yield (
            first,
            line[first : start + step + margin],
            slice(start - first, min(start + step, len(line)) - first),
        )


def _resampled(block: C64, up: int, down: int, taps: F64, inside: slice) -> C64:
    """What lies inside, at `up / down` times the rate; the taps are those of the common rate."""
    # resample_poly multiplies by `up`.
    made = signal.resample_poly(block, up, down, window=(taps / up).astype(np.float32))
    return np.asarray(made[inside.start * up // down : -(-inside.stop * up // down)])


def _turns(first: int, count: int, hz: float, rate_hz: int) -> C64:
    """exp(2 pi i hz t) at the samples from `first` on."""
    turn = np.mod((first + np.arange(count, dtype=np.float64)) * hz / rate_hz, 1.0)
    return np.exp(2j * np.pi * turn).astype(np.complex64)


IQ, FRAME_TIMES = "baseband.iq", "baseband.csv"
BYTES = 4
"""Of one sample: I and Q, little-endian 16 bits each."""
SAMPLE_BYTES = 4
"""Of the sound that is made of it."""
LIMITS = {
    "rate_hz": (5000, 24_000),
    "centre_hz": (10_000, 22_000),
    "frame_samples": (1, 24_000),
    "scale": (1e-12, 1.0),
    "source_rate_hz": (min(ACCEPTED_RATES_HZ), max(ACCEPTED_RATES_HZ)),
    "lead_s": (0, 1),
}
"""What recording.json must say, and between which values it is believed."""
WHOLE = ("rate_hz", "frame_samples", "source_rate_hz")
SPARSEST_FRAMES = 0.01
"""Frames that fill less of their time line than this carry times in another unit."""
OFF_GRID = 0.01
"""Of a sample; nine decimals of a second are within 1e-4."""


def write_baseband(baseband: Baseband, folder: Path) -> dict[str, object]:
    """Both files into `folder`; gives what recording.json says under "baseband"."""
    (folder / IQ).write_bytes(baseband.iq.astype("<i2").tobytes())
    pairs = zip(baseband.t_s, baseband.scale.tolist(), strict=True)
    rows = "".join(f"{t_s:.9f},{scale!r}\n" for t_s, scale in pairs)
    (folder / FRAME_TIMES).write_text("t_s,scale\n" + rows, encoding="utf-8")
    return asdict(baseband.kept)


def read_baseband(folder: Path, described: object) -> Baseband:
    """The frames of a folder; `described` is recording.json's "baseband". Raises InputError."""
    kept = _format(folder / "recording.json", described)
    t_s, scale = _times_and_scales(folder / FRAME_TIMES, kept)
    first = _on_grid(folder / FRAME_TIMES, t_s, kept)
    wanted = len(t_s) * kept.frame_samples * BYTES
    content = read_bytes(folder / IQ)
    if len(content) != wanted:
        raise InputError(
            f"{folder / IQ}: has {len(content)} bytes, wanted {wanted} for {len(t_s)} frames of "
            f"{kept.frame_samples} samples in {FRAME_TIMES}; copy both again"
        )
    samples = t_s[-1] * kept.source_rate_hz
    check_claim(folder / FRAME_TIMES, "its last time", samples * SAMPLE_BYTES, len(content))
    iq = np.frombuffer(content, dtype="<i2").reshape(len(t_s), kept.frame_samples, 2)
    return Baseband(first, iq.astype(np.int16), scale, kept)


def _times_and_scales(file: Path, kept: BasebandFormat) -> tuple[F64, F64]:
    """When each frame begins, and its scale: that of its row, else the one for all."""
    if "scale" not in read_header(file):
        t_s, _ = read_timed_table(file, [])
        return t_s, np.full(len(t_s), kept.scale)
    t_s, values = read_timed_table(file, ["scale"])
    low, high = LIMITS["scale"]
    beyond = np.flatnonzero((values[:, 0] < low) | (values[:, 0] > high))
    if len(beyond):
        row, got = beyond[0] + 2, values[beyond[0], 0]
        raise InputError(
            f"{file}: row {row} has scale {got:g}, wanted {low:g} to {high:g}; repair it"
        )
    return t_s, values[:, 0]


def _on_grid(file: Path, t_s: F64, kept: BasebandFormat) -> I64:
    """The index of each frame's first sample on the grid of the rate."""
    filled_s = len(t_s) * kept.frame_samples / kept.rate_hz
    if t_s[0] < 0 or filled_s < SPARSEST_FRAMES * t_s[-1]:
        raise InputError(
            f"{file}: {len(t_s)} frames from {t_s[0]:g} to {t_s[-1]:g} s; wanted seconds from 0 on"
        )
    first = np.round(t_s * kept.rate_hz)
    off = np.flatnonzero(np.abs(t_s * kept.rate_hz - first) > OFF_GRID)
    if len(off):
        raise InputError(
            f"{file}: row {off[0] + 2} has {t_s[off[0]]:.9f} s, wanted a multiple of "
            f"1/{kept.rate_hz} s; write nine decimals"
        )
    return first.astype(np.int64)


def _format(file: Path, described: object) -> BasebandFormat:
    if not isinstance(described, dict):
        raise InputError(f"{file}: baseband is {described!r:.60}, wanted how {IQ} was made")
    said = {name: _number(file, name, described.get(name)) for name in LIMITS}
    made = BasebandFormat(
        rate_hz=int(said["rate_hz"]),
        centre_hz=said["centre_hz"],
        frame_samples=int(said["frame_samples"]),
        scale=said["scale"],
        source_rate_hz=int(said["source_rate_hz"]),
        lead_s=said["lead_s"],
    )
    if made.source_rate_hz not in ACCEPTED_RATES_HZ:
        wanted = " or ".join(map(str, ACCEPTED_RATES_HZ))
        got = made.source_rate_hz
        raise InputError(f"{file}: baseband.source_rate_hz is {got}, wanted {wanted}; repair it")
    return made


def _number(file: Path, name: str, given: object) -> float:
    (low, high), whole = LIMITS[name], name in WHOLE
    if isinstance(given, int | float) and not isinstance(given, bool) and low <= given <= high:
        number = float(given)
        if number.is_integer() or not whole:
            return number
    kind = "a whole number" if whole else "a number"
    raise InputError(
        f"{file}: baseband.{name} is {given!r:.40}, wanted {kind} from {low:g} to {high:g}; "
        "repair it"
    )
