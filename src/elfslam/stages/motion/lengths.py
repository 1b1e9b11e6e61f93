"""Step length estimation, from how far and how often the walker bounces."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from elfslam.base.arrays import F64
from elfslam.stages.motion.footsteps import bounce_rms, vertical_bounce
from elfslam.stages.motion.level import Level
from elfslam.stages.motion.parameters import MotionParameters

STEPS_AROUND = 5
"""The usual interval is the median of so many: one pause or missed footstep does not move it."""


def lengths_between(levelled: Level, footsteps_t_s: F64, parameters: MotionParameters) -> F64:
    """Lengths (n-1), m, of the steps between n footsteps.

    A power law in the bounce, the rms of the vertical acceleration in the footstep band around
    the step, and in the cadence: half way between the bounce alone (Weinberg 2002) and the
    height of the bounce (the inverted pendulum of Zijlstra and Hof 2003: powers 0.5 and -1).
    A pause is no long step.
    """
    bounce = vertical_bounce(levelled, parameters)
    rms = bounce_rms(bounce, parameters.length_window_s, levelled.rate_hz)
    halfway_s = (footsteps_t_s[1:] + footsteps_t_s[:-1]) / 2
    intervals_s = np.diff(footsteps_t_s)
    usual_s = ndimage.median_filter(intervals_s, STEPS_AROUND, mode="nearest")
    # A cadence out of the band is that of someone who stops and goes.
    cadence_hz = np.clip(1 / usual_s, parameters.cadence_low_hz, parameters.cadence_high_hz)
    lengths_m = (
        parameters.step_length_m
        * (np.interp(halfway_s, levelled.t_s, rms) / parameters.typical_bounce_mps2)
        ** parameters.length_power_of_bounce
        * (cadence_hz / parameters.typical_cadence_hz) ** parameters.length_power_of_cadence
    )
    lengths_m = np.clip(lengths_m, parameters.shortest_step_m, parameters.longest_step_m)
    paused = intervals_s > parameters.pause_intervals * usual_s
    return parameters.step_scale * np.where(paused, parameters.pause_length_m, lengths_m)
