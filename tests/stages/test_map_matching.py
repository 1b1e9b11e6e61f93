"""A walk through corridors: walls put right what dead reckoning bends."""

import dataclasses

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.geometry import chain, compose, wrap_angle
from elfslam.base.grid import FloorGrid, walked_grid
from elfslam.base.values import Odometry, Trajectory
from elfslam.stages import map_matching

CORNERS = np.array([[0, 0], [20, 0], [20, 12], [6, 12], [6, 20.0]])
PARAMETERS = map_matching.MapMatchingParameters(particles=1500)
SURE = np.diag([0.2, 0.2, 0.05]) ** 2
STEP_SIGMA = np.array([0.15, 0.1, 0.01])


def corridor(half_width_m: float = 0.6) -> FloorGrid:
    return walked_grid([CORNERS], half_width_m, 0.1)


def walked(bend_rad: float = 0.0, scale: float = 1.0) -> tuple[Odometry, F64]:
    """The corridor walked in steps of 0.7 m as reckoned with an error per step, and the truth."""
    moves = []
    for k, leg in enumerate(np.diff(CORNERS, axis=0)):
        count = round(float(np.hypot(*leg)) / 0.7)
        heading = np.arctan2(leg[1], leg[0])
        moves += [[np.hypot(*leg) / count, 0.0, 0.0]] * count
        if k + 2 < len(CORNERS):
            following = CORNERS[k + 2] - CORNERS[k + 1]
            moves[-1] = [moves[-1][0], 0.0, np.arctan2(following[1], following[0]) - heading]
    truth = chain(np.zeros(3), np.array(moves))
    reckoned = chain(np.zeros(3), np.array(moves) * [scale, 1, 1] + [0, 0, bend_rad])
    sigma = np.tile(STEP_SIGMA, (len(moves), 1))
    t_s = 0.5 * np.arange(len(truth))
    return Odometry(t_s, reckoned, sigma, heading_drift_sigma_radps=0.02), truth


def follow(
    nodes: Odometry, ground: FloorGrid, start: F64 | None = None, seed: int = 0
) -> map_matching.Followed:
    begin = np.zeros(3) if start is None else start
    generator = np.random.default_rng(seed)
    return map_matching.follow_ground(nodes, begin, SURE, ground, PARAMETERS, generator)


def error_m(poses: F64, truth: F64) -> float:
    return float(np.median(np.hypot(*(poses - truth)[:, :2].T)))


@pytest.mark.parametrize("bend_rad", [-0.01, 0.01])
def test_walls_straighten_a_walk_that_bends(bend_rad: float) -> None:
    nodes, truth = walked(bend_rad)
    found = follow(nodes, corridor())
    assert error_m(nodes.world_from_body, truth) > 1.5
    assert error_m(found.poses, truth) < 0.5
    assert found.off_share == 0


def test_its_sigmas_hold_the_truth() -> None:
    nodes, truth = walked(0.01)
    found = follow(nodes, corridor())
    sigma = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)[:, :2])
    assert np.mean(np.abs((found.poses - truth)[:, :2]) < 2 * sigma) > 0.9
    assert np.median(sigma) < 1.0


def test_open_ground_leaves_a_walk_as_it_was() -> None:
    drifting, truth = walked(0.004)
    nodes = dataclasses.replace(drifting, heading_drift_sigma_radps=0.0)
    everywhere = FloorGrid(np.ones((800, 800), dtype=bool), np.array([-40.0, -40.0]), 0.1)
    found = follow(nodes, everywhere)
    assert error_m(found.poses, nodes.world_from_body) < 0.3
    assert error_m(found.poses, truth) > 0.7 * error_m(nodes.world_from_body, truth)


def test_moving_the_world_moves_the_answer() -> None:
    moved = np.array([30.0, -7.0, 0.0])
    nodes, _ = walked(0.01)
    ground = corridor()
    there = dataclasses.replace(ground, corner_m=ground.corner_m + moved[:2])
    here = follow(nodes, ground)
    again = follow(nodes, there, moved)
    npt.assert_allclose(again.poses[:, :2], compose(moved, here.poses)[:, :2], atol=1e-6)
    npt.assert_allclose(wrap_angle(again.poses[:, 2] - here.poses[:, 2]), 0, atol=1e-6)


def test_a_walk_that_was_never_there_stays_off_the_ground() -> None:
    nodes, _ = walked()
    elsewhere = walked_grid([np.array([[0, 0], [0, 9.0]])], 0.6, 0.1)
    assert follow(nodes, elsewhere).off_share > 0.5
    nowhere = FloorGrid(np.zeros((5, 5), dtype=bool), np.zeros(2), 0.1)
    assert follow(nodes, nowhere).off_share == 1


def test_the_same_seed_gives_the_same_walk() -> None:
    nodes, _ = walked(0.01)
    npt.assert_array_equal(follow(nodes, corridor()).poses, follow(nodes, corridor()).poses)
    other = follow(nodes, corridor(), seed=1).poses
    assert not np.array_equal(other, follow(nodes, corridor()).poses)


def test_gaps_are_distances_to_the_ground_up_to_the_reach() -> None:
    ground = FloorGrid(np.ones((10, 10), dtype=bool), np.zeros(2), 0.1)
    gaps = map_matching.gaps_of(ground, 0.6)
    npt.assert_allclose(gaps.at(np.array([[0.5, 0.5], [1.35, 0.5], [9.0, 0.5]])), [0, 0.4, 0.6])


def test_a_trajectory_takes_its_poses_from_the_plan() -> None:
    nodes, _ = walked(0.01)
    found = follow(nodes, corridor())
    count = len(nodes.t_s)
    nothing = np.zeros((count, 3, 3))
    before = Trajectory(nodes.t_s, nodes.world_from_body, nothing, np.zeros(2), "NO_CLOSURES")
    after = map_matching.followed_trajectory(before, found)
    npt.assert_array_equal(after.world_from_body, found.poses)
    npt.assert_array_equal(after.covariance, found.covariance)
    assert after.status == "OK"
    npt.assert_array_equal(after.closure_weights, before.closure_weights)
