"""A walk whose heading, north and fields are planted."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from elfslam.base.values import Imu, Magnetometer

EARTH_UT = np.array([0.0, 33.0, -37.0])
"""East, north, up."""
STEPS_HZ = 1.8


def walk(
    start_rad: float,
    *,
    turns: Sequence[tuple[float, float]] = (),
    pitch_deg: float = 30.0,
    roll_deg: float = 0.0,
    iron_ut: tuple[float, float] = (0.0, 0.0),
    bend_ut: float = 0.0,
) -> tuple[Imu, Magnetometer]:
    """40 s at 50 Hz that heads `start_rad`, and turns by (when s, angle) within a second.

    The field is the Earth's, the phone's own (forward, left) and what a building adds, which
    changes with time.
    """
    t_s = np.arange(0.0, 40.0, 0.02)
    heading = np.full(len(t_s), start_rad)
    for when_s, angle_rad in turns:
        heading = heading + angle_rad * np.clip(t_s - when_s, 0.0, 1.0)
    bounce = 2.5 * np.sin(2 * np.pi * STEPS_HZ * t_s) * (t_s > 1) * (t_s < 39)
    tilt = Rotation.from_euler("XY", [pitch_deg, roll_deg], degrees=True)
    level_from_phone = Rotation.from_euler("z", (heading - np.pi / 2)[:, None]) * tilt
    accel = level_from_phone.inv().apply(np.column_stack([0 * t_s, 0 * t_s, 9.81 + bounce]))
    rate = np.gradient(heading, t_s)
    gyro = level_from_phone.inv().apply(np.column_stack([0 * t_s, 0 * t_s, rate]))
    building = bend_ut * np.column_stack([np.sin(t_s / 3), np.cos(t_s / 2), np.sin(t_s / 5)])
    ahead = np.column_stack([np.cos(heading), np.sin(heading), 0 * t_s])
    left = np.column_stack([-np.sin(heading), np.cos(heading), 0 * t_s])
    own = iron_ut[0] * ahead + iron_ut[1] * left
    field = level_from_phone.inv().apply(EARTH_UT + building + own)
    return Imu(t_s, accel, gyro), Magnetometer(t_s, field)
