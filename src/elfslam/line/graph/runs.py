"""Closures that agree with one another by dead reckoning alone.

Who walks the same stretch twice meets many known places in a row, and each says the same of the
way between. A false closure by chance has no such company. Pairwise consistency is due to Mangelson
et al. (ICRA 2018, "Pairwise consistent measurement set maximization").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, compose, inverse
from elfslam.base.values import PoseGraph
from elfslam.line.graph.build import covariance_of_edges, edges_of
from elfslam.line.graph.linear import carried, chi_square


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
    """How uncertain (k, 3, 3) the way from pose i to pose j is, in the frame of pose j."""
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


def agreeing_pairs(chain: Chain, closures: Forward, reach: int, limit: float) -> tuple[I64, Bool]:
    """Pairs (p, 2) of closures near each other, and whether each agrees by dead reckoning.

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
class Runs:
    """Which run (k) each closure belongs to, and per run its best connected closure and its size.

    Of r runs every closure has one; a closure without company is a run of its own.
    """

    run: I64
    middle: I64
    size: I64


def find_runs(chain: Chain, closures: Forward, reach: int, limit: float) -> Runs:
    """Closures that hang together by agreeing pairs."""
    count = len(closures.low)
    pairs, agree = agreeing_pairs(chain, closures, reach, limit)
    a, b = pairs[agree].T
    links = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    _, run = connected_components(links, directed=False)
    friends = np.bincount(pairs[agree].ravel(), minlength=count)
    order = np.lexsort((-friends, run))
    _, first = np.unique(run[order], return_index=True)
    return Runs(run.astype(np.int64), order[first], np.bincount(run))
