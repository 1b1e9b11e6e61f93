"""A walk over several floors, floor by floor: a run for each, and the passages that join them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from math import dist

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.building import MOST_PASSAGES, Building, FloorsVisited, Passage
from elfslam.base.values import (
    AnySimilarity,
    Checkpoints,
    Closures,
    LevelPassage,
    MeanSimilarity,
    Odometry,
    Run,
    Similarity,
    Trajectory,
)
from elfslam.slam.front_end import floors_walked
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import map_of
from elfslam.stages.checkpoints import places_visited
from elfslam.stages.levels import passages_of, without_level_taps

SAME_PASSAGE_M = 5.0
"""Stairs of one kind between the same floors are others where both ends are farther apart."""


def floor_runs(run: Run, parameters: Parameters) -> dict[int, Run]:
    """The part of a run on each floor that was walked, by level, with a map of its own.

    All are in the frame of the whole. Between two visits of a floor lies one move, as sure as
    those it stands for together.
    """
    visited = _visited(run)
    level = visited.levels.at(run.trajectory.t_s)
    return {
        floor: _floor_run(run, floor, np.flatnonzero(level == floor), parameters)
        for floor in floors_walked(visited, run.trajectory.t_s)
    }


def building_of(run: Run, levels: Sequence[int]) -> Building:
    """The building that a run walked: those of its floors, and the passages between them."""
    visited = _visited(run)
    floors = tuple(each for each in visited.floors if each.level in levels)
    walked = [
        each
        for each in passages_walked(run.trajectory, visited)
        if {each.from_level, each.to_level} <= set(levels)
    ]
    return Building(run.name, floors, gathered_passages(walked))


def gathered_passages(passages: Sequence[Passage]) -> tuple[Passage, ...]:
    """One passage for all of a kind that join the same floors near each other: their mean.

    A lift joins besides all floors at which any ride in it began or ended.
    """
    taken = tuple(map(_mean, _grouped(passages, _same)))
    lifts = [each for each in taken if each.kind is LevelPassage.LIFT]
    others = [
        ride for shaft in _grouped(lifts, _same_shaft) for ride in _rides_between_stops(shaft)
    ]
    return (*taken, *others[: MOST_PASSAGES - len(taken)])


def _grouped(
    passages: Sequence[Passage], alike: Callable[[Passage, Passage], bool]
) -> list[list[Passage]]:
    """Each with the first that it is alike."""
    groups: list[list[Passage]] = []
    for each in passages:
        group = next((group for group in groups if alike(group[0], each)), None)
        if group is None:
            groups.append([each])
        else:
            group.append(each)
    return groups


def _same_shaft(one: Passage, other: Passage) -> bool:
    return dist(one.from_xy_m, other.from_xy_m) <= SAME_PASSAGE_M


def _rides_between_stops(shaft: Sequence[Passage]) -> list[Passage]:
    """Those that nobody took, as fast as the others."""
    stops = {each.from_level: each.from_xy_m for each in shaft}
    stops |= {each.to_level: each.to_xy_m for each in shaft}
    taken = {frozenset((each.from_level, each.to_level)) for each in shaft}
    rates = [each.duration_s / abs(each.to_level - each.from_level) for each in shaft]
    floor_s = float(np.mean(rates))
    return [
        Passage(LevelPassage.LIFT, low, high, stops[low], stops[high], floor_s * (high - low))
        for low, high in combinations(sorted(stops), 2)
        if {low, high} not in taken
    ]


def _visited(run: Run) -> FloorsVisited:
    if run.visited is None:
        raise ValueError(f"{run.name}: was walked on one floor")
    return run.visited


def _floor_run(run: Run, floor: int, kept: I64, parameters: Parameters) -> Run:
    assert run.visited is not None
    levels = run.visited.levels
    named = _chosen_taps(without_level_taps(run.checkpoints), floor, run.visited)
    closures, weights = _chosen_closures(run, kept)
    status = "OK" if (weights > 0.5).any() else "NO_CLOSURES"
    trajectory = replace(
        run.trajectory.chosen(kept), closure_weights=weights, status=status, verdict=None
    )
    echoes, features = run.echoes, run.features
    part = replace(
        run,
        odometry=_chosen_nodes(run.odometry, kept),
        similarity=_chosen_similarity(run.similarity, kept),
        closures=closures,
        trajectory=trajectory,
        echoes=echoes and echoes.chosen(levels.at(echoes.t_s) == floor),
        features=features and features.chosen(levels.at(features.t_s) == floor),
        points_of_interest=places_visited(named, trajectory, parameters.checkpoint),
        checkpoints=named,
        visited=None,
    )
    return replace(part, floor_map=map_of(part, parameters))


def _chosen_taps(
    checkpoints: Checkpoints | None, floor: int, visited: FloorsVisited
) -> Checkpoints | None:
    if checkpoints is None:
        return None
    there = visited.levels.at(checkpoints.t_s) == floor
    names = tuple(name for name, keep in zip(checkpoints.names, there, strict=True) if keep)
    return replace(checkpoints.chosen(there), names=names) if names else None


def _chosen_nodes(nodes: Odometry, kept: I64) -> Odometry:
    """Some nodes; the variances of the moves between two of them add up."""
    summed = np.vstack([np.zeros(3), np.cumsum(nodes.step_sigma**2, axis=0)])
    poses = nodes.world_from_body[kept]
    sigma = np.sqrt(np.diff(summed[kept], axis=0))
    return replace(nodes, t_s=nodes.t_s[kept], world_from_body=poses, step_sigma=sigma)


def _chosen_similarity(similarity: AnySimilarity, kept: I64) -> AnySimilarity:
    """That of the stretches between footsteps; over a gap between two visits it is zero."""
    heard = np.diff(kept) == 1
    stretches = np.minimum(kept[:-1], similarity.count - 1)
    if isinstance(similarity, MeanSimilarity):
        means: F32 = similarity.means[stretches] * heard[:, None]
        return replace(similarity, means=means)
    scores = similarity.scores[np.ix_(stretches, stretches)] * heard * heard[:, None]
    return Similarity(scores, similarity.kind)


def _chosen_closures(run: Run, kept: I64) -> tuple[Closures, F64]:
    """The closures between two of the footsteps, with their weights."""
    there = np.isin(run.closures.i, kept) & np.isin(run.closures.j, kept)
    closures = run.closures.chosen(there)
    i, j = (np.searchsorted(kept, each) for each in (closures.i, closures.j))
    return replace(closures, i=i, j=j), run.trajectory.closure_weights[there]


def passages_walked(trajectory: Trajectory, visited: FloorsVisited) -> list[Passage]:
    """Each passage as it was taken, at the places where the floors were left and reached."""
    walked = []
    for begin_s, end_s, kind, (before, after) in passages_of(visited.levels):
        if kind is None or not np.isfinite([before, after]).all() or before == after:
            continue
        last = max(int(np.searchsorted(trajectory.t_s, begin_s, side="right")) - 1, 0)
        first = min(int(np.searchsorted(trajectory.t_s, end_s)), len(trajectory.t_s) - 1)
        left, reached = (
            (float(x_m), float(y_m)) for x_m, y_m, _ in trajectory.world_from_body[[last, first]]
        )
        walked.append(Passage(kind, int(before), int(after), left, reached, end_s - begin_s))
    return [each if each.kind is LevelPassage.ESCALATOR else _upward(each) for each in walked]


def _upward(passage: Passage) -> Passage:
    """The same from the lower floor."""
    if passage.from_level < passage.to_level:
        return passage
    return replace(
        passage,
        from_level=passage.to_level,
        to_level=passage.from_level,
        from_xy_m=passage.to_xy_m,
        to_xy_m=passage.from_xy_m,
    )


def _same(one: Passage, other: Passage) -> bool:
    alike = one.kind, one.from_level, one.to_level
    off_m = max(dist(one.from_xy_m, other.from_xy_m), dist(one.to_xy_m, other.to_xy_m))
    return alike == (other.kind, other.from_level, other.to_level) and off_m <= SAME_PASSAGE_M


def _mean(group: Sequence[Passage]) -> Passage:
    numbers = np.mean([(*each.from_xy_m, *each.to_xy_m, each.duration_s) for each in group], axis=0)
    from_x_m, from_y_m, to_x_m, to_y_m, duration_s = numbers.tolist()
    return replace(
        group[0], from_xy_m=(from_x_m, from_y_m), to_xy_m=(to_x_m, to_y_m), duration_s=duration_s
    )
