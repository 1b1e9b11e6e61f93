"""Pedestrian dead reckoning: footsteps, step lengths and walking heading from the inertial sensors.

No magnetometer is used and no way of holding the phone is assumed, only that its mounting does not
turn about the vertical while walking. Heading is relative: the walk begins at heading 0 unless a
start pose is given. The step lengths are calibrated on real walks of surveyors in a mall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, signal
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.geometry import chain
from elfslam.base.parameters import parameter
from elfslam.base.values import Imu, Odometry

GRAVITY_MPS2 = 9.81


@dataclass(frozen=True)
class MotionParameters:
    """How steps are found, measured and turned, and how far each is trusted."""

    node_spacing_m: float = parameter(
        0.5, "m", "distance between nodes where the device brings odometry", low=0.05, high=100.0
    )
    least_rate_hz: float = parameter(
        20.0, "Hz", "slower inertial sensors are refused", low=12.0, high=1e4
    )
    least_duration_s: float = parameter(
        2.0, "s", "shorter recordings are refused", low=1.0, high=3600.0
    )
    longest_gap_s: float = parameter(
        0.5, "s", "recordings with a longer interruption are refused", low=0.01, high=60.0
    )
    least_footsteps: int = parameter(
        4, "", "walks with fewer footsteps are refused", low=2, high=100_000
    )
    gravity_cutoff_hz: float = parameter(
        0.1, "Hz", "low-pass that keeps gravity", low=0.005, high=0.5
    )
    cadence_low_hz: float = parameter(
        0.8, "Hz", "lower edge of the footstep band", low=0.3, high=1.5
    )
    cadence_high_hz: float = parameter(
        3.0, "Hz", "upper edge of the footstep band", low=2.0, high=5.0
    )
    least_interval_s: float = parameter(
        0.3, "s", "footsteps are never closer in time", low=0.1, high=0.6
    )
    least_bounce_mps2: float = parameter(
        1.0, "m/s2", "smallest rise of the vertical acceleration in a step", low=0.0, high=50.0
    )
    relative_bounce: float = parameter(
        0.4, "", "rise wanted, relative to the steps around", low=0.0, high=1.0
    )
    bounce_window_s: float = parameter(
        4.0, "s", "span over which the bounce is averaged", low=0.5, high=60.0
    )
    step_length_m: float = parameter(
        0.69, "m", "step length at the typical cadence and bounce", low=0.1, high=1.5
    )
    # The calibration walks say nothing of cadence: their quick steps are shuffling, short ones.
    length_per_cadence_m_s: float = parameter(
        0.0, "m s", "growth of the step length with cadence (m per step/s)", low=-2.0, high=2.0
    )
    length_per_root_bounce: float = parameter(
        0.15, "m / sqrt(m/s2)", "growth of the step length with root bounce", low=-2.0, high=2.0
    )
    typical_cadence_hz: float = parameter(
        1.8, "Hz", "cadence at which step_length_m holds", low=0.5, high=4.0
    )
    typical_bounce_mps2: float = parameter(
        3.0, "m/s2", "bounce (rms) at which step_length_m holds", low=0.0, high=50.0
    )
    shortest_step_m: float = parameter(
        0.3, "m", "estimated steps are never shorter", low=0.05, high=2.0
    )
    longest_step_m: float = parameter(
        1.2, "m", "estimated steps are never longer", low=0.3, high=3.0
    )
    heading_window_s: float = parameter(
        1.0, "s", "heading is averaged over a stride to remove body sway", low=0.0, high=30.0
    )
    still_accel_mps2: float = parameter(
        0.15, "m/s2", "standing still: largest deviation of the acceleration", low=0.0, high=10.0
    )
    still_gyro_radps: float = parameter(
        0.06, "rad/s", "standing still: largest rate of turn", low=0.0, high=10.0
    )
    still_s: float = parameter(
        2.0,
        "s",
        "standing still: shortest stretch that gives the gyroscope bias",
        low=0.2,
        high=30.0,
    )
    forward_sigma: float = parameter(
        0.4, "", "step length error of one step, relative to it", low=1e-3, high=10.0
    )
    lateral_sigma: float = parameter(
        0.1, "", "sideways error of one step, relative to its length", low=1e-3, high=10.0
    )
    heading_sigma_rad: float = parameter(
        0.015, "rad", "heading error gathered in one step", low=1e-4, high=3.14
    )


def dead_reckon(
    imu: Imu, parameters: MotionParameters, start_pose: tuple[float, float, float] | None = None
) -> Odometry:
    """One node per footstep, the first at `start_pose` or the origin, with the sigma of each move.

    Raises InputError where the recording is too short, too slow, interrupted, or holds too few
    footsteps, ParameterError where two parameters contradict each other.
    """
    check_motion(parameters)
    footsteps_t_s = find_footsteps(imu, parameters)
    if len(footsteps_t_s) < parameters.least_footsteps:
        raise InputError(
            f"inertial data: found {len(footsteps_t_s)} footsteps, wanted at least "
            f"{parameters.least_footsteps}; record a longer walk, phone in the hand"
        )
    lengths_m = step_lengths(imu, footsteps_t_s, parameters)[1:]
    heading_rad = walking_heading(imu, parameters)
    at_footsteps = np.interp(footsteps_t_s, imu.t_s, heading_rad)
    halfway = np.interp((footsteps_t_s[1:] + footsteps_t_s[:-1]) / 2, imu.t_s, heading_rad)
    moves = _moves(lengths_m, at_footsteps, halfway)
    poses = chain(np.asarray(start_pose or (0.0, 0.0, 0.0)), moves)
    return Odometry(footsteps_t_s, poses, _step_sigma(lengths_m, parameters))


def find_footsteps(imu: Imu, parameters: MotionParameters) -> F64:
    """Times (n) of the footfalls, s: peaks of the vertical acceleration in the footstep band.

    Raises InputError as `check_imu` does; a walk without footsteps gives no times.
    """
    check_imu(imu, parameters)
    t_s, bounce = _bounce(imu, parameters)
    rate_hz = _rate_hz(t_s)
    span = 2 * np.sqrt(2) * _bounce_rms(bounce, rate_hz, parameters)  # peak to peak of a sinusoid
    wanted = np.maximum(parameters.least_bounce_mps2, parameters.relative_bounce * span)
    peaks, found = signal.find_peaks(
        bounce,
        distance=max(1, round(parameters.least_interval_s * rate_hz)),
        prominence=parameters.least_bounce_mps2,
    )
    kept = peaks[found["prominences"] >= wanted[peaks]]
    return np.asarray(t_s[kept] + _peak_offset(bounce, kept) / rate_hz)


def step_lengths(imu: Imu, footsteps_t_s: F64, parameters: MotionParameters) -> F64:
    """Length (n), m, of the step that ends at each of two or more footsteps.

    Linear in cadence and in the root of the bounce, the rms of the vertical acceleration in the
    footstep band. The first footstep has no step before it and takes the length of the second.
    """
    t_s, bounce = _bounce(imu, parameters)
    rms = np.interp(footsteps_t_s, t_s, _bounce_rms(bounce, _rate_hz(t_s), parameters))
    # A long interval is a pause, not a slow step.
    cadence_hz = np.maximum(1.0 / np.diff(footsteps_t_s), parameters.cadence_low_hz)
    lengths_m = (
        parameters.step_length_m
        + parameters.length_per_cadence_m_s * (cadence_hz - parameters.typical_cadence_hz)
        + parameters.length_per_root_bounce
        * (np.sqrt(rms[1:]) - np.sqrt(parameters.typical_bounce_mps2))
    )
    lengths_m = np.clip(lengths_m, parameters.shortest_step_m, parameters.longest_step_m)
    return np.concatenate([lengths_m[:1], lengths_m])


def walking_heading(imu: Imu, parameters: MotionParameters) -> F64:
    """Heading (n), rad, at `imu.t_s`: the rate of turn about the vertical, summed from 0.

    It is continuous (not wrapped) and averaged over a stride.
    """
    t_s, accel, gyro = _evenly_sampled(imu)
    rate_hz = _rate_hz(t_s)
    turn_radps = gyro - gyroscope_bias(imu, parameters)
    up = _up_in_phone(accel, turn_radps, rate_hz, parameters)
    yaw_radps = np.sum(turn_radps * up, axis=1)
    heading = np.concatenate([[0.0], np.cumsum((yaw_radps[1:] + yaw_radps[:-1]) / 2) / rate_hz])
    window = max(1, round(parameters.heading_window_s * rate_hz))
    smooth = ndimage.uniform_filter1d(heading, window, mode="nearest")
    return np.asarray(np.interp(imu.t_s, t_s, smooth))


def gyroscope_bias(imu: Imu, parameters: MotionParameters) -> F64:
    """Bias (3), rad/s in phone axes: the mean rate of turn while standing still.

    Zero where the walk never rests.
    """
    t_s, accel, gyro = _evenly_sampled(imu)
    still = _still(accel, gyro, _rate_hz(t_s), parameters)
    return gyro[still].mean(axis=0) if still.any() else np.zeros(3)


def nodes_by_distance(odometry: Odometry, spacing_m: float) -> Odometry:
    """The odometry thinned to a node each time the walker is `spacing_m` from the node before.

    For devices that bring their own odometry at a fixed rate. The variances of the moves between
    two nodes add up. Raises InputError where the walk is shorter than the spacing.
    """
    kept = _spaced_rows(odometry.world_from_body[:, :2], spacing_m)
    if len(kept) < 2:
        raise InputError(
            f"odometry: the walk never gets {spacing_m:g} m away from its start; "
            "choose a smaller spacing"
        )
    summed = np.vstack([np.zeros(3), np.cumsum(odometry.step_sigma**2, axis=0)])
    sigma = np.sqrt(np.diff(summed[kept], axis=0))
    return Odometry(odometry.t_s[kept], odometry.world_from_body[kept], sigma)


def check_imu(imu: Imu, parameters: MotionParameters) -> None:
    """Raises InputError where the recording is too short, sampled too slowly or interrupted."""
    duration_s = float(imu.t_s[-1] - imu.t_s[0]) if len(imu.t_s) > 1 else 0.0
    if duration_s < parameters.least_duration_s:
        raise InputError(
            f"inertial data: got {duration_s:.1f} s, wanted at least "
            f"{parameters.least_duration_s:g} s; record longer"
        )
    gaps_s = np.diff(imu.t_s)
    worst = int(np.argmax(gaps_s))
    if gaps_s[worst] > parameters.longest_gap_s:
        raise InputError(
            f"inertial data: {gaps_s[worst]:.2f} s missing after {imu.t_s[worst]:.2f} s, "
            f"wanted gaps of at most {parameters.longest_gap_s:g} s; cut the recording there "
            "or raise longest_gap_s"
        )
    if _rate_hz(imu.t_s) < parameters.least_rate_hz:
        raise InputError(
            f"inertial data: got {_rate_hz(imu.t_s):.1f} samples/s, wanted at least "
            f"{parameters.least_rate_hz:g}; choose a faster sensor rate"
        )


def check_motion(parameters: MotionParameters) -> None:
    """Refuse parameters that contradict each other."""
    if parameters.shortest_step_m > parameters.longest_step_m:
        raise ParameterError(
            f"motion.shortest_step_m: wanted at most longest_step_m "
            f"({parameters.longest_step_m:g}), got {parameters.shortest_step_m:g}; set both"
        )


def _moves(lengths_m: F64, heading_rad: F64, halfway_rad: F64) -> F64:
    """Moves (n-1, 3) between footsteps: each goes where the walker heads halfway through it."""
    aside = halfway_rad - heading_rad[:-1]
    return np.column_stack(
        [lengths_m * np.cos(aside), lengths_m * np.sin(aside), np.diff(heading_rad)]
    )


def _step_sigma(lengths_m: F64, parameters: MotionParameters) -> F64:
    forward_m, lateral_m = (
        parameters.forward_sigma * lengths_m,
        parameters.lateral_sigma * lengths_m,
    )
    return np.column_stack(
        [forward_m, lateral_m, np.full(len(lengths_m), parameters.heading_sigma_rad)]
    )


def _evenly_sampled(imu: Imu) -> tuple[F64, F64, F64]:
    """Times, acceleration and rate of turn on an even grid at the recording's own rate."""
    rate_hz = _rate_hz(imu.t_s)
    count = int((imu.t_s[-1] - imu.t_s[0]) * rate_hz) + 1
    t_s = imu.t_s[0] + np.arange(count) / rate_hz
    accel, gyro = (
        np.column_stack([np.interp(t_s, imu.t_s, column) for column in rows.T])
        for rows in (imu.accel_mps2, imu.gyro_radps)
    )
    return t_s, accel, gyro


def _rate_hz(t_s: F64) -> float:
    return float(1.0 / np.median(np.diff(t_s)))


def _bounce(imu: Imu, parameters: MotionParameters) -> tuple[F64, F64]:
    """Even times and the vertical acceleration in the footstep band."""
    t_s, accel, gyro = _evenly_sampled(imu)
    rate_hz = _rate_hz(t_s)
    up = _up_in_phone(accel, gyro, rate_hz, parameters)
    vertical = np.sum(accel * up, axis=1) - GRAVITY_MPS2
    band = (parameters.cadence_low_hz, parameters.cadence_high_hz)
    sos = signal.butter(2, band, "bandpass", fs=rate_hz, output="sos")
    return t_s, np.asarray(signal.sosfiltfilt(sos, vertical))


def _bounce_rms(bounce: F64, rate_hz: float, parameters: MotionParameters) -> F64:
    window = max(1, round(parameters.bounce_window_s * rate_hz))
    return np.asarray(np.sqrt(np.maximum(ndimage.uniform_filter1d(bounce**2, window), 0.0)))


def _peak_offset(signal_rows: F64, peaks: I64) -> F64:
    """Where the parabola through a peak and its neighbours is highest, in samples from it."""
    before, at, after = (signal_rows[peaks + shift] for shift in (-1, 0, 1))
    return np.asarray((before - after) / np.minimum(2 * (before - 2 * at + after), -1e-12))


def _up_in_phone(accel: F64, gyro: F64, rate_hz: float, parameters: MotionParameters) -> F64:
    """Unit vectors (n, 3) that point up, in phone axes.

    The gyroscope carries the phone into a frame that barely moves, where a slow low-pass without
    delay leaves of the acceleration only gravity, however the phone is turned meanwhile.
    """
    mean_radps = (gyro[1:] + gyro[:-1]) / 2
    fixed_from_phone = _cumulated(
        Rotation.from_rotvec(np.vstack([np.zeros(3), mean_radps / rate_hz]))
    )
    sos = signal.butter(1, parameters.gravity_cutoff_hz, fs=rate_hz, output="sos")
    padding = min(len(accel) - 1, round(rate_hz / parameters.gravity_cutoff_hz))
    gravity = signal.sosfiltfilt(
        sos, fixed_from_phone.apply(accel), axis=0, padtype="even", padlen=padding
    )
    in_phone = fixed_from_phone.inv().apply(gravity)
    return np.asarray(in_phone / np.linalg.norm(in_phone, axis=1, keepdims=True))


def _cumulated(turns: Rotation) -> Rotation:
    """Products of the first k rotations, for every k, by doubling."""
    reach = 1
    while reach < len(turns):
        turns = Rotation.concatenate([turns[:reach], turns[:-reach] * turns[reach:]])
        reach *= 2
    return turns


def _still(accel: F64, gyro: F64, rate_hz: float, parameters: MotionParameters) -> Bool:
    """Rows inside stretches where the phone hardly shakes or turns for long enough."""
    window = max(1, round(parameters.still_s * rate_hz))
    shake = np.linalg.norm(accel - ndimage.uniform_filter1d(accel, window, axis=0), axis=1)
    calm = (shake < parameters.still_accel_mps2) & (
        np.linalg.norm(gyro, axis=1) < parameters.still_gyro_radps
    )
    return np.asarray(ndimage.binary_opening(calm, np.ones(window, bool)))


def _spaced_rows(xy_m: F64, spacing_m: float) -> I64:
    """Rows at least `spacing_m` from the row kept before, straight: standing adds none."""
    kept = [0]
    for row, position in enumerate(xy_m):
        if np.hypot(*(position - xy_m[kept[-1]])) >= spacing_m - 1e-9:
            kept.append(row)
    return np.asarray(kept, np.int64)
