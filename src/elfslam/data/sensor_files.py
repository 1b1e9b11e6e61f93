"""Sensors of a recording on disk, one file each."""

import csv
import math
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.geometry import between
from elfslam.base.text_files import read_text
from elfslam.base.values import (
    Barometer,
    Emr,
    Imu,
    Magnetometer,
    Odometry,
    Orientation,
    Recording,
    WifiScans,
)
from elfslam.data.position_files import read_tum, write_tum
from elfslam.data.tables import (
    check_size,
    number_or_nan,
    read_header,
    read_table,
    read_timed_table,
    write_timed_table,
)
from elfslam.stages.motion import MotionParameters

MOST_CELLS = 10_000_000
"""Of a table of scans by access points, most of it empty: hours in a mall have a tenth."""
LARGEST_DBM = 200.0
HEADER = ("t_s", "bssid", "rssi_dbm", "frequency_mhz", "age_s")


def scans_from_rows(
    source: Path,
    t_s: Sequence[float] | F64,
    bssids: Sequence[str],
    rssi_dbm: Sequence[float] | F64,
    age_s: Sequence[float] | F64,
) -> WifiScans:
    """Rows of one time make one scan; a bssid seen twice in a scan keeps its last row.

    Raises InputError, starting with `source`, where there are too many of both.
    """
    times, scan = np.unique(np.asarray(t_s, dtype=float), return_inverse=True)
    names = tuple(sorted(set(bssids)))
    if len(times) * len(names) > MOST_CELLS:
        raise InputError(
            f"{source}: {len(times)} scans of {len(names)} access points, wanted at most "
            f"{MOST_CELLS:.1g} pairs; check the columns of time and bssid"
        )
    column = {name: k for k, name in enumerate(names)}
    cells = scan, np.array([column[bssid] for bssid in bssids], dtype=int)
    rssi, age = np.full((2, len(times), len(names)), np.nan)
    rssi[cells], age[cells] = rssi_dbm, age_s
    return WifiScans(times, names, rssi, age)


def write_wifi(wifi: WifiScans, file: Path) -> None:
    """The CSV of a recording; the frequency is left empty, a WifiScans does not hold it.

    Raises InputError for a name with a carriage return, which would not be read back.
    """
    broken = [bssid for bssid in wifi.bssids if "\r" in bssid]
    if broken:
        raise InputError(f"{file}: bssid {broken[0]!r:.60} holds a carriage return; rename it")
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(HEADER)
        for k, m in np.argwhere(np.isfinite(wifi.rssi_dbm)):
            age = wifi.age_s[k, m]
            numbers = (f"{wifi.rssi_dbm[k, m]:.9g}", "", f"{age:.9g}" if np.isfinite(age) else "")
            writer.writerow([f"{wifi.t_s[k]:.6f}", wifi.bssids[m], *numbers])


def read_wifi(file: Path) -> WifiScans:
    """The scans of a recording. Raises InputError naming file and row."""
    rows = _rows(file)
    header = [name.strip() for name in next(rows, [])]
    missing = [name for name in HEADER if name not in header and name != "frequency_mhz"]
    if missing:
        raise InputError(f"{file}: column {missing[0]} is missing, got {','.join(header)[:80]}")
    places = [header.index(name) for name in ("t_s", "rssi_dbm", "age_s", "bssid")]
    numbers, bssids = array("d"), list[str]()
    for row, cells in enumerate(rows, start=2):
        if len(cells) != len(header):
            raise InputError(
                f"{file}: row {row} has {len(cells)} cells, wanted {len(header)}; "
                "the file is cut off or damaged there, remove that row"
            )
        t_s, rssi_dbm, age_s, bssid = (cells[k] for k in places)
        numbers.extend(_number(file, row, cell, None) for cell in (t_s, rssi_dbm))
        numbers.append(_number(file, row, age_s, math.nan))
        bssids.append(bssid)
    if not bssids:
        raise InputError(f"{file}: has a header and no rows; delete it if the sensor was off")
    table = np.array(numbers).reshape(-1, 3)
    _check_order(file, table[:, 0])
    check_size(file, table[:, 1:2], LARGEST_DBM, "dBm")
    return scans_from_rows(file, table[:, 0], bssids, table[:, 1], table[:, 2])


def _rows(file: Path) -> Iterator[list[str]]:
    """Cells by row; a name in quotes may hold commas, quotes and line breaks."""
    text = read_text(file).rstrip()
    if not text:
        raise InputError(f"{file}: is empty; delete it if there is nothing to say")
    try:
        yield from csv.reader(_lines(text), strict=True)
    except csv.Error as cause:
        raise InputError(f"{file}: cannot be read as CSV ({cause}); check the file") from cause


def _lines(text: str) -> Iterator[str]:
    """The lines with their ends, one after the other: a list of them is larger than the text."""
    start = 0
    while end := text.find("\n", start) + 1:
        yield text[start:end]
        start = end
    yield text[start:]


def _number(file: Path, row: int, cell: str, empty: float | None) -> float:
    if not cell.strip() and empty is not None:
        return empty
    number = number_or_nan(cell)
    if not math.isfinite(number):
        raise InputError(
            f"{file}: row {row} has {cell.strip()[:30]!r}, wanted a finite number; "
            "remove or repair that row"
        )
    return number


def _check_order(file: Path, t_s: F64) -> None:
    backward = np.flatnonzero(np.diff(t_s) < 0)
    if len(backward):
        k = int(backward[0]) + 1
        raise InputError(
            f"{file}: time runs backward at row {k + 2} ({t_s[k - 1]:.6f} then {t_s[k]:.6f} s); "
            "sort the rows"
        )


AXES = ("x", "y", "z")
PRESSURE = ("pressure_hpa",)
PRESSURES_HPA = (300.0, 1200.0)
"""From above the highest mountain to below the deepest mine."""
QUATERNION = ("qx", "qy", "qz", "qw")
SIGMAS = ("forward_m", "lateral_m", "heading_rad")
ODOMETRY_SIGMA_PER_METRE = 0.02
ODOMETRY_SIGMA_FLOOR = (0.005, 0.005, 0.005)
"""Assumed of odometry that comes without its own sigmas: 2 % of the distance, and metres and
radians per move below which no phone's odometry is trusted."""
LARGEST_ACCEL_MPS2, LARGEST_TURN_RADPS, LARGEST_FIELD_UT = 500.0, 100.0, 5000.0
LARGEST_OF_MOTION = LARGEST_ACCEL_MPS2, LARGEST_TURN_RADPS, LARGEST_FIELD_UT
LARGEST_EMR_UV = 1e9
"""Beyond the range of any phone's sensor."""
GRAVITY_MPS2 = (5.0, 15.0)
"""Between these lies the steady part of an acceleration with gravity."""
STEADY_S, LEAST_STEADY_SHARE = 1.0, 0.6
"""Over two steps or so their accelerations and brakings are over: gravity is left, by far the
most of what was measured, and without it a quarter."""
CLOCK_SLACK_S = 2.0
"""Sensors of one recording start within this of each other."""
LEAST_SHARED_S = 2.0
"""So long two sensors must have run together; what one has alone is missing from the other."""
WANTED = MotionParameters()


def write_sensors(recording: Recording, folder: Path) -> None:
    """One file per sensor that the recording has, sound left out."""
    for name, columns, t_s, values in _tables(recording):
        write_timed_table(folder / name, columns, t_s, values)
    if recording.wifi is not None:
        write_wifi(recording.wifi, folder / "wifi.csv")
    odometry = recording.odometry
    if odometry is not None:
        write_tum(folder / "odometry.tum", odometry.t_s, odometry.world_from_body)
        sigma_file, t_s = folder / "odometry_sigma.csv", odometry.t_s[1:]
        write_timed_table(sigma_file, SIGMAS, t_s, odometry.step_sigma)


def _tables(recording: Recording) -> list[tuple[str, tuple[str, ...], F64, F64]]:
    tables: list[tuple[str, tuple[str, ...], F64, F64]] = []
    if (imu := recording.imu) is not None:
        tables.append(("accelerometer.csv", AXES, imu.t_s, imu.accel_mps2))
        tables.append(("gyroscope.csv", AXES, imu.t_s, imu.gyro_radps))
    if (magnetometer := recording.magnetometer) is not None:
        tables.append(("magnetometer.csv", AXES, magnetometer.t_s, magnetometer.field_ut))
    if (barometer := recording.barometer) is not None:
        pressure = barometer.pressure_hpa[:, None]
        tables.append(("barometer.csv", PRESSURE, barometer.t_s, pressure))
    if (attitude := recording.orientation) is not None:
        tables.append(("orientation.csv", QUATERNION, attitude.t_s, attitude.world_from_phone))
    if (emr := recording.emr) is not None:
        harmonics = tuple(f"h{k + 1}" for k in range(emr.amplitude.shape[1]))
        tables.append(("emr.csv", harmonics, emr.t_s, emr.amplitude))
    return tables


def _read_optional(file: Path, columns: tuple[str, ...]) -> tuple[F64, F64] | None:
    return read_timed_table(file, columns) if file.is_file() else None


def read_magnetometer(file: Path) -> Magnetometer | None:
    """The field; None without the file. Raises InputError naming file and row."""
    table = _read_optional(file, AXES)
    if table is None:
        return None
    check_size(file, table[1], LARGEST_FIELD_UT, "microtesla")
    return Magnetometer(*table)


def read_barometer(file: Path) -> Barometer | None:
    """The air pressure; None without the file. Raises InputError naming file and row."""
    table = _read_optional(file, PRESSURE)
    if table is None:
        return None
    t_s, pressure_hpa = table[0], table[1][:, 0]
    low, high = PRESSURES_HPA
    bad = np.flatnonzero((pressure_hpa < low) | (pressure_hpa > high))
    if len(bad):
        raise InputError(
            f"{file}: row {bad[0] + 2} has {pressure_hpa[bad[0]]:.6g} hPa, wanted {low:g} to "
            f"{high:g}; give the pressure in hectopascal"
        )
    return Barometer(t_s, pressure_hpa)


KILOPASCAL_BELOW = 150.0
"""No air has so few hectopascal: then kilopascal are meant."""


def barometer_from(t_s: F64, pressure: F64) -> Barometer | None:
    """The pressure (n) that a program wrote, in hPa or kPa, without what no air can have.

    Sensors that wake up read nothing at first. None where fewer than two readings are left.
    """
    unit_hpa = 10.0 if len(pressure) and np.median(pressure) < KILOPASCAL_BELOW else 1.0
    pressure_hpa = unit_hpa * pressure
    low, high = PRESSURES_HPA
    believed = (pressure_hpa >= low) & (pressure_hpa <= high)
    return Barometer(t_s[believed], pressure_hpa[believed]) if believed.sum() > 1 else None


def read_orientation(file: Path) -> Orientation | None:
    """The attitude; None without the file. Raises InputError naming file and row."""
    table = _read_optional(file, QUATERNION)
    if table is None:
        return None
    t_s, quaternion = table
    length = np.linalg.norm(np.clip(quaternion, -10, 10), axis=1)
    bad = np.flatnonzero(abs(length - 1) > 0.01)
    if len(bad):
        raise InputError(
            f"{file}: row {bad[0] + 2} has a quaternion of length {length[bad[0]]:.3f}, wanted 1; "
            "check the columns"
        )
    return Orientation(t_s, quaternion / length[:, None])


def read_imu(folder: Path) -> Imu | None:
    """Accelerometer and gyroscope; None without both. Raises InputError naming file and row."""
    accelerometer = _read_optional(folder / "accelerometer.csv", AXES)
    gyroscope = _read_optional(folder / "gyroscope.csv", AXES)
    if accelerometer is None and gyroscope is None:
        return None
    if accelerometer is None or gyroscope is None:
        absent = "accelerometer.csv" if accelerometer is None else "gyroscope.csv"
        raise InputError(f"{folder}: {absent} is missing beside its twin; record both or neither")
    check_size(folder / "accelerometer.csv", accelerometer[1], LARGEST_ACCEL_MPS2, "m/s2")
    check_size(folder / "gyroscope.csv", gyroscope[1], LARGEST_TURN_RADPS, "rad/s")
    return imu_on_accelerometer_clock(str(folder), *accelerometer, *gyroscope)


def imu_on_accelerometer_clock(
    source: str, accel_t_s: F64, accel_mps2: F64, gyro_t_s: F64, gyro_radps: F64
) -> Imu:
    """The gyroscope interpolated to the accelerometer's times, where both were running.

    Where the gyroscope pauses, so does the result: dead reckoning then decides about the gap.
    Raises InputError, starting with `source`, where the accelerometer lacks gravity, the
    gyroscope is too slow, or they did not run at the same time.
    """
    _check_gravity(source, accel_t_s, accel_mps2)
    check_shared_time(source, ("accelerometer", accel_t_s), ("gyroscope", gyro_t_s))
    _check_gyroscope_rate(source, accel_t_s, gyro_t_s)
    both = _running(gyro_t_s, accel_t_s)
    if both.sum() < 2:
        raise InputError(f"{source}: accelerometer and gyroscope do not overlap in time")
    t_s = accel_t_s[both]
    turned = [np.interp(t_s, gyro_t_s, axis) for axis in gyro_radps.T]
    return Imu(t_s, accel_mps2[both], np.column_stack(turned))


def check_shared_time(
    source: str, *streams: tuple[str, F64], slack_s: float = CLOCK_SLACK_S
) -> None:
    """Raises InputError, naming both spans, where two streams did not run at the same time.

    Either may end before the other; starts further apart than `slack_s` are those of two clocks.
    """
    spans = [(t_s[0], t_s[-1]) for _, t_s in streams]
    (first_start, first_end), (second_start, second_end) = spans
    shared_s = min(first_end, second_end) - max(first_start, second_start)
    longest_s = max(end - start for start, end in spans)
    wanted_s = max(0.0, min(LEAST_SHARED_S, longest_s - CLOCK_SLACK_S))
    if shared_s < wanted_s or abs(first_start - second_start) > slack_s:
        ran = [f"{name} ({t_s[0]:.1f} to {t_s[-1]:.1f} s)" for name, t_s in streams]
        raise InputError(
            f"{source}: {ran[0]} and {ran[1]} do not overlap enough; wanted starts within "
            f"{CLOCK_SLACK_S:g} s and at least {LEAST_SHARED_S:g} s in common; copy both again, or "
            "put them on one clock in seconds"
        )


def gravity_in(t_s: F64, accel: F64) -> float:
    """How strong the gravity in an acceleration (n, 3) is, in its unit: 0 where it has none.

    It stays when a second is averaged, and is then most of what there was; of steps little is.
    """
    strength = float(np.median(np.linalg.norm(accel, axis=1)))
    steady = _steady_strength(t_s, accel)
    return steady if steady >= LEAST_STEADY_SHARE * strength else 0.0


def _steady_strength(t_s: F64, accel: F64) -> float:
    steps_s = np.diff(t_s)
    step_s = float(np.median(steps_s[steps_s > 0])) if (steps_s > 0).any() else STEADY_S
    rows = min(max(round(STEADY_S / step_s), 1), len(accel))
    whole = accel[: len(accel) // rows * rows].reshape(-1, rows, 3)
    return float(np.median(np.linalg.norm(whole.mean(axis=1), axis=1)))


def _check_gravity(source: str, t_s: F64, accel_mps2: F64) -> None:
    strength_mps2 = gravity_in(t_s, accel_mps2)
    low, high = GRAVITY_MPS2
    if not low <= strength_mps2 <= high:
        steady_mps2 = _steady_strength(t_s, accel_mps2)
        what = "gravity is missing" if strength_mps2 < low else "its gravity is too strong"
        raise InputError(
            f"{source}: {what}: the steady part of the acceleration is {steady_mps2:.3g} m/s2, "
            f"wanted {low:g} to {high:g}, and most of it; give m/s2 with gravity left in"
        )


def _check_gyroscope_rate(source: str, accel_t_s: F64, gyro_t_s: F64) -> None:
    """Interpolation would hide it; a rate common to both is judged by dead reckoning."""
    rates_hz = [1 / np.median(np.diff(t_s)) for t_s in (accel_t_s, gyro_t_s) if len(t_s) > 1]
    if len(rates_hz) < 2 or rates_hz[1] < min(WANTED.least_rate_hz, 0.8 * rates_hz[0]):
        got = f"{rates_hz[1]:.1f}" if len(rates_hz) == 2 else "too few"
        raise InputError(
            f"{source}: gyroscope has {got} samples/s, wanted at least {WANTED.least_rate_hz:g}; "
            "choose a faster sensor rate"
        )


def _running(gyro_t_s: F64, t_s: F64) -> Bool:
    """Which times lie in no pause of the gyroscope, nor before or after it."""
    after = np.searchsorted(gyro_t_s, t_s)
    inside = (t_s >= gyro_t_s[0]) & (t_s <= gyro_t_s[-1])
    pause_s = np.diff(gyro_t_s, prepend=gyro_t_s[0])[np.minimum(after, len(gyro_t_s) - 1)]
    at_sample = gyro_t_s[np.minimum(after, len(gyro_t_s) - 1)] == t_s
    return np.asarray(inside & (at_sample | (pause_s <= WANTED.longest_gap_s)))


def read_emr(file: Path) -> Emr | None:
    """Mains harmonics; None without the file. Raises InputError naming file and row."""
    if not file.is_file():
        return None
    harmonics = [name for name in read_header(file) if name != "t_s"]
    t_s, amplitude = read_timed_table(file, harmonics)
    check_size(file, amplitude, LARGEST_EMR_UV, "microvolts")
    return Emr(t_s, amplitude)


def read_odometry(folder: Path) -> Odometry | None:
    """The device's own odometry; None without. Raises InputError naming file and row."""
    file, sigma_file = folder / "odometry.tum", folder / "odometry_sigma.csv"
    if not file.is_file():
        return None
    t_s, poses = read_tum(file)
    if not sigma_file.is_file():
        return Odometry(t_s, poses, _assumed_sigma(poses))
    sigma = read_table(sigma_file, SIGMAS) if len(t_s) > 1 else np.empty((0, 3))
    if len(sigma) != len(t_s) - 1:
        raise InputError(f"{sigma_file}: {len(sigma)} rows for {len(t_s)} poses; wanted one less")
    return Odometry(t_s, poses, sigma)


def _assumed_sigma(poses: F64) -> F64:
    moves = between(poses[:-1], poses[1:])
    distance_m = np.linalg.norm(moves[:, :2], axis=1)
    grown = np.column_stack([distance_m * ODOMETRY_SIGMA_PER_METRE] * 2 + [0 * distance_m])
    return np.asarray(np.maximum(grown, ODOMETRY_SIGMA_FLOOR))
