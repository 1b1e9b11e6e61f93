"""Optimisation of the pose graph: Levenberg-Marquardt (GTSAM) on the accepted closures."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from elfslam.base.arrays import F64, Bool
from elfslam.base.errors import NoAnswerError
from elfslam.base.geometry import shifted
from elfslam.base.values import PoseGraph, Trajectory
from elfslam.stages.graph.building import (
    GraphParameters,
    believing,
    rotation_first,
    seen_from_start,
)
from elfslam.stages.graph.outlier_rejection import choose_closures
from elfslam.stages.graph.uncertainty import (
    judge,
    pose_covariances,
    scale_covariance,
    with_own_noise,
)

if TYPE_CHECKING:
    import gtsam


def optimise(
    graph: PoseGraph, t_s: F64, parameters: GraphParameters, *, by_hand: Bool | None = None
) -> Trajectory:
    """Pose graph optimisation: the maximum-likelihood trajectory, with a covariance per pose.

    Closures tell how noisy the steps were. They cannot see the scale of a walk: what is uncertain
    about it comes on top.

    Closures made `by_hand` (k) are believed until the others contradict them.

    The first pose stays where it is. Without closures the dead reckoning comes back as it was.
    Raises NoAnswerError where the solver finds no trajectory: the edges are degenerate; and
    InputError where closures are to be rejected and the steps are no chain.
    """
    begin_m, graph = graph.initial[0, :2], seen_from_start(graph)
    with solving(graph):
        poses, kept = graph.initial, np.ones(int(graph.is_closure.sum()), dtype=bool)
        if parameters.robust and len(kept):
            poses, kept = choose_closures(graph, parameters, by_hand=by_hand)
        believed = believing(graph, kept)
        if kept.any():
            poses = solve(believed, [poses, rotation_first(believed)], parameters)
            poses, believed = with_own_noise(believed, poses, parameters)
        covariance = pose_covariances(believed, poses, parameters.anchor_sigma)
        covariance = covariance + scale_covariance(poses, graph.scale_sigma)
        if not (np.isfinite(poses).all() and np.isfinite(covariance).all()):
            raise RuntimeError("the result is not finite")
        verdict = judge(graph, poses, kept, parameters) if len(kept) else None
    status = "OK" if kept.any() else "NO_CLOSURES"
    weights, poses = kept.astype(np.float64), shifted(poses, begin_m)
    return Trajectory(t_s, poses, covariance, weights, status, verdict)


@contextmanager
def solving(graph: PoseGraph) -> Iterator[None]:
    """One line for whatever a solver says; a numerical failure comes as a RuntimeError."""
    try:
        yield
    except (RuntimeError, ValueError, np.linalg.LinAlgError) as cause:
        said = str(cause).strip().split("\n")[0].split(" while")[0].strip(" .:")
        span_m = float(np.ptp(graph.initial[:, :2], axis=0).max())
        raise NoAnswerError(
            f"pose graph: no trajectory for {len(graph.initial)} poses over {span_m:.3g} m "
            f"({said}); check the units of the odometry, and the sigmas of motion and closure"
        ) from cause


def solve(graph: PoseGraph, starts: list[F64], parameters: GraphParameters) -> F64:
    """Levenberg-Marquardt from several starts (n, 3): the poses of lowest cost.

    Raises RuntimeError or ValueError, as GTSAM says it, where the edges are degenerate.
    """
    import gtsam

    problem = as_gtsam(graph, parameters.anchor_sigma)
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(parameters.iterations)
    solved = [
        gtsam.LevenbergMarquardtOptimizer(problem, as_values(start), settings).optimize()
        for start in starts
    ]
    return as_poses(min(solved, key=problem.error), len(graph.initial))


def as_gtsam(graph: PoseGraph, anchor_sigma: float) -> gtsam.NonlinearFactorGraph:
    """GTSAM's factor graph: the edges in their order, then the prior that holds pose 0."""
    import gtsam

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
    """GTSAM's values: poses (n, 3) under the keys 0 to n - 1."""
    import gtsam

    values = gtsam.Values()
    for k, pose in enumerate(poses):
        values.insert(k, gtsam.Pose2(*pose))
    return values


def as_poses(values: gtsam.Values, count: int) -> F64:
    """Poses (n, 3) of the keys 0 to n - 1."""
    poses = (values.atPose2(k) for k in range(count))
    return np.array([(pose.x(), pose.y(), pose.theta()) for pose in poses])
