"""The compass on planted walks: north, the phone's own field and the building's are known."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import Imu, Magnetometer
from elfslam.stages.motion import (
    HardIron,
    MotionParameters,
    compass_heading,
    dead_reckon,
    half_turned,
    missed_half_turn,
)
from elfslam.stages.motion.level import level
from elfslam.stages.motion.reckoning import smooth_heading
from tests.stages.magnetic_walk import walk

PARAMETERS = MotionParameters()


def degrees_off(found_rad, true_rad):
    return abs(float(np.degrees(wrap_angle(found_rad - true_rad))))


@pytest.mark.parametrize("start_deg", [-170.0, -60.0, 0.0, 90.0])
@pytest.mark.parametrize("pitch_deg", [0.0, 30.0, 60.0])
def test_the_planted_heading_is_found(start_deg, pitch_deg):
    compass = compass_heading(*walk(np.radians(start_deg), pitch_deg=pitch_deg), PARAMETERS)
    assert degrees_off(compass.heading_rad, np.radians(start_deg)) < 1


def test_roll_changes_nothing():
    compass = compass_heading(*walk(1.0, roll_deg=25.0), PARAMETERS)
    assert degrees_off(compass.heading_rad, 1.0) < 1


def test_it_starts_dead_reckoning_in_the_plane_of_north():
    imu, magnetometer = walk(2.0)
    compass = compass_heading(imu, magnetometer, PARAMETERS)
    poses = dead_reckon(imu, PARAMETERS, (0.0, 0.0, compass.heading_rad)).world_from_body
    assert degrees_off(np.arctan2(poses[-1, 1], poses[-1, 0]), 2.0) < 1


def test_a_turn_before_the_first_footstep_counts():
    imu, magnetometer = walk(1.0, turns=[(0.0, -0.5)])
    found = compass_heading(imu, magnetometer, PARAMETERS).heading_rad
    first_s, levelled = dead_reckon(imu, PARAMETERS).t_s[0], level(imu, PARAMETERS)
    turned = np.interp(first_s, levelled.t_s, smooth_heading(levelled, PARAMETERS))
    assert turned < -0.2
    assert degrees_off(found, 1.0 + turned) < 2


def test_a_walk_that_turns_tells_the_phones_own_field():
    around = [(13.0, np.pi / 2), (26.0, np.pi / 2)]
    imu, magnetometer = walk(0.5, turns=around, iron_ut=(-11.0, 12.0))
    compass = compass_heading(imu, magnetometer, PARAMETERS)
    assert compass.hard_iron.forward_left_ut == pytest.approx([-11.0, 12.0], abs=1.5)
    assert degrees_off(compass.heading_rad, 0.5) < 2
    deaf = replace(PARAMETERS, hard_iron_sigma_ut=0.01)
    assert degrees_off(compass_heading(imu, magnetometer, deaf).heading_rad, 0.5) > 3.5


def test_a_straight_walk_takes_it_from_the_walk_before():
    imu, magnetometer = walk(0.5, iron_ut=(-11.0, 12.0))
    known = HardIron(np.array([-11.0, 12.0]), 1.0)
    alone, taught = (compass_heading(imu, magnetometer, PARAMETERS, by) for by in (None, known))
    assert degrees_off(alone.heading_rad, 0.5) > 10
    assert degrees_off(taught.heading_rad, 0.5) < 2
    assert taught.sigma_rad < alone.sigma_rad
    wanted_ut = np.hypot(1.0, PARAMETERS.hard_iron_drift_ut)
    assert taught.hard_iron.sigma_ut == pytest.approx(wanted_ut, rel=0.05)


def test_what_was_known_gives_way_where_the_walk_says_otherwise():
    turns = [(6.0 * k, np.pi / 2) for k in range(1, 6)]
    imu, magnetometer = walk(0.5, turns=turns, iron_ut=(2.0, 2.0))
    stale = HardIron(np.array([-11.0, 12.0]), 1.0)
    found = compass_heading(imu, magnetometer, PARAMETERS, stale).hard_iron.forward_left_ut
    assert found == pytest.approx([2.0, 2.0], abs=2.5)


def test_the_sigma_covers_what_a_building_bends():
    for seed_rad in np.linspace(-3.0, 3.0, 7):
        compass = compass_heading(*walk(seed_rad, bend_ut=6.0), PARAMETERS)
        assert abs(wrap_angle(compass.heading_rad - seed_rad)) < 2 * compass.sigma_rad
        assert 0.02 < compass.sigma_rad < 0.2


def test_no_walk_and_no_field_are_refused():
    imu, magnetometer = walk(0.0)
    still = Imu(imu.t_s, np.tile([0.0, 0.0, 9.81], (len(imu.t_s), 1)), 0 * imu.gyro_radps)
    with pytest.raises(InputError, match="wanted a walk"):
        compass_heading(still, magnetometer, PARAMETERS)
    with pytest.raises(InputError, match="no horizontal part"):
        compass_heading(imu, Magnetometer(imu.t_s, 0 * magnetometer.field_ut), PARAMETERS)


CORNERS = [(6.0, np.pi / 2), (30.0, -np.pi / 2)]
FIELDS = {"iron_ut": (-11.0, 12.0), "bend_ut": 4.0}


def without_the_turn(after_s):
    """A walk back, half a turn at that time, and what a gyroscope tells that missed it."""
    imu, magnetometer = walk(0.5, turns=[*CORNERS, (after_s, np.pi)], **FIELDS)
    missed = (imu.t_s >= after_s - 0.02) & (imu.t_s <= after_s + 1.02)
    gyro_radps = np.where(missed[:, None], 0.0, imu.gyro_radps)
    return imu, replace(imu, gyro_radps=gyro_radps), magnetometer


@pytest.mark.parametrize("after_s", [12.0, 20.0, 26.0])
def test_a_missed_half_turn_is_told_and_put_in(after_s):
    imu, missed, magnetometer = without_the_turn(after_s)
    at_s = missed_half_turn(missed, magnetometer, PARAMETERS)
    assert at_s == pytest.approx(after_s + 0.5, abs=1.2)
    back = dead_reckon(half_turned(missed, at_s), PARAMETERS).world_from_body
    true = dead_reckon(imu, PARAMETERS).world_from_body
    assert np.linalg.norm(back[-1, :2] - true[-1, :2]) < 2.5
    assert degrees_off(back[-1, 2], true[-1, 2]) < 5
    assert missed_half_turn(half_turned(missed, at_s), magnetometer, PARAMETERS) is None


@pytest.mark.parametrize("turns", [[], CORNERS, [(20.0, np.pi)], [(12.0, np.pi), (24.0, -np.pi)]])
@pytest.mark.parametrize("iron_ut", [(0.0, 0.0), (-11.0, 12.0), (40.0, 20.0)])
def test_no_half_turn_is_told_of_a_walk_as_it_was(turns, iron_ut):
    told = missed_half_turn(*walk(0.5, turns=turns, iron_ut=iron_ut, bend_ut=4.0), PARAMETERS)
    assert told is None


def test_a_field_that_disagrees_with_itself_tells_nothing():
    _, missed, magnetometer = without_the_turn(20.0)
    spin = np.exp(1j * magnetometer.t_s)
    level_ut = 30.0 * np.column_stack([spin.real, spin.imag, 0 * spin.real])
    noisy = replace(magnetometer, field_ut=magnetometer.field_ut + level_ut)
    assert missed_half_turn(missed, noisy, PARAMETERS) is None
