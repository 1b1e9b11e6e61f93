"""The walker: a gait that agrees with itself, and rests at both ends."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from elfslam.base.arrays import F64
from elfslam.world import walker as walkers
from elfslam.world.walker import KINEMATICS_RATE_HZ, TYPICAL_STEP_M, Motion, cadence_hz, walk

ROUTE_M = np.array([[1.0, 1.0], [7.0, 1.0], [7.0, 5.0], [1.0, 5.0]])
"""Counter-clockwise, 20 m without its rounded corners."""
SHARE = ndtr(np.linspace(-8, 8, 2001))
LAP_M = 20.0 - 4 * walkers.CORNER_RADIUS_M * np.trapezoid(1 - np.hypot(SHARE, 1 - SHARE), dx=0.008)
"""Length once a Gaussian has rounded the corners: it mixes the two directions of each."""
SEEDS = range(2)


def walker_of(seed: int = 0) -> walkers.Walker:
    return walkers.random_walker(np.random.default_rng(seed))


def motion_of(seed: int = 0, *, rounds: int = 2, route_m: F64 = ROUTE_M) -> Motion:
    return walk(walker_of(seed), route_m, rounds, np.random.default_rng([seed, 7]))


def straight_walker() -> walkers.Walker:
    """Someone who follows the route to the centimetre."""
    return replace(walker_of(), wander_m=0.0, sway_m=0.0)


def resting(motion: Motion) -> F64:
    return (motion.t_s < 1.5) | (motion.t_s > motion.t_s[-1] - 1.0)


def has_full_window(motion: Motion) -> F64:
    return (motion.t_s > 4.5) & (motion.t_s < motion.t_s[-1] - 4.5)


def rate(values: F64) -> F64:
    return np.gradient(values, 1 / KINEMATICS_RATE_HZ, axis=0)


def ground_speed(motion: Motion) -> F64:
    return np.linalg.norm(rate(motion.position_m[:, :2]), axis=1)


@pytest.mark.parametrize("seed", SEEDS)
def test_random_walkers_are_people(seed: int) -> None:
    walker = walker_of(seed)
    assert 1.0 <= walker.speed_mps <= 1.4
    assert 0.9 <= walker.step_factor <= 1.1
    assert 1.1 <= walker.height_m <= 1.35
    assert walker != walker_of(seed + 100)


def test_a_typical_walker_takes_typical_steps() -> None:
    typical = replace(walker_of(), step_factor=1.0)
    cadence = cadence_hz(typical, np.array([walkers.TYPICAL_SPEED_MPS]))[0]
    assert cadence == pytest.approx(walkers.TYPICAL_CADENCE_HZ)
    assert walkers.TYPICAL_SPEED_MPS / cadence == pytest.approx(TYPICAL_STEP_M)


@pytest.mark.parametrize("step_factor", [0.9, 1.0, 1.1])
def test_at_one_cadence_the_step_factor_scales_the_step(step_factor: float) -> None:
    """What the line cannot know: it sees the cadence, and the same cadence hides another step."""
    speed_mps = np.linspace(0.3, 2.0, 200)
    typical, someone = (replace(walker_of(), step_factor=f) for f in (1.0, step_factor))
    cadence = cadence_hz(typical, speed_mps)
    same_cadence_mps = np.interp(cadence, cadence_hz(someone, speed_mps), speed_mps)
    inside = slice(20, -40)
    ratio = same_cadence_mps[inside] / speed_mps[inside]
    np.testing.assert_allclose(ratio, step_factor, rtol=1e-3)


def test_nobody_steps_backwards() -> None:
    assert cadence_hz(walker_of(), np.array([-0.1, 0.0])).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("seed", SEEDS)
def test_steps_times_their_length_are_the_distance_walked(seed: int) -> None:
    walker, motion = walker_of(seed), motion_of(seed)
    cadence = rate(motion.steps)
    step_m = walker.step_factor * TYPICAL_STEP_M * cadence / walkers.TYPICAL_CADENCE_HZ
    assert np.sum(step_m * cadence) / KINEMATICS_RATE_HZ == pytest.approx(2 * LAP_M, rel=2e-3)


def test_no_step_is_shorter_in_a_turn() -> None:
    """Step by step: the way gone is the length that belongs to the step's own cadence."""
    walker = straight_walker()
    motion = walk(walker, ROUTE_M, 2, np.random.default_rng(0))
    way_m = np.concatenate([[0], np.cumsum(ground_speed(motion))]) / KINEMATICS_RATE_HZ
    footfalls = np.searchsorted(motion.steps, np.arange(4, int(motion.steps[-1]) - 3))
    step_s = np.diff(motion.t_s[footfalls])
    expected_m = walker.step_factor * TYPICAL_STEP_M / (walkers.TYPICAL_CADENCE_HZ * step_s)
    np.testing.assert_allclose(np.diff(way_m[footfalls]), expected_m, rtol=0.03)


@pytest.mark.parametrize("seed", SEEDS)
def test_speed_and_cadence_are_those_of_the_walker(seed: int) -> None:
    walker, motion = walker_of(seed), motion_of(seed)
    walking = has_full_window(motion)
    assert ground_speed(motion)[walking].mean() == pytest.approx(walker.speed_mps, rel=0.12)
    expected = cadence_hz(walker, np.array([walker.speed_mps]))[0]
    assert rate(motion.steps)[walking].mean() == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_walk_rests_at_both_ends(seed: int) -> None:
    motion = motion_of(seed)
    still, walking = resting(motion), has_full_window(motion)
    assert rate(motion.steps)[still].max() < 0.01 < rate(motion.steps)[walking].min()
    assert ground_speed(motion)[still].max() < 0.15 < ground_speed(motion)[walking].min()
    assert np.abs(rate(rate(motion.position_m))[still]).max() < 0.2


@pytest.mark.parametrize("seed", SEEDS)
def test_the_bounce_is_human(seed: int) -> None:
    """Vertical acceleration of 1.5 to 5 m/s2 rms while walking."""
    motion = motion_of(seed)
    assert 1.5 < rate(rate(motion.position_m[:, 2]))[has_full_window(motion)].std() < 5.0


@pytest.mark.parametrize("seed", SEEDS)
def test_angles_run_on_without_jumps(seed: int) -> None:
    motion = motion_of(seed)
    for angle in (motion.heading_rad, motion.yaw_rad, motion.pitch_rad, motion.roll_rad):
        assert np.abs(np.diff(angle)).max() < 0.02
    assert np.abs(np.diff(motion.position_m, axis=0)).max() < 0.02


@pytest.mark.parametrize(("turn", "route_m"), [(1, ROUTE_M), (-1, ROUTE_M[::-1])])
def test_every_lap_turns_once(turn: int, route_m: F64) -> None:
    motion = motion_of(rounds=3, route_m=route_m)
    turned = (motion.heading_rad[-1] - motion.heading_rad[0]) / (2 * np.pi)
    assert turned == pytest.approx(3 * turn, abs=0.03)


def test_laps_close() -> None:
    motion = walk(straight_walker(), ROUTE_M, 2, np.random.default_rng(0))
    start, end = motion.position_m[0, :2], motion.position_m[-1, :2]
    assert np.linalg.norm(end - start) < 0.02
    half = np.searchsorted(motion.heading_rad, motion.heading_rad[0] + 2 * np.pi)
    assert np.linalg.norm(motion.position_m[half, :2] - start) < 0.1


def test_the_heading_is_the_way_the_body_goes() -> None:
    motion = walk(straight_walker(), ROUTE_M, 1, np.random.default_rng(0))
    velocity = rate(motion.position_m[:, :2])[has_full_window(motion)]
    heading = motion.heading_rad[has_full_window(motion)]
    ahead = velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading)
    aside = velocity[:, 1] * np.cos(heading) - velocity[:, 0] * np.sin(heading)
    assert ahead.min() > 0.4
    assert np.abs(aside).max() < 0.05


def test_the_walk_keeps_to_the_route() -> None:
    motion = walk(straight_walker(), ROUTE_M, 1, np.random.default_rng(0))
    xy = motion.position_m[:, :2]
    beside = np.min(np.abs(np.stack([xy[:, 0] - 1, xy[:, 0] - 7, xy[:, 1] - 1, xy[:, 1] - 5])), 0)
    assert beside.max() < 0.3  # rounded corners cut across by no more
    assert np.median(beside) < 0.02
    assert np.linalg.norm(np.diff(xy, axis=0), axis=1).sum() == pytest.approx(LAP_M, rel=5e-3)


def test_the_phone_is_held_as_the_walker_holds_it() -> None:
    walker, motion = walker_of(3), motion_of(3)
    assert motion.position_m[:, 2].mean() == pytest.approx(walker.height_m, abs=0.03)
    assert motion.pitch_rad.mean() == pytest.approx(walker.pitch_rad, abs=0.05)
    assert np.abs(motion.roll_rad).max() < 0.15
    aside = motion.yaw_rad - motion.heading_rad
    assert 0.01 < aside.std() < 0.12
    assert np.abs(aside).max() < 0.3


def test_standing_longer_makes_the_walk_longer() -> None:
    draws = ((np.random.default_rng(0), s) for s in (1.0, 6.0))
    short, long = (walk(walker_of(), ROUTE_M, 1, draw, standing_s=s) for draw, s in draws)
    still = rate(long.steps) < 1e-3
    assert long.t_s[-1] - short.t_s[-1] == pytest.approx(10.0, abs=2.0)
    assert still[: int(5 * KINEMATICS_RATE_HZ)].all()
    assert still[-int(5 * KINEMATICS_RATE_HZ) :].all()
