"""Logs of the RoNIN recorder (Yan et al. 2020, arXiv 1905.12853): one text file per sensor.

Lines are `nanoseconds x y z`, parted by white space, after comments that start with `#`:
acce.txt (m/s2 with gravity), gyro.txt (rad/s), magnet.txt (microtesla), and rv.txt or
game_rv.txt (`nanoseconds x y z w`). The nanoseconds count from any origin, one for all files.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_json
from elfslam.base.values import Imu, Magnetometer, Orientation, Recording
from elfslam.data.log_files import log_folder, name_of
from elfslam.data.sensor_files import (
    LARGEST_ACCEL_MPS2,
    LARGEST_FIELD_UT,
    LARGEST_TURN_RADPS,
    imu_on_accelerometer_clock,
)
from elfslam.data.streams import attitude_that_agrees, forward, in_mps2
from elfslam.data.tables import check_size, parse_rows, read_lines

ACCELEROMETER, GYROSCOPE, MAGNETOMETER = "acce.txt", "gyro.txt", "magnet.txt"
ATTITUDES = ("rv.txt", "game_rv.txt", "orientation.txt")
NANOSECONDS = 1e9
STEP_S = (1e-4, 1.0)
"""Between these lies the median step of a sensor's times, if they are nanoseconds."""

Table = tuple[F64, F64]


def read_ronin(path: Path) -> Recording:
    """The recording in a folder of such files or a .zip of one, t = 0 at its first acceleration.

    Raises InputError naming what is missing or bad.
    """
    with log_folder(path) as folder:
        return _read_folder(folder, name_of(path))


def _read_folder(root: Path, name: str) -> Recording:
    folder = _folder_of_one(root)
    accelerometer, gyroscope = folder / ACCELEROMETER, folder / GYROSCOPE
    start_ns, accel = _sensor(accelerometer, LARGEST_ACCEL_MPS2, "m/s2")
    start = float(start_ns[0])
    turns = _sensor(gyroscope, LARGEST_TURN_RADPS, "rad/s")
    imu = imu_on_accelerometer_clock(
        str(folder), _since(start_ns, start), in_mps2(accel), _since(turns[0], start), turns[1]
    )
    return Recording(
        name=name,
        device=_device(folder),
        imu=imu,
        orientation=_orientation(folder, start, imu),
        magnetometer=_magnetometer(folder / MAGNETOMETER, start),
    )


def _folder_of_one(root: Path) -> Path:
    found = sorted(file.parent for file in root.rglob(ACCELEROMETER))
    if len(found) != 1 or not (found[0] / GYROSCOPE).is_file():
        raise InputError(
            f"{root}: holds {len(found)} recordings with {ACCELEROMETER}, wanted one, "
            f"with {GYROSCOPE} beside it; give its folder"
        )
    return found[0]


def _sensor(file: Path, largest: float, unit: str, columns: int = 3) -> Table:
    """Nanoseconds (n) and values (n, columns) of a file."""
    lines = read_lines(file)
    comments = next((k for k, line in enumerate(lines) if not line.startswith("#")), len(lines))
    if comments == len(lines):
        raise InputError(f"{file}: has comments and no rows; delete it if the sensor was off")
    cells = range(columns + 1)
    table = parse_rows(file, lines[comments:], cells, first_row=comments + 1, comma=False)
    check_size(file, table[:, 1:], largest, unit)
    time_ns, values = forward(table[:, 0], table[:, 1:])
    _check_unit(file, time_ns)
    return time_ns, values


def _check_unit(file: Path, time_ns: F64) -> None:
    step_s = float(np.median(np.diff(time_ns))) / NANOSECONDS if len(time_ns) > 1 else STEP_S[0]
    if not STEP_S[0] <= step_s <= STEP_S[1]:
        raise InputError(
            f"{file}: times step by {step_s * NANOSECONDS:.4g}, wanted nanoseconds; "
            "is this a log of another program?"
        )


def _since(time_ns: F64, start_ns: float) -> F64:
    return np.asarray((time_ns - start_ns) / NANOSECONDS)


def _magnetometer(file: Path, start_ns: float) -> Magnetometer | None:
    if not file.is_file():
        return None
    time_ns, field = _sensor(file, LARGEST_FIELD_UT, "microtesla")
    return Magnetometer(_since(time_ns, start_ns), field)


def _orientation(folder: Path, start_ns: float, imu: Imu) -> Orientation | None:
    """Versions differ in where w stands: gravity decides."""
    file = next((folder / name for name in ATTITUDES if (folder / name).is_file()), None)
    if file is None:
        return None
    time_ns, values = _sensor(file, 1.01, "", columns=4)
    both = [values, values[:, [1, 2, 3, 0]]]
    return attitude_that_agrees(_since(time_ns, start_ns), both, imu)


def _device(folder: Path) -> str:
    """What info.json says, which the published recordings have beside their sensors."""
    try:
        facts = read_json(folder / "info.json")
    except InputError:
        return "unknown"
    device = facts.get("device") if isinstance(facts, dict) else None
    return device if isinstance(device, str) and device else "unknown"
