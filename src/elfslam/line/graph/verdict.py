"""How many closures the final trajectory bears out, of those believed and of those rejected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from elfslam.base.arrays import F64
from elfslam.base.values import PoseGraph, Trajectory
from elfslam.line.graph.blocks import pattern_of
from elfslam.line.graph.build import believing, covariance_of_edges, edges_of
from elfslam.line.graph.linear import (
    chi_square,
    equations_at,
    predicted_covariance,
    residuals,
    uncertainty,
)
from elfslam.line.graph.parameters import GraphParameters

LEAST_SHARE = 1e-6
"""Of a measurement's covariance, what is left at least for those who alone decide their place."""


@dataclass(frozen=True)
class Verdict:
    """Counts of closures: how many were believed or rejected, and how many of each agree.

    A closure agrees where its residual lies inside the chi-square quantile `probability`. If all
    is well nearly that share of the believed ones agree, and hardly any of the rejected.
    """

    believed: int
    believed_agreeing: int
    rejected: int
    rejected_agreeing: int
    probability: float

    def __str__(self) -> str:
        return (
            f"{self.believed_agreeing} of {self.believed} believed closures and "
            f"{self.rejected_agreeing} of {self.rejected} rejected ones agree with the trajectory "
            f"(within {self.probability:.0%} of chance)"
        )


def judge(graph: PoseGraph, trajectory: Trajectory, parameters: GraphParameters) -> Verdict:
    """Hold every closure of a graph against the trajectory that came of it.

    A believed closure is asked as if it had had no say: what it bent towards itself is taken out
    of its residual's covariance. Raises RuntimeError where the edges do not hold the poses.
    """
    kept = trajectory.closure_weights > 0.5
    squared = agreement(graph, trajectory, parameters)
    agrees = squared <= chi2.ppf(parameters.inlier_probability, 3)
    return Verdict(
        int(kept.sum()),
        int((kept & agrees).sum()),
        int((~kept).sum()),
        int((~kept & agrees).sum()),
        parameters.inlier_probability,
    )


def agreement(graph: PoseGraph, trajectory: Trajectory, parameters: GraphParameters) -> F64:
    """Squared Mahalanobis length (k) of each closure's residual; chi-square of 3 if it is true."""
    kept, poses = trajectory.closure_weights > 0.5, trajectory.world_from_body
    closures = edges_of(graph, graph.is_closure)
    pattern = pattern_of(graph.edges, len(poses))
    equations = equations_at(believing(graph, kept), poses, pattern, parameters.anchor_sigma)
    edges, measured = closures.edges, closures.measurements
    predicted = predicted_covariance(uncertainty(equations), poses, edges, measured)
    own = covariance_of_edges(closures)
    without = own - predicted + LEAST_SHARE * own
    covariance = np.where(kept[:, None, None], without, own + predicted)
    return chi_square(residuals(poses, edges, measured), covariance)
