"""A walk straightened in the frame of its start, and in that of a plan that was tapped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.geometry import between, compose, shifted
from elfslam.base.values import NO_CLOSURES, Checkpoints, Closures, Odometry, Trajectory
from elfslam.slam.optimisation import optimise_walk
from elfslam.slam.parameters import Parameters
from elfslam.stages.checkpoints import CheckpointParameters, lies_on_plan, on_plan

PARAMETERS = Parameters()
LAP, STEP_M = 40, 0.7
PLAN_FROM_WALK = np.array([31.0, -12.0, 2.1])
NOBODY = np.zeros(0, dtype=bool)
FAR_M = np.array([[1e3, 1e3], [5e5, 5e6]])


def square(bent_rad: float = 0.0) -> Odometry:
    """A lap round a square of 7 m by a gyroscope that reads too much, in half seconds."""
    turn = np.where(np.arange(LAP) % 10 == 9, np.pi / 2, 0.0) + bent_rad
    poses = [np.zeros(3)]
    for each in turn:
        poses.append(compose(poses[-1], np.array([STEP_M, 0.0, each])))
    sigma = np.tile(np.array([0.1, 0.05, 0.03]), (LAP, 1))
    return Odometry(np.arange(LAP + 1) / 2, np.array(poses), sigma)


TRUE = compose(PLAN_FROM_WALK, square().world_from_body)


def tapped(footsteps: list[int], off_m: F64 | None = None) -> Checkpoints:
    """Taps on the plan at some footsteps, and a place that was named only."""
    xy_m = TRUE[footsteps, :2] + (0.0 if off_m is None else off_m)
    names = (*(f"place {k}" for k in footsteps), "somewhere")
    t_s = np.array([*(k / 2 for k in footsteps), LAP / 2 + 0.25])
    return Checkpoints(t_s, names, np.vstack([xy_m, [np.nan, np.nan]]))


def straightened(nodes: Odometry, told: Checkpoints | None) -> Trajectory:
    return optimise_walk(nodes, NO_CLOSURES, NOBODY, told, PARAMETERS)[1]


def test_two_taps_give_the_walk_the_frame_of_the_plan() -> None:
    made = straightened(square(), tapped([3, 18]))
    np.testing.assert_allclose(made.world_from_body[:, :2], TRUE[:, :2], atol=0.02)
    np.testing.assert_allclose(np.cos(made.world_from_body[:, 2] - TRUE[:, 2]), 1, atol=1e-3)
    assert made.closure_weights.shape == (0,)
    assert len(made.t_s) == LAP + 1


def test_dead_reckoning_comes_along() -> None:
    bent = square(bent_rad=0.01)
    reckoned, made = optimise_walk(bent, NO_CLOSURES, NOBODY, tapped([0, 18]), PARAMETERS)
    moves = between(reckoned.world_from_body[:-1], reckoned.world_from_body[1:])
    expected = between(bent.world_from_body[:-1], bent.world_from_body[1:])
    np.testing.assert_allclose(moves, expected, atol=1e-9)
    np.testing.assert_allclose(
        reckoned.world_from_body[0, :2], made.world_from_body[0, :2], atol=1.0
    )


def test_its_uncertainty_is_that_of_the_taps() -> None:
    made = straightened(square(), tapped([3, 18]))
    sigma_m = np.sqrt(np.diagonal(made.covariance, axis1=1, axis2=2)[:, :2].max(axis=1))
    assert PARAMETERS.checkpoint.sigma_m / 2 < sigma_m[10] < 2 * PARAMETERS.checkpoint.sigma_m
    assert sigma_m[40] > sigma_m[10], "nothing was tapped after the eighteenth footstep"


def test_taps_straighten_a_bent_walk() -> None:
    bent = square(bent_rad=0.01)
    errors_m = [
        np.linalg.norm(straightened(bent, tapped(taps)).world_from_body - TRUE, axis=1)
        for taps in ([3, 18], [3, 13, 23, 33])
    ]
    assert errors_m[1].mean() < 0.5 * errors_m[0].mean()
    assert np.median(errors_m[1]) < PARAMETERS.checkpoint.sigma_m


@pytest.mark.parametrize(
    "told",
    [
        None,
        Checkpoints(np.array([1.5]), ("Door",)),
        tapped([3]),
        tapped([3, 4]),
        tapped([3, 18], np.array([[0.0, 0.0], [30.0, 0.0]])),
    ],
    ids=["none", "named", "one tap", "too near each other", "no walk is like that"],
)
def test_otherwise_the_walk_stays_in_the_frame_of_its_start(told: Checkpoints | None) -> None:
    nodes = square()
    made = straightened(nodes, told)
    np.testing.assert_allclose(made.world_from_body, nodes.world_from_body, atol=1e-9)
    assert not lies_on_plan(told, made, PARAMETERS.checkpoint)


@pytest.mark.parametrize("off_m", FAR_M, ids=["1 km", "UTM"])
def test_moving_the_plan_moves_the_walk_and_leaves_every_covariance(off_m: F64) -> None:
    told, bent = tapped([3, 13, 23, 33]), square(bent_rad=0.01)
    assert told.xy_m is not None
    here = straightened(bent, told)
    there = straightened(bent, replace(told, xy_m=told.xy_m + off_m))
    np.testing.assert_allclose(
        there.world_from_body - here.world_from_body,
        np.tile([*off_m, 0.0], (LAP + 1, 1)),
        atol=1e-6,
    )
    np.testing.assert_allclose(there.covariance, here.covariance, rtol=1e-5, atol=1e-9)
    assert there.status == here.status == "OK"


@pytest.mark.parametrize("off_m", FAR_M, ids=["1 km", "UTM"])
def test_moving_the_start_moves_the_walk_and_leaves_every_covariance(off_m: F64) -> None:
    """Of a walk that closes its loop by what it heard."""
    bent = square(bent_rad=0.01)
    covariance = np.diag([0.01, 0.01, 0.01])[None]
    home = Closures(
        np.array([0]), np.array([LAP]), np.ones(1), between(TRUE[:1], TRUE[LAP:]), covariance
    )  # fmt: skip
    believed = np.ones(1, dtype=bool)
    far = replace(bent, world_from_body=shifted(bent.world_from_body, off_m))
    here, there = (
        optimise_walk(nodes, home, believed, None, PARAMETERS)[1] for nodes in (bent, far)
    )
    assert here.closure_weights.tolist() == [1.0]
    np.testing.assert_allclose(
        there.world_from_body - here.world_from_body,
        np.tile([*off_m, 0.0], (LAP + 1, 1)),
        atol=1e-6,
    )
    np.testing.assert_allclose(there.covariance, here.covariance, rtol=1e-5, atol=1e-9)


def test_a_wrong_tap_among_right_ones_is_not_believed() -> None:
    off_m = np.zeros((4, 2))
    off_m[2] = [8.0, -5.0]
    made = straightened(square(), tapped([3, 13, 23, 33], off_m))
    np.testing.assert_allclose(made.world_from_body[:, :2], TRUE[:, :2], atol=0.1)


def test_the_first_guess_is_the_best_rigid_fit() -> None:
    plan = on_plan(tapped([3, 13, 23]), square(), CheckpointParameters())
    assert plan is not None
    np.testing.assert_allclose(plan.nodes.world_from_body[1:], TRUE, atol=1e-9)
    led_from, tapped_m = plan.nodes.world_from_body[0], TRUE[[3, 13, 23], :2]
    np.testing.assert_array_equal(led_from, [*np.median(tapped_m, axis=0), 0.0])
    np.testing.assert_allclose(compose(led_from, plan.closures.i_from_j)[:, :2], tapped_m)
    assert plan.closures.i.tolist() == [0, 0, 0]
    assert plan.closures.j.tolist() == [4, 14, 24]
