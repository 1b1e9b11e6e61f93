"""Sound of a recording on disk: 24-bit FLAC written; FLAC, WAV and chirp-by-chirp frames read."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import soundfile

from elfslam.base.errors import InputError
from elfslam.base.values import Audio
from elfslam.data.tables import read_timed_table

FLAC, WAV = "audio.flac", "audio.wav"
FRAMES, FRAME_TIMES = "frames.flac", "frames.csv"
UNKNOWN_WAV_SIZES = (0, 0xFFFFFFFF)
"""What programs write that stream a WAV and never come back to say how long it became."""
SPARSEST_FRAMES = 0.01
"""Frames that fill less of their time line than this carry times in another unit."""


def write_audio(audio: Audio, file: Path) -> None:
    """24-bit FLAC, which keeps float32 samples to 6e-8."""
    soundfile.write(file, audio.samples.T, audio.rate_hz, subtype="PCM_24", format="FLAC")


def read_audio(file: Path) -> Audio:
    """Audio with one row per channel. Raises InputError where unreadable or cut off."""
    try:
        with soundfile.SoundFile(file) as sound:
            promised, rate_hz = sound.frames, sound.samplerate
            samples = sound.read(dtype="float32", always_2d=True)
    except (OSError, RuntimeError) as cause:
        raise InputError(f"{file}: cannot be read as sound ({cause}); record again") from cause
    if len(samples) != promised or _wav_is_cut_off(file):
        raise InputError(f"{file}: is cut off; copy the file again")
    if not np.isfinite(samples).all():
        raise InputError(f"{file}: has samples that are not finite; write it again as FLAC")
    return Audio(samples.T, rate_hz)


def _wav_is_cut_off(file: Path) -> bool:
    with file.open("rb") as stream:
        head = stream.read(8)
    if head[:4] != b"RIFF":
        return False
    (size,) = struct.unpack("<I", head[4:8])
    return size not in UNKNOWN_WAV_SIZES and size + 8 > file.stat().st_size


def read_recorded_sound(folder: Path) -> Audio | None:
    """The sound of a recording folder; None where it has none. Raises InputError."""
    for name in (FLAC, WAV):
        if (folder / name).is_file():
            return read_audio(folder / name)
    if (folder / FRAMES).is_file():
        return _read_frames(folder)
    return None


def _read_frames(folder: Path) -> Audio:
    """Equally long frames put at their times on a silent time line."""
    sound = read_audio(folder / FRAMES)
    t_s, _ = read_timed_table(folder / FRAME_TIMES, [])
    channels, total = sound.samples.shape
    if t_s[0] < 0 or total == 0 or total % len(t_s):
        raise InputError(
            f"{folder / FRAMES}: {total} samples are not {len(t_s)} equal frames at times from "
            f"0 on; check {FRAME_TIMES}"
        )
    frames = sound.samples.reshape(channels, len(t_s), -1)
    starts = np.round(t_s * sound.rate_hz).astype(np.int64)
    length = int(starts[-1]) + frames.shape[2]
    if total < SPARSEST_FRAMES * length:
        raise InputError(f"{folder / FRAME_TIMES}: frames last to {t_s[-1]:.0f} s; wanted seconds")
    line = np.zeros((channels, length), dtype=np.float32)
    for k, start in enumerate(starts):
        line[:, start : start + frames.shape[2]] = frames[:, k]
    return Audio(line, sound.rate_hz)
