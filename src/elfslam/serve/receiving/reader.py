"""What a child of the server finds in recordings from outside, within bounds of time and memory."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_json
from elfslam.base.values import Recording
from elfslam.data.recordings import MANIFEST, read_recording
from elfslam.serve.parsing.child import Bounds, without_places
from elfslam.serve.settings import Limits
from elfslam.slam.coverage import spans_of
from elfslam.stages.chirp import check_rate
from elfslam.stages.motion import MotionParameters, find_footsteps

if TYPE_CHECKING:
    from elfslam.serve.parsing.children import Children
    from elfslam.serve.store.tables import RecordingFacts

READER, WALKS = "elfslam.serve.receiving.reader", "elfslam.serve.receiving.walks"


@dataclass(frozen=True)
class ReadFolder:
    """What a folder holds, or why it is no recording."""

    facts: RecordingFacts = field(default_factory=dict)  # type: ignore[assignment]
    refusal: str | None = None


@dataclass(frozen=True)
class Walk:
    """What came of a walk in a file; `place` is the name of its folder, where there is one."""

    found: ReadFolder
    place: str | None = None


def bounds_of(limits: Limits) -> Bounds:
    """What reading a recording may cost."""
    return Bounds(
        processor_s=limits.reading_s,
        wall_s=limits.reading_s,
        memory_bytes=limits.reading_bytes,
        file_bytes=limits.recording_bytes,
        advice="cut it in parts",
    )


def read_apart(children: Children, folder: Path, limits: Limits) -> ReadFolder:
    """What a child finds in the folder of a recording.

    Raises Problem 503 where that was killed, 507 where the disk is full.
    """
    try:
        return ReadFolder(children.parse(READER, bounds_of(limits), folder=str(folder)))
    except InputError as refused:
        return ReadFolder(refusal=str(refused))


def walks_apart(
    children: Children, file: Path, folder: Path, most: int, limits: Limits
) -> list[Walk]:
    """What a child finds in a file, unpacked into `folder`; `most` walks and no more.

    Raises Problem 503 where that was killed, 507 where the disk is full.
    """
    given = {"file": str(file), "folder": str(folder), "most": most, "limits": asdict(limits)}
    try:
        told = children.parse(WALKS, bounds_of(limits), **given)
    except InputError as refused:
        return [Walk(ReadFolder(refusal=str(refused)))]
    return [Walk(ReadFolder(**each["found"]), each["place"]) for each in told]


MOST_SPANS = 200
"""So many are told: the list of recordings stays short."""
MAP_ID = re.compile(r"[0-9a-f]{32}")


def parse(folder: str) -> RecordingFacts:
    """What a folder holds. Raises InputError where that is no recording."""
    place = Path(folder)
    recording = read_recording(place)
    if recording.audio is not None:
        check_rate(recording.audio.rate_hz)
    return {**facts_of(recording), **_tapped_on(place)}


def find(folder: Path) -> ReadFolder:
    """What a folder holds, or why that is no recording."""
    try:
        return ReadFolder(parse(str(folder)))
    except InputError as error:
        return ReadFolder(refusal=without_places(str(error), folder))


def facts_of(recording: Recording) -> RecordingFacts:
    """What is told of a recording: name, device, duration, sensors, their spans, footsteps."""
    facts: RecordingFacts = {"name": recording.name, "device": recording.device}
    ends_s = [0.0]
    if recording.audio is not None:
        channels, samples = recording.audio.samples.shape
        rate_hz = recording.audio.rate_hz
        ends_s.append(samples / rate_hz)
        facts["audio"] = {"rate_hz": rate_hz, "channels": channels}
    sensors = ("imu", "orientation", "odometry", "magnetometer", "barometer", "wifi", "emr")
    present = {name: getattr(recording, name) for name in sensors}
    ends_s += [
        float(value.t_s[-1]) for value in present.values() if value is not None and len(value.t_s)
    ]
    facts["sensors"] = [name for name, value in present.items() if value is not None]
    facts["duration_s"] = round(float(np.max(ends_s)), 3)
    if recording.start_pose is not None and np.isfinite(recording.start_pose).all():
        facts["start_pose"] = list(recording.start_pose)
    spans = spans_of(recording, MotionParameters())
    facts["spans_s"] = {what: _listed(each) for what, each in spans.items()}
    if recording.notes:
        facts["notes"] = list(recording.notes)
    if (footsteps := _footsteps(recording)) is not None:
        facts["footsteps"] = footsteps
    return facts


def _tapped_on(folder: Path) -> RecordingFacts:
    """The map on whose plan its walker tapped, where recording.json names one."""
    told = read_json(folder / MANIFEST).get("tapped_on")
    return {"tapped_on": told} if isinstance(told, str) and MAP_ID.fullmatch(told) else {}


def _listed(spans: F64) -> list[list[float]]:
    """The first spans, few enough to be told in a list of recordings."""
    return [[round(float(each), 2) for each in span] for span in spans[:MOST_SPANS]]


def _footsteps(recording: Recording) -> int | None:
    """How many there are; None where the motion sensors do not tell."""
    if recording.imu is None:
        return None
    try:
        return len(find_footsteps(recording.imu, MotionParameters()))
    except InputError:
        return None
