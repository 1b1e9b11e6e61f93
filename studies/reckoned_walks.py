"""Walks to reckon: those of the mall floors, simulated ones, and the same with a changed phone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.progress import Announce
from elfslam.base.values import Imu, Magnetometer, Truth
from elfslam.data.mall import read_walk, walks_in
from elfslam.line.motion import MotionParameters, dead_reckon
from elfslam.world.device import BMI160, BROWSER
from elfslam.world.simulate import load_world, simulate

WORLDS = ("studio", "lounge", "concourse")
"""None of the worlds that are for evaluation: motion was developed on these."""
FIRST_SEED = 100
ROUNDS = 2


@dataclass(frozen=True)
class ReckonedWalk:
    """One walk: its sensors and its truth, and the direction that the phone itself reports."""

    name: str
    imu: Imu
    truth: Truth
    magnetometer: Magnetometer | None = None
    reported_rad: float = float("nan")


def mall_floors(
    data: Path, count: int | None, announce: Announce
) -> Iterator[tuple[str, list[ReckonedWalk]]]:
    """Every floor by name with its walks, at most `count`. Raises InputError without data."""
    archives = sorted((data / "mall_walks").glob("*.tar.xz"))
    if not archives:
        raise InputError(f"{data}: holds no mall_walks/*.tar.xz; wanted the real mall walks")
    for k, archive in enumerate(archives):
        name = archive.name.removesuffix(".tar.xz").removeprefix("site1-")
        announce(f"reading floor {name}", 0.25 * k)
        yield name, [walk for path in islice(walks_in(archive), count) for walk in _read(path)]


def _read(path: Path) -> list[ReckonedWalk]:
    """The walk of a file, if it has a truth to compare with."""
    found = read_walk(path)
    recording, truth = found.recording, found.truth
    if recording.imu is None or recording.orientation is None:
        return []
    if truth is None or len(truth.t_s) < 2:
        return []
    attitude = Rotation.from_quat(recording.orientation.world_from_phone)
    top = attitude.apply([0.0, 1.0, 0.0])
    reported = np.interp(
        recording.imu.t_s, recording.orientation.t_s, np.unwrap(np.arctan2(top[:, 1], top[:, 0]))
    )
    turned = _heading_of(recording.imu)
    mean_rad = float(np.angle(np.exp(1j * (reported - turned)).mean()))
    return [ReckonedWalk(recording.name, recording.imu, truth, recording.magnetometer, mean_rad)]


def _heading_of(imu: Imu) -> F64:
    """Heading (n), rad, at the sensors' times; 0 at the first footstep."""
    odometry = dead_reckon(imu, MotionParameters())
    return np.interp(imu.t_s, odometry.t_s, np.unwrap(odometry.world_from_body[:, 2]))


def simulated_walks(
    worlds: Sequence[str], seeds: int
) -> Iterator[tuple[str, int, list[ReckonedWalk]]]:
    """Walks of every world by both motion sensors: its name, the rate, the walks."""
    for name in worlds:
        world = load_world(name)
        for grade in (BMI160, BROWSER):
            some = []
            for seed in range(FIRST_SEED, FIRST_SEED + seeds):
                recording, truth = simulate(world, seed, rounds=ROUNDS, sound=False, grade=grade)
                if recording.imu is not None:
                    some.append(ReckonedWalk(f"{name} {seed}", recording.imu, truth))
            yield name, round(grade.rate_hz), some


def resampled(walk: ReckonedWalk, rate_hz: float) -> ReckonedWalk:
    """The same walk by sensors of another rate."""
    t_s = np.arange(walk.imu.t_s[0], walk.imu.t_s[-1], 1 / rate_hz)
    accel, gyro = (
        np.column_stack([np.interp(t_s, walk.imu.t_s, column) for column in rows.T])
        for rows in (walk.imu.accel_mps2, walk.imu.gyro_radps)
    )
    return replace(walk, imu=Imu(t_s, accel, gyro))


def tilted(walk: ReckonedWalk, pitch_deg: float, roll_deg: float) -> ReckonedWalk:
    """The same walk with the phone's top tilted up, and the phone rolled about its long axis."""
    turn = Rotation.from_euler("XY", [pitch_deg, roll_deg], degrees=True).inv()
    imu, field = walk.imu, walk.magnetometer
    turned = Imu(imu.t_s, *(_applied(turn, rows) for rows in (imu.accel_mps2, imu.gyro_radps)))
    if field is not None:
        field = Magnetometer(field.t_s, _applied(turn, field.field_ut))
    return replace(walk, imu=turned, magnetometer=field)


def _applied(turn: Rotation, vectors: F64) -> F64:
    """SciPy takes no read-only arrays."""
    return np.asarray(turn.apply(vectors.copy()))
