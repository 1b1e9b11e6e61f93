"""Which closures to believe: those that fit, from short loops to long ones.

A run of closures is believed where it fits what the graph predicts there, within the uncertainty
of that prediction. The most certain predictions are asked first; each run believed straightens the
walk and makes the next prediction more certain, until what is false no longer fits. Single
closures come last, and must fit much better than chance would.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.stats import chi2

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.values import Closures, PoseGraph
from elfslam.line.graph.blocks import pattern_of
from elfslam.line.graph.build import believing, closure_edges, covariance_of_edges, edges_of
from elfslam.line.graph.linear import (
    Equations,
    chi_square,
    covariance_of,
    half_square,
    jacobians,
    predicted_covariance,
    residuals,
    settle,
    uncertainty,
)
from elfslam.line.graph.parameters import GraphParameters
from elfslam.line.graph.runs import chain_of, find_runs, forward
from elfslam.line.graph.solve import rotation_first

SETTLING_STEPS = 10
LAST_ROUNDS = 20
"""Believing and doubting single closures in turn ends by itself after a few."""


@dataclass(frozen=True, eq=False)
class Fit:
    """How closures (k) fit a prediction: residual, its covariance, and squared length."""

    residual: F64
    covariance: F64
    squared: F64


def choose_closures(graph: PoseGraph, parameters: GraphParameters) -> tuple[F64, Bool]:
    """Poses (n, 3) near the solution, and the mask (k) of closures to believe.

    Raises InputError where the steps of the graph are no chain.
    """
    closures = edges_of(graph, graph.is_closure)
    limit = float(chi2.ppf(parameters.inlier_probability, 3))
    runs = find_runs(chain_of(graph), forward(closures), parameters.run_reach, limit)
    poses, kept = graph.initial, np.zeros(len(closures.edges), dtype=bool)
    waiting = np.flatnonzero(runs.size >= parameters.run_closures)
    while len(waiting):
        middles = edges_of(closures, runs.middle[waiting])
        poses, equations = _settled(graph, kept, poses, middles.edges, parameters)
        fit = fit_of(middles, poses, equations)
        fits = fit.squared <= limit
        if not fits.any():
            break
        size = np.linalg.slogdet(fit.covariance)[1]
        taken = fits & (log_odds(fit, poses) >= np.log(parameters.least_odds))
        taken[np.argmin(np.where(fits, size, np.inf))] = True
        kept |= np.isin(runs.run, waiting[taken])
        waiting = waiting[~taken]
    return _revised(graph, closures, kept, poses, limit, parameters)


def agreeing(graph: PoseGraph, further: Closures, parameters: GraphParameters) -> Bool:
    """Which further closures (k) fit the graph as its own closures leave it; all without any.

    Raises InputError where the steps of the graph are no chain.
    """
    if not graph.is_closure.any():
        return np.ones(len(further.i), dtype=bool)
    poses, kept = choose_closures(graph, parameters)
    asked = closure_edges(graph.initial, further)
    poses, equations = _settled(graph, kept, poses, asked.edges, parameters)
    limit = float(chi2.ppf(parameters.agreeing_probability, 3))
    return np.asarray(fit_of(asked, poses, equations).squared <= limit)


def _revised(
    graph: PoseGraph,
    closures: PoseGraph,
    kept: Bool,
    poses: F64,
    limit: float,
    parameters: GraphParameters,
) -> tuple[F64, Bool]:
    """Doubt each closure that does not fit, believe each that fits too well for chance."""
    for _ in range(LAST_ROUNDS):
        poses, equations = _settled(graph, kept, poses, closures.edges[:0], parameters)
        residual = residuals(poses, closures.edges, closures.measurements)
        wanted = kept & (chi_square(residual, covariance_of_edges(closures)) <= limit)
        asked = np.flatnonzero(~kept & _within_reach(closures, poses, equations, limit))
        candidates = edges_of(closures, asked)
        _, equations = _settled(graph, kept, poses, candidates.edges, parameters)
        fit = fit_of(candidates, poses, equations)
        sure = log_odds(fit, poses) >= np.log(parameters.least_odds)
        wanted[asked] = (fit.squared <= limit) & sure
        if (wanted == kept).all():
            break
        kept = wanted
    return poses, kept


def _within_reach(closures: PoseGraph, poses: F64, equations: Equations, limit: float) -> Bool:
    """Closures (k) that could fit, by the uncertainty of either pose alone.

    A difference varies by no more than twice the sum of both variances, so that whoever is out of
    reach here fits nowhere; it need not be asked in full, which costs far more.
    """
    residual, near, far = jacobians(poses, closures.edges, closures.measurements)
    known, (i, j) = uncertainty(equations), closures.edges.T
    total = near @ covariance_of(known, i, i) @ np.swapaxes(near, 1, 2)
    total += far @ covariance_of(known, j, j) @ np.swapaxes(far, 1, 2)
    widest = bent(2 * total + covariance_of_edges(closures))
    return np.asarray(chi_square(residual, widest) <= limit)


def _settled(
    graph: PoseGraph, kept: Bool, poses: F64, asked: I64, parameters: GraphParameters
) -> tuple[F64, Equations]:
    """The poses that the believed closures give, ready to be asked about other pairs."""
    believed = believing(graph, kept)
    pattern = pattern_of(np.vstack([believed.edges, asked]), len(poses))
    start = min(poses, rotation_first(believed), key=partial(half_square, believed))
    return settle(believed, start, pattern, parameters.anchor_sigma, SETTLING_STEPS)


def fit_of(closures: PoseGraph, poses: F64, equations: Equations) -> Fit:
    """How closures that have no say yet fit the poses."""
    edges, measured = closures.edges, closures.measurements
    residual = residuals(poses, edges, measured)
    predicted = predicted_covariance(uncertainty(equations), poses, edges, measured)
    covariance = bent(predicted + covariance_of_edges(closures))
    return Fit(residual, covariance, chi_square(residual, covariance))


def bent(covariance: F64) -> F64:
    """Covariances (k, 3, 3) widened for the way that an uncertain heading bends.

    To second order, a heading error of sigma s shortens a lever by s^2 / 2 of its length, where
    to first order it only moves its end sideways by s of it.
    """
    widened = covariance.copy()
    turned = np.minimum(covariance[:, 2, 2], 1.0) / 4
    along = turned * (covariance[:, 0, 0] + covariance[:, 1, 1])
    widened[:, 0, 0] += along
    widened[:, 1, 1] += along
    return widened


def log_odds(fit: Fit, poses: F64) -> F64:
    """How much likelier (k, natural logarithm) a residual is than a chance meeting on the floor."""
    floor_m2 = float(np.prod(np.maximum(np.ptp(poses[:, :2], axis=0), 1.0)))
    density = -0.5 * fit.squared - 0.5 * np.linalg.slogdet(2 * np.pi * fit.covariance)[1]
    return np.asarray(density + np.log(floor_m2 * 2 * np.pi))
