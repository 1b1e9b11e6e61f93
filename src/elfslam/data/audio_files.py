"""Sound of a recording on disk: 24-bit FLAC written; FLAC, WAV, frames and baseband read."""

import io
import os
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import soundfile

from elfslam.base.arrays import F32
from elfslam.base.bounds import check_claim
from elfslam.base.errors import InputError
from elfslam.base.values import Audio
from elfslam.data.baseband import IQ, SPARSEST_FRAMES, from_baseband, read_baseband
from elfslam.data.tables import read_timed_table
from elfslam.stages.chirp import ACCEPTED_RATES_HZ
from elfslam.stages.echo import resampled

FLAC, WAV = "audio.flac", "audio.wav"
FRAMES, FRAME_TIMES = ("frames.flac", "frames.wav"), "frames.csv"
UNKNOWN_WAV_SIZES = (0, 0xFFFFFFFF)
"""What programs write that stream a WAV and never come back to say how long it became."""


LARGEST_FLOAT = 8.0
"""Floats that were made louder than full scale stay below."""
WHOLE_SCALES = (2.0**15, 2.0**23, 2.0**31)


def write_audio(audio: Audio, file: Path) -> None:
    """24-bit FLAC, which keeps float32 samples to 6e-8. Raises OSError."""
    encoded = io.BytesIO()  # soundfile does not say of every disk that it is full
    soundfile.write(encoded, audio.samples.T, audio.rate_hz, subtype="PCM_24", format="FLAC")
    file.write_bytes(encoded.getbuffer())


def read_audio(file: Path) -> Audio:
    """Audio with one row per channel; floats in the scale of whole numbers are put into [-1, 1].

    Raises InputError where unreadable or cut off.
    """
    try:
        with soundfile.SoundFile(os.fsencode(file)) as sound:
            promised, rate_hz = sound.frames, sound.samplerate
            _check_length(file, file, promised * sound.channels)
            samples = sound.read(dtype="float32", always_2d=True)
    except (OSError, RuntimeError) as cause:
        raise InputError(f"{file}: cannot be read as sound ({cause}); record again") from cause
    if len(samples) != promised or _wav_is_cut_off(file):
        raise InputError(f"{file}: is cut off; copy the file again")
    if not np.isfinite(samples).all():
        raise InputError(f"{file}: has samples that are not finite; write it again as FLAC")
    return _in_unit_scale(samples, rate_hz)


def _in_unit_scale(samples: F32, rate_hz: int) -> Audio:
    """Samples (n, c) as audio: whoever writes floats may write those of an integer's scale."""
    peak = float(max(samples.max(initial=0.0), -samples.min(initial=0.0)))
    if peak <= LARGEST_FLOAT:
        return Audio(samples.T, rate_hz)
    scale = next((each for each in WHOLE_SCALES if peak <= each), WHOLE_SCALES[-1])
    note = f"the sound reaches {peak:.0f}, as whole numbers do; it was divided by {scale:.0f}"
    return Audio(samples.T / np.float32(scale), rate_hz, notes=(note,))


def at_accepted_rate(audio: Audio) -> Audio:
    """The sound at 44.1 or 48 kHz where its rate is a multiple of that, else as it is."""
    rate_hz = next((each for each in ACCEPTED_RATES_HZ if audio.rate_hz % each == 0), audio.rate_hz)
    down = audio.rate_hz // rate_hz
    if down == 1:
        return audio
    samples = np.array([resampled(row, 1, down) for row in audio.samples])
    note = f"the sound was resampled from {audio.rate_hz} to {rate_hz} Hz"
    return replace(audio, samples=samples, rate_hz=rate_hz, notes=(*audio.notes, note))


def _check_length(file: Path, source: Path, samples: float) -> None:
    """Refuse more samples, of all channels, than a sound file can stand for."""
    claimed_bytes = samples * np.dtype(np.float32).itemsize
    check_claim(source, "its length", claimed_bytes, file.stat().st_size)


def _wav_is_cut_off(file: Path) -> bool:
    with file.open("rb") as stream:
        head = stream.read(8)
    if head[:4] != b"RIFF":
        return False
    (size,) = struct.unpack("<I", head[4:8])
    return size not in UNKNOWN_WAV_SIZES and size + 8 > file.stat().st_size


def read_recorded_sound(folder: Path, baseband: object = None) -> Audio | None:
    """The sound of a recording folder; None where it has none. Raises InputError.

    `baseband` is what recording.json says of one. Whole sound is taken before frames, and
    frames before the baseband.
    """
    for name in (FLAC, WAV):
        if (folder / name).is_file():
            return read_audio(folder / name)
    for name in FRAMES:
        if (folder / name).is_file():
            return _read_frames(folder, name)
    if (folder / IQ).is_file():
        return from_baseband(read_baseband(folder, baseband))
    return None


def _read_frames(folder: Path, name: str) -> Audio:
    """Equally long frames put at their times on a silent time line."""
    sound = read_audio(folder / name)
    t_s, _ = read_timed_table(folder / FRAME_TIMES, [])
    channels, total = sound.samples.shape
    if t_s[0] < 0 or total == 0 or total % len(t_s):
        raise InputError(
            f"{folder / name}: {total} samples are not {len(t_s)} equal frames at times from "
            f"0 on; check {FRAME_TIMES}"
        )
    _check_length(folder / name, folder / FRAME_TIMES, t_s[-1] * sound.rate_hz * channels)
    frames = sound.samples.reshape(channels, len(t_s), -1)
    starts = np.round(t_s * sound.rate_hz).astype(np.int64)
    length = int(starts[-1]) + frames.shape[2]
    if total < SPARSEST_FRAMES * length:
        raise InputError(f"{folder / FRAME_TIMES}: frames last to {t_s[-1]:.0f} s; wanted seconds")
    line = np.zeros((channels, length), dtype=np.float32)
    for k, start in enumerate(starts):
        line[:, start : start + frames.shape[2]] = frames[:, k]
    return replace(sound, samples=line, is_timed=True)
