"""A planted floor: a corridor of 36 m with access points on both sides, and walks along it."""

import numpy as np
from scipy.spatial.transform import Rotation

from elfslam.base import values
from studies.mall_floor import SurveyedWalk

STEP_M = 0.7
STEPS = 52
SIGHTS_M = np.array([[x, y] for x in (0.0, 12.0, 24.0, 36.0) for y in (-6.0, 6.0)])
STRENGTH_DBM, LOSS_DB = -40.0, 28.0


def walk_along(y_m, *, backwards=False, shift_m=(0.0, 0.0)):
    """A walk down the corridor; dead reckoning has its shape right and begins elsewhere."""
    t_s = 0.5 * np.arange(STEPS)
    x_m = STEP_M * np.arange(STEPS)
    x_m = x_m[::-1] if backwards else x_m
    true = np.column_stack([x_m, np.full(STEPS, y_m), np.full(STEPS, np.pi if backwards else 0.0)])
    apart_m = np.linalg.norm(true[:, None, :2] - SIGHTS_M[None], axis=2)
    rssi = STRENGTH_DBM - LOSS_DB * np.log10(np.maximum(apart_m, 1.0))
    wifi = values.WifiScans(t_s[::4], tuple("abcdefgh"), rssi[::4], np.zeros(rssi[::4].shape))
    strength_ut = 25 + 6 * np.sin(x_m) + 8 * np.sin(0.37 * x_m + 1.0)
    field = np.column_stack([strength_ut, np.zeros(STEPS), np.full(STEPS, -40.0)])
    nodes = values.Odometry(t_s, true + np.array([*shift_m, 0.0]), np.full((STEPS - 1, 3), 0.05))
    still = np.tile([0.0, 0.0, 9.81], (STEPS, 1))
    imu, field = values.Imu(t_s, still, 0 * still), values.Magnetometer(t_s, field)
    sensed = {"imu": imu, "magnetometer": field, "orientation": upright(t_s, true[:, 2])}
    recording = values.Recording(f"walk {y_m:g}", "phone", wifi=wifi, **sensed)
    return SurveyedWalk(recording, nodes, True, values.Truth(t_s[::8], true[::8]))


def upright(t_s, heading_rad):
    """A phone held flat, its upper edge ahead."""
    about_up = np.outer(heading_rad - np.pi / 2, [0.0, 0.0, 1.0])
    return values.Orientation(t_s, Rotation.from_rotvec(about_up).as_quat())
