"""Heading: the yaw rate about the vertical, integrated."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64
from elfslam.stages.motion.footsteps import vertical_bounce
from elfslam.stages.motion.level import Level, averaged
from elfslam.stages.motion.parameters import MotionParameters

SETTING_OFF_S, REST_S = 0.6, 0.5
"""Before the first footfall a foot is lifted; before that, a phone may be at rest."""


def smooth_heading(levelled: Level, parameters: MotionParameters) -> F64:
    """Heading (n), rad, averaged over a stride, which takes the sway of the body out."""
    return averaged(phone_turn(levelled), parameters.heading_window_s, levelled.rate_hz)


def turned_since_rest(
    levelled: Level, footstep_s: float, parameters: MotionParameters
) -> float | None:
    """How far (rad) the walker has turned by the first footstep since the recording began.

    None where the phone was not at rest for the first half second. Whoever sets off softly has
    gone a step or two, and may have turned, by the first footstep that is found.
    """
    rest = round(REST_S * levelled.rate_hz)
    if (levelled.t_s < footstep_s - SETTING_OFF_S).sum() < rest:
        return None
    if np.abs(vertical_bounce(levelled, parameters)[:rest]).max() > parameters.least_bounce_mps2:
        return None
    facing_rad = phone_turn(levelled)[:rest].mean()
    heading_rad = np.interp(footstep_s, levelled.t_s, smooth_heading(levelled, parameters))
    return float(heading_rad - facing_rad)


def phone_turn(levelled: Level) -> F64:
    """How far (n), rad, the phone has turned about the vertical since the first sample."""
    yaw_radps = np.sum(levelled.gyro_radps * levelled.up, axis=1)
    steps_rad = (yaw_radps[1:] + yaw_radps[:-1]) / 2 / levelled.rate_hz
    return np.concatenate([[0.0], np.cumsum(steps_rad)])
