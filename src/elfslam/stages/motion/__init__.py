"""Pedestrian dead reckoning: footsteps, step lengths and walking heading from the inertial sensors.

No way of holding the phone is assumed, only that its mounting does not turn about the vertical
while walking. Heading is relative: the walk begins at heading 0 unless a start pose is given;
`compass_heading` says where that is against magnetic north. One set of parameters was fitted to
real walks of surveyors in a mall, and holds for simulated ones.
"""

from elfslam.stages.motion.compass import (
    Compass,
    HardIron,
    compass_heading,
    half_turned,
    missed_half_turn,
)
from elfslam.stages.motion.level import check_imu
from elfslam.stages.motion.live import BEGINNING, LivePdrState, Steps, go_on
from elfslam.stages.motion.parameters import MotionParameters, check_motion
from elfslam.stages.motion.reckoning import (
    calibrated,
    calibrated_by_distance,
    dead_reckon,
    find_footsteps,
    nodes_by_distance,
)

__all__ = [
    "BEGINNING",
    "Compass",
    "HardIron",
    "LivePdrState",
    "MotionParameters",
    "Steps",
    "calibrated",
    "calibrated_by_distance",
    "check_imu",
    "check_motion",
    "compass_heading",
    "dead_reckon",
    "find_footsteps",
    "go_on",
    "half_turned",
    "missed_half_turn",
    "nodes_by_distance",
]
