"""Pose graph optimisation: outlier rejection among loop closures, then Levenberg-Marquardt (GTSAM).

Who walks the same stretch twice meets many known places in a row, and each says the same of the
way between; a false closure by chance has no such company. Pairwise consistency is due to Mangelson
et al. (ICRA 2018, "Pairwise consistent measurement set maximization").

A run of closures is believed where it fits what the graph predicts there, within the uncertainty
of that prediction. The most certain predictions are asked first; each run believed corrects the
walk and makes the next prediction more certain, until what is false no longer fits. Single
closures come last, and must fit much better than chance would.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.stats import chi2

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.errors import InputError, NoAnswerError
from elfslam.base.geometry import between, compose, inverse, shifted
from elfslam.base.values import Closures, PoseGraph, Trajectory
from elfslam.stages.graph.blocks import pattern_of
from elfslam.stages.graph.building import (
    GraphParameters,
    believing,
    closure_edges,
    covariance_of_edges,
    edges_of,
    rotation_first,
    seen_from_start,
)
from elfslam.stages.graph.uncertainty import (
    SETTLING_STEPS,
    Equations,
    MarginalCovariances,
    carried,
    chi_square,
    half_square,
    judge,
    known_at,
    least_squared,
    left_out_squared,
    marginal_covariances,
    pose_covariances,
    predicted_covariance,
    residuals,
    scale_covariance,
    second_order_inflated,
    settle,
    steady_drift,
    with_own_noise,
    without_drift,
)

if TYPE_CHECKING:
    import gtsam

LAST_ROUNDS = 20
"""Believing and doubting single closures in turn ends by itself after a few."""
MOST_OF_ALL = 0.2
"""Of all closures; a run of more is not doubted."""
MOST_RUNS = 64
"""Where runs are more, leaving out each takes too long, and those that are true prevail."""
LEAST_RELIEF = 0.1
"""Of what chance allows, by the first run left out; others are not asked for if it brings less."""
MOST_LEFT_OUT = 6
"""Runs left out together."""
MOST_ASKED = 12
"""Runs asked again once the first is left out."""


def choose_closures(
    graph: PoseGraph, parameters: GraphParameters, *, by_hand: Bool | None = None
) -> tuple[F64, Bool]:
    """Outlier rejection: poses (n, 3) near the solution, and the mask (k) of closures to believe.

    Those made `by_hand` (k) are no chance: they are believed at first, and need no company.
    Raises InputError where the steps of the graph are no chain.
    """
    closures = edges_of(graph, graph.is_closure)
    limit = float(chi2.ppf(parameters.inlier_probability, 3))
    runs = find_runs(chain_of(graph), forward(closures), parameters.run_reach, limit)
    poses = graph.initial
    by_hand = np.zeros(len(closures.edges), dtype=bool) if by_hand is None else by_hand
    kept = by_hand.copy()
    waiting = np.flatnonzero(runs.size >= parameters.run_closures)
    batch = len(waiting)
    while len(waiting):
        middles = edges_of(closures, runs.middle[waiting])
        poses, equations = _settled(graph, kept, poses, middles.edges, parameters)
        fit = fit_of(middles, poses, marginal_covariances(equations))
        fits = fit.squared <= limit
        if not fits.any():
            break
        likely = fits & (log_odds(fit, poses) >= np.log(parameters.least_odds))
        size = np.where(fits, np.linalg.slogdet(fit.covariance)[1], np.inf)
        surest = np.argsort(size, kind="stable")[: fits.sum()]
        asked = runs.middle[waiting[surest]]
        agreed, poses = _jointly_consistent(
            graph, kept, asked[:batch], poses, equations, parameters
        )
        taken = likely | np.isin(runs.middle[waiting], agreed)
        kept |= np.isin(runs.run, waiting[taken])
        waiting, batch = waiting[~taken], 2 * len(agreed)
    poses, kept = _revised(graph, closures, kept, by_hand, poses, limit, parameters)
    for _ in range(LAST_ROUNDS):
        relieved = _relieved(graph, kept, by_hand, poses, parameters)
        if relieved is None:
            break
        poses, kept = _revised(
            graph, closures, relieved[1], by_hand, relieved[0], limit, parameters
        )
    return poses, kept


def _jointly_consistent(
    graph: PoseGraph,
    kept: Bool,
    asked: I64,
    poses: F64,
    equations: Equations,
    parameters: GraphParameters,
) -> tuple[I64, F64]:
    """Which of the closures asked about (k), surest first, can all be true; and the poses then.

    The cost may rise by no more than chance allows, and each must fit what the graph and all the
    others predict. Those that do not are left out of the next trial, or the less sure half if
    they are many. The surest is never left alone: by itself it is held for consistent.
    """
    closures = edges_of(graph, graph.is_closure)
    while len(asked) > 1:
        together = kept | np.isin(np.arange(len(kept)), asked)
        trial, solved = _settled(graph, together, poses, graph.edges[:0], parameters)
        left_out = left_out_squared(edges_of(closures, asked), trial, marginal_covariances(solved))
        each, joint = 1 - (1 - parameters.inlier_probability) / len(asked), 3 * len(asked)
        fits = left_out <= chi2.ppf(each, 3)
        rise = 2 * (solved.cost - equations.cost)
        if fits.all() and rise <= chi2.ppf(parameters.inlier_probability, joint):
            return asked, trial
        half = len(asked) // 2
        asked = asked[fits] if half < fits.sum() < len(asked) else asked[:half]
    return asked, poses


def agreeing(graph: PoseGraph, further: Closures, parameters: GraphParameters) -> Bool:
    """Gating: which further closures (k) fit the graph as its own leave it; all without any.

    Raises InputError where the steps of the graph are no chain.
    """
    if not graph.is_closure.any():
        return np.ones(len(further.i), dtype=bool)
    graph = seen_from_start(graph)
    poses, kept = choose_closures(graph, parameters)
    asked = closure_edges(graph.initial, further)
    poses, equations = _settled(graph, kept, poses, asked.edges, parameters)
    limit = float(chi2.ppf(parameters.agreeing_probability, 3))
    return np.asarray(fit_of(asked, poses, marginal_covariances(equations)).squared <= limit)


def expected(graph: PoseGraph, further: Closures, parameters: GraphParameters) -> tuple[F64, F64]:
    """What the solution of a graph expects of further closures (k); both in nats.

    The log odds of each to a chance meeting anywhere on the floor, -inf where it is excluded or
    nothing was corrected; and the mutual information of the closure and the trajectory (Ila et
    al., T-RO 2010, "Information-based compact pose SLAM"). Raises NoAnswerError where the edges
    are degenerate, InputError where the steps are no chain.
    """
    odds, gain = np.full(len(further.i), -np.inf), np.zeros(len(further.i))
    if not graph.is_closure.any():
        return odds, gain
    graph = seen_from_start(graph)
    with solving(graph):
        poses, kept = choose_closures(graph, parameters)
        poses, believed = with_own_noise(believing(graph, kept), poses, parameters)
        limit = float(chi2.ppf(parameters.inlier_probability, 3))
        asked = closure_edges(poses, further)
        known = known_at(believed, poses, asked.edges[:0], parameters.anchor_sigma)
        near = np.flatnonzero(least_squared(known, poses, asked) <= limit)
        asked = edges_of(asked, near)
        fit = fit_of(asked, poses, known_at(believed, poses, asked.edges, parameters.anchor_sigma))
    odds[near] = np.where(fit.squared <= limit, log_odds(fit, poses), -np.inf)
    own = np.linalg.slogdet(covariance_of_edges(asked))[1]
    gain[near] = (np.linalg.slogdet(fit.covariance)[1] - own) / 2
    return odds, gain


def _revised(
    graph: PoseGraph,
    closures: PoseGraph,
    kept: Bool,
    by_hand: Bool,
    poses: F64,
    limit: float,
    parameters: GraphParameters,
) -> tuple[F64, Bool]:
    """Doubt each closure that does not fit, believe each that fits too well for chance.

    What was made by hand and has no company bends the walk towards itself: it is asked whether it
    fits what the rest predicts.
    """
    for _ in range(LAST_ROUNDS):
        poses, equations = _settled(graph, kept, poses, closures.edges[:0], parameters)
        residual = residuals(poses, closures.edges, closures.measurements)
        known = marginal_covariances(equations)
        squared, alone = chi_square(residual, covariance_of_edges(closures)), kept & by_hand
        left_out = left_out_squared(edges_of(closures, alone), poses, known)
        squared[alone] = np.maximum(squared[alone], left_out)
        wanted = kept & (squared <= limit)
        out_of_reach = least_squared(known, poses, closures) > limit
        asked = np.flatnonzero(~kept & ~out_of_reach)
        candidates = edges_of(closures, asked)
        believed = believing(graph, kept)
        fit = fit_of(
            candidates, poses, known_at(believed, poses, candidates.edges, parameters.anchor_sigma)
        )
        sure = log_odds(fit, poses) >= np.log(parameters.least_odds)
        wanted[asked] = (fit.squared <= limit) & sure
        if (wanted == kept).all():
            break
        kept = wanted
    return poses, kept


def _relieved(
    graph: PoseGraph, kept: Bool, by_hand: Bool, poses: F64, parameters: GraphParameters
) -> tuple[F64, Bool] | None:
    """Backward elimination: poses and mask (k) without the runs that bend the walk; None if none.

    Runs are consistency clusters. False ones that support each other fit once they have bent the
    walk together, and no residual tells them; but without them the cost falls by more than chance
    allows. The run without which it falls most is left out first, then the next. What was made by
    hand and runs of many closures stay.
    """
    chosen = np.flatnonzero(kept)
    closures = edges_of(edges_of(graph, graph.is_closure), chosen)
    limit = float(chi2.ppf(parameters.inlier_probability, 3))
    runs = find_runs(chain_of(graph), forward(closures), parameters.run_reach, limit)
    doubted = runs.size <= MOST_OF_ALL * len(chosen)
    doubted[runs.run[by_hand[chosen]]] = False
    asked = np.flatnonzero(doubted)
    if not 0 < len(asked) <= len(runs.size) <= MOST_RUNS:
        return None
    poses, equations = _settled(graph, kept, poses, graph.edges[:0], parameters)
    chance = (1 - parameters.inlier_probability) / len(asked)  # Bonferroni
    most, best, left = 1.0, None, kept
    for _ in range(min(MOST_LEFT_OUT, len(asked))):
        trials = [
            _left_out(graph, left, chosen[runs.run == run], poses, parameters) for run in asked
        ]
        cost = np.array([each[2] for each in trials])
        limits = [chi2.isf(chance, 3 * np.sum(kept & ~each[1])) for each in trials]
        relief = 2 * (equations.cost - cost) / limits
        order = np.argsort(relief)[::-1]
        poses, left, _ = trials[order[0]]
        if relief[order[0]] < LEAST_RELIEF:
            break
        if relief[order[0]] > most:
            most, best = relief[order[0]], (poses, left)
        asked = asked[order[1:MOST_ASKED]]
    return best


def _left_out(
    graph: PoseGraph, kept: Bool, run: I64, poses: F64, parameters: GraphParameters
) -> tuple[F64, Bool, float]:
    """Poses, the mask (k) and the cost without the closures of a run."""
    left = kept.copy()
    left[run] = False
    poses, equations = _settled(graph, left, poses, graph.edges[:0], parameters)
    return poses, left, equations.cost


def _settled(
    graph: PoseGraph, kept: Bool, poses: F64, asked: I64, parameters: GraphParameters
) -> tuple[F64, Equations]:
    """The poses that the believed closures give, ready to be asked about other pairs."""
    believed = believing(graph, kept)
    pattern = pattern_of(np.vstack([believed.edges, asked]), len(poses))
    return settle(
        believed, plausible_start(believed, poses), pattern, parameters.anchor_sigma, SETTLING_STEPS
    )


def plausible_start(graph: PoseGraph, poses: F64) -> F64:
    """Poses (n, 3) to solve from: those given, if edges agree with them; else the cheaper guess.

    The expectation of twice the cost is the number of redundant measurements.
    """
    redundant = 3 * (len(graph.edges) - len(poses) + 1)
    if 2 * half_square(graph, poses) <= redundant:
        return poses
    return min(poses, rotation_first(graph), key=partial(half_square, graph))


@dataclass(frozen=True, eq=False)
class Fit:
    """Innovations of closures (k): their covariance, and squared Mahalanobis length."""

    covariance: F64
    squared: F64


def fit_of(closures: PoseGraph, poses: F64, known: MarginalCovariances) -> Fit:
    """Innovations of closures that have no say yet in the poses."""
    edges, measured = closures.edges, closures.measurements
    residual = residuals(poses, edges, measured)
    predicted = predicted_covariance(known, poses, edges, measured)
    covariance = second_order_inflated(predicted + covariance_of_edges(closures))
    return Fit(covariance, chi_square(residual, covariance))


def log_odds(fit: Fit, poses: F64) -> F64:
    """Log-likelihood ratio (k) of each residual to a chance meeting anywhere on the floor."""
    floor_m2 = float(np.prod(np.maximum(np.ptp(poses[:, :2], axis=0), 1.0)))
    density = -0.5 * fit.squared - 0.5 * np.linalg.slogdet(2 * np.pi * fit.covariance)[1]
    return np.asarray(density + np.log(floor_m2 * 2 * np.pi))


@dataclass(frozen=True, eq=False)
class ConsistencyClusters:
    """Which run (k) each closure belongs to, and per run its best connected closure and its size.

    Of r runs every closure has one; a closure without company is a run of its own.
    """

    run: I64
    middle: I64
    size: I64


def find_runs(chain: Chain, closures: Forward, reach: int, limit: float) -> ConsistencyClusters:
    """Connected components of the pairwise consistency graph of closures."""
    count = len(closures.low)
    pairs, agree = agreeing_pairs(chain, closures, reach, limit)
    a, b = pairs[agree].T
    links = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    _, run = connected_components(links, directed=False)
    friends = np.bincount(pairs[agree].ravel(), minlength=count)
    order = np.lexsort((-friends, run))
    _, first = np.unique(run[order], return_index=True)
    return ConsistencyClusters(run.astype(np.int64), order[first], np.bincount(run))


def agreeing_pairs(chain: Chain, closures: Forward, reach: int, limit: float) -> tuple[I64, Bool]:
    """Pairwise consistency: pairs (p, 2) of near closures, and whether dead reckoning agrees.

    `limit` bounds the squared Mahalanobis length of what is left of the loop through both.
    """
    near = cKDTree(np.column_stack([closures.low, closures.high]))
    pairs = np.asarray(near.query_pairs(reach, p=np.inf, output_type="ndarray"), dtype=np.int64)
    a, b = pairs.reshape(-1, 2).T
    low, high, moves = closures.low, closures.high, closures.low_from_high
    hop = between(chain.poses[high[a]], chain.poses[high[b]])
    onward = compose(moves[a], hop)
    predicted = compose(between(chain.poses[low[b]], chain.poses[low[a]]), onward)
    covariance = closures.covariance[b] + chain_covariance(chain, high[a], high[b])
    covariance += carried(inverse(hop), closures.covariance[a])
    covariance += carried(inverse(onward), chain_covariance(chain, low[b], low[a]))
    return pairs, chi_square(between(moves[b], predicted), covariance) <= limit


@dataclass(frozen=True, eq=False)
class Chain:
    """Dead reckoning: poses (n, 3), and how their errors add up along the way (n, 3, 3)."""

    poses: F64
    growth: F64


def chain_of(graph: PoseGraph) -> Chain:
    """The steps of a graph as a chain.

    Raises InputError where they do not lead from each pose to the next.
    """
    steps = edges_of(graph, ~graph.is_closure)
    count = len(graph.initial) - 1
    order = np.argsort(steps.edges[:, 0], kind="stable")
    wanted = np.column_stack([np.arange(count), np.arange(1, count + 1)])
    if len(order) != count or (steps.edges[order] != wanted).any():
        raise InputError(
            f"pose graph: {len(order)} steps do not lead through its {count + 1} poses one by one, "
            "as rejecting closures needs; set graph.robust=false"
        )
    covariance = carried(graph.initial[1:], covariance_of_edges(steps)[order])
    growth = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(covariance, axis=0)])
    return Chain(graph.initial, growth)


def chain_covariance(chain: Chain, i: I64, j: I64) -> F64:
    """Covariances (k, 3, 3) of the dead reckoning from pose i to pose j, in the frame of j."""
    sign = np.sign(j - i)[:, None, None]
    return carried(inverse(chain.poses[j]), sign * (chain.growth[j] - chain.growth[i]))


@dataclass(frozen=True, eq=False)
class Forward:
    """Closures seen from their earlier pose: poses low < high (k), low_from_high, covariance."""

    low: I64
    high: I64
    low_from_high: F64
    covariance: F64


def forward(closures: PoseGraph) -> Forward:
    """The closures of a graph, those that look back turned round."""
    i, j = closures.edges.T
    back, measured, covariance = i > j, closures.measurements, covariance_of_edges(closures)
    turned = np.where(back[:, None, None], carried(measured, covariance), covariance)
    moves = np.where(back[:, None], inverse(measured), measured)
    return Forward(np.minimum(i, j), np.maximum(i, j), moves, turned)


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
            poses = solve(believed, plausible_start(believed, poses), parameters)
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


def solve(graph: PoseGraph, start: F64, parameters: GraphParameters) -> F64:
    """Levenberg-Marquardt from a start (n, 3), then Gauss-Newton with the drift of the heading.

    Raises RuntimeError or ValueError, as GTSAM says it, where the edges are degenerate.
    """
    import gtsam

    problem = as_gtsam(without_drift(graph, steady_drift(graph, start)), parameters.anchor_sigma)
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(parameters.iterations)
    solved = gtsam.LevenbergMarquardtOptimizer(problem, as_values(start), settings).optimize()
    poses = as_poses(solved, len(graph.initial))
    if graph.drift_turn_rad is None:
        return poses
    pattern = pattern_of(graph.edges, len(poses))
    return settle(graph, poses, pattern, parameters.anchor_sigma, parameters.iterations)[0]


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
