"""Which files a recording folder may have; nothing else is taken."""

from __future__ import annotations

FILE_NAMES = frozenset(
    (
        "recording.json",
        "audio.flac",
        "audio.wav",
        "frames.flac",
        "frames.wav",
        "frames.csv",
        "baseband.iq",
        "baseband.csv",
        "chirps.csv",
        "checkpoints.csv",
        "accelerometer.csv",
        "gyroscope.csv",
        "magnetometer.csv",
        "orientation.csv",
        "emr.csv",
        "wifi.csv",
        "odometry.tum",
        "odometry_sigma.csv",
        "truth.tum",
        "waypoints.csv",
    )
)
WHOLE = (".zip", ".tar.xz", ".txt", ".mat")
"""So end the names of whole recordings, and of what other programs write."""


def is_whole(name: str) -> bool:
    """Whether an upload of this name is all of a recording, or of several."""
    return name.lower().endswith(WHOLE)


def stem_of(name: str) -> str:
    """The name of such an upload without its ending."""
    ending = next((each for each in WHOLE if name.lower().endswith(each)), "")
    return name[: len(name) - len(ending)]
