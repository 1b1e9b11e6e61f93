"""The graph near a solution: its normal equations, and the covariances that they imply.

An error of a pose is a small move (forward m, left m, turn rad) in its own frame, after it:
pose' = compose(pose, move).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.base.geometry import between, compose, inverse
from elfslam.base.values import PoseGraph
from elfslam.line.graph.blocks import (
    Factor,
    Pattern,
    factored,
    inverse_blocks,
    solution,
    stored_at,
)

SETTLED = 1e-4
"""A Gauss-Newton step that lowers the cost by no more than this share is the last."""


def residuals(poses: F64, edges: I64, measurements: F64) -> F64:
    """How far the poses (n, 3) are from what each edge measured (e, 3), as small moves.

    That is the logarithm of what is left of the move, in the frame of its end, as in GTSAM.
    """
    return logarithm(between(measurements, between(poses[edges[:, 0]], poses[edges[:, 1]])))


def logarithm(move: F64) -> F64:
    """The velocity (..., 3) that in unit time leads along a circle to the pose `move` (..., 3)."""
    half = move[..., 2] / 2
    straight = 1.0 / np.sinc(half / np.pi) * np.cos(half)
    x = straight * move[..., 0] + half * move[..., 1]
    y = straight * move[..., 1] - half * move[..., 0]
    return np.stack([x, y, move[..., 2]], axis=-1)


def chi_square(residual: F64, covariance: F64) -> F64:
    """Squared Mahalanobis lengths (k) of residuals (k, 3) under covariances (k, 3, 3)."""
    whitened = np.linalg.solve(covariance, residual[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("ka,ka->k", residual, whitened))


def adjoint(pose: F64) -> F64:
    """Matrices (..., 3, 3) that carry a small move from the pose's frame into the outer one."""
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    zero, one = np.zeros_like(cos), np.ones_like(cos)
    rows = [[cos, -sin, pose[..., 1]], [sin, cos, -pose[..., 0]], [zero, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def carried(pose: F64, covariance: F64) -> F64:
    """Covariances (..., 3, 3) seen in the outer frame of `pose`."""
    matrix = adjoint(pose)
    return np.asarray(matrix @ covariance @ np.swapaxes(matrix, -1, -2))


def jacobians(poses: F64, edges: I64, measurements: F64) -> tuple[F64, F64, F64]:
    """Residuals (e, 3) and their derivatives (e, 3, 3) by the near and the far pose.

    The logarithm's own derivative is cut off after its second order.
    """
    moves = between(poses[edges[:, 0]], poses[edges[:, 1]])
    residual = logarithm(between(measurements, moves))
    x, y, turn = residual.T
    bracket = np.zeros((len(edges), 3, 3))
    bracket[:, 0, 1], bracket[:, 1, 0] = -turn, turn
    bracket[:, 0, 2], bracket[:, 1, 2] = y, -x
    far = np.eye(3) + bracket / 2 + bracket @ bracket / 12
    return residual, -far @ adjoint(inverse(moves)), far


@dataclass(frozen=True, eq=False)
class Equations:
    """Gauss-Newton's equations of a graph at some poses, factored.

    `cost` is half the sum of the squared whitened residuals.
    """

    factor: Factor
    gradient: F64
    cost: float


def equations_at(graph: PoseGraph, poses: F64, pattern: Pattern, anchor_sigma: float) -> Equations:
    """The equations at `poses` (n, 3), of which the first is held where it is.

    Raises RuntimeError where the edges do not hold the poses together.
    """
    residual, near, far = jacobians(poses, graph.edges, graph.measurements)
    i, j = graph.edges.T
    near_w = np.swapaxes(near, 1, 2) @ graph.information
    far_w = np.swapaxes(far, 1, 2) @ graph.information
    start, anchor = np.zeros(1, dtype=np.int64), np.eye(3)[None] * (1 / anchor_sigma) ** 2
    rows, columns = np.concatenate([i, j, i, start]), np.concatenate([i, j, j, start])
    blocks = np.concatenate([near_w @ near, far_w @ far, near_w @ far, anchor])
    gradient = np.zeros((len(poses), 3))
    np.add.at(gradient, i, np.einsum("eab,eb->ea", near_w, residual))
    np.add.at(gradient, j, np.einsum("eab,eb->ea", far_w, residual))
    factor = factored(pattern, rows, columns, blocks)
    return Equations(factor, gradient, half_square(graph, poses))


def half_square(graph: PoseGraph, poses: F64) -> float:
    """Half the sum of the edges' squared whitened residuals, as GTSAM counts it."""
    residual = residuals(poses, graph.edges, graph.measurements)
    return 0.5 * float(np.einsum("ea,eab,eb", residual, graph.information, residual))


def settle(
    graph: PoseGraph, poses: F64, pattern: Pattern, anchor_sigma: float, steps: int
) -> tuple[F64, Equations]:
    """Poses after at most `steps` of Gauss-Newton from a start nearby, and the equations there."""
    equations = equations_at(graph, poses, pattern, anchor_sigma)
    for _ in range(steps):
        moved = compose(poses, -solution(equations.factor, equations.gradient))
        saved = equations.cost - half_square(graph, moved)
        if not saved > 0:
            break
        settled = saved < SETTLED * equations.cost
        poses, equations = moved, equations_at(graph, moved, pattern, anchor_sigma)
        if settled:
            break
    return poses, equations


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariances at a solution, in the poses' own frames; see `covariance_of`."""

    pattern: Pattern
    blocks: F64


def uncertainty(equations: Equations) -> Uncertainty:
    """The covariances that the equations imply, of neighbours in the pattern."""
    return Uncertainty(equations.factor.pattern, inverse_blocks(equations.factor))


def covariance_of(known: Uncertainty, i: I64, j: I64) -> F64:
    """Covariances (k, 3, 3) between poses i and j (k), which the pattern must join."""
    at, transposed = stored_at(known.pattern, i, j)
    blocks = known.blocks[at]
    return np.where(transposed[:, None, None], np.swapaxes(blocks, 1, 2), blocks)


def predicted_covariance(known: Uncertainty, poses: F64, edges: I64, measurements: F64) -> F64:
    """How uncertain (k, 3, 3) the graph is of what each edge measures, in its residual's frame."""
    _, near, far = jacobians(poses, edges, measurements)
    i, j = edges.T
    across = near @ covariance_of(known, i, j) @ np.swapaxes(far, 1, 2)
    total = near @ covariance_of(known, i, i) @ np.swapaxes(near, 1, 2)
    total += far @ covariance_of(known, j, j) @ np.swapaxes(far, 1, 2)
    return np.asarray(total + across + np.swapaxes(across, 1, 2))
