"""The trajectory that a pose graph means, with its uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import NoAnswerError
from elfslam.base.values import PoseGraph, Trajectory
from elfslam.line.graph.blocks import pattern_of
from elfslam.line.graph.build import believing
from elfslam.line.graph.choose import choose_closures
from elfslam.line.graph.linear import covariance_of, equations_at, uncertainty
from elfslam.line.graph.noise import with_own_noise
from elfslam.line.graph.parameters import GraphParameters
from elfslam.line.graph.solve import rotation_first, solve


def optimise(graph: PoseGraph, t_s: F64, parameters: GraphParameters) -> Trajectory:
    """The trajectory that agrees best with all edges, with a covariance per pose.

    Closures tell how noisy the steps were. They cannot see the scale of a walk: what is uncertain
    about it comes on top.

    The first pose stays where it is. Without closures the dead reckoning comes back as it was.
    Raises NoAnswerError where the solver finds no trajectory: the edges are degenerate; and
    InputError where closures are to be rejected and the steps are no chain.
    """
    with solving(graph):
        poses, kept = graph.initial, np.ones(int(graph.is_closure.sum()), dtype=bool)
        if parameters.robust and len(kept):
            poses, kept = choose_closures(graph, parameters)
        believed = believing(graph, kept)
        if kept.any():
            poses = solve(believed, [poses, rotation_first(believed)], parameters)
            poses, believed = with_own_noise(believed, poses, parameters)
        covariance = marginals(believed, poses, parameters.anchor_sigma)
        covariance = covariance + scale_covariance(poses, graph.scale_sigma)
        if not (np.isfinite(poses).all() and np.isfinite(covariance).all()):
            raise RuntimeError("the result is not finite")
    status = "OK" if kept.any() else "NO_CLOSURES"
    return Trajectory(t_s, poses, covariance, kept.astype(np.float64), status)


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


def marginals(graph: PoseGraph, poses: F64, anchor_sigma: float) -> F64:
    """Covariances (n, 3, 3) of the poses, x and y in world axes."""
    pattern = pattern_of(graph.edges, len(poses))
    known = uncertainty(equations_at(graph, poses, pattern, anchor_sigma))
    every = np.arange(len(poses))
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.zeros((len(poses), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1] = cos, -sin, sin, cos
    turn[:, 2, 2] = 1.0
    return np.asarray(turn @ covariance_of(known, every, every) @ np.swapaxes(turn, 1, 2))


def scale_covariance(poses: F64, scale_sigma: float) -> F64:
    """Covariances (n, 3, 3) of poses whose distances from the first are wrong in one ratio."""
    away = poses - poses[0]
    away[:, 2] = 0.0
    return np.asarray(scale_sigma**2 * away[:, :, None] * away[:, None, :])
