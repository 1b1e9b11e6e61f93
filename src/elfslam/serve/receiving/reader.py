"""What a child of the server finds in recordings from outside, within bounds of time and memory.

A file that came whole is recognised by what is in it, a recording of ours or other programs' logs,
and each walk in it is written as the folder of a recording. Of sensors a few numbers are told: a
curve is cut into equal stretches of time, of each of which the least and the largest value are
kept, so that no peak is lost.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import ElfslamError, InputError, StoreError
from elfslam.base.text_files import read_json
from elfslam.base.values import Audio, Imu, Recording
from elfslam.base.zips import opened_zip
from elfslam.data.importing import FORMATS, LogFormat, Refused, read_logs, recognise
from elfslam.data.log_files import Imported, is_zip
from elfslam.data.recordings import MANIFEST, read_recording, write_recording
from elfslam.serve.parsing.child import Bounds, without_places
from elfslam.serve.settings import Limits
from elfslam.serve.store.blobs import refuse_full_disk
from elfslam.serve.store.zips import unpack_recording
from elfslam.slam.coverage import spans_of
from elfslam.stages.chirp import ChirpParameters, check_rate, make_chirp
from elfslam.stages.echo import EchoParameters, find_frames
from elfslam.stages.motion import MotionParameters, find_footsteps
from elfslam.stages.motion.level import level

if TYPE_CHECKING:
    from elfslam.serve.parsing.children import Children
    from elfslam.serve.store.tables import RecordingFacts

READER = f"{__name__}:parse"
WALKS, SENSORS = f"{READER}_walks", f"{READER}_sensors"


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


DRIFT_SEED = 0
"""Of odometry that would else be the truth: the same log gives the same recording."""
COPIES = 2
"""What is unpacked lies there twice for a moment: as it came, and as it is kept."""


def parse_walks(file: str, folder: str, most: int, limits: dict[str, Any]) -> list[dict[str, Any]]:
    """The walks of a file, `most` and no more, unpacked into a folder.

    Raises InputError, OSError ENOSPC.
    """
    tempfile.tempdir = folder  # whoever ends this process removes that, and all in it
    return [asdict(walk) for walk in _walks(Path(file), Path(folder), most, Limits(**limits))]


def _walks(file: Path, folder: Path, most: int, limits: Limits) -> list[Walk]:
    log_format = recognise(file)
    if log_format is None:
        return [_own(file, folder, limits)]
    _check_room(file, folder, limits)
    return list(_imported(log_format, file, folder, most, limits))


def _own(file: Path, folder: Path, limits: Limits) -> Walk:
    """All of a zip or nothing: what is cut short lies in a folder of its own."""
    partial, place = folder / ".partial", folder / file.stem
    partial.mkdir()
    unpack_recording(file, partial, limits)
    partial.rename(place)
    return Walk(find(place), place.name)


def _check_room(file: Path, folder: Path, limits: Limits) -> None:
    """Raise InputError for what unpacks to more than is allowed, OSError ENOSPC."""
    size_bytes = file.stat().st_size
    if is_zip(file):
        with opened_zip(file) as packed:
            size_bytes = sum(entry.file_size for entry in packed.entries.values())
    if size_bytes > limits.recording_bytes:
        raise InputError(
            f"{file}: unpacks to {size_bytes} bytes, wanted at most {limits.recording_bytes}; "
            "cut it in parts"
        )
    refuse_full_disk(folder, COPIES * size_bytes, limits.free_bytes)


def _imported(
    log_format: LogFormat, file: Path, folder: Path, most: int, limits: Limits
) -> Iterator[Walk]:
    """Every walk of a log. Raises InputError where there are too many, or too much in them."""
    left_bytes = limits.recording_bytes
    logs = read_logs(log_format, file, np.random.default_rng(DRIFT_SEED))
    for count, item in enumerate(logs):
        if count >= most:
            raise InputError(f"{file}: holds more than {most} walks; give it in parts")
        if isinstance(item, Refused):
            refusal = without_places(item.reason, file, folder)
            yield Walk(ReadFolder({"name": PurePath(item.name).stem}, refusal))
            continue
        place = folder / str(count)
        _write(item, place)
        left_bytes -= _size_bytes(place, limits)
        if left_bytes < 0:
            raise InputError(
                f"{file}: its walks are more than {limits.recording_bytes} bytes; give it in parts"
            )
        refuse_full_disk(folder, 0, limits.free_bytes)
        yield Walk(_read_back(place, log_format, item), place.name)


def _write(item: Imported, place: Path) -> None:
    try:
        write_recording(item.recording, place, truth=item.truth)
    except StoreError as error:
        raise error.__cause__ if isinstance(error.__cause__, OSError) else error from error


def _size_bytes(place: Path, limits: Limits) -> int:
    """How large the files of a walk are in all. Raises InputError for one that is too large."""
    sizes = {file.name: file.stat().st_size for file in place.iterdir()}
    for name, size_bytes in sizes.items():
        if size_bytes > limits.file_bytes:
            raise InputError(
                f"{name}: becomes {size_bytes} bytes, wanted at most {limits.file_bytes}; "
                "cut the walk in parts"
            )
    return sum(sizes.values())


def _read_back(place: Path, log_format: LogFormat, item: Imported) -> ReadFolder:
    """What is kept of a walk, as everybody will read it, and where it came from."""
    found = find(place)
    if found.refusal is not None:
        return found
    return replace(
        found,
        facts={
            **found.facts,
            "imported": str(log_format),
            "chirps": FORMATS[log_format].plays_chirps,
            "damaged_lines": item.damaged_lines,
        },
    )


@dataclass(frozen=True)
class Curve:
    """Least and largest values in equal stretches of time; None where nothing was read."""

    name: str
    unit: str
    start_s: float
    step_s: float
    low: list[float | None]
    high: list[float | None]


@dataclass(frozen=True)
class SensorRate:
    """How often a sensor was read, and how often a second."""

    name: str
    readings: int
    rate_hz: float | None


@dataclass(frozen=True)
class Look:
    """All that is shown of a recording's sensors."""

    sensors: list[SensorRate]
    curves: list[Curve]
    chirps_played: int | None
    """Where that was noted."""
    chirps_heard_share: float | None
    """Of those that were due; None without sound."""


MOST_STRETCHES = 400
"""Of a curve; each is two numbers."""
LOUDNESS_S = 0.1
"""Sound is as loud as it is on average over a chirp period."""
SILENCE_DB = -120.0


def look_at(recording: Recording) -> Look:
    """The sensors of a recording and their curves."""
    played = recording.played_t_s
    return Look(
        list(_sensors(recording)),
        list(_curves(recording)),
        None if played is None else len(played),
        None if recording.audio is None else _heard_share(recording.audio, played),
    )


def _heard_share(audio: Audio, played_t_s: F64 | None) -> float:
    """Of how many chirps the direct arrival is found; none of sound in which nothing chirps."""
    parameters = EchoParameters(found_share=0.0, clipped_share=1.0)
    try:
        chirp = make_chirp(ChirpParameters(), audio.rate_hz)
        frames = find_frames(audio, chirp, parameters, played_t_s)
    except ElfslamError:
        return 0.0
    return round(float(np.mean(frames.found >= 0)), 3)


def _sensors(recording: Recording) -> Iterator[SensorRate]:
    if (audio := recording.audio) is not None:
        yield SensorRate("audio", audio.samples.shape[1], float(audio.rate_hz))
    for name in ("imu", "orientation", "odometry", "magnetometer", "barometer", "wifi", "emr"):
        value = getattr(recording, name)
        if value is not None and len(value.t_s):
            yield SensorRate(name, len(value.t_s), _rate_hz(value.t_s))


def _rate_hz(t_s: F64) -> float | None:
    """Readings a second, over all; None of a single one."""
    span_s = float(t_s[-1] - t_s[0])
    return round((len(t_s) - 1) / span_s, 3) if span_s > 0 else None


def _curves(recording: Recording) -> Iterator[Curve]:
    if (imu := recording.imu) is not None:
        strength = np.linalg.norm(imu.accel_mps2, axis=1)
        yield curve("acceleration", "m/s²", imu.t_s, strength)
        if (turning := _yaw_rate(imu)) is not None:
            yield curve("yaw rate", "°/s", *turning)
    if (field := recording.magnetometer) is not None and len(field.t_s):
        yield curve("magnetic field", "µT", field.t_s, np.linalg.norm(field.field_ut, axis=1))
    if (barometer := recording.barometer) is not None and len(barometer.t_s):
        yield curve("air pressure", "hPa", barometer.t_s, barometer.pressure_hpa)
    if (wifi := recording.wifi) is not None and len(wifi.t_s):
        seen = np.isfinite(wifi.rssi_dbm).sum(axis=1)
        yield curve("access points", "per scan", wifi.t_s, seen.astype(np.float64))
    if (audio := recording.audio) is not None and audio.samples.size:
        yield curve("sound level", "dB", *loudness(audio))


def _yaw_rate(imu: Imu) -> tuple[F64, F64] | None:
    """Times and turn rates about the vertical, degrees a second; None where that is not known."""
    try:
        levelled = level(imu, MotionParameters())
    except (InputError, ValueError):
        return None
    yaw_radps = np.sum(levelled.gyro_radps * levelled.up, axis=1)
    return (levelled.t_s, np.rad2deg(yaw_radps)) if np.isfinite(yaw_radps).all() else None


def loudness(audio: Audio) -> tuple[F64, F64]:
    """Times and levels of the loudest channel, decibels of full scale, per chirp period."""
    size = max(1, round(LOUDNESS_S * audio.rate_hz))
    sound = audio.samples
    starts = range(0, sound.shape[1], size)
    pieces = (np.square(sound[:, first : first + size], dtype=np.float64) for first in starts)
    power = np.array([piece.mean(axis=1).max() for piece in pieces])
    level_db = 10 * np.log10(np.maximum(power, 10 ** (SILENCE_DB / 10)))
    return (np.arange(len(power)) + 0.5) * size / audio.rate_hz, level_db


def curve(name: str, unit: str, t_s: F64, values: F64) -> Curve:
    """The curve of values (n) at times (n) that increase, in at most `MOST_STRETCHES`."""
    stretches = min(MOST_STRETCHES, len(t_s))
    span_s = float(t_s[-1] - t_s[0])
    step_s = span_s / stretches if span_s > 0 else 1.0
    stretch = np.minimum(((t_s - t_s[0]) / step_s).astype(np.int64), stretches - 1)
    low, high = np.full((2, stretches), np.nan)
    np.fmin.at(low, stretch, values)
    np.fmax.at(high, stretch, values)
    return Curve(name, unit, round(float(t_s[0]), 6), step_s, _told(low), _told(high))


def _told(values: F64) -> list[float | None]:
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]


def parse_sensors(folder: str) -> dict[str, Any]:
    """What is told of a recording's folder. Raises InputError."""
    return asdict(look_at(read_recording(Path(folder))))
