"""Footsteps while the walk goes on: those of the whole walk, each once, as soon as it is final."""

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.geometry import between
from elfslam.base.values import Imu
from elfslam.stages.motion import BEGINNING, MotionParameters, Steps, dead_reckon, go_on
from elfslam.stages.motion.live import final_footsteps, not_given, rest_kept

PARAMETERS = MotionParameters()
RATE_HZ, CADENCE_HZ = 60.0, 1.8


def walk(
    duration_s: float,
    *,
    rest_s: tuple[float, float] = (0.0, 3.0),
    turn_s: float = np.inf,
    turn_rad: float = np.pi / 2,
    bias_radps: float = 0.0,
) -> Imu:
    """A phone in the hand of someone who walks straight but for one turn, and rests at times."""
    t_s = np.arange(0.0, duration_s, 1 / RATE_HZ)
    moving = (t_s > 3.0) & ~((t_s > rest_s[0]) & (t_s < rest_s[1]))
    bounce = 3.0 * moving * np.sin(2 * np.pi * CADENCE_HZ * t_s)
    sway = 0.3 * moving * np.cos(np.pi * CADENCE_HZ * t_s)
    turning = np.abs(t_s - turn_s - 0.5) < 0.5
    yaw_radps = bias_radps + turn_rad * turning + sway
    noise = np.random.default_rng(0).normal(0, 0.03, (len(t_s), 3))
    accel = np.round(np.column_stack([sway, 0 * t_s, 9.81 + bounce]) + noise, 1)
    return Imu(t_s, accel, np.column_stack([0 * t_s, 0 * t_s, yaw_radps]))


def part(imu: Imu, rows: slice) -> Imu:
    return Imu(imu.t_s[rows], imu.accel_mps2[rows], imu.gyro_radps[rows])


def live(imu: Imu, every: int = 30, parameters: MotionParameters = PARAMETERS) -> list[Steps]:
    """The steps as they come, with readings in lots of `every`."""
    going, told = BEGINNING, []
    for first in range(0, len(imu.t_s), every):
        going, steps = go_on(going, part(imu, slice(first, first + every)), parameters)
        told.append(steps)
    return told


def joined(told: list[Steps]) -> Steps:
    columns = ("t_s", "from_s", "moves", "sigma")
    return Steps(*(np.concatenate([getattr(each, name) for each in told]) for name in columns))


def test_live_steps_are_those_of_the_whole_walk() -> None:
    imu = walk(30.0, turn_s=15.0)
    nodes = dead_reckon(imu, PARAMETERS)
    steps = joined(live(imu))
    known = steps.from_s > nodes.t_s[0] - 0.1  # the very first may be found live alone
    assert known.sum() >= max(len(known) - 1, len(nodes.t_s) - 3) > 40
    begun = np.searchsorted(nodes.t_s, steps.from_s[known][0] - 0.1)
    same = slice(begun, begun + known.sum())
    moves = between(nodes.world_from_body[:-1], nodes.world_from_body[1:])[same]
    npt.assert_allclose(steps.t_s[known], nodes.t_s[1:][same], atol=0.02)
    npt.assert_allclose(steps.from_s[known], nodes.t_s[:-1][same], atol=0.02)
    npt.assert_allclose(steps.moves[known, :2], moves[:, :2], atol=0.04)
    npt.assert_allclose(steps.moves[known, 2], moves[:, 2], atol=0.02)
    npt.assert_allclose(steps.sigma[known, :2], nodes.step_sigma[same, :2], atol=0.02)
    turned_rad = moves[:, 2].sum()
    assert steps.moves[known, 2].sum() == pytest.approx(turned_rad, abs=0.03)
    assert turned_rad == pytest.approx(np.pi / 2, abs=0.2)


@pytest.mark.parametrize("every", [24, 120])
def test_footsteps_come_once_in_order_and_not_before_they_are_final(every: int) -> None:
    imu = walk(25.0)
    told = live(imu, every)
    for lot, steps in enumerate(told):
        newest_s = imu.t_s[min((lot + 1) * every, len(imu.t_s)) - 1]
        assert np.all(steps.t_s <= newest_s - PARAMETERS.live_delay_s + 1e-9)
    steps = joined(told)
    assert np.all(np.diff(steps.t_s) > PARAMETERS.least_interval_s)
    npt.assert_array_equal(steps.from_s[1:], steps.t_s[:-1])
    assert abs(len(steps.t_s) - len(dead_reckon(imu, PARAMETERS).t_s)) <= 2 + every // 60


def test_a_turn_in_a_pause_longer_than_the_window_is_remembered() -> None:
    pause_s = (14.0, 20.0 + 2 * PARAMETERS.live_window_s)
    imu = walk(pause_s[1] + 10.0, rest_s=pause_s, turn_s=17.0)
    steps = joined(live(imu))
    after = steps.t_s > pause_s[1]
    assert after.sum() > 10
    nodes = dead_reckon(imu, PARAMETERS)
    begun, ended = (np.argmin(abs(nodes.t_s - t_s)) for t_s in (steps.from_s[0], steps.t_s[-1]))
    turned_rad = nodes.world_from_body[ended, 2] - nodes.world_from_body[begun, 2]
    assert turned_rad == pytest.approx(np.pi / 2, abs=0.2)
    assert steps.moves[:, 2].sum() == pytest.approx(turned_rad, abs=0.1)
    crossing = np.argmax(after)
    assert np.hypot(*steps.moves[crossing, :2]) == pytest.approx(PARAMETERS.pause_length_m)
    assert abs(steps.moves[crossing, 2]) == pytest.approx(np.pi / 2, abs=0.1)


@pytest.mark.parametrize("every", [24, 60])
def test_the_gyroscope_at_rest_is_remembered_when_the_rest_has_left_the_window(every: int) -> None:
    steps = joined(live(walk(40.0, bias_radps=0.02), every))
    assert steps.t_s[-1] - steps.t_s[0] > 30
    assert abs(steps.moves[:, 2].sum()) < 0.06


@pytest.mark.parametrize("gap_s", [8.0, 20.0])
def test_after_a_gap_the_walk_begins_anew_with_the_same_gyroscope(gap_s: float) -> None:
    imu = walk(30.0, bias_radps=0.02)
    behind = imu.t_s > gap_s
    broken = Imu(imu.t_s + 1.0 * behind, imu.accel_mps2, imu.gyro_radps)
    steps = joined(live(broken))
    across = (steps.from_s < gap_s) & (steps.t_s > gap_s)
    assert not across.any()
    later = steps.from_s > gap_s
    assert later.sum() > 10
    assert abs(steps.moves[later, 2].sum()) < 0.05
    first = np.argmax(later)
    assert steps.sigma[first, 2] > steps.sigma[first + 1, 2]


def test_too_few_or_too_slow_readings_give_no_steps() -> None:
    imu = walk(20.0)
    assert len(joined(live(part(imu, slice(0, 100)))).t_s) == 0
    assert len(joined(live(part(imu, slice(0, None, 4)))).t_s) == 0


def test_a_footstep_near_the_last_given_is_that_one() -> None:
    found_s = np.array([9.5, 10.01, 10.1, 10.16, 10.5])
    npt.assert_array_equal(not_given(found_s, np.array([9.4, 10.0]), PARAMETERS), [10.16, 10.5])
    npt.assert_array_equal(not_given(found_s, np.zeros(0), PARAMETERS), found_s)


def test_a_footstep_is_final_when_the_walk_has_gone_on() -> None:
    delay_s = PARAMETERS.live_delay_s
    found_s = np.array([1.0, 2.0, 2.001])
    npt.assert_array_equal(final_footsteps(found_s, 2.0 + delay_s + 1e-9, PARAMETERS), [1.0, 2.0])


@pytest.mark.parametrize(
    ("cut", "kept"), [(0, 0), (3, 3), (12, 12), (16, 16), (25, 20), (29, 20), (30, 30)]
)
def test_a_rest_is_not_cut_to_pieces(cut: int, kept: int) -> None:
    still = (np.arange(40) >= 10) & (np.arange(40) < 30)
    assert rest_kept(still, cut, 10) == kept


def test_a_rest_that_lasts_is_cut() -> None:
    assert rest_kept(np.ones(40, bool), 35, 10) == 30
    assert rest_kept(np.ones(40, bool), 15, 10) == 15
    assert rest_kept(np.ones(8, bool), 5, 10) == 0
