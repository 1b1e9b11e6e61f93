"""Bits per second of walks as a phone page sends them: each file of the folders given.

Usage: PYTHONPATH=src python -m studies.benchmarks.phone_bits FOLDER...
A folder is a recording: the page's own, or one that `elfslam simulate` made, of which the sound is
then counted as the page would keep it, compact and as WAV.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from elfslam.data.baseband import IQ, frame_starts_s, to_baseband, write_baseband
from elfslam.data.recordings import read_recording
from elfslam.stages.chirp import ChirpParameters, make_chirp

FRAME_S = 0.08
SENT = ("baseband.iq", "baseband.csv", "frames.wav", "frames.csv")
MOTION = ("accelerometer.csv", "gyroscope.csv")


def bits_per_second(folder: Path) -> dict[str, float]:
    """By file; "compact" and "WAV" are what would be sent of a recording with whole sound."""
    recording = read_recording(folder)
    assert recording.audio is not None, f"{folder}: has no sound"
    audio = recording.audio
    seconds = audio.samples.shape[1] / audio.rate_hz
    found = {
        name: 8 * (folder / name).stat().st_size / seconds
        for name in (*SENT, *MOTION)
        if (folder / name).is_file()
    }
    if not (folder / IQ).is_file() and not (folder / "frames.wav").is_file():
        chirp = make_chirp(ChirpParameters(), audio.rate_hz)
        kept = to_baseband(audio, frame_starts_s(audio, chirp))
        with tempfile.TemporaryDirectory() as made:
            write_baseband(kept, Path(made))
            size = sum(file.stat().st_size for file in Path(made).iterdir())
        found["compact"] = 8 * size / seconds
        found["WAV"] = 16 * FRAME_S * audio.rate_hz * len(kept.first) / seconds
    return found


def main() -> None:
    """Print a table."""
    for folder in map(Path, sys.argv[1:]):
        for name, bits in bits_per_second(folder).items():
            print(f"{folder.name:24s} {name:20s} {bits / 1000:7.1f} kbit/s")


if __name__ == "__main__":
    main()
