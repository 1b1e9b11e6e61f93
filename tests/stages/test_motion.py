"""Dead reckoning on planted walks: every step, turn and length is known."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from elfslam.base.errors import InputError
from elfslam.base.geometry import between, compose, interpolate_poses, wrap_angle
from elfslam.base.values import Imu, Odometry
from elfslam.data.mall import read_walk, walks_in
from elfslam.stages import motion
from elfslam.stages.motion import calibrated, dead_reckon, find_footsteps, nodes_by_distance
from elfslam.stages.motion import level as levelling
from elfslam.stages.motion.level import level, offset_by_gravity, rate_of, still_bias
from elfslam.stages.motion.reckoning import lengths_between, smooth_heading
from elfslam.world.simulate import load_world, simulate

PARAMETERS = motion.MotionParameters()
TILTED = Rotation.from_euler("xyz", [35, -20, 50], degrees=True)
LEVEL = Rotation.identity()
BY_BOUNCE = replace(PARAMETERS, walk_ratio_sigma=10.0)
"""Step lengths by the bounce alone."""
CADENCE_HZ = 1.8
REST_S = 3.0


def walk(
    steps,
    *,
    rate_hz=50.0,
    mounting=LEVEL,
    turns=(),
    bounce_mps2=2.5,
    cadence_hz=CADENCE_HZ,
    bias_radps=(0.0, 0.0, 0.0),
    decimals=None,
):
    """Rest, `steps` steps, rest; `turns` are (at which step, radians), each takes one second."""
    walking_s = steps / cadence_hz
    t_s = np.arange(0.0, walking_s + 2 * REST_S, 1.0 / rate_hz)
    phase = np.clip((t_s - REST_S) * cadence_hz, 0.0, steps)
    moving = (t_s > REST_S) & (t_s < REST_S + walking_s)
    vertical = bounce_mps2 * moving * (np.sin(2 * np.pi * phase) + 0.4 * np.sin(4 * np.pi * phase))
    sway = 0.6 * moving * np.cos(np.pi * phase)
    yaw_radps = np.zeros_like(t_s)
    for step, angle_rad in turns:
        yaw_radps += angle_rad * (np.abs(t_s - REST_S - step / cadence_hz) < 0.5)
    noise = np.random.default_rng(0).normal(0.0, 0.02, (len(t_s), 3))
    accel = np.column_stack([sway, 0.5 * vertical, 9.81 + vertical]) + noise
    gyro = np.column_stack([0.1 * sway, 0 * t_s, yaw_radps + 0.2 * sway])
    accel, gyro = (mounting.inv().apply(rows) for rows in (accel, gyro))
    gyro = gyro + np.asarray(bias_radps)
    if decimals is not None:
        accel = np.round(accel, decimals)
    return Imu(t_s, accel, gyro)


def square(side_steps, **options):
    corners = [(side_steps * k, np.pi / 2) for k in (1, 2, 3)]
    return walk(4 * side_steps, turns=corners, **options)


@pytest.mark.parametrize("rate_hz", [50.0, 60.0, 100.0])
@pytest.mark.parametrize("mounting", [LEVEL, TILTED])
@pytest.mark.parametrize("decimals", [None, 1])
def test_planted_footsteps_are_counted(rate_hz, mounting, decimals):
    imu = walk(60, rate_hz=rate_hz, mounting=mounting, decimals=decimals)
    assert abs(len(find_footsteps(imu, PARAMETERS)) - 60) <= 1


@pytest.mark.parametrize(("cadence_hz", "bounce_mps2"), [(1.3, 1.2), (1.8, 2.0), (2.2, 5.0)])
def test_footsteps_come_at_the_planted_cadence(cadence_hz, bounce_mps2):
    footsteps = find_footsteps(walk(40, cadence_hz=cadence_hz, bounce_mps2=bounce_mps2), PARAMETERS)
    assert abs(len(footsteps) - 40) <= 1
    assert np.diff(footsteps)[3:-3] == pytest.approx(1 / cadence_hz, abs=0.02)


def test_a_straight_walk_has_the_planted_length_and_direction():
    parameters = replace(
        BY_BOUNCE, length_power_of_bounce=0.0, length_power_of_cadence=0.0, step_length_m=0.7
    )
    odometry = dead_reckon(walk(80, mounting=TILTED), parameters)
    x_m, y_m, heading_rad = odometry.world_from_body[-1]
    assert x_m == pytest.approx(0.7 * 79, abs=0.8)
    assert abs(y_m) < 0.01 * x_m
    assert abs(heading_rad) < np.radians(2)


@pytest.mark.parametrize("rate_hz", [50.0, 60.0, 100.0])
def test_a_square_turns_three_corners_and_comes_home(rate_hz):
    imu = square(20, rate_hz=rate_hz, mounting=TILTED, decimals=1)
    heading_rad = smooth_heading(level(imu, PARAMETERS), PARAMETERS)
    assert heading_rad[-1] - heading_rad[0] == pytest.approx(1.5 * np.pi, abs=np.radians(2))
    end = dead_reckon(imu, PARAMETERS).world_from_body[-1]
    assert np.hypot(*end[:2]) < 2.0


@pytest.mark.parametrize("mounting", [LEVEL, TILTED])
def test_gravity_tells_an_offset_of_the_gyroscope_but_for_its_vertical_part(mounting):
    planted = np.array([0.1, -0.06, 0.08])
    found = offset_by_gravity(level(square(20, mounting=mounting, bias_radps=planted), PARAMETERS))
    up = mounting.inv().apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(found, planted - up * (up @ planted), atol=0.06)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("mounting", [LEVEL, TILTED])
def test_a_gyroscope_that_cannot_be_right_is_refused(mounting, axis):
    imu = square(20, mounting=mounting, bias_radps=2.0 * np.eye(3)[axis])
    with pytest.raises(InputError, match="gyroscope: turns by") as refused:
        dead_reckon(imu, PARAMETERS)
    assert "\n" not in str(refused.value)
    assert "calibrate it" in str(refused.value)


@pytest.mark.parametrize("offset_radps", [0.02, 0.17])
def test_an_offset_that_data_sheets_allow_is_taken(offset_radps):
    for axis in np.eye(3):
        imu = square(20, mounting=TILTED, bias_radps=offset_radps * axis)
        assert abs(len(dead_reckon(imu, PARAMETERS).t_s) - 80) <= 2


def test_who_turns_back_often_has_a_gyroscope_that_is_right():
    world = load_world("studio")
    there_and_back = replace(world, route_m=world.route_m[:2])
    imu = simulate(there_and_back, 132, rounds=4, sound=False)[0].imu
    assert imu is not None
    offset_radps = np.linalg.norm(offset_by_gravity(level(imu, PARAMETERS)))
    assert offset_radps < 0.5 * PARAMETERS.most_offset_radps


def test_no_walk_of_the_mall_contradicts_its_gyroscope(shared_data):
    walks = islice(walks_in(shared_data / "mall_walks" / "site1-F4.tar.xz"), 40)
    levelled = [level(read_walk(file).recording.imu, PARAMETERS) for file in walks]
    offsets_radps = [np.linalg.norm(offset_by_gravity(each)) for each in levelled]
    assert len(offsets_radps) == 40
    assert max(offsets_radps) < 0.3 * PARAMETERS.most_offset_radps
    turning = [np.mean(np.sum(each.gyro_radps * each.up, axis=1)) for each in levelled]
    assert np.abs(turning).max() < 0.5 * PARAMETERS.most_turning_radps


def test_each_corner_turns_by_the_planted_angle():
    odometry = dead_reckon(square(20), PARAMETERS)
    headings = odometry.world_from_body[:, 2]
    for step, wanted in ((10, 0.0), (30, np.pi / 2), (50, np.pi), (70, 1.5 * np.pi)):
        assert abs(wrap_angle(headings[step] - wanted)) < np.radians(3)


@pytest.mark.parametrize("power", [0.0, 0.4])
def test_steps_follow_the_powers_of_cadence_and_bounce(power):
    parameters = replace(BY_BOUNCE, length_power_of_bounce=power, length_power_of_cadence=-power)

    def usual_length(**options):
        imu = walk(40, **options)
        footsteps = find_footsteps(imu, parameters)
        return np.median(lengths_between(level(imu, parameters), footsteps, parameters))

    usual = usual_length()
    assert usual_length(bounce_mps2=3.5) / usual == pytest.approx(1.4**power, rel=0.02)
    quicker = usual_length(cadence_hz=2.2) / usual
    assert quicker == pytest.approx((CADENCE_HZ / 2.2) ** power, rel=0.06)  # the band is not flat


@pytest.mark.parametrize(
    ("sigmas", "least", "most"), [((0.001, 10.0), -0.01, 0.01), ((1.0, 0.001), 0.99, 1.01)]
)
def test_bounce_and_walk_ratio_are_weighed_by_their_sigmas(sigmas, least, most):
    imu, (bounce, ratio) = walk(40, bounce_mps2=1.5), sigmas
    wanted = replace(PARAMETERS, bounce_law_sigma=bounce, walk_ratio_sigma=ratio)
    footsteps = find_footsteps(imu, PARAMETERS)
    joined, alone = (
        np.median(np.log(lengths_between(level(imu, each), footsteps, each)))
        for each in (wanted, BY_BOUNCE)
    )
    by_ratio = np.log(PARAMETERS.walk_ratio_m_per_hz * CADENCE_HZ)
    assert least <= (joined - alone) / (by_ratio - alone) <= most


@pytest.mark.parametrize(("cadence_hz", "length_m"), [(1.35, 0.53), (1.52, 0.6), (1.7, 0.68)])
def test_slow_walkers_steps_are_within_an_eighth(cadence_hz, length_m):
    by_bounce_m = length_m * np.interp(cadence_hz, (1.35, 1.7), (0.79, 0.75))
    bounce = (by_bounce_m / 0.7) ** 2.5 * (cadence_hz / 1.8) ** 1.25 * 3.0  # rms
    imu = walk(60, cadence_hz=cadence_hz, bounce_mps2=bounce / np.sqrt(0.58))
    footsteps = find_footsteps(imu, PARAMETERS)
    alone, joined = (
        np.median(lengths_between(level(imu, each), footsteps, each))
        for each in (BY_BOUNCE, PARAMETERS)
    )
    assert alone < 0.85 * length_m
    assert joined == pytest.approx(length_m, rel=0.125)


@pytest.mark.parametrize("rate_hz", [50.0, 60.0, 100.0])
@pytest.mark.parametrize("pitch_deg", [0.0, 30.0, 60.0])
def test_steps_are_as_long_at_any_rate_and_tilt(rate_hz, pitch_deg):
    mounting = Rotation.from_euler("xyz", [pitch_deg, 10, 0], degrees=True)
    usual, other = (
        np.median(
            lengths_between(level(imu, PARAMETERS), find_footsteps(imu, PARAMETERS), PARAMETERS)
        )
        for imu in (walk(40), walk(40, rate_hz=rate_hz, mounting=mounting))
    )
    assert other == pytest.approx(usual, rel=0.01)


def test_a_pause_is_no_long_step():
    imu, pause_s = walk(40), 5.0
    footsteps = find_footsteps(imu, PARAMETERS)
    both = footsteps, footsteps + pause_s * (np.arange(len(footsteps)) >= 20)
    usual, paused = (lengths_between(level(imu, PARAMETERS), t_s, PARAMETERS) for t_s in both)
    assert paused[19] == PARAMETERS.pause_length_m
    assert paused[:18] == pytest.approx(usual[:18], rel=0.01)


def test_a_walker_is_calibrated_by_a_known_distance():
    short, long = walk(40), square(20)
    taught = motion.calibrated_by_distance(short, 39 * 0.8, PARAMETERS)
    assert taught.step_scale_sigma == 0.02
    moves_m = np.diff(dead_reckon(long, taught).world_from_body[:, :2], axis=0)
    assert np.linalg.norm(moves_m, axis=1).mean() == pytest.approx(0.8, rel=0.02)
    assert dead_reckon(long, taught).scale_sigma == 0.02
    assert dead_reckon(long, PARAMETERS).scale_sigma == PARAMETERS.step_scale_sigma > 0.02


def test_calibrations_multiply():
    twice = calibrated(calibrated(PARAMETERS, 1.1), 0.9, 0.03)
    assert (twice.step_scale, twice.step_scale_sigma) == (pytest.approx(0.99), 0.03)


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan")])
def test_an_impossible_calibration_is_refused(wrong):
    with pytest.raises(InputError, match="wanted more than 0"):
        calibrated(PARAMETERS, wrong)
    with pytest.raises(InputError, match="wanted more than 0"):
        motion.calibrated_by_distance(walk(40), wrong, PARAMETERS)


def test_turning_the_phone_in_its_mounting_changes_nothing():
    level, tilted = (dead_reckon(square(15, mounting=by), PARAMETERS) for by in (LEVEL, TILTED))
    assert tilted.t_s == pytest.approx(level.t_s, abs=1e-6)
    assert tilted.world_from_body == pytest.approx(level.world_from_body, abs=1e-6)


def test_a_shift_of_the_clock_moves_only_the_times():
    imu = square(10)
    here = dead_reckon(imu, PARAMETERS)
    later = dead_reckon(Imu(imu.t_s + 1000.0, imu.accel_mps2, imu.gyro_radps), PARAMETERS)
    assert later.t_s == pytest.approx(here.t_s + 1000.0, abs=1e-6)
    assert later.world_from_body == pytest.approx(here.world_from_body, abs=1e-6)


def test_the_start_pose_moves_the_walk_rigidly():
    imu, start = square(10), (3.0, -2.0, 1.0)
    here = dead_reckon(imu, PARAMETERS).world_from_body
    there = dead_reckon(imu, PARAMETERS, start).world_from_body
    assert there == pytest.approx(compose(np.array(start), here), abs=1e-9)


def test_the_first_footstep_is_half_a_step_from_where_the_walker_stood():
    start = (3.0, -2.0, np.pi / 2)
    first, second = dead_reckon(walk(20), PARAMETERS, start).world_from_body[:2]
    step_m = np.linalg.norm(second[:2] - first[:2])
    assert first[1] == pytest.approx(-2.0 + step_m / 2, abs=0.05)
    assert first[0] == pytest.approx(3.0, abs=0.05)
    assert first[2] == pytest.approx(np.pi / 2, abs=0.1)


def test_a_turn_while_setting_off_is_a_turn_of_the_whole_walk():
    straight, aside = walk(20), walk(20, turns=[(-0.5, 1.0)])
    ends = [dead_reckon(imu, PARAMETERS).world_from_body[-1] for imu in (straight, aside)]
    assert wrap_angle(ends[1][2] - ends[0][2]) == pytest.approx(1.0, abs=0.02)
    angles = [np.arctan2(end[1], end[0]) for end in ends]
    assert angles[1] - angles[0] == pytest.approx(1.0, abs=0.1)


def test_a_soft_step_before_the_first_that_is_found_hides_no_turn():
    """Whoever sets off softly has turned, too; only a phone that never rested is another case."""
    imu = walk(20, turns=[(-0.5, 1.0)], bounce_mps2=6.0)
    softly = imu.accel_mps2.copy()
    stir = (imu.t_s > 1.9) & (imu.t_s < 2.5)
    softly[stir, 2] -= 1.6 * np.sin(2 * np.pi * CADENCE_HZ * (imu.t_s[stir] - 1.9))
    stirred = Imu(imu.t_s, softly, imu.gyro_radps)
    assert len(find_footsteps(stirred, PARAMETERS)) == len(find_footsteps(imu, PARAMETERS))
    ends = [dead_reckon(one, PARAMETERS).world_from_body[-1] for one in (imu, stirred)]
    assert ends[1] == pytest.approx(ends[0], abs=0.3)


def test_a_recording_that_begins_in_mid_walk_begins_at_the_start_pose():
    imu = walk(40)
    walking = imu.t_s > REST_S + 2.0
    cut = Imu(imu.t_s[walking], imu.accel_mps2[walking], imu.gyro_radps[walking])
    first = dead_reckon(cut, PARAMETERS, (3.0, -2.0, 1.0)).world_from_body[0]
    assert first == pytest.approx([3.0, -2.0, 1.0], abs=1e-9)


def test_rest_reveals_the_gyroscope_bias():
    bias = (0.01, -0.02, 0.015)
    imu = walk(60, mounting=TILTED, bias_radps=bias)
    t_s, accel, gyro = levelling.evenly_sampled(imu)
    found = still_bias(accel, gyro, rate_of(t_s), PARAMETERS)
    assert found == pytest.approx(np.array(bias), abs=0.002)
    heading_rad = smooth_heading(level(imu, PARAMETERS), PARAMETERS)
    assert abs(heading_rad[-1] - heading_rad[0]) < np.radians(2)


def test_uncertainty_is_given_for_every_step_and_follows_its_parameters():
    odometry = dead_reckon(walk(30), PARAMETERS)
    assert odometry.step_sigma.shape == (len(odometry.t_s) - 1, 3)
    lengths_m = np.linalg.norm(np.diff(odometry.world_from_body[:, :2], axis=0), axis=1)
    assert odometry.step_sigma[:, 0] == pytest.approx(PARAMETERS.forward_sigma * lengths_m)
    assert odometry.step_sigma[:, 1] == pytest.approx(PARAMETERS.lateral_sigma * lengths_m)
    assert odometry.step_sigma[1:, 2] == pytest.approx(PARAMETERS.heading_sigma_rad)
    setting_off = np.hypot(PARAMETERS.heading_sigma_rad, PARAMETERS.setting_off_sigma_rad)
    assert odometry.step_sigma[0, 2] == pytest.approx(setting_off)
    assert odometry.heading_drift_sigma_radps == PARAMETERS.heading_drift_sigma_radps


def test_real_walks_end_near_where_they_truly_end(shared_data):
    archive = shared_data / "mall_walks" / "site1-F4.tar.xz"
    errors = [end_error(read_walk(path)) for path in islice(walks_in(archive), 12)]
    assert np.median([error for error in errors if error is not None]) < 0.2


def end_error(mall_walk):
    """End error by path length, the first leg turned onto the true one; none for short walks."""
    truth = mall_walk.truth
    odometry = dead_reckon(mall_walk.recording.imu, PARAMETERS)
    estimated, true = (
        position @ (1, 1j)
        for position in (
            interpolate_poses(odometry.t_s, odometry.world_from_body, truth.t_s)[:, :2],
            truth.world_from_body[:, :2],
        )
    )
    length_m = np.abs(np.diff(true)).sum()
    if length_m < 15:
        return None
    estimated, true = estimated - estimated[0], true - true[0]
    turn = true[1] / estimated[1]
    return abs(estimated[-1] * turn / abs(turn) - true[-1]) / length_m


def test_standing_still_takes_no_steps_and_is_refused():
    imu = walk(0)
    assert len(find_footsteps(imu, PARAMETERS)) == 0
    with pytest.raises(InputError, match="found 0 footsteps"):
        dead_reckon(imu, PARAMETERS)


def test_a_pause_takes_no_steps():
    imu = walk(40)
    middle = REST_S + 20 / CADENCE_HZ
    still = np.repeat(imu.accel_mps2[:1], 500, axis=0)
    row = int(np.searchsorted(imu.t_s, middle))
    accel = np.vstack([imu.accel_mps2[:row], still, imu.accel_mps2[row:]])
    gyro = np.vstack([imu.gyro_radps[:row], 0 * still, imu.gyro_radps[row:]])
    footsteps = find_footsteps(Imu(np.arange(len(accel)) / 50.0, accel, gyro), PARAMETERS)
    assert abs(len(footsteps) - 40) <= 1
    assert not ((footsteps > middle + 1.0) & (footsteps < middle + 9.0)).any()


def without(imu, *holes):
    """The sensors without what they measured within some spans."""
    kept = np.ones(len(imu.t_s), bool)
    for begin_s, end_s in holes:
        kept &= (imu.t_s < begin_s) | (imu.t_s > end_s)
    return Imu(imu.t_s[kept], imu.accel_mps2[kept], imu.gyro_radps[kept])


def test_three_seconds_without_motion_make_one_move_uncertain_and_no_other():
    imu = square(15)
    whole, holed = (dead_reckon(each, PARAMETERS) for each in (imu, without(imu, (12.0, 15.0))))
    across = int(np.argmax(np.diff(holed.t_s)))
    unseen_s = float(np.diff(holed.t_s)[across])
    assert 3.0 < unseen_s < 4.5
    assert len(whole.t_s) - 10 < len(holed.t_s) < len(whole.t_s)
    forward_m, lateral_m, heading_rad = holed.step_sigma[across]
    assert forward_m == lateral_m == pytest.approx(PARAMETERS.unseen_speed_mps * unseen_s / 2)
    assert heading_rad == pytest.approx(min(PARAMETERS.unseen_turn_radps * unseen_s, np.pi / 2))
    assert np.delete(holed.step_sigma, across, axis=0)[1:].max() < 0.5
    behind = holed.t_s[across + 2]
    moves = [
        between(each.world_from_body[row], each.world_from_body[-1])
        for each, row in ((whole, np.argmin(abs(whole.t_s - behind))), (holed, across + 2))
    ]
    assert moves[1] == pytest.approx(moves[0], abs=0.25)


def test_the_way_across_lies_between_standing_and_walking_on():
    """Whoever walked straight on, and whoever stood, are within two sigmas of it."""
    imu = walk(40)
    whole, holed = (dead_reckon(each, PARAMETERS) for each in (imu, without(imu, (10.0, 13.0))))
    across = int(np.argmax(np.diff(holed.t_s)))
    rows = [int(np.argmin(abs(whole.t_s - t_s))) for t_s in holed.t_s[across : across + 2]]
    walked_on = between(*whole.world_from_body[rows])
    said = between(*holed.world_from_body[across : across + 2])
    for true in (walked_on, np.zeros(3)):
        assert (np.abs(true - said) <= 2 * holed.step_sigma[across]).all()


def test_a_turn_is_not_believed_beyond_a_quarter():
    imu = without(walk(200), (20.0, 90.0))
    nodes = dead_reckon(imu, PARAMETERS)
    assert nodes.step_sigma[:, 2].max() == pytest.approx(np.pi / 2)


def test_footsteps_are_found_on_both_sides_of_a_hole():
    imu = walk(40)
    whole, found = (find_footsteps(each, PARAMETERS) for each in (imu, without(imu, (10.0, 13.0))))
    clear = (whole < 9.0) | (whole > 14.0)
    nearest_s = np.min(np.abs(found[:, None] - whole[clear]), axis=0)
    assert nearest_s.max() < 0.05


def test_a_gyroscope_at_rest_before_a_hole_is_known_behind_it():
    """The bias would turn the walk behind the hole by 20 degrees."""
    biased = walk(40, bias_radps=(0.0, 0.0, 0.02))
    holed = dead_reckon(without(biased, (3.2, 4.2), (15.0, 16.0)), PARAMETERS)
    behind = holed.world_from_body[holed.t_s > 16.5]
    assert abs(wrap_angle(behind[-1, 2] - behind[0, 2])) < 0.05


def test_nothing_but_pieces_too_short_is_refused():
    imu = walk(40)
    holes = [(float(begin), begin + 0.6) for begin in np.arange(1.0, 30.0, 2.0)]
    with pytest.raises(InputError, match=r"no 2 s without an interruption of more than 0\.5 s"):
        dead_reckon(without(imu, *holes), PARAMETERS)


def test_a_hole_of_half_a_second_is_none():
    imu = walk(40)
    nodes = dead_reckon(without(imu, (10.0, 10.4)), PARAMETERS)
    assert nodes.step_sigma[1:].max() < 0.5


def test_a_slow_sensor_and_a_short_recording_are_refused():
    with pytest.raises(InputError, match="samples/s"):
        dead_reckon(walk(40, rate_hz=10.0), PARAMETERS)
    imu = walk(40)
    with pytest.raises(InputError, match="record longer"):
        dead_reckon(Imu(imu.t_s[:100], imu.accel_mps2[:100], imu.gyro_radps[:100]), PARAMETERS)
    with pytest.raises(InputError, match="record longer"):
        dead_reckon(Imu(imu.t_s[:0], imu.accel_mps2[:0], imu.gyro_radps[:0]), PARAMETERS)


def device_odometry(count=301):
    """A device that walks 0.1 m per sample along x, standing for 50 samples in the middle."""
    x_m = 0.1 * np.concatenate([np.arange(150), np.full(51, 150), np.arange(151, count - 50)])
    poses = np.column_stack([x_m, 0 * x_m, 0 * x_m])
    return Odometry(np.arange(len(x_m)) / 10.0, poses, np.full((len(x_m) - 1, 3), 0.01))


def test_nodes_lie_apart_by_the_spacing():
    nodes = nodes_by_distance(device_odometry(), 0.5)
    gaps_m = np.diff(nodes.world_from_body[:, 0])
    assert gaps_m == pytest.approx(0.5, abs=1e-9)
    assert nodes.t_s[0] == 0.0


def test_thinning_keeps_what_is_wrong_all_along():
    device = replace(device_odometry(), scale_sigma=0.05, heading_drift_sigma_radps=0.002)
    nodes = nodes_by_distance(device, 0.5)
    assert (nodes.scale_sigma, nodes.heading_drift_sigma_radps) == (0.05, 0.002)


def test_variances_of_the_moves_between_nodes_add_up():
    device = device_odometry()
    nodes = nodes_by_distance(device, 0.5)
    last = int(np.searchsorted(device.t_s, nodes.t_s[-1]))
    assert np.sum(nodes.step_sigma**2) == pytest.approx(3 * last * 0.01**2)


def test_a_device_that_stays_is_refused():
    with pytest.raises(InputError, match="never gets"):
        nodes_by_distance(device_odometry(), 100.0)
