"""All walks of a floor in one pose graph: known starts, headings of the phone, places alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.base.geometry import between, compose
from elfslam.base.values import Closures, Odometry, PoseGraph, Trajectory
from elfslam.stages.graph import GraphParameters, optimise

THINNED = 4
"""Every so many footsteps a walk is compared and corrected, 2.8 m apart."""


@dataclass(frozen=True)
class StartSigma:
    """How exactly the start of a walk is known."""

    position_m: float = 0.3
    heading_rad: float = 0.2


def thinned_rows(walk: Odometry) -> I64:
    """The nodes of a walk that stand for all."""
    return np.arange(0, len(walk.t_s), THINNED)


def thinned(walk: Odometry) -> Odometry:
    """The walk at those nodes; variances of the moves between add up."""
    rows = thinned_rows(walk)
    summed = np.vstack([np.zeros(3), np.cumsum(walk.step_sigma**2, axis=0)])[rows]
    sigma = np.sqrt(np.diff(summed, axis=0))
    return replace(
        walk, t_s=walk.t_s[rows], world_from_body=walk.world_from_body[rows], step_sigma=sigma
    )


def joint_graph(
    walks: Sequence[Odometry], closures: Closures, start: StartSigma | None = None
) -> PoseGraph:
    """One graph of walks that all begin in the world's frame; closures count nodes through.

    Node 0 is the world's origin, to which each walk's first pose is tied as exactly as it is
    known.
    """
    start = start or StartSigma()
    known = [start.position_m, start.position_m, start.heading_rad]
    edges, measurements, sigmas = [], [], []
    first = 1
    for walk in walks:
        poses, rows = walk.world_from_body, first + np.arange(len(walk.t_s))
        edges += [np.array([[0, first]]), np.column_stack([rows[:-1], rows[1:]])]
        measurements += [poses[:1], between(poses[:-1], poses[1:])]
        sigmas += [np.array([known]), walk.step_sigma]
        first += len(rows)
    sigma = np.vstack(sigmas)
    return PoseGraph(
        initial=np.vstack([np.zeros((1, 3)), *[walk.world_from_body for walk in walks]]),
        edges=np.vstack([*edges, np.column_stack([closures.i, closures.j]) + 1]),
        measurements=np.vstack([*measurements, closures.i_from_j]),
        information=np.concatenate(
            [np.eye(3) / sigma[:, None] ** 2, np.linalg.inv(closures.covariance).reshape(-1, 3, 3)]
        ),
        is_closure=np.arange(len(sigma) + len(closures.i)) >= len(sigma),
    )


def corrected(
    walks: Sequence[Odometry], closures: Closures, start: StartSigma | None = None
) -> list[Trajectory]:
    """The trajectory of every walk after all have been solved together at their thinned nodes.

    Pulls are weak and many, none of them decides: they are not judged one by one.
    """
    graph = joint_graph([thinned(walk) for walk in walks], closures, start)
    count = np.arange(len(graph.initial), dtype=np.float64)
    solved = optimise(graph, count, GraphParameters(robust=False, noise_rounds=0))
    ends = np.cumsum([1, *[len(thinned_rows(walk)) for walk in walks]])
    return [
        _carried(walk, solved.world_from_body[first:last], solved.covariance[first:last])
        for walk, first, last in zip(walks, ends[:-1], ends[1:], strict=True)
    ]


def _carried(walk: Odometry, poses: F64, covariance: F64) -> Trajectory:
    """All poses of a walk, each moved as the thinned node before it was, and as sure."""
    rows, every = thinned_rows(walk), np.arange(len(walk.t_s))
    before = np.searchsorted(rows, every, side="right") - 1
    own = between(walk.world_from_body[rows][before], walk.world_from_body)
    moved = compose(poses[before], own)
    return Trajectory(walk.t_s, moved, covariance[before], np.ones(0), "OK")
