"""Places that were named by hand: which footsteps they tie, and what that does to a map."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.geometry import compose
from elfslam.base.values import Checkpoints, Odometry, PointKind, PointOfInterest, Trajectory
from elfslam.stages import checkpoints
from elfslam.stages.graph import GraphParameters, build_graph, optimise

PARAMETERS = checkpoints.CheckpointParameters()
LAP, STEP_M = 40, 0.7
SIGMA = np.array([0.1, 0.05, 0.03])


def square(laps: int, bent_rad: float = 0.0) -> Odometry:
    """Laps round a square of 7 m by a gyroscope that reads too much, in half seconds."""
    count = laps * LAP
    turn = np.where(np.arange(count) % 10 == 9, np.pi / 2, 0.0) + bent_rad
    poses = [np.zeros(3)]
    for each in turn:
        poses.append(compose(poses[-1][None], np.array([[STEP_M, 0.0, each]]))[0])
    return Odometry(np.arange(count + 1) / 2, np.array(poses), np.tile(SIGMA, (count, 1)))


def test_the_first_visit_is_tied_to_every_later_one() -> None:
    told = Checkpoints(np.array([5.0, 9.9, 25.1, 45.0]), ("Door", "Stairs", "Door", "Door"))
    found = checkpoints.closures_at(told, square(3), PARAMETERS)
    assert list(zip(found.i, found.j, strict=True)) == [(10, 50), (10, 90)]
    np.testing.assert_array_equal(found.i_from_j, 0)
    sigma = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(sigma[:, :2], PARAMETERS.sigma_m)
    assert (sigma[:, 2] > np.pi).all(), "whoever stands there may face anywhere"


def test_what_ties_nothing_gives_nothing() -> None:
    nodes = square(1)
    outside = Checkpoints(np.array([5.0, 500.0]), ("Door", "Door"))
    twice = Checkpoints(np.array([5.0, 5.1]), ("Door", "Door"))
    single = Checkpoints(np.array([5.0]), ("Door",))
    for told in (None, outside, twice, single):
        assert len(checkpoints.closures_at(told, nodes, PARAMETERS).i) == 0


def test_a_named_place_lies_in_the_middle_of_its_visits() -> None:
    walk = square(2)
    poses = walk.world_from_body.copy()
    poses[50:, 0] += 1.0
    mapped = Trajectory(
        walk.t_s, poses, np.tile(np.eye(3), (len(poses), 1, 1)), np.zeros(0), "OK"
    )  # fmt: skip
    told = Checkpoints(np.array([0.0, 5.0, 25.0, 500.0]), ("Start", "Door", "Door", "Late"))
    start, door = checkpoints.places_visited(told, mapped, PARAMETERS)
    assert start == PointOfInterest("Start", PointKind.OTHER, 0.0, 0.0)
    x_m, y_m = poses[[10, 50], :2].mean(axis=0)
    assert (door.name, door.x_m, door.y_m) == ("Door", pytest.approx(x_m), pytest.approx(y_m))
    assert checkpoints.places_visited(None, mapped, PARAMETERS) == ()


def test_a_tap_straightens_a_bent_walk() -> None:
    true, bent = square(2), square(2, bent_rad=0.01)
    told = Checkpoints(np.array([5.0, 25.0]), ("Door", "Door"))
    found = checkpoints.closures_at(told, bent, PARAMETERS)
    by_hand = np.ones(1, dtype=bool)
    graph = build_graph(bent, found)
    solved = optimise(graph, bent.t_s, GraphParameters(), by_hand=by_hand)
    assert solved.closure_weights.tolist() == [1.0]
    errors = [
        np.linalg.norm(each[:, :2] - true.world_from_body[:, :2], axis=1).mean()
        for each in (solved.world_from_body, bent.world_from_body)
    ]
    assert errors[0] < 0.8 * errors[1]


def test_a_tap_is_believed_where_chance_would_not_be() -> None:
    bent = square(2, bent_rad=0.01)
    told = Checkpoints(np.array([5.0, 25.0]), ("Door", "Door"))
    graph = build_graph(bent, checkpoints.closures_at(told, bent, PARAMETERS))
    by_chance = optimise(graph, bent.t_s, GraphParameters())
    assert by_chance.closure_weights.tolist() == [0.0]


@pytest.mark.parametrize("wrong_s", [15.0, 35.0])
def test_a_tap_at_another_place_is_not_believed(wrong_s: float) -> None:
    nodes = square(2)
    told = Checkpoints(np.array([5.0, wrong_s]), ("Door", "Door"))
    graph = build_graph(nodes, checkpoints.closures_at(told, nodes, PARAMETERS))
    solved = optimise(graph, nodes.t_s, GraphParameters(), by_hand=np.ones(1, dtype=bool))
    assert solved.closure_weights.tolist() == [0.0]
    np.testing.assert_allclose(solved.world_from_body, nodes.world_from_body, atol=1e-6)


DOOR = PointOfInterest("Door", PointKind.DOOR, 2.0, 1.0)
COUNT = 5
POSES = np.arange(COUNT)[:, None] * [1.0, 0.0, 0.0]
COVARIANCE = np.tile(np.eye(3), (COUNT, 1, 1))
STRAIGHT = Trajectory(np.arange(COUNT) / 2, POSES, COVARIANCE, np.zeros(0), "OK")


def test_a_walk_that_is_turned_and_moved_takes_its_points_along() -> None:
    move = np.array([10.0, -3.0, np.pi / 2])
    moved = replace(STRAIGHT, world_from_body=compose(move, STRAIGHT.world_from_body))
    (found,) = checkpoints.carried([DOOR], STRAIGHT, moved)
    assert (found.name, found.kind) == (DOOR.name, DOOR.kind)
    assert (found.x_m, found.y_m) == pytest.approx((9.0, -1.0))


def test_where_a_walk_is_bent_a_point_stays_beside_its_footstep() -> None:
    poses = STRAIGHT.world_from_body.copy()
    poses[3:, 1] += 5.0
    (found,) = checkpoints.carried([DOOR], STRAIGHT, replace(STRAIGHT, world_from_body=poses))
    assert (found.x_m, found.y_m) == pytest.approx((2.0, 1.0)), "only later footsteps moved"


def test_one_place_named_by_several_walks_lies_in_their_middle() -> None:
    other = replace(DOOR, name="door", x_m=4.0)
    assert checkpoints.gathered([DOOR, other]) == [replace(DOOR, x_m=3.0)]


def test_what_is_far_away_or_of_another_kind_stays_apart() -> None:
    apart = [DOOR, replace(DOOR, x_m=20.0), replace(DOOR, kind=PointKind.ROOM)]
    assert checkpoints.gathered(apart) == apart
    assert checkpoints.gathered([]) == []
