"""Localization in a building: on which floor first, then where on it.

With a barometer the floors of a query walk are known up to the first: one vote over the whole walk
settles that. Without one, each moment's floor is voted on by the sound around it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np

from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.enums import Mode
from elfslam.base.fixes import NOWHERE
from elfslam.base.values import Features, Fixes, FixStatus, FloorMap, Odometry, Recording
from elfslam.slam.front_end import dead_reckoning_nodes, extract_query_echoes, floors_visited
from elfslam.slam.parameters import Parameters
from elfslam.slam.pipeline import footstep_similarity, locate_walk
from elfslam.stages.device_adaptation import to_map_domain
from elfslam.stages.feature import Encoder, extract_features
from elfslam.stages.levels import LevelParameters
from elfslam.stages.locate import trusted_one_shot
from elfslam.stages.spoofing import Suspicion

COLUMNS = tuple(each.name for each in fields(Fixes) if each.name != "level")
FEWEST_FOOTSTEPS = 10
"""On a floor, for a walk on it to be located by them."""


def locate_in_building(
    recording: Recording,
    floors: Mapping[int, FloorMap],
    encoder: Encoder,
    parameters: Parameters,
    *,
    mode: Mode = Mode.ONE_SHOT,
    seed: int = 0,
    translation: F32 | None = None,
) -> Fixes:
    """As `locate`, among the maps of floors by level, with the level of each fix.

    The level is NaN where the walker is between floors (UNKNOWN_PLACE), and where another floor is
    nearly as likely (AMBIGUOUS, on the likelier).
    """
    echoes, suspect = extract_query_echoes(recording, parameters)
    features = extract_features(echoes, encoder)
    if translation is not None:
        features = to_map_domain(features, translation)
    shots = {
        level: trusted_one_shot(features, each, parameters.locate, suspect)
        for level, each in floors.items()
    }
    nodes = dead_reckoning_nodes(recording, parameters)
    t_s = next(iter(shots.values())).t_s
    relative = _relative(recording, nodes, t_s, parameters)
    scores = np.column_stack([each.score for each in shots.values()])
    level, sure = floors_by_vote(t_s, scores, list(floors), relative, parameters.levels)
    if mode is Mode.ONE_SHOT:
        return _with_levels(_chosen(shots, level), level, sure)
    at = np.clip(np.searchsorted(t_s, nodes.t_s), 0, len(t_s) - 1)
    walked = _walked(nodes, level[at], features, floors, suspect, parameters, mode, seed)
    at = np.clip(np.searchsorted(t_s, walked.t_s), 0, len(t_s) - 1)
    return _with_levels(walked, level[at], sure[at])


def floors_by_vote(
    t_s: F64,
    scores: F64,
    levels: Sequence[int],
    relative: F64 | None,
    parameters: LevelParameters,
) -> tuple[F64, Bool]:
    """The likeliest level (n) at times (n), and whether it leads clearly.

    `scores` (n, f) say how similar the best place on each floor is, NaN in silence. `relative` (n)
    are levels up to a constant, NaN between floors: then that constant is voted on by all. None
    where nothing is known: then each moment by those around it.
    """
    if relative is None:
        votes = _means_around(t_s, scores, parameters.vote_s)
        best, sure = _elected(votes, parameters)
        return np.asarray(levels, np.float64)[best], sure
    lowest, highest = int(np.nanmin(relative)), int(np.nanmax(relative))
    shifts = np.arange(min(levels) - highest, max(levels) - lowest + 1)
    known = {level: scores[:, k] for k, level in enumerate(levels)}
    # A floor without a map sounds like none of those that have one.
    worst = scores.min(axis=1)
    votes = np.zeros((1, len(shifts)))
    for k, shift in enumerate(shifts):
        said = worst.copy()
        for level, column in known.items():
            there = relative + shift == level
            said[there] = column[there]
        said = said[np.isfinite(relative)]
        votes[0, k] = np.nansum(said) / max(np.isfinite(said).sum(), 1)
    best, sure = _elected(votes, parameters)
    return relative + shifts[best[0]], np.full(len(t_s), sure[0])


def _elected(votes: F64, parameters: LevelParameters) -> tuple[F64, Bool]:
    """The column (n) with most votes in each row (n, f), and whether it leads clearly."""
    ranked = np.sort(votes, axis=1)
    lead = ranked[:, -1] - ranked[:, -2] if votes.shape[1] > 1 else np.full(len(votes), np.inf)
    return votes.argmax(axis=1), lead >= parameters.least_lead


def _means_around(t_s: F64, scores: F64, span_s: float) -> F64:
    """Means (n, f) of scores within half a span of each time; silence has no say."""
    heard = np.isfinite(scores[:, :1])
    first = np.searchsorted(t_s, t_s - span_s / 2)
    last = np.searchsorted(t_s, t_s + span_s / 2, side="right")
    zero = np.zeros((1, scores.shape[1]))
    sums = np.vstack([zero, np.cumsum(np.where(heard, scores, 0.0), axis=0)])
    counts = np.vstack([zero[:, :1], np.cumsum(heard, axis=0)])
    return np.asarray((sums[last] - sums[first]) / np.maximum(counts[last] - counts[first], 1))


def _relative(
    recording: Recording, nodes: Odometry, t_s: F64, parameters: Parameters
) -> F64 | None:
    """The levels (n) of a query walk up to a constant; None where nothing tells them."""
    visited = floors_visited(recording, nodes, parameters)
    if visited is not None:
        return visited.levels.at(t_s)
    return None if recording.barometer is None else np.zeros(len(t_s))


def _chosen(shots: Mapping[int, Fixes], level: F64) -> Fixes:
    """At each time the fix on its level; none where there is no map of that."""
    fixes = _nowhere(next(iter(shots.values())).t_s)
    columns = {name: np.copy(getattr(fixes, name)) for name in COLUMNS}
    for floor, each in shots.items():
        there = level == floor
        for name, column in columns.items():
            column[there] = getattr(each, name)[there]
    return Fixes(**columns)


def _walked(
    nodes: Odometry,
    level: F64,
    features: Features,
    floors: Mapping[int, FloorMap],
    suspect: Suspicion,
    parameters: Parameters,
    mode: Mode,
    seed: int,
) -> Fixes:
    """Fixes by the footsteps of each stay on a floor (level (n) at the nodes), one by one."""
    ends = np.flatnonzero(np.diff(level, prepend=np.nan, append=np.nan) != 0)
    parts = []
    for first, last in pairwise(ends.tolist()):
        stay = nodes.chosen(slice(first, last))
        floor_map = floors.get(int(level[first])) if np.isfinite(level[first]) else None
        if floor_map is None or last - first < FEWEST_FOOTSTEPS:
            parts.append(_nowhere(stay.t_s))
            continue
        scores = footstep_similarity(features, stay, floor_map, parameters.locate)
        parts.append(
            locate_walk(
                stay, scores, floor_map, parameters, mode=mode, seed=seed,
                suspect=suspect(stay.t_s),
            )
        )  # fmt: skip
    return Fixes(*(np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS))


def _nowhere(t_s: F64) -> Fixes:
    xy_m, heading_rad, covariance_m2 = NOWHERE
    count = len(t_s)
    return Fixes(
        t_s, np.tile(xy_m, (count, 1)), np.full(count, heading_rad),
        np.tile(covariance_m2, (count, 1, 1)), np.full(count, np.nan),
        np.full(count, int(FixStatus.UNKNOWN_PLACE)),
    )  # fmt: skip


def _with_levels(fixes: Fixes, level: F64, sure: Bool) -> Fixes:
    """The fixes with their levels (n), AMBIGUOUS where those are not `sure` (n)."""
    doubted = (fixes.status == FixStatus.OK) & ~sure
    status = np.where(doubted, int(FixStatus.AMBIGUOUS), fixes.status)
    return replace(fixes, status=status, level=np.where(sure, level, np.nan))
