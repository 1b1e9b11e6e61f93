"""How steps are found, measured and turned, and how far each is trusted."""

import math
from dataclasses import dataclass

from elfslam.base.errors import ParameterError
from elfslam.base.parameters import parameter


@dataclass(frozen=True)
class MotionParameters:
    """How steps are found, measured and turned, and how far each is trusted."""

    node_spacing_m: float = parameter(
        0.5, "m", "distance between nodes where the device brings odometry", 0.05, 100.0
    )
    least_rate_hz: float = parameter(20.0, "Hz", "slower inertial sensors are refused", 12.0, 1e4)
    least_duration_s: float = parameter(2.0, "s", "shorter recordings are refused", 1.0, 3600.0)
    longest_gap_s: float = parameter(
        0.5, "s", "a longer interruption is bridged: nothing is known there", 0.01, 60.0
    )
    least_footsteps: int = parameter(4, "", "walks with fewer footsteps are refused", 2, 100_000)
    gravity_cutoff_hz: float = parameter(0.1, "Hz", "low-pass that keeps gravity", 0.005, 0.5)
    cadence_low_hz: float = parameter(0.8, "Hz", "lower edge of the footstep band", 0.3, 1.5)
    cadence_high_hz: float = parameter(3.0, "Hz", "upper edge of the footstep band", 2.0, 5.0)
    least_interval_s: float = parameter(0.3, "s", "footsteps are never closer in time", 0.1, 0.6)
    least_bounce_mps2: float = parameter(
        1.0, "m/s2", "smallest rise of the vertical acceleration in a step", 0.0, 50.0
    )
    relative_bounce: float = parameter(
        0.4, "", "rise wanted, relative to the steps around", 0.0, 1.0
    )
    bounce_window_s: float = parameter(4.0, "s", "span of the steps around", 0.5, 60.0)
    step_scale: float = parameter(
        1.0, "", "step length of this walker, relative to a stranger's", 0.3, 3.0
    )
    step_scale_sigma: float = parameter(
        0.08, "", "how uncertain that is: 0.02 once calibrated", 0.0, 1.0
    )
    step_length_m: float = parameter(
        0.7, "m", "step length at the typical cadence and bounce", 0.1, 1.5
    )
    length_power_of_bounce: float = parameter(
        0.4, "", "the step length grows with this power of the bounce", 0.0, 1.0
    )
    length_power_of_cadence: float = parameter(
        -0.5, "", "the step length grows with this power of the cadence", -2.0, 2.0
    )
    length_window_s: float = parameter(
        1.2, "s", "span over which the bounce of a step is taken", 0.1, 60.0
    )
    typical_cadence_hz: float = parameter(
        1.8, "Hz", "cadence at which step_length_m holds", 0.5, 4.0
    )
    typical_bounce_mps2: float = parameter(
        3.0, "m/s2", "bounce (rms) at which step_length_m holds", 0.1, 50.0
    )
    bounce_law_sigma: float = parameter(
        0.08, "", "how far a stranger's steps are from that law, relative to it", 0.001, 1.0
    )
    bounce_law_sigma_if_slow: float = parameter(
        4.0, "", "what that gains by every logarithm of slower steps", 0.0, 100.0
    )
    walk_ratio_m_per_hz: float = parameter(
        0.384, "m s", "step length over cadence: 6.4 mm per step a minute", 0.1, 1.0
    )
    walk_ratio_sigma: float = parameter(
        0.15, "", "how far a stranger's is from it, relative to it", 0.001, 10.0
    )
    shortest_step_m: float = parameter(0.3, "m", "a stranger's steps are never shorter", 0.05, 2.0)
    longest_step_m: float = parameter(1.2, "m", "a stranger's steps are never longer", 0.3, 3.0)
    pause_intervals: float = parameter(
        1.75, "", "so many usual intervals without a footstep are a pause", 1.0, 100.0
    )
    pause_length_m: float = parameter(
        0.28, "m", "how far a stranger gets from before a pause to after it", 0.0, 2.0
    )
    heading_window_s: float = parameter(
        1.0, "s", "heading is averaged over a stride to remove body sway", 0.0, 30.0
    )
    still_accel_mps2: float = parameter(
        0.15, "m/s2", "standing still: largest deviation of the acceleration", 0.0, 10.0
    )
    still_gyro_radps: float = parameter(
        0.06, "rad/s", "standing still: largest rate of turn", 0.0, 10.0
    )
    still_tremor_radps: float = parameter(
        0.005,
        "rad/s",
        "lying still, not in a hand: largest deviation of the rate of turn",
        0.0,
        10.0,
    )
    still_s: float = parameter(
        2.0, "s", "standing still: shortest stretch that gives the gyroscope bias", 0.2, 30.0
    )
    most_offset_radps: float = parameter(
        0.25,
        "rad/s",
        "a gyroscope that contradicts gravity by more is refused; data sheets allow 0.02 to 0.17",
        0.0,
        100.0,
    )
    most_turning_radps: float = parameter(
        1.0,
        "rad/s",
        "nobody turns by more all along a walk, on average, and once round besides",
        0.0,
        100.0,
    )
    field_sigma_ut: float = parameter(
        6.0, "uT", "how far a building bends the magnetic field", 0.1, 100.0
    )
    field_correlation_m: float = parameter(
        5.0, "m", "over which distance it bends it alike", 0.1, 1000.0
    )
    hard_iron_sigma_ut: float = parameter(
        2.5, "uT", "the phone's own field where nothing is known of it", 0.01, 1000.0
    )
    hard_iron_drift_ut: float = parameter(
        1.0, "uT", "how much it changes from one walk to the next", 0.0, 1000.0
    )
    forward_sigma: float = parameter(
        0.35, "", "step length error of one step, relative to it", 1e-3, 10.0
    )
    lateral_sigma: float = parameter(
        0.25, "", "sideways error of one step, relative to its length", 1e-3, 10.0
    )
    heading_sigma_rad: float = parameter(
        0.01, "rad", "heading error gathered in one step", 1e-4, 3.14
    )
    setting_off_sigma_rad: float = parameter(
        0.11, "rad", "how far the phone points aside as the walk sets off", 0.0, 3.14
    )
    magnetic_north_rad: float = parameter(
        math.pi / 2, "rad", "where magnetic north lies in the map, from x to y", -6.3, 6.3
    )
    heading_drift_sigma_radps: float = parameter(
        0.001, "rad/s", "steady drift of the heading", 0.0, 1.0
    )
    unseen_speed_mps: float = parameter(
        1.4, "m/s", "how fast a walker may go where motion is missing", 0.1, 10.0
    )
    unseen_turn_radps: float = parameter(
        0.5, "rad/s", "how fast the heading is lost where motion is missing", 0.0, 10.0
    )
    live_window_s: float = parameter(
        8.0, "s", "live, footsteps are found in so much of the walk", 6.0, 3600.0
    )
    live_delay_s: float = parameter(
        0.5, "s", "live, a footstep is final when the walk has gone on for so long", 0.0, 10.0
    )


def check_motion(parameters: MotionParameters) -> None:
    """Refuse parameters that contradict each other."""
    if parameters.shortest_step_m > parameters.longest_step_m:
        raise ParameterError(
            f"motion.shortest_step_m: wanted at most longest_step_m "
            f"({parameters.longest_step_m:g}), got {parameters.shortest_step_m:g}; set both"
        )
