"""Poses that agree best with all edges, by GTSAM."""

from __future__ import annotations

import gtsam
import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from elfslam.base.arrays import F64
from elfslam.base.values import PoseGraph
from elfslam.line.graph.parameters import GraphParameters

C128 = npt.NDArray[np.complex128]


def as_gtsam(graph: PoseGraph, anchor_sigma: float) -> gtsam.NonlinearFactorGraph:
    """The edges as factors in their order, then the prior that holds pose 0."""
    problem = gtsam.NonlinearFactorGraph()
    for (i, j), measured, information in zip(
        graph.edges, graph.measurements, graph.information, strict=True
    ):
        noise = gtsam.noiseModel.Gaussian.Information(information)
        problem.add(gtsam.BetweenFactorPose2(int(i), int(j), gtsam.Pose2(*measured), noise))
    anchor = gtsam.noiseModel.Isotropic.Sigma(3, anchor_sigma)
    problem.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*graph.initial[0]), anchor))
    return problem


def as_values(poses: F64) -> gtsam.Values:
    """Poses (n, 3) under the keys 0 to n - 1."""
    values = gtsam.Values()
    for k, pose in enumerate(poses):
        values.insert(k, gtsam.Pose2(*pose))
    return values


def as_poses(values: gtsam.Values, count: int) -> F64:
    """Poses (n, 3) of the keys 0 to n - 1."""
    poses = (values.atPose2(k) for k in range(count))
    return np.array([(pose.x(), pose.y(), pose.theta()) for pose in poses])


def solve(graph: PoseGraph, starts: list[F64], parameters: GraphParameters) -> F64:
    """The best of what Levenberg-Marquardt makes of each start (n, 3): the lower cost wins.

    Raises RuntimeError or ValueError, as GTSAM says it, where the edges are degenerate.
    """
    problem = as_gtsam(graph, parameters.anchor_sigma)
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(parameters.iterations)
    solved = [
        gtsam.LevenbergMarquardtOptimizer(problem, as_values(start), settings).optimize()
        for start in starts
    ]
    return as_poses(min(solved, key=problem.error), len(graph.initial))


def rotation_first(graph: PoseGraph) -> F64:
    """Poses (n, 3) found without any guess but the first: headings, then positions.

    A heading is a complex number; without holding its length at 1 the headings that agree best
    with all measured turns are linear in them (Carlone et al., ICRA 2015, "Initialization
    techniques for 3D SLAM", chordal relaxation). Given the headings, so are the positions.
    """
    first_x, first_y, first_heading = graph.initial[0]
    forward, left, turn = graph.measurements.T
    turn_weight = graph.information[:, 2, 2]
    still = np.zeros(len(turn), dtype=np.complex128)
    heading = _agreeing(graph, np.exp(1j * turn), still, turn_weight, np.exp(1j * first_heading))
    heading = heading / np.abs(heading)
    move = heading[graph.edges[:, 0]] * (forward + 1j * left)
    move_weight = (graph.information[:, 0, 0] + graph.information[:, 1, 1]) / 2
    same = np.ones(len(turn), dtype=np.complex128)
    position = _agreeing(graph, same, move, move_weight, first_x + 1j * first_y)
    return np.column_stack([position.real, position.imag, np.angle(heading)])


def _agreeing(graph: PoseGraph, factor: C128, offset: C128, weight: F64, first: complex) -> C128:
    """Numbers z (n) that begin with `first` and least violate z[j] = factor * z[i] + offset."""
    count, edge = len(graph.initial), np.arange(len(graph.edges))
    root = np.sqrt(weight)
    entries = np.concatenate([-root * factor, root + 0j])
    ends = (np.concatenate([edge, edge]), graph.edges.T.ravel())
    matrix = csc_array((entries, ends), shape=(len(edge), count))
    free, known = matrix[:, 1:], matrix[:, [0]].toarray()[:, 0] * first
    adjoint = free.conj().T
    normal = csc_array(adjoint @ free)
    solved = splu(normal, permc_spec="MMD_AT_PLUS_A").solve(adjoint @ (root * offset - known))
    return np.concatenate([[first], solved])
