"""Logs of the RoNIN recorder (Yan et al. 2020, arXiv 1905.12853): one text file per sensor.

Lines are `nanoseconds x y z`, parted by white space, after comments that start with `#`:
acce.txt (m/s2 with gravity), gyro.txt (rad/s), magnet.txt (microtesla), and rv.txt or
game_rv.txt (`nanoseconds x y z w`). The nanoseconds count from any origin, one for all files;
they and all else may be written as whole numbers or as 1.2e+18.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_json
from elfslam.base.values import Imu, Magnetometer, Orientation, Recording
from elfslam.data import log_files, sensor_files
from elfslam.data.tables import check_size, numbers_in, parse_rows, read_lines

ACCELEROMETER, GYROSCOPE, MAGNETOMETER = "acce.txt", "gyro.txt", "magnet.txt"
ATTITUDES = ("rv.txt", "game_rv.txt", "orientation.txt")
LARGEST = {
    ACCELEROMETER: (sensor_files.LARGEST_ACCEL_MPS2, "m/s2"),
    GYROSCOPE: (sensor_files.LARGEST_TURN_RADPS, "rad/s"),
    MAGNETOMETER: (sensor_files.LARGEST_FIELD_UT, "microtesla"),
    **dict.fromkeys(ATTITUDES, (1.01, "")),
}
NANOSECOND_S = 1e-9
STEP_S = (1e-4, 1.0)
"""Between these lies the median step of a sensor's times, if they are nanoseconds."""
LEAST_NS = 1e4
"""A later first time tells nanoseconds from seconds; who counts from 0 is known by the second."""


def read_ronin(path: Path) -> log_files.Imported:
    """The recording in a folder of such files or a .zip of one, t = 0 at its first acceleration.

    Raises InputError naming what is missing or bad.
    """
    with log_files.log_folder(path) as folder:
        return _read_folder(folder, log_files.name_of(path))


def is_ronin(name: PurePosixPath, lines: Sequence[str]) -> bool:
    """Whether a file is called as the recorder's are, and its first rows are times and values."""
    if name.name.lower() not in LARGEST:
        return False
    rows = [numbers_in(line) for line in lines[_comments(lines) :][:2]]
    return bool(rows) and all(len(row) > 3 for row in rows) and rows[-1][0] > LEAST_NS


def _comments(lines: Sequence[str]) -> int:
    """How many lines stand before the rows: comments, or names of columns."""
    return next((k for k, line in enumerate(lines) if _is_row(line)), len(lines))


def _is_row(line: str) -> bool:
    return not line.startswith("#") and any(numbers_in(cell) for cell in line.split())


def _read_folder(root: Path, name: str) -> log_files.Imported:
    files = log_files.one_of_each(root, (".txt",))
    if ACCELEROMETER not in files or GYROSCOPE not in files:
        raise InputError(
            f"{root}: holds no {ACCELEROMETER} with {GYROSCOPE} beside it; give the folder of "
            "one recording"
        )
    read = {each: _sensor(files[each], *LARGEST[each]) for each in LARGEST if each in files}
    start_ns = read[ACCELEROMETER][0][0]
    since = {each: ((t - start_ns) * NANOSECOND_S, values) for each, (t, values) in read.items()}
    clock = log_files.clock_of(str(root), since[ACCELEROMETER][0])
    streams, damaged = log_files.on_one_clock(since, clock)
    accel = log_files.with_gravity([streams[ACCELEROMETER]])
    imu = sensor_files.imu_on_accelerometer_clock(str(root), *accel, *streams[GYROSCOPE])
    field = streams.get(MAGNETOMETER)
    recording = Recording(
        name=name,
        device=_device(files[ACCELEROMETER].parent),
        imu=imu,
        orientation=_orientation(streams, imu),
        magnetometer=Magnetometer(*field) if field else None,
        notes=clock.notes,
    )
    return log_files.Imported(recording, damaged_lines=damaged)


def _sensor(file: Path, largest: float, unit: str) -> log_files.Stream:
    lines = read_lines(file)
    comments = _comments(lines)
    if comments == len(lines):
        raise InputError(f"{file}: has comments and no rows; delete it if the sensor was off")
    columns = range(5 if file.name.lower() in ATTITUDES else 4)
    table = parse_rows(file, lines[comments:], columns, first_row=comments + 1, comma=False)
    check_size(file, table[:, 1:], largest, unit)
    _check_unit(file, table[:, 0])
    return table[:, 0], table[:, 1:]


def _check_unit(file: Path, time_ns: F64) -> None:
    steps_ns = np.diff(time_ns)
    step_s = (
        float(np.median(steps_ns[steps_ns > 0])) * NANOSECOND_S if (steps_ns > 0).any() else 0.0
    )
    if len(time_ns) > 1 and not STEP_S[0] <= step_s <= STEP_S[1]:
        raise InputError(
            f"{file}: times step by {step_s / NANOSECOND_S:.4g}, wanted nanoseconds; "
            "is this a log of another program?"
        )


def _orientation(streams: Mapping[str, log_files.Stream], imu: Imu) -> Orientation | None:
    """Versions differ in where w stands: gravity decides."""
    found = next((streams[each] for each in ATTITUDES if each in streams), None)
    if found is None:
        return None
    t_s, values = found
    return log_files.attitude_that_agrees(t_s, [values, values[:, [1, 2, 3, 0]]], imu)


def _device(folder: Path) -> str:
    """What info.json says, which the published recordings have beside their sensors."""
    try:
        facts = read_json(folder / "info.json")
    except InputError:
        return "unknown"
    device = facts.get("device") if isinstance(facts, dict) else None
    return device if isinstance(device, str) and device else "unknown"
