"""Footsteps and closures as a pose graph."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.errors import InputError
from elfslam.base.geometry import between
from elfslam.base.values import Closures, Odometry, PoseGraph

LEAST_SIGMA = 1e-9


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
    closing = closure_edges(poses, closures)
    return PoseGraph(
        initial=poses,
        edges=np.vstack([steps, closing.edges]),
        measurements=np.vstack([between(poses[:-1], poses[1:]), closing.measurements]),
        information=np.concatenate([step_information, closing.information]),
        is_closure=np.arange(count + len(closures.i)) >= count,
        scale_sigma=nodes.scale_sigma,
    )


def closure_edges(poses: F64, closures: Closures) -> PoseGraph:
    """The closures alone, as edges between poses (n, 3)."""
    information = np.asarray(np.linalg.inv(closures.covariance)).reshape(-1, 3, 3)
    edges = np.column_stack([closures.i, closures.j])
    every = np.ones(len(edges), dtype=bool)
    return PoseGraph(poses, edges, closures.i_from_j, information, every)


def edges_of(graph: PoseGraph, chosen: I64 | Bool) -> PoseGraph:
    """The graph with some of its edges only: indices or a mask."""
    return PoseGraph(
        graph.initial,
        graph.edges[chosen],
        graph.measurements[chosen],
        graph.information[chosen],
        graph.is_closure[chosen],
        graph.scale_sigma,
    )


def believing(graph: PoseGraph, kept: Bool) -> PoseGraph:
    """The graph with all of its steps and the closures of the mask (k)."""
    chosen = ~graph.is_closure
    chosen[graph.is_closure] = kept
    return edges_of(graph, chosen)


def covariance_of_edges(graph: PoseGraph) -> F64:
    """Covariances (e, 3, 3) of the edges' measurements."""
    return np.asarray(np.linalg.inv(graph.information)).reshape(-1, 3, 3)
