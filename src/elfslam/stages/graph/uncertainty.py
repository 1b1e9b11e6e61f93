"""Marginal covariances, variance components, and chi-square tests of closures.

All of it is told by the Gauss-Newton normal equations at a solution. An error of a pose is a small
move (forward m, left m, turn rad) in its own frame, after it: pose' = compose(pose, move).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.geometry import between, compose, inverse, wrap_angle
from elfslam.base.values import PoseGraph, Verdict
from elfslam.stages.graph.blocks import (
    Factor,
    Pattern,
    factored,
    inverse_blocks,
    pattern_of,
    solution,
    stored_at,
    summed,
)
from elfslam.stages.graph.building import GraphParameters, believing, covariance_of_edges, edges_of

SETTLED = 1e-4
"""A Gauss-Newton step that promises to lower the cost by less than this share is not taken."""
SETTLING_STEPS = 10
LEAST_TURN = 1.0
"""A closure that knows its heading by less (1/rad2) leaves it open."""
LEAST_SHARE = 1e-6
"""Of a measurement's covariance, what is left at least for those who alone decide their place."""


def pose_covariances(graph: PoseGraph, poses: F64, anchor_sigma: float) -> F64:
    """Marginal covariances (n, 3, 3) of the poses, x and y in world axes."""
    pattern = pattern_of(graph.edges, len(poses))
    known = marginal_covariances(equations_at(graph, poses, pattern, anchor_sigma))
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


def judge(graph: PoseGraph, poses: F64, kept: Bool, parameters: GraphParameters) -> Verdict:
    """Chi-square test of every closure of a graph against the poses (n, 3) that came of it.

    Of the closures (k) the `kept` were believed. Each of those is asked as if it had had no say:
    what it bent towards itself is taken out of its residual's covariance. Raises RuntimeError
    where the edges do not hold the poses.
    """
    squared = agreement(graph, poses, kept, parameters)
    agrees = squared <= chi2.ppf(parameters.inlier_probability, 3)
    return Verdict(
        int(kept.sum()),
        int((kept & agrees).sum()),
        int((~kept).sum()),
        int((~kept & agrees).sum()),
        parameters.inlier_probability,
    )


def agreement(graph: PoseGraph, poses: F64, kept: Bool, parameters: GraphParameters) -> F64:
    """Squared Mahalanobis length (k) of each closure's residual; chi-square of 3 if it is true.

    Of rejected closures that cannot agree, however their two poses vary together, it is no more
    than a lower bound.
    """
    closures, believed = edges_of(graph, graph.is_closure), believing(graph, kept)
    limit = float(chi2.ppf(parameters.inlier_probability, 3))
    known = known_at(believed, poses, closures.edges[:0], parameters.anchor_sigma)
    squared = least_squared(known, poses, closures)
    asked = np.flatnonzero(kept | (squared <= limit))
    within = edges_of(closures, asked)
    known = known_at(believed, poses, within.edges, parameters.anchor_sigma)
    predicted = predicted_covariance(known, poses, within.edges, within.measurements)
    own, believe = covariance_of_edges(within), kept[asked]
    without = own - predicted + LEAST_SHARE * own
    covariance = np.where(believe[:, None, None], without, own + predicted)
    squared[asked] = chi_square(residuals(poses, within.edges, within.measurements), covariance)
    return squared


def left_out_squared(closures: PoseGraph, poses: F64, known: MarginalCovariances) -> F64:
    """Squared Mahalanobis length (k) of each believed closure against what all the rest predicts.

    What the closure itself bent towards it is taken out of its residual's covariance.
    """
    predicted = predicted_covariance(known, poses, closures.edges, closures.measurements)
    own = covariance_of_edges(closures)
    residual = residuals(poses, closures.edges, closures.measurements)
    return chi_square(residual, own - predicted + LEAST_SHARE * own)


def known_at(graph: PoseGraph, poses: F64, asked: I64, anchor_sigma: float) -> MarginalCovariances:
    """Marginal covariances at `poses`, of every neighbour and of the pairs (k, 2) asked about."""
    pattern = pattern_of(np.vstack([graph.edges, asked]), len(poses))
    return marginal_covariances(equations_at(graph, poses, pattern, anchor_sigma))


def least_squared(known: MarginalCovariances, poses: F64, closures: PoseGraph) -> F64:
    """What the squared Mahalanobis length (k) of closures that have no say is at least.

    A difference varies by no more than twice the sum of both variances, so this asks for single
    poses only, which costs far less than to ask for pairs.
    """
    residual, near, far = jacobians(poses, closures.edges, closures.measurements)
    i, j = closures.edges.T
    total = near @ covariance_of(known, i, i) @ np.swapaxes(near, 1, 2)
    total += far @ covariance_of(known, j, j) @ np.swapaxes(far, 1, 2)
    return chi_square(residual, second_order_inflated(2 * total + covariance_of_edges(closures)))


def second_order_inflated(covariance: F64) -> F64:
    """Second-order covariance inflation (k, 3, 3) for the way that an uncertain heading bends.

    To second order, a heading error of sigma s shortens a lever by s^2 / 2 of its length, where
    to first order it only moves its end sideways by s of it.
    """
    widened = covariance.copy()
    turned = np.minimum(covariance[:, 2, 2], 1.0) / 4
    along = turned * (covariance[:, 0, 0] + covariance[:, 1, 1])
    widened[:, 0, 0] += along
    widened[:, 1, 1] += along
    return widened


def with_own_noise(
    graph: PoseGraph, poses: F64, parameters: GraphParameters
) -> tuple[F64, PoseGraph]:
    """Variance component estimation: poses (n, 3) and a graph by the noise that closures tell.

    What closures left over of each step says how noisy steps were (Helmert 1907), with the
    redundancy of each measurement after Förstner (1979, "Ein Verfahren zur Schätzung von
    Varianz- und Kovarianzkomponenten"): one factor for the variances of all steps in each of
    forward, left and turn. Steps err alike too, by their scale: poses lean on none of them more
    than was stated, while the uncertainty of the graph that comes back is as told, and that of the
    heading at the start, which no redundancy shows, as closures differ in heading. `poses` solve
    the graph as it is. Both as they were where it has no closures.
    """
    if not (parameters.noise_rounds and graph.is_closure.any()):
        return poses, graph
    pattern = pattern_of(graph.edges, len(poses))
    told, factor, trial = graph, np.ones(3), poses
    for _ in range(parameters.noise_rounds):
        factor = factor * variance_factors(told, trial, parameters)
        factor = np.maximum(factor, parameters.least_step_noise**2)
        told = _with_step_variances(graph, factor)
        trial, _ = settle(told, trial, pattern, parameters.anchor_sigma, SETTLING_STEPS)
    leaning = _with_step_variances(graph, np.maximum(factor, 1.0))
    poses, _ = settle(leaning, poses, pattern, parameters.anchor_sigma, SETTLING_STEPS)
    return poses, _with_told_start(told, graph, poses, parameters)


def variance_factors(graph: PoseGraph, poses: F64, parameters: GraphParameters) -> F64:
    """Variance components (3) of the steps: how much larger they are than the graph says.

    Squared whitened residuals against the redundancy that they have; `noise_prior` of both speak
    for the variances as stated.
    """
    pattern = pattern_of(graph.edges, len(poses))
    known = marginal_covariances(equations_at(graph, poses, pattern, parameters.anchor_sigma))
    steps = edges_of(without_drift(graph, steady_drift(graph, poses)), ~graph.is_closure)
    predicted = predicted_covariance(known, poses, steps.edges, steps.measurements)
    residual = residuals(poses, steps.edges, steps.measurements)
    squared = residual * np.einsum("eab,eb->ea", steps.information, residual)
    redundancy = 1 - np.einsum("eab,eba->ea", steps.information, predicted)
    prior = parameters.noise_prior
    return np.asarray((prior + squared.sum(axis=0)) / (prior + redundancy.sum(axis=0)))


def _with_step_variances(graph: PoseGraph, factor: F64) -> PoseGraph:
    """The variances of steps times a factor (3); what a step has beyond the usual stays."""
    steps = ~graph.is_closure
    stated = 1 / np.diagonal(graph.information[steps], axis1=1, axis2=2)
    usual = np.minimum(stated, np.median(stated, axis=0))
    shrink = np.sqrt(stated / (stated + (factor - 1) * usual))
    information = graph.information.copy()
    information[steps] *= shrink[:, :, None] * shrink[:, None, :]
    return replace(graph, information=information)


def _with_told_start(
    told: PoseGraph, stated: PoseGraph, poses: F64, parameters: GraphParameters
) -> PoseGraph:
    """The first step turned aside by as much as headings differ where a place was passed again.

    Walkers differ by three times in how far their phones point aside, and by how much at the start
    is what turns a whole map. Never less than stated; an odometry whose first step is no less sure
    than the others has no phone that points aside.
    """
    variances = 1 / stated.information[~stated.is_closure, 2, 2]
    aside = variances[0] - np.median(variances)
    closures = edges_of(told, told.is_closure & (told.information[:, 2, 2] > LEAST_TURN))
    turned = residuals(poses, closures.edges, closures.measurements)[:, 2]
    more = np.sum(turned**2 - aside) / max(parameters.noise_prior + len(turned), 1.0)
    if min(aside, more) <= 0:
        return told
    first = np.argmin(told.is_closure)
    information = told.information.copy()
    shrink = np.sqrt(1 / (1 + more * information[first, 2, 2]))
    information[first] *= np.outer([1.0, 1.0, shrink], [1.0, 1.0, shrink])
    return replace(told, information=information)


@dataclass(frozen=True, eq=False)
class Equations:
    """Gauss-Newton normal equations of a graph at some poses, factored (block L D L').

    `cost` is half the sum of the squared whitened residuals. A steady drift of the heading is
    eliminated: it is what suits the poses best, and the inverse is that of the factor and the
    outer product of `drift_lever` (n, 3) more (Schur complement).
    """

    factor: Factor
    gradient: F64
    cost: float
    drift_lever: F64 | None = None

    def step(self) -> F64:
        """The Gauss-Newton step (n, 3), to be taken backwards."""
        step = solution(self.factor, self.gradient)
        if self.drift_lever is None:
            return step
        return np.asarray(step + self.drift_lever * np.vdot(self.drift_lever, self.gradient))


def settle(
    graph: PoseGraph, poses: F64, pattern: Pattern, anchor_sigma: float, steps: int
) -> tuple[F64, Equations]:
    """Gauss-Newton: poses after at most `steps` from a start nearby, and the equations there.

    It ends as the Newton decrement, half of gradient times step, promises next to nothing.
    """
    equations = equations_at(graph, poses, pattern, anchor_sigma)
    for _ in range(steps):
        step = equations.step()
        if np.vdot(equations.gradient, step) / 2 < SETTLED * equations.cost:
            break
        moved = equations_at(graph, compose(poses, -step), pattern, anchor_sigma)
        if moved.cost >= equations.cost:
            break
        poses, equations = compose(poses, -step), moved
    return poses, equations


def equations_at(graph: PoseGraph, poses: F64, pattern: Pattern, anchor_sigma: float) -> Equations:
    """Gauss-Newton normal equations at `poses` (n, 3), of which the first is held where it is.

    Raises RuntimeError where the edges do not hold the poses together.
    """
    drift = steady_drift(graph, poses)
    graph = without_drift(graph, drift)
    residual, near, far = jacobians(poses, graph.edges, graph.measurements)
    i, j = graph.edges.T
    near_w = np.swapaxes(near, 1, 2) @ graph.information
    far_w = np.swapaxes(far, 1, 2) @ graph.information
    start, anchor = np.zeros(1, dtype=np.int64), np.eye(3)[None] * (1 / anchor_sigma) ** 2
    rows, columns = np.concatenate([i, j, i, start]), np.concatenate([i, j, j, start])
    blocks = np.concatenate([near_w @ near, far_w @ far, near_w @ far, anchor])
    weighed = np.concatenate([near_w, far_w])

    def pull(of: F64) -> F64:
        pulls = weighed @ np.concatenate([of, of])[:, :, None]
        return summed(pulls[:, :, 0], np.concatenate([i, j]), len(poses))

    cost = 0.5 * (float(np.einsum("ea,eab,eb", residual, graph.information, residual)) + drift**2)
    factor = factored(pattern, rows, columns, blocks)
    if graph.drift_turn_rad is None:
        return Equations(factor, pull(residual), cost)
    turning = drift_jacobian(graph, residual)
    own = 1.0 + float(np.einsum("ea,eab,eb", turning, graph.information, turning))
    border = pull(turning)
    lever = solution(factor, border)
    return Equations(
        factor, pull(residual), cost, lever / np.sqrt(own - float(np.vdot(border, lever)))
    )


def steady_drift(graph: PoseGraph, poses: F64) -> float:
    """How many sigmas of steady heading drift suit the poses best; 0 where the graph has none.

    A heading that drifts, as a gyroscope with a constant bias makes it, turns every step alike.
    """
    if graph.drift_turn_rad is None:
        return 0.0
    residual = residuals(poses, graph.edges, graph.measurements)
    turning = drift_jacobian(graph, residual)
    weighed = np.einsum("ea,eab->eb", turning, graph.information)
    return -float(np.vdot(weighed, residual) / (1.0 + np.vdot(weighed, turning)))


def without_drift(graph: PoseGraph, drift: float) -> PoseGraph:
    """The graph whose steps turn as if the heading had not drifted by so many sigmas."""
    if graph.drift_turn_rad is None:
        return graph
    turned = graph.measurements.copy()
    turned[:, 2] = wrap_angle(turned[:, 2] + drift * graph.drift_turn_rad)
    return replace(graph, measurements=turned)


def drift_jacobian(graph: PoseGraph, residual: F64) -> F64:
    """Derivatives (e, 3) of the residuals by a sigma of steady heading drift."""
    assert graph.drift_turn_rad is not None
    x, y, _ = residual.T
    straight = np.column_stack([-y / 2, x / 2, np.ones(len(x))])
    return np.asarray(-graph.drift_turn_rad[:, None] * straight)


def half_square(graph: PoseGraph, poses: F64) -> float:
    """Half the sum of the squared whitened residuals, as GTSAM counts it, and of the drift."""
    drift = steady_drift(graph, poses)
    graph = without_drift(graph, drift)
    residual = residuals(poses, graph.edges, graph.measurements)
    return 0.5 * (float(np.einsum("ea,eab,eb", residual, graph.information, residual)) + drift**2)


@dataclass(frozen=True, eq=False)
class MarginalCovariances:
    """Blocks of the inverse normal matrix, in the poses' own frames; see `covariance_of`."""

    pattern: Pattern
    blocks: F64
    drift_lever: F64 | None = None


def marginal_covariances(equations: Equations) -> MarginalCovariances:
    """Marginal covariances of single poses and of neighbours in the pattern."""
    blocks = inverse_blocks(equations.factor)
    return MarginalCovariances(equations.factor.pattern, blocks, equations.drift_lever)


def covariance_of(known: MarginalCovariances, i: I64, j: I64) -> F64:
    """Covariances (k, 3, 3) between poses i and j (k), which the pattern must join."""
    at, transposed = stored_at(known.pattern, i, j)
    blocks = known.blocks[at]
    upright = np.where(transposed[:, None, None], np.swapaxes(blocks, 1, 2), blocks)
    if known.drift_lever is None:
        return upright
    return np.asarray(upright + known.drift_lever[i, :, None] * known.drift_lever[j, None, :])


def predicted_covariance(
    known: MarginalCovariances, poses: F64, edges: I64, measurements: F64
) -> F64:
    """Covariances (k, 3, 3) of what each edge would measure, in its residual's frame."""
    _, near, far = jacobians(poses, edges, measurements)
    i, j = edges.T
    across = near @ covariance_of(known, i, j) @ np.swapaxes(far, 1, 2)
    total = near @ covariance_of(known, i, i) @ np.swapaxes(near, 1, 2)
    total += far @ covariance_of(known, j, j) @ np.swapaxes(far, 1, 2)
    return np.asarray(total + across + np.swapaxes(across, 1, 2))


def chi_square(residual: F64, covariance: F64) -> F64:
    """Squared Mahalanobis lengths (k) of residuals (k, 3) under covariances (k, 3, 3)."""
    whitened = np.linalg.solve(covariance, residual[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("ka,ka->k", residual, whitened))


def residuals(poses: F64, edges: I64, measurements: F64) -> F64:
    """Residuals (e, 3) of poses (n, 3): the SE(2) logarithm of what each measurement misses.

    In the frame of the edge's end, as in GTSAM.
    """
    return logarithm(between(measurements, between(poses[edges[:, 0]], poses[edges[:, 1]])))


def jacobians(poses: F64, edges: I64, measurements: F64) -> tuple[F64, F64, F64]:
    """Residuals (e, 3) and their Jacobians (e, 3, 3) by the near and the far pose.

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


def logarithm(move: F64) -> F64:
    """The SE(2) logarithm (..., 3): the velocity that leads to `move` (..., 3) in unit time."""
    half = move[..., 2] / 2
    straight = 1.0 / np.sinc(half / np.pi) * np.cos(half)
    x = straight * move[..., 0] + half * move[..., 1]
    y = straight * move[..., 1] - half * move[..., 0]
    return np.stack([x, y, move[..., 2]], axis=-1)


def carried(pose: F64, covariance: F64) -> F64:
    """Covariances (..., 3, 3) seen in the outer frame of `pose`."""
    matrix = adjoint(pose)
    return np.asarray(matrix @ covariance @ np.swapaxes(matrix, -1, -2))


def adjoint(pose: F64) -> F64:
    """SE(2) adjoints (..., 3, 3): they carry a small move from the pose's frame outwards."""
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    zero, one = np.zeros_like(cos), np.ones_like(cos)
    rows = [[cos, -sin, pose[..., 1]], [sin, cos, -pose[..., 0]], [zero, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
