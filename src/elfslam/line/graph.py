"""The pose graph: dead reckoning and closures together, solved by GTSAM.

Closures can still be wrong; graduated non-convexity (Yang et al., RA-L 2020) decides which of them
to believe, while the dead reckoning is always believed as far as its sigmas go.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import gtsam
import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.geometry import between
from elfslam.base.parameters import parameter
from elfslam.base.values import Closures, Odometry, PoseGraph, Trajectory

LEAST_SIGMA = 1e-9


@dataclass(frozen=True)
class GraphParameters:
    """How the graph is solved."""

    robust: bool = parameter(True, "", "let graduated non-convexity reject closures")
    inlier_probability: float = parameter(
        0.99, "", "closures with a residual beyond this quantile are outliers", low=0.5, high=0.9999
    )
    anchor_sigma: float = parameter(1e-3, "m, rad", "sigma of the start pose", low=1e-6, high=10.0)
    iterations: int = parameter(100, "", "most iterations of the solver", low=1, high=10_000)


def build_graph(nodes: Odometry, closures: Closures) -> PoseGraph:
    """One pose per footstep, an edge per step and an edge per closure.

    Raises InputError where a step claims to have no error: nothing could correct it.
    """
    if (nodes.step_sigma < LEAST_SIGMA).any():
        raise InputError(
            f"odometry: wanted sigmas of at least {LEAST_SIGMA:g}, got {nodes.step_sigma.min():g}; "
            "state how far each move can be off"
        )
    poses = nodes.world_from_body
    count = len(poses) - 1
    steps = np.column_stack([np.arange(count), np.arange(1, count + 1)])
    step_information = np.stack([np.diag(1 / sigma**2) for sigma in nodes.step_sigma])
    closure_information = np.linalg.inv(closures.covariance).reshape(-1, 3, 3)
    return PoseGraph(
        initial=poses,
        edges=np.vstack([steps, np.column_stack([closures.i, closures.j])]),
        measurements=np.vstack([between(poses[:-1], poses[1:]), closures.i_from_j]),
        information=np.concatenate([step_information, closure_information]),
        is_closure=np.arange(count + len(closures.i)) >= count,
    )


def optimise(graph: PoseGraph, t_s: F64, parameters: GraphParameters) -> Trajectory:
    """The trajectory that agrees best with all edges, with a covariance per pose.

    The first pose stays where it is. Without closures the dead reckoning comes back as it was.
    Raises NoAnswerError where the solver finds no trajectory: the edges are degenerate.
    """
    with _solving(graph):
        problem, initial = _as_gtsam(graph, parameters)
        near, weights = initial, np.ones(int(graph.is_closure.sum()))
        if parameters.robust and len(weights):
            near, weights = _choose_closures(problem, initial, graph, parameters)
        kept = _without_rejected(problem, graph, weights)
        solved = _solve(kept, near, parameters)
        covariance = _marginals(kept, solved, len(graph.initial))
        poses = np.array([_pose(solved.atPose2(k)) for k in range(len(graph.initial))])
        if not (np.isfinite(poses).all() and np.isfinite(covariance).all()):
            raise RuntimeError("the result is not finite")
    status = "OK" if (weights > 0.5).any() else "NO_CLOSURES"
    return Trajectory(t_s, poses, covariance, weights, status)


@contextmanager
def _solving(graph: PoseGraph) -> Iterator[None]:
    """One line for whatever GTSAM says; a numerical failure comes as a RuntimeError."""
    try:
        yield
    except (RuntimeError, ValueError) as cause:
        said = str(cause).strip().split("\n")[0].split(" while")[0].strip(" .:")
        span_m = float(np.ptp(graph.initial[:, :2], axis=0).max())
        raise NoAnswerError(
            f"pose graph: no trajectory for {len(graph.initial)} poses over {span_m:.3g} m "
            f"({said}); check the units of the odometry, and the sigmas of motion and closure"
        ) from cause


def _as_gtsam(
    graph: PoseGraph, parameters: GraphParameters
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    problem, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for (i, j), measured, information in zip(
        graph.edges, graph.measurements, graph.information, strict=True
    ):
        noise = gtsam.noiseModel.Gaussian.Information(information)
        problem.add(gtsam.BetweenFactorPose2(int(i), int(j), gtsam.Pose2(*measured), noise))
    anchor = gtsam.noiseModel.Isotropic.Sigma(3, parameters.anchor_sigma)
    problem.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*graph.initial[0]), anchor))
    for k, pose in enumerate(graph.initial):
        initial.insert(k, gtsam.Pose2(*pose))
    return problem, initial


def _choose_closures(
    problem: gtsam.NonlinearFactorGraph,
    initial: gtsam.Values,
    graph: PoseGraph,
    parameters: GraphParameters,
) -> tuple[gtsam.Values, F64]:
    """Poses, and a weight per closure: 1 believed, 0 rejected."""
    settings = gtsam.GncLMParams(_solver_settings(parameters))
    settings.setLossType(gtsam.GncLossType.TLS)
    trusted = [*np.flatnonzero(~graph.is_closure), len(graph.edges)]
    settings.setKnownInliers([int(k) for k in trusted])
    optimizer = gtsam.GncLMOptimizer(problem, initial, settings)
    optimizer.setInlierCostThresholdsAtProbability(parameters.inlier_probability)
    solved = optimizer.optimize()
    weights = np.asarray(optimizer.getWeights())[: len(graph.edges)]
    return solved, weights[graph.is_closure]


def _without_rejected(
    problem: gtsam.NonlinearFactorGraph, graph: PoseGraph, weights: F64
) -> gtsam.NonlinearFactorGraph:
    kept = gtsam.NonlinearFactorGraph()
    trust = np.ones(problem.size())
    trust[np.flatnonzero(graph.is_closure)] = weights
    for k in np.flatnonzero(trust > 0.5):
        kept.add(problem.at(int(k)))
    return kept


def _solve(
    problem: gtsam.NonlinearFactorGraph, near: gtsam.Values, parameters: GraphParameters
) -> gtsam.Values:
    settings = _solver_settings(parameters)
    return gtsam.LevenbergMarquardtOptimizer(problem, near, settings).optimize()


def _solver_settings(parameters: GraphParameters) -> gtsam.LevenbergMarquardtParams:
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(parameters.iterations)
    return settings


def _marginals(problem: gtsam.NonlinearFactorGraph, solved: gtsam.Values, count: int) -> F64:
    """Covariances (n, 3, 3) with x and y in world axes: GTSAM gives them in body axes."""
    marginals = gtsam.Marginals(problem, solved)
    covariance = np.empty((count, 3, 3))
    for k in range(count):
        turn = np.eye(3)
        turn[:2, :2] = solved.atPose2(k).rotation().matrix()
        covariance[k] = turn @ marginals.marginalCovariance(k) @ turn.T
    return covariance


def _pose(pose: gtsam.Pose2) -> tuple[float, float, float]:
    return pose.x(), pose.y(), pose.theta()
