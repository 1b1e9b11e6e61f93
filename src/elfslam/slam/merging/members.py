"""Members of a merge, walks and maps: footsteps with the features heard at each."""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elfslam.base.arrays import F32, F64, Value, array
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose
from elfslam.base.parameters import parameter
from elfslam.base.values import (
    Checkpoints,
    Closures,
    Features,
    FloorMap,
    Levels,
    Odometry,
    PointOfInterest,
    Run,
    Trajectory,
)
from elfslam.slam.parameters import Parameters
from elfslam.stages.closure import (
    AGAIN,
    closures_between,
    echo_sequence_similarity,
    joined,
    sequence_mean,
)
from elfslam.stages.floormap import QualityParameters
from elfslam.stages.map_alignment import (
    AlignmentParameters,
    WalkPair,
    resemblances,
    usual_resemblance,
)


@dataclass(frozen=True)
class MergingParameters:
    """How walks are joined once it is known how they lie, and how a map is kept alive."""

    gate_m: float = parameter(
        1.0, "m", "links that miss by more are left out of the graph", 0.05, 100.0
    )
    gate_rad: float = parameter(0.7, "rad", "the same for the heading", 0.05, 3.2)
    rounds: int = parameter(4, "", "how often links are chosen and the graph is solved", 1, 50)
    start_sigma_m: float = parameter(0.3, "m", "how exactly a declared start is known", 0.01, 100.0)
    start_sigma_rad: float = parameter(0.2, "rad", "and its heading", 0.01, 3.2)
    spacing_m: float = parameter(0.7, "m", "a map is walked again in steps of this", 0.1, 5.0)
    fade: float = parameter(
        0.9, "", "weight that a spot keeps when a newer walk passes it", 0.0, 1.0
    )
    fade_changed: float = parameter(
        0.5, "", "the same where its surroundings have changed", 0.0, 1.0
    )
    forget_below: float = parameter(0.1, "", "spots with less weight leave the map", 0.0, 1.0)
    passes: int = parameter(2, "", "times that a newer walk must find a place changed", 1, 100)
    changed_below: float = parameter(
        0.65, "", "similarity to the map, against other places, that is a change", 0.0, 2.0
    )


@dataclass(frozen=True)
class MergeParameters(Parameters):
    """Those of the pipeline, and those of merging."""

    alignment: AlignmentParameters = field(default_factory=AlignmentParameters)
    merging: MergingParameters = field(default_factory=MergingParameters)
    quality: QualityParameters = field(default_factory=QualityParameters)


@dataclass(frozen=True, eq=False)
class MappedWalk:
    """A mapped walk: what is needed to merge it; the `levels` of one over several floors."""

    name: str
    odometry: Odometry
    trajectory: Trajectory
    closures: Closures
    features: Features
    points_of_interest: tuple[PointOfInterest, ...] = ()
    checkpoints: Checkpoints | None = None
    levels: Levels | None = None


@dataclass(frozen=True, eq=False)
class Side(Value):
    """Stretches of a walk (n): pose of the middle, what is heard, how certain the poses are.

    `usual` is how similar the walk is to itself where it comes back. Stretches are compared on one
    `level` alone, where that is told; NaN is none.
    """

    poses: F64 = array("n", 3)
    means: F32 = array("n", "d", dtype=np.float32)
    sigma_m: float
    usual: float
    level: F64 | None = array("n", finite=False, optional=True)


def walk_of(run: Run) -> MappedWalk:
    """What merging needs of a run. Raises InputError where the run has no sound."""
    if run.features is None or len(run.odometry.t_s) < 2:
        raise InputError(
            f"{run.name}: was mapped without sound; map it with --by elf, only echoes are merged"
        )
    evidence = run.odometry, run.trajectory, run.closures, run.features
    return MappedWalk(run.name, *evidence, run.points_of_interest, run.checkpoints)


def side_of(walk: MappedWalk, parameters: MergeParameters) -> Side:
    """A walk as merging sees it, in its own frame."""
    similarity = echo_sequence_similarity(walk.features, walk.odometry)
    poses = middles(walk.trajectory.world_from_body)
    level = None if walk.levels is None else walk.levels.at(walk.trajectory.t_s[:-1])
    covariance = walk.trajectory.covariance[:, :2, :2]
    return _side(poses, similarity.means, covariance, parameters, level)


def sides_of(floor_map: FloorMap, parameters: MergeParameters) -> list[Side]:
    """The walks of a map, in its frame: every so far along a walk one of its spots."""
    vectors = next(item.vectors for item in floor_map.payloads if item.kind == "elf")
    sides = []
    for walk in np.unique(floor_map.walk):
        rows = np.flatnonzero(floor_map.walk == walk)
        rows = rows[np.argsort(floor_map.order[rows], kind="stable")]
        moves_m = np.linalg.norm(np.diff(floor_map.xy_m[rows], axis=0), axis=1)
        steps = np.concatenate([[0.0], np.cumsum(moves_m)]) // parameters.merging.spacing_m
        rows = rows[np.unique(steps, return_index=True)[1]]
        poses = np.column_stack([floor_map.xy_m[rows], floor_map.heading_rad[rows]])
        sides.append(_side(poses, vectors[rows], floor_map.covariance_m2[rows], parameters))
    return sides


def placed(side: Side, frame_from_side: F64) -> Side:
    """The same walk in another frame."""
    return replace(side, poses=compose(frame_from_side, side.poses))


def meeting_of(
    ones: Sequence[Side], other: Side, links: Sequence[Closures], parameters: MergeParameters
) -> WalkPair:
    """What a walk has in common with walks that share a frame; `links` as `links_between` gives."""
    firsts = np.cumsum([0, *(len(one.poses) for one in ones)])
    counted = [
        replace(found, i=found.i + first) for first, found in zip(firsts, links, strict=False)
    ]
    return WalkPair(
        one=np.vstack([one.poses for one in ones]),
        other=other.poses,
        scores=np.vstack([short_scores(one, other, parameters) for one in ones]),
        links=joined(counted),
        sigma_m=float(np.hypot(np.mean([one.sigma_m for one in ones]), other.sigma_m)),
    )


def similarity_to(ones: Sequence[Side], other: Side, parameters: MergeParameters) -> float:
    """How similar a walk is to others of its frame on common ground, relative to the usual.

    Zero without common ground.
    """
    poses = np.vstack([one.poses for one in ones])
    scores = np.vstack([short_scores(one, other, parameters) for one in ones])
    found = resemblances(poses, other.poses, scores, parameters.alignment)
    known = found[np.isfinite(found)]
    return float(known.mean()) / usual_of([*ones, other]) if len(known) else 0.0


def links_between(one: Side, other: Side, parameters: MergeParameters) -> Closures:
    """Places of two walks that sound alike over a long sequence."""
    links = closures_between(one.means, other.means, other.poses, parameters.closure)
    if one.level is None or other.level is None:
        return links
    return links.chosen(one.level[links.i] == other.level[links.j])


def short_scores(one: Side, other: Side, parameters: MergeParameters) -> F32:
    """How similar footsteps are (n, m), averaged over a few that follow each other.

    Minus infinity on different levels.
    """
    scores = sequence_mean(one.means @ other.means.T, parameters.alignment.short_sequence, AGAIN)
    if one.level is None or other.level is None:
        return scores
    return np.where(one.level[:, None] == other.level, scores, np.float32(-np.inf))


def middles(poses: F64) -> F64:
    """Poses (n-1, 3) half-way between each pose (n, 3) and the next, headed as the first is."""
    between_m = (poses[:-1, :2] + poses[1:, :2]) / 2
    return np.column_stack([between_m, poses[:-1, 2]])


def usual_of(sides: Sequence[Side]) -> float:
    """How similar these walks are to themselves, typically."""
    return float(np.exp(np.mean(np.log([side.usual for side in sides]))))


def _side(
    poses: F64,
    means: F32,
    covariance_m2: F64,
    parameters: MergeParameters,
    level: F64 | None = None,
) -> Side:
    sigma_m = float(np.sqrt(np.trace(covariance_m2, axis1=1, axis2=2).mean() / 2))
    side = Side(poses, means, sigma_m, 1.0, level)
    apart, known = parameters.closure.near_footsteps, parameters.alignment
    usual = usual_resemblance(poses, short_scores(side, side, parameters), apart, known)
    return replace(side, usual=max(usual or known.usual_resemblance, 0.1))
