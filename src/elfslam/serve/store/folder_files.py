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
ZIP = ".zip"
"""So end the names of whole recordings."""


def is_whole(name: str) -> bool:
    """Whether an upload of this name is a whole recording."""
    return name.lower().endswith(ZIP)
