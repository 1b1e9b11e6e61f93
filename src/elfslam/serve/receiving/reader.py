"""Reads the folder of a recording and prints what it holds, as JSON.

`python -m elfslam.serve.receiving.reader FOLDER BYTES` uses at most so much memory.
"""

from __future__ import annotations

import json
import resource
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.values import Recording
from elfslam.data.recordings import read_recording
from elfslam.line.chirp import check_rate
from elfslam.line.motion import MotionParameters, find_footsteps
from elfslam.serve.receiving.reading import Found


def find(folder: Path) -> Found:
    """What a folder holds, read here and now."""
    try:
        recording = read_recording(folder)
        if recording.audio is not None:
            check_rate(recording.audio.rate_hz)
        return Found(facts_of(recording))
    except InputError as error:
        return Found(refusal=str(error).replace(f"{folder}/", "").replace(f"{folder}: ", ""))
    except MemoryError:
        return Found(refusal="reading needs more memory than is allowed; cut it in parts")


def facts_of(recording: Recording) -> dict[str, Any]:
    """What is told of a recording: name, device, duration, sensors, footsteps."""
    facts: dict[str, Any] = {"name": recording.name, "device": recording.device}
    ends_s = [0.0]
    if recording.audio is not None:
        channels, samples = recording.audio.samples.shape
        rate_hz = recording.audio.rate_hz
        ends_s.append(samples / rate_hz)
        facts["audio"] = {"rate_hz": rate_hz, "channels": channels}
    sensors = ("imu", "orientation", "odometry", "magnetometer", "wifi", "emr")
    present = {name: getattr(recording, name) for name in sensors}
    ends_s += [
        float(value.t_s[-1]) for value in present.values() if value is not None and len(value.t_s)
    ]
    facts["sensors"] = [name for name, value in present.items() if value is not None]
    facts["duration_s"] = round(float(np.max(ends_s)), 3)
    if recording.start_pose is not None:
        facts["start_pose"] = list(recording.start_pose)
    if (footsteps := _footsteps(recording)) is not None:
        facts["footsteps"] = footsteps
    return facts


def _footsteps(recording: Recording) -> int | None:
    """How many there are; None where the motion sensors do not tell."""
    if recording.imu is None:
        return None
    try:
        return len(find_footsteps(recording.imu, MotionParameters()))
    except InputError:
        return None


def main(folder: Path, most_bytes: int) -> None:
    """Print what is found in a folder, with at most so much memory."""
    resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))
    found = find(folder)
    print(json.dumps(asdict(found), allow_nan=False))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
