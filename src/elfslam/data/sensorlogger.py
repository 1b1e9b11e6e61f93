"""Logs of the Sensor Logger app (Kelvin Choi): a .zip with one CSV per sensor.

Conventions, from the app's own pages on units, coordinates and platforms: `seconds_elapsed`
counts from the start and may begin below zero, `time` are nanoseconds since 1970, accelerations
are in m/s2 (in g where uncalibrated on iOS), turn rates in rad/s, the field in microtesla, the
pressure in hPa. On iOS acceleration and gravity have the opposite sign unless "Standardise Units &
Frames" was on, which Metadata.csv says in `standardisation`. Only Android writes an acceleration
with gravity. Taps on the annotation button stand in Annotation.csv with the text that was given to
them.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.base.values import (
    Audio,
    Barometer,
    Checkpoints,
    Imu,
    Magnetometer,
    Orientation,
    Recording,
    WifiScans,
)
from elfslam.data import log_files, sensor_files
from elfslam.data.audio_files import at_accepted_rate, read_audio
from elfslam.data.named_places import LONGEST_NAME, MOST
from elfslam.data.tables import CsvText, check_size, number_in, read_csv, read_named_rows

ELAPSED, TIME = "seconds_elapsed", "time"
NANOSECOND_S = 1e-9
LOWEST_RATE_HZ = 44_100
"""The app's lossy sound has less than this, and nothing in the chirp band."""
ENDINGS = (".csv", ".wav", ".flac")
SOUND_FILES = ("microphone.wav", "microphone.flac")
BAROMETER = "barometer"
ACCELERATIONS = ("totalacceleration", "accelerometer", "gravity", "accelerometeruncalibrated")
SENSORS = {
    **dict.fromkeys(ACCELERATIONS, (sensor_files.AXES, sensor_files.LARGEST_ACCEL_MPS2, "m/s2")),
    "gyroscope": (sensor_files.AXES, sensor_files.LARGEST_TURN_RADPS, "rad/s"),
    "magnetometer": (sensor_files.AXES, sensor_files.LARGEST_FIELD_UT, "microtesla"),
    "orientation": (sensor_files.QUATERNION, 1.01, ""),
    BAROMETER: (("pressure",), 1e5, "hectopascal"),
}
"""The columns of a sensor, and what it can read at most, with its unit."""
PLACE = re.compile(r"\s*([-+]?\d+(?:\.\d+)?)\s*[,;]\s*([-+]?\d+(?:\.\d+)?)\s*")
"""Metres x and y, which people give a tap as its text."""


@dataclass(frozen=True)
class Times:
    """Which column tells the time of all files, its unit, and what is added to have seconds."""

    column: str = ELAPSED
    unit_s: float = 1.0
    origin_s: float = 0.0

    def of_table(self, text: CsvText) -> F64:
        """The times of a table's rows (n)."""
        return np.asarray(text.numbers([self.column])[:, 0] * self.unit_s + self.origin_s)

    def of_row(self, row: Mapping[str, str]) -> float:
        """The time of a row. Raises KeyError without it, ValueError for no number."""
        return number_in(row[self.column]) * self.unit_s + self.origin_s


def read_sensorlogger(path: Path) -> log_files.Imported:
    """The recording in a .zip of the app, or in its folder, t = 0 where the app began.

    Sound is kept only where lossless at 44.1 kHz or more (the app itself plays no chirps), the
    attitude only where it agrees with gravity. Raises InputError naming what is missing or bad.
    """
    with log_files.log_folder(path) as folder:
        return _read_folder(folder, log_files.name_of(path))


def is_sensorlogger(columns: Sequence[str]) -> bool:
    """Whether the columns of a table are the app's."""
    return ELAPSED in columns


def _read_folder(folder: Path, name: str) -> log_files.Imported:
    files = log_files.one_of_each(folder, ENDINGS)
    tables = {
        sensor: read_csv(files[f"{sensor}.csv"]) for sensor in SENSORS if f"{sensor}.csv" in files
    }
    if BAROMETER in tables and "pressure" not in tables[BAROMETER].names:
        del tables[BAROMETER]  # older apps on iOS wrote the altitude alone
    accelerations = [sensor for sensor in ACCELERATIONS if sensor in tables]
    if set(accelerations) <= {"gravity"} or "gyroscope" not in tables:
        wanted = "TotalAcceleration.csv (or Accelerometer.csv and Gravity.csv) and Gyroscope.csv"
        raise InputError(f"{folder}: motion sensors are missing; wanted {wanted}")
    times = _times(tables[accelerations[0]])
    read = {sensor: _stream(table, sensor, times) for sensor, table in tables.items()}
    clock = log_files.clock_of(str(folder), read[accelerations[0]][0])
    streams, damaged = log_files.on_one_clock(read, clock)
    imu = _imu(folder, streams, _metadata(files))
    audio = _sound(files)
    checkpoints, said = _checkpoints(files, times, clock)
    recording = Recording(
        name=name,
        device=_metadata(files).get("device name") or "unknown",
        audio=audio,
        imu=imu,
        orientation=_orientation(streams, imu),
        magnetometer=Magnetometer(*streams["magnetometer"]) if "magnetometer" in streams else None,
        barometer=_barometer(streams),
        wifi=_wifi(files, times, clock),
        checkpoints=checkpoints,
        notes=(*clock.notes, *said, *(audio.notes if audio else ())),
    )
    return log_files.Imported(recording, damaged_lines=damaged)


def _metadata(files: Mapping[str, Path]) -> dict[str, str]:
    file = files.get("metadata.csv")
    return next(iter(read_named_rows(file, ())), {}) if file else {}


def _times(text: CsvText) -> Times:
    """The app's seconds, or where those were put back and its other clock ran on, that one's."""
    elapsed_s = Times().of_table(text)
    if TIME not in text.names or (np.diff(elapsed_s) >= 0).all():
        return Times()
    time_s = Times(TIME, NANOSECOND_S).of_table(text)
    ran_on = bool((np.diff(time_s) >= 0).all())
    return Times(TIME, NANOSECOND_S, float(elapsed_s[0] - time_s[0])) if ran_on else Times()


def _stream(text: CsvText, sensor: str, times: Times) -> log_files.Stream:
    columns, largest, unit = SENSORS[sensor]
    values = text.numbers(columns)
    check_size(text.file, values, largest, unit)
    return times.of_table(text), values


def _imu(folder: Path, streams: Mapping[str, log_files.Stream], facts: dict[str, str]) -> Imu:
    calibrated = {"totalacceleration", "gravity"} & streams.keys()
    wanted = ACCELERATIONS[:-1] if calibrated else ACCELERATIONS
    t_s, accel = log_files.with_gravity([streams[sensor] for sensor in wanted if sensor in streams])
    upright = -accel if _is_flipped(accel, facts) else accel
    return sensor_files.imu_on_accelerometer_clock(str(folder), t_s, upright, *streams["gyroscope"])


def _is_flipped(values: F64, facts: dict[str, str]) -> bool:
    """iOS without standardisation; old logs do not say, there a phone is held face up."""
    if facts.get("platform", "").lower() != "ios":
        return False
    standardised = facts.get("standardisation", "").lower()
    if standardised in ("true", "false"):
        return standardised == "false"
    return bool(values[:, 2].mean() < 0)


def _orientation(streams: Mapping[str, log_files.Stream], imu: Imu) -> Orientation | None:
    """Platforms and versions differ in which way the quaternion turns: gravity decides."""
    if "orientation" not in streams:
        return None
    t_s, quaternion = streams["orientation"]
    return log_files.attitude_that_agrees(t_s, [quaternion], imu)


def _barometer(streams: Mapping[str, log_files.Stream]) -> Barometer | None:
    if BAROMETER not in streams:
        return None
    t_s, pressure = streams[BAROMETER]
    return sensor_files.barometer_from(t_s, pressure[:, 0])


def _wifi(files: Mapping[str, Path], times: Times, clock: log_files.Clock) -> WifiScans | None:
    """Rows `seconds_elapsed, bssid, level`; a network's name may hold anything, commas too."""
    file = files.get("wifi.csv")
    if file is None:
        return None
    seen: list[tuple[float, str, float]] = []
    for number, row in enumerate(read_named_rows(file, ()), start=2):
        cells = _seen(row, times)
        if cells is None:
            raise InputError(
                f"{file}: row {number} lacks a number in seconds_elapsed or level, or a bssid; "
                "repair that row or delete the file"
            )
        seen.append(cells)
    if not seen:
        return None
    t_s, bssids, rssi_dbm = zip(*seen, strict=True)
    running_s = clock.running(np.array(t_s))
    return sensor_files.scans_from_rows(file, running_s, bssids, rssi_dbm, [math.nan] * len(seen))


def _seen(row: Mapping[str, str], times: Times) -> tuple[float, str, float] | None:
    bssid = row.get("bssid")
    try:
        t_s, level_dbm = times.of_row(row), number_in(row["level"])
    except (ValueError, KeyError):
        return None
    return (t_s, bssid, level_dbm) if bssid else None


def _checkpoints(
    files: Mapping[str, Path], times: Times, clock: log_files.Clock
) -> tuple[Checkpoints | None, tuple[str, ...]]:
    """What was tapped with a text, two numbers being metres on a plan; what there is to tell."""
    file = files.get("annotation.csv")
    rows = read_named_rows(file, (times.column,)) if file else []
    try:
        t_s = np.round(clock.running(np.array([times.of_row(row) for row in rows])), 3)
    except ValueError as cause:
        raise InputError(f"{file}: {cause!s:.60} is no time; repair that row") from cause
    texts = [" ".join((row.get("text") or "").split()) for row in rows]
    named = [k for k, text in enumerate(texts) if 0 < len(text) <= LONGEST_NAME]
    kept = [named[k] for k in np.unique(t_s[named], return_index=True)[1][:MOST]]
    left_out = len(rows) - len(kept)
    wanted = f"{MOST} at most, each at its own time, with a text of up to {LONGEST_NAME} letters"
    said = [f"annotations that are no checkpoints: {left_out}; wanted {wanted}"] if left_out else []
    if not kept:
        return None, tuple(said)
    names = tuple(texts[k] for k in kept)
    xy_m = np.array([_place(name) for name in names])
    if count := int(np.isfinite(xy_m[:, 0]).sum()):
        said.append(f"annotations taken as places on a plan, x and y in metres: {count}")
    return Checkpoints(t_s[kept], names, xy_m if count else None), tuple(said)


def _place(text: str) -> tuple[float, float]:
    """The metres that a text gives, 1.5, 2.0 or 1,5; 2,0; NaN where it is a name."""
    found = PLACE.fullmatch(text.replace(",", ".") if ";" in text else text)
    x_m, y_m = map(float, found.groups()) if found else (math.nan, math.nan)
    return (x_m, y_m) if max(abs(x_m), abs(y_m)) <= FARTHEST_M else (math.nan, math.nan)


def _sound(files: Mapping[str, Path]) -> Audio | None:
    file = next((files[name] for name in SOUND_FILES if name in files), None)
    audio = read_audio(file) if file else None
    return at_accepted_rate(audio) if audio and audio.rate_hz >= LOWEST_RATE_HZ else None
