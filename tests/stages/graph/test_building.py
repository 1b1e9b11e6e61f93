"""Pose graph construction: every step and closure an edge, and a first guess from nothing."""

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.geometry import between, chain, wrap_angle
from elfslam.base.values import NO_CLOSURES, Closures, Odometry, PoseGraph
from elfslam.stages.graph import build_graph
from elfslam.stages.graph.building import rotation_first

SIGMA = np.array([0.07, 0.035, 0.02])


def four_steps(sigma: float = 1.0) -> Odometry:
    poses = chain(np.array([1.0, 2.0, 0.5]), np.tile([0.7, 0.1, 0.2], (4, 1)))
    return Odometry(np.arange(5.0), poses, np.tile(SIGMA * [1.0, sigma, 1.0], (4, 1)))


def test_the_graph_holds_every_step_and_every_closure() -> None:
    nodes = four_steps()
    moves = np.array([[1.0, 0, 0], [0, 2.0, np.pi / 2]])
    covariance = np.tile(np.diag([0.1, 0.2, 0.3]), (2, 1, 1))
    found = Closures([0, 1], [3, 4], np.full(2, 0.6), moves, covariance)
    graph = build_graph(nodes, found)
    assert graph.edges.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4], [0, 3], [1, 4]]
    assert graph.is_closure.tolist() == [False] * 4 + [True] * 2
    poses = nodes.world_from_body
    npt.assert_allclose(graph.measurements[:4], between(poses[:-1], poses[1:]))
    npt.assert_allclose(graph.measurements[4:], moves)
    npt.assert_allclose(graph.information[:4], np.tile(np.diag(SIGMA**-2), (4, 1, 1)))
    unit = np.tile(np.eye(3), (2, 1, 1))
    npt.assert_allclose(graph.information[4:] @ covariance, unit, atol=1e-9)
    npt.assert_array_equal(graph.initial, poses)


def test_a_step_that_claims_no_error_is_refused() -> None:
    with pytest.raises(InputError, match="wanted sigmas of at least 1e-09, got 0; state how far"):
        build_graph(four_steps(sigma=0.0), NO_CLOSURES)


def test_rotations_first_needs_no_guess() -> None:
    truth = chain(np.array([1.0, 2.0, 0.3]), np.tile([1.0, 0.1, 0.6], (9, 1)))
    edges = np.array([*((k, k + 1) for k in range(9)), (9, 0), (7, 2)])
    exact = between(truth[edges[:, 0]], truth[edges[:, 1]])
    root = np.random.default_rng(5).normal(size=(11, 3, 3))
    information = 400 * np.eye(3) + 20 * root @ root.swapaxes(1, 2)
    lost = np.vstack([truth[:1], np.random.default_rng(6).normal(size=(9, 3)) * 50])
    found = rotation_first(PoseGraph(lost, edges, exact, information, np.arange(11) >= 9))
    npt.assert_allclose(found[:, :2], truth[:, :2], atol=1e-9)
    npt.assert_allclose(wrap_angle(found[:, 2] - truth[:, 2]), 0, atol=1e-9)
