"""Walks followed through plans: from where they are placed, and refused where nobody can say."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.app.anchor import Plan, Start, follow, follow_into, start_on
from elfslam.base.errors import NoAnswerError
from elfslam.base.geometry import chain
from elfslam.base.grid import FloorGrid, walked_grid
from elfslam.base.values import NO_CLOSURES, MeanSimilarity, Odometry, Run, Trajectory
from elfslam.data.runs import write_run
from elfslam.stages.floor_plan_alignment import OK, AnchoringParameters, Placement
from elfslam.stages.map_matching import MapMatchingParameters

KNOWN = MapMatchingParameters(particles=300)
HALL = FloorGrid(np.ones((300, 300), dtype=bool), np.array([-15.0, -15.0]), 0.1)


@pytest.fixture
def run() -> Run:
    """Ten metres straight ahead, by steps alone."""
    poses = chain(np.array([1.0, 0.0, 0.0]), np.tile([0.5, 0.0, 0.0], (20, 1)))
    t_s = 0.5 * np.arange(len(poses))
    nodes = Odometry(t_s, poses, np.tile([0.1, 0.1, 0.01], (20, 1)))
    spread = np.tile(0.01 * np.eye(3), (len(poses), 1, 1))
    walk = Trajectory(t_s, poses, spread, np.zeros(0), "NO_CLOSURES")
    alike = MeanSimilarity(np.zeros((20, 1), dtype=np.float32), kind="motion")
    return Run("walk", nodes, alike, NO_CLOSURES, walk, None, None, None)


def placed(status: str = OK) -> Placement:
    one = np.ones(1)
    covariance = np.diag([0.04, 0.04, 0.01])
    pose = np.array([2.0, 3.0, np.pi / 2])
    return Placement(pose, covariance, one, np.zeros((0, 3)), 1.0, 0.0, status)


def test_a_placed_run_begins_where_its_first_pose_lies_on_the_plan(run: Run) -> None:
    start = start_on(placed(), [run.trajectory.world_from_body[:, :2]], run)
    npt.assert_allclose(start.pose, [2.0, 4.0, np.pi / 2])
    # Five metres of lever to the walk's middle, straight behind it.
    npt.assert_allclose(np.diag(start.covariance), [0.04 + 0.01 * 25, 0.04, 0.01])


def test_lengths_follow_the_scale_of_the_placement(run: Run) -> None:
    double = dataclasses.replace(placed(), scale=2.0)
    start = start_on(double, [run.trajectory.world_from_body[:, :2]], run)
    npt.assert_allclose(start.pose, [2.0, 5.0, np.pi / 2])
    found = follow(run, start, HALL, 0.4, KNOWN)
    assert np.linalg.norm(found.poses[10, :2] - found.poses[0, :2]) == pytest.approx(10, abs=0.7)


def test_a_walk_is_followed_from_its_start(run: Run) -> None:
    start = Start(np.array([-5.0, 1.0, 0.0]), np.diag([0.01, 0.01, 1e-4]))
    found = follow(run, start, HALL, 0.4, KNOWN)
    npt.assert_allclose(found.poses[-1], [5.0, 1.0, 0.0], atol=0.5)


def test_a_plan_without_room_to_stand_is_refused(run: Run) -> None:
    narrow = walked_grid([np.array([[0, 0], [9, 0.0]])], 0.3, 0.1)
    start = Start(np.zeros(3), np.eye(3))
    with pytest.raises(NoAnswerError, match=r"lower anchoring\.keep_off_m"):
        follow(run, start, narrow, 0.4, KNOWN)


def test_a_walk_that_fits_in_several_ways_needs_its_start_said(run: Run, tmp_path: Path) -> None:
    write_run(run, tmp_path / "run", facts={}, encoder=None)
    quick = AnchoringParameters(cell_m=0.5)
    with pytest.raises(NoAnswerError, match="AMBIGUOUS; say where it begins"):
        follow_into(tmp_path / "out", tmp_path / "run", Plan(HALL), (quick, KNOWN), None)
    assert not (tmp_path / "out").exists()
