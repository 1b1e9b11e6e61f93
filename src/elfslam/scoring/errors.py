"""How far an estimate is from the truth: of walks, and of fixes with what was refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.base.geometry import compose, interpolate_poses, path_length_m
from elfslam.base.values import Fixes, FixStatus, Truth
from elfslam.scoring.alignment import (
    Alignment,
    SimilarityTransform,
    alignment_of,
    is_sparse,
    match,
    place,
    placement,
)

__all__ = [
    "Alignment",
    "ErrorSummary",
    "FixSummary",
    "alignment_of",
    "end_error_share",
    "fix_distances",
    "fix_errors",
    "position_errors",
    "summarise",
    "walk_errors",
]

FIX_GAP_S = 2.0
"""Fixes are interpolated to a waypoint only where the two around it are no further apart."""


@dataclass(frozen=True)
class ErrorSummary:
    """Errors in metres; NaN all through where there is none to summarise."""

    median_m: float
    mean_m: float
    q3_m: float
    rmse_m: float
    maximum_m: float
    count: int


@dataclass(frozen=True)
class FixSummary:
    """Errors of the fixes that stand, of the ambiguous ones apart, and how many were refused.

    `by_status` counts every fix; `coverage` is the share with status OK. `ok.count` may be less
    than `by_status["OK"]` where the truth does not reach.
    """

    ok: ErrorSummary
    ambiguous: ErrorSummary
    by_status: Mapping[str, int]
    coverage: float


def walk_errors(t_s: F64, poses: F64, truth: Truth, alignment: Alignment) -> tuple[F64, F64]:
    """Times (m) and position errors (m) in metres, after alignment.

    Dense truth: at the estimate's times inside its span. Waypoints: at the waypoints.
    """
    matched = match(t_s, poses, truth)
    placed = place(matched.estimate, placement(matched, alignment))
    return matched.t_s, np.linalg.norm(placed[:, :2] - matched.truth[:, :2], axis=1)


def position_errors(t_s: F64, poses: F64, truth: Truth, alignment: Alignment) -> F64:
    """Position errors (m) in metres after alignment; see `walk_errors` for their times."""
    return walk_errors(t_s, poses, truth, alignment)[1]


def placed_errors(t_s: F64, poses: F64, truth: Truth, where: SimilarityTransform) -> F64:
    """Position errors (m) in metres of a map that lies there; see `walk_errors` for their times."""
    matched = match(t_s, poses, truth)
    apart = place(matched.estimate, where)[:, :2] - matched.truth[:, :2]
    return np.asarray(np.linalg.norm(apart, axis=1))


def summarise(errors: F64) -> ErrorSummary:
    """Median, mean, third quartile, root mean square and maximum of errors in metres."""
    if errors.size == 0:
        nan = float("nan")
        return ErrorSummary(nan, nan, nan, nan, nan, count=0)
    return ErrorSummary(
        median_m=float(np.median(errors)),
        mean_m=float(np.mean(errors)),
        q3_m=float(np.quantile(errors, 0.75)),
        rmse_m=float(np.sqrt(np.mean(errors**2))),
        maximum_m=float(np.max(errors)),
        count=int(errors.size),
    )


def end_error_share(t_s: F64, poses: F64, truth: Truth) -> float:
    """End-point error after anchoring, as a share of the true path; NaN where nobody moved."""
    length = path_length_m(match(t_s, poses, truth).truth[:, :2])
    end = position_errors(t_s, poses, truth, Alignment.ANCHORED)[-1]
    return float(end / length) if length > 0 else float("nan")


def fix_errors(fixes: Fixes, truth: Truth, world_from_map: F64) -> FixSummary:
    """Errors of the fixes, moved into the world by `world_from_map` (3).

    That pose comes from `alignment_of` the mapping walk; a fix itself is never aligned.
    """
    status, errors = fix_distances(fixes, truth, world_from_map)
    known = np.isfinite(errors)
    counts = {kind.name: int((fixes.status == kind).sum()) for kind in FixStatus}
    return FixSummary(
        ok=summarise(errors[known & (status == FixStatus.OK)]),
        ambiguous=summarise(errors[known & (status == FixStatus.AMBIGUOUS)]),
        by_status=counts,
        coverage=counts["OK"] / fixes.t_s.size if fixes.t_s.size else float("nan"),
    )


def fix_distances(fixes: Fixes, truth: Truth, world_from_map: F64) -> tuple[I64, F64]:
    """Status and error at each fix, or at each waypoint between two fixes of near times."""
    poses = np.column_stack([fixes.xy_m, np.zeros(fixes.t_s.size)])
    xy_m = compose(world_from_map, poses)[:, :2]
    if not is_sparse(truth):
        inside = (fixes.t_s >= truth.t_s[0]) & (fixes.t_s <= truth.t_s[-1])
        true = interpolate_poses(truth.t_s, truth.world_from_body, fixes.t_s[inside])[:, :2]
        return fixes.status[inside], np.linalg.norm(xy_m[inside] - true, axis=1)
    if fixes.t_s.size < 2:
        return np.empty(0, int), np.empty(0)
    after = np.clip(np.searchsorted(fixes.t_s, truth.t_s), 1, fixes.t_s.size - 1)
    gap_s = fixes.t_s[after] - fixes.t_s[after - 1]
    share = (truth.t_s - fixes.t_s[after - 1]) / gap_s
    near = (share >= 0) & (share <= 1) & (gap_s <= FIX_GAP_S)
    between = xy_m[after - 1] + share[:, None] * (xy_m[after] - xy_m[after - 1])
    worse = np.maximum(fixes.status[after - 1], fixes.status[after])
    return worse[near], np.linalg.norm(between - truth.world_from_body[:, :2], axis=1)[near]
