"""What is known of one walker: the length of the steps, once calibrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.values import Imu
from elfslam.stages.motion.parameters import MotionParameters
from elfslam.stages.motion.reckoning import dead_reckon

CALIBRATED_SIGMA = 0.02
"""Over some fifty metres of known length the steps of one walker agree about as well."""


def calibrated(
    parameters: MotionParameters, scale: float, sigma: float = CALIBRATED_SIGMA
) -> MotionParameters:
    """The parameters of a walker whose steps are `scale` times as long as these say.

    `sigma` is how uncertain that factor is. The scale may come from anywhere: a known distance,
    a map, a device with its own odometry. Raises InputError where it is not positive.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"step scale: got {scale:g}, wanted more than 0; measure it again")
    return replace(parameters, step_scale=parameters.step_scale * scale, step_scale_sigma=sigma)


def calibrated_by_distance(
    imu: Imu, distance_m: float, parameters: MotionParameters, sigma: float = CALIBRATED_SIGMA
) -> MotionParameters:
    """The parameters of this walker, who walked `distance_m` along the path in this recording.

    The distance runs from the first footstep to the last, along the way (not as the crow flies).
    Raises InputError as `dead_reckon` does, or where the distance is not positive.
    """
    odometry = dead_reckon(imu, parameters)
    moves_m = np.diff(odometry.world_from_body[:, :2], axis=0)
    walked_m = float(np.linalg.norm(moves_m, axis=1).sum())
    if not distance_m > 0:
        raise InputError(f"distance: got {distance_m:g} m, wanted more than 0; measure it again")
    return calibrated(parameters, distance_m / walked_m, sigma)
