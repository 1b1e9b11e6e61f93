"""Motion sensors: gravity, turns, and the errors that the data sheet promises."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.stages.motion import MotionParameters, find_footsteps
from elfslam.world import imu as sensing
from elfslam.world.device import BMI160, BROWSER, LSM6DSO, ImuGrade
from elfslam.world.imu import BIAS_CORRELATION_S, GRAVITY_MPS2, GYRO_SCALE_ERROR, attitude, read_imu
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion, random_walker, walk

PERFECT = ImuGrade("perfect", 100.0, 0.0, 0.0, 0.0, 0.0)
ROUTE_M = np.array([[1.0, 1.0], [7.0, 1.0], [7.0, 5.0], [1.0, 5.0]])


def standing(
    duration_s: float, *, yaw: float = 0.7, pitch: float = 0.4, roll: float = 0.2
) -> Motion:
    count = round(duration_s * KINEMATICS_RATE_HZ)
    same = np.ones(count)
    return Motion(
        t_s=np.arange(count) / KINEMATICS_RATE_HZ,
        position_m=np.tile([1.0, 2.0, 1.2], (count, 1)),
        yaw_rad=yaw * same,
        pitch_rad=pitch * same,
        roll_rad=roll * same,
        heading_rad=yaw * same,
        steps=0 * same,
    )


def walking(seed: int = 0, rounds: int = 1) -> Motion:
    generator = np.random.default_rng(seed)
    return walk(random_walker(generator), ROUTE_M, rounds, generator)


def generator_of(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def up_in_phone(motion: Motion, rate_hz: float) -> F64:
    step = round(KINEMATICS_RATE_HZ / rate_hz)
    return attitude(motion).inv().apply([0.0, 0.0, 1.0])[:-1:step]


def test_standing_still_reads_gravity_tilted_by_the_pitch() -> None:
    pitch, roll = 0.4, 0.2
    imu = read_imu(standing(1.0, pitch=pitch, roll=roll), PERFECT, generator_of())
    felt = -np.cos(pitch) * np.sin(roll), np.sin(pitch), np.cos(pitch) * np.cos(roll)
    expected = GRAVITY_MPS2 * np.array(felt)
    np.testing.assert_allclose(imu.accel_mps2, np.tile(expected, (len(imu.t_s), 1)), atol=1e-9)
    np.testing.assert_allclose(imu.gyro_radps, 0.0, atol=1e-9)


def test_the_screen_points_where_the_phone_does() -> None:
    turn = attitude(standing(0.1, yaw=0.7, pitch=0.4, roll=0.0))[0]
    ahead = [np.cos(0.4) * np.cos(0.7), np.cos(0.4) * np.sin(0.7), np.sin(0.4)]
    np.testing.assert_allclose(turn.apply([0, 1, 0]), ahead, atol=1e-12)
    np.testing.assert_allclose(turn.apply([1, 0, 0]), [np.sin(0.7), -np.cos(0.7), 0], atol=1e-12)


def test_a_walk_reads_gravity_on_average() -> None:
    motion = walking(rounds=2)
    imu = read_imu(motion, PERFECT, generator_of())
    vertical = np.sum(imu.accel_mps2 * up_in_phone(motion, PERFECT.rate_hz), axis=1)
    assert vertical.mean() == pytest.approx(GRAVITY_MPS2, abs=0.02)
    assert 1.0 < vertical.std() < 5.0


@pytest.mark.parametrize("seed", range(2))
def test_yaw_rate_integrates_to_the_turn(seed: int) -> None:
    """To 2 % of the turn, plus what the bias adds up to."""
    motion = walking(seed, rounds=2)
    imu = read_imu(motion, BMI160, generator_of(seed))
    yaw_radps = np.sum(imu.gyro_radps * up_in_phone(motion, BMI160.rate_hz), axis=1)
    turned = motion.yaw_rad[-1] - motion.yaw_rad[0]
    bias = 3 * BMI160.gyro_bias_radps * motion.t_s[-1]
    scale = 3 * GYRO_SCALE_ERROR * abs(turned)
    assert yaw_radps.sum() / BMI160.rate_hz == pytest.approx(turned, abs=bias + scale)
    perfect = read_imu(motion, PERFECT, generator_of(seed))
    yaw_radps = np.sum(perfect.gyro_radps * up_in_phone(motion, 100.0), axis=1)
    assert yaw_radps.sum() / 100.0 == pytest.approx(turned, rel=0.02)


def test_the_scale_error_is_within_the_data_sheet() -> None:
    motion = walking()
    rates = [read_imu(motion, PERFECT, generator_of(seed)).gyro_radps for seed in range(40)]
    scale = np.array([np.sum(r * rates[0]) / np.sum(rates[0] ** 2) for r in rates])
    assert np.ptp(scale) > 0
    assert np.abs(scale / scale.mean() - 1).max() < 0.04
    assert scale.std() == pytest.approx(GYRO_SCALE_ERROR, rel=0.4)


def test_noise_has_the_level_of_the_data_sheet() -> None:
    """White noise of density d sampled at rate r has a standard deviation of d sqrt(r / 2)."""
    imu = read_imu(standing(100.0), BMI160, generator_of())
    half_band = np.sqrt(BMI160.rate_hz / 2)
    accel, gyro = imu.accel_mps2.std(axis=0), imu.gyro_radps.std(axis=0)
    np.testing.assert_allclose(accel, BMI160.accel_noise_mps2_rthz * half_band, rtol=0.05)
    np.testing.assert_allclose(gyro, BMI160.gyro_noise_radps_rthz * half_band, rtol=0.05)


def test_every_phone_has_its_own_bias() -> None:
    truth = read_imu(standing(2.0), PERFECT, generator_of())
    readings = [read_imu(standing(2.0), BMI160, generator_of(seed)) for seed in range(60)]
    accel = np.array([(r.accel_mps2 - truth.accel_mps2).mean(axis=0) for r in readings])
    gyro = np.array([r.gyro_radps.mean(axis=0) for r in readings])
    assert len(np.unique(accel)) == accel.size
    # 180 draws fix a standard deviation to about 5 %.
    assert accel.std() == pytest.approx(BMI160.accel_bias_mps2, rel=0.2)
    assert gyro.std() == pytest.approx(BMI160.gyro_bias_radps, rel=0.2)


@pytest.mark.parametrize("rate_hz", [60.0, 104.0, 200.0])
def test_the_clock_runs_at_the_rate_of_the_grade(rate_hz: float) -> None:
    motion = walking()
    imu = read_imu(motion, replace(BMI160, rate_hz=rate_hz), generator_of())
    np.testing.assert_allclose(np.diff(imu.t_s), 1 / rate_hz, atol=1e-9)
    assert imu.t_s[0] == 0.0
    assert imu.t_s[-1] == pytest.approx(motion.t_s[-1], abs=1.5 / rate_hz)


def test_a_rate_that_divides_nothing_reads_between() -> None:
    """60 Hz does not divide 400 Hz: samples lie on the straight line between its neighbours."""
    motion = walking()
    fast = read_imu(motion, replace(PERFECT, rate_hz=400.0), generator_of())
    odd = read_imu(motion, replace(PERFECT, rate_hz=60.0), generator_of())
    for name in ("accel_mps2", "gyro_radps"):
        columns = [np.interp(odd.t_s, fast.t_s, axis) for axis in getattr(fast, name).T]
        np.testing.assert_allclose(getattr(odd, name), np.column_stack(columns), atol=1e-9)


def test_a_browser_gives_60_hz_in_tenths() -> None:
    imu = read_imu(walking(), BROWSER, generator_of())
    assert 1 / np.diff(imu.t_s).mean() == pytest.approx(60.0)
    for values in (imu.accel_mps2, np.rad2deg(imu.gyro_radps)):
        np.testing.assert_allclose(values * 10, np.round(values * 10), atol=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_steps_are_found_in_what_a_browser_gives(seed: int) -> None:
    motion = walking(seed, rounds=2)
    found = find_footsteps(read_imu(motion, BROWSER, generator_of(seed)), MotionParameters())
    assert len(found) == pytest.approx(motion.steps[-1], abs=3)


def allan_deviation(rates: F64, size: int) -> float:
    means = rates[: len(rates) // size * size].reshape(-1, size, rates.shape[1]).mean(axis=1)
    return float(np.sqrt((np.diff(means, axis=0) ** 2).mean() / 2))


def test_the_bias_wanders_as_far_as_its_instability() -> None:
    """The Allan deviation peaks there, at 1.89 correlation times."""
    bias = sensing.gauss_markov(generator_of(), (400_000, 3), BIAS_CORRELATION_S, 1.0)
    assert bias.std() == pytest.approx(1.0, rel=0.05)
    sizes = [round(share * BIAS_CORRELATION_S) for share in (0.3, 1.89, 12.0)]
    short, peak, long = (allan_deviation(bias / sensing.ALLAN_PEAK, size) for size in sizes)
    assert peak == pytest.approx(1.0, rel=0.06)
    assert short < 0.8
    assert long < 0.8


def test_only_grades_with_instability_wander() -> None:
    motion = standing(2.0)
    steady = replace(LSM6DSO, gyro_bias_instability_radps=0.0)
    wandering, plain = (read_imu(motion, grade, generator_of()) for grade in (LSM6DSO, steady))
    difference = wandering.gyro_radps - plain.gyro_radps
    assert wandering.accel_mps2.tobytes() == plain.accel_mps2.tobytes()
    assert 0 < np.abs(difference).max() < 10 * LSM6DSO.gyro_bias_instability_radps
