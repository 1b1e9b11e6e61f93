"""Joint pose graph optimisation over all walks of a group."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.geometry import between, compose, inverse
from elfslam.base.values import Closures, PoseGraph, Trajectory
from elfslam.slam.merging.members import MappedWalk, MergeParameters, middles
from elfslam.stages.checkpoints import tapped_closures
from elfslam.stages.graph import GraphParameters, build_graph, optimise


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges (e) with their nodes, measurements and information."""

    nodes: I64
    measured: F64
    information: F64


def joined_walks(
    walks: Sequence[MappedWalk],
    frames: Sequence[F64],
    links: Mapping[tuple[int, int], Closures],
    parameters: MergeParameters,
    *,
    known_starts: bool = False,
) -> list[Trajectory]:
    """All walks bent into one frame, that of the first: the graph over their steps and links.

    `frames` (3) place each walk to begin with; with `known_starts` each walk is also tied to where
    it began, or to where its walker tapped on a plan, in the frame that all of them share. Links
    that the solution does not bear out are left out, and it is solved again.
    Raises NoAnswerError where the graph has no solution.
    """
    poses = [
        compose(frame, walk.trajectory.world_from_body)
        for walk, frame in zip(walks, frames, strict=True)
    ]
    # Where all share a frame, its middle leads the graph; else the first walk's start holds it.
    middle = middle_of(np.vstack(poses))
    lead = [middle] if known_starts else []
    ends = len(lead) + np.cumsum([0, *(len(each) for each in poses)])
    firsts = list(zip(walks, ends[:-1], strict=True))
    fixed = [_own_edges(walk, first) for walk, first in firsts]
    if known_starts:
        fixed += [_frame_edges(walk, first, middle, parameters) for walk, first in firsts]
    scale = float(np.mean([walk.odometry.scale_sigma for walk in walks])) / np.sqrt(len(walks))
    initial, solved = np.vstack([*lead, *poses]), None
    for _ in range(parameters.merging.rounds):
        held = [_link_edges(links[pair], pair, poses, ends, parameters) for pair in sorted(links)]
        solved = _solved(initial, [*fixed, *held], scale)
        poses = np.split(solved.world_from_body, ends[:-1])[1:]
    assert solved is not None
    covariances = np.split(solved.covariance, ends[:-1])[1:]
    return [
        replace(walk.trajectory, world_from_body=each, covariance=covariance, status="OK")
        for walk, each, covariance in zip(walks, poses, covariances, strict=True)
    ]


def against_map(
    walk: MappedWalk,
    frame: F64,
    spots: F64,
    links: Closures,
    parameters: MergeParameters,
    *,
    known_start: bool = False,
) -> Trajectory:
    """A walk bent onto a map that stays as it is, from the frame (3) that it begins in.

    Links tie spots i of the map (n, 3) to stretches j of the walk; with `known_start` it is also
    tied to where it began, or to where its walker tapped on a plan. The covariance is relative to
    the spots.
    """
    poses = compose(frame, walk.trajectory.world_from_body)
    middle = middle_of(poses)
    own = [_own_edges(walk, 1)]
    if known_start:
        own.append(_frame_edges(walk, 1, middle, parameters))
    solved = walk.trajectory
    for _ in range(parameters.merging.rounds):
        known = links.chosen(_fitting(links, spots, middles(poses), parameters))
        held = _map_edges(known, spots, poses, middle)
        solved = _solved(np.vstack([middle, poses]), [*own, held], 0.0)
        poses = solved.world_from_body[1:]
    return replace(
        walk.trajectory, world_from_body=poses, covariance=solved.covariance[1:], status="OK"
    )


def _solved(initial: F64, parts: Sequence[Edges], scale_sigma: float) -> Trajectory:
    graph = PoseGraph(
        initial=initial,
        edges=np.vstack([part.nodes for part in parts]),
        measurements=np.vstack([part.measured for part in parts]),
        information=np.concatenate([part.information for part in parts]),
        is_closure=np.concatenate(
            [np.full(len(part.nodes), k > 0) for k, part in enumerate(parts)]
        ),
        scale_sigma=scale_sigma,
    )
    count = np.arange(len(initial), dtype=np.float64)
    return optimise(graph, count, GraphParameters(robust=False, noise_rounds=0))


def _own_edges(walk: MappedWalk, first: int) -> Edges:
    """The steps of a walk and the closures that it believed by itself."""
    kept = walk.closures.chosen(walk.trajectory.closure_weights > 0.5)
    graph = build_graph(walk.odometry, kept)
    return Edges(graph.edges + first, graph.measurements, graph.information)


def middle_of(poses: F64) -> F64:
    """A pose (3) of the frame amid poses (n, 3): a frame's origin may lie a country away."""
    return np.append(poses[:, :2].mean(axis=0), 0.0)


def _frame_edges(walk: MappedWalk, first: int, middle: F64, parameters: MergeParameters) -> Edges:
    """Where a walk lies, seen from the middle of the frame, node 0: by its taps or its start."""
    taps = tapped_closures(walk.checkpoints, walk.trajectory, parameters.checkpoint)
    if len(taps.i):
        nodes = np.column_stack([taps.i, taps.j + first])
        return Edges(nodes, between(middle, taps.i_from_j), _inverted(taps.covariance))
    known = parameters.merging
    sigma = np.array([known.start_sigma_m, known.start_sigma_m, known.start_sigma_rad])
    information = np.diag(1 / sigma**2)[None]
    begin = between(middle, walk.odometry.world_from_body[:1])
    return Edges(np.array([[0, first]]), begin, information)


def _link_edges(
    links: Closures,
    pair: tuple[int, int],
    poses: Sequence[F64],
    ends: I64,
    parameters: MergeParameters,
) -> Edges:
    """The links between two walks that their poses bear out, from footstep to footstep."""
    one, other = (poses[k] for k in pair)
    known = links.chosen(_fitting(links, middles(one), middles(other), parameters))
    onto = between(one[:-1], middles(one))[known.i]
    back = between(other[:-1], middles(other))[known.j]
    measured = compose(compose(onto, known.i_from_j), inverse(back))
    nodes = np.column_stack([known.i + ends[pair[0]], known.j + ends[pair[1]]])
    return Edges(nodes, measured, _inverted(known.covariance))


def _map_edges(links: Closures, spots: F64, poses: F64, middle: F64) -> Edges:
    """Where spots put the footsteps of a walk, seen from the middle of the frame, node 0."""
    back = between(poses[:-1], middles(poses))[links.j]
    there = between(middle, spots[links.i])
    measured = compose(compose(there, links.i_from_j), inverse(back))
    nodes = np.column_stack([np.zeros(len(measured), dtype=np.int64), links.j + 1])
    return Edges(nodes, measured, _inverted(links.covariance))


def _fitting(links: Closures, one: F64, other: F64, parameters: MergeParameters) -> Bool:
    """Which links the poses of both sides bear out; of each stretch of the other, the best one."""
    missed = between(compose(one[links.i], links.i_from_j), other[links.j])
    fits = np.linalg.norm(missed[:, :2], axis=1) <= parameters.merging.gate_m
    fits &= np.abs(missed[:, 2]) <= parameters.merging.gate_rad
    order = np.lexsort((-links.score, ~fits, links.j))
    first = np.unique(links.j[order], return_index=True)[1]
    best = np.zeros(len(fits), dtype=bool)
    best[order[first]] = True
    return np.asarray(fits & best)


def _inverted(covariance: F64) -> F64:
    return np.asarray(np.linalg.inv(covariance)).reshape(-1, 3, 3)
