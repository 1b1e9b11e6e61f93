"""How far an estimate is from the truth: of walks, of fixes with what was refused, of closures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose, interpolate_poses, path_length_m
from elfslam.base.values import Closures, Fixes, FixStatus, Run, Truth
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


@dataclass(frozen=True, eq=False)
class ClosureScore:
    """Closures against the truth.

    `distance_m` (k) is the true distance between the ends of each closure, NaN outside the
    truth's span; `count` leaves those out. Shares are NaN where there is nothing to share.
    """

    precision: float
    recall: float
    count: int
    median_distance_m: float
    distance_m: F64
    right: Bool


def score_closures(
    closures: Closures,
    node_t_s: F64,
    truth: Truth,
    *,
    radius_m: float = 1.0,
    revisit_s: float = 10.0,
) -> ClosureScore:
    """Precision and recall; a closure is right when its two ends truly lie within `radius_m`.

    Recall is the share of returning nodes at which a right closure ends. A node returns when an
    earlier one, `revisit_s` or more before, truly lies within `radius_m`. One closure per return
    is enough, so five rounds do not ask for all pairs of rounds. Between waypoints the truth is
    taken as a straight walk at even speed, so give a larger radius there.
    """
    xy_m = _true_positions(node_t_s, truth)
    distance = np.linalg.norm(xy_m[closures.i] - xy_m[closures.j], axis=1)
    known, right = np.isfinite(distance), distance <= radius_m
    returning = _returning(node_t_s, xy_m, radius_m, revisit_s)
    found = np.zeros(node_t_s.size, dtype=bool)
    found[closures.j[right]] = True
    return ClosureScore(
        precision=_share(right[known]),
        recall=_share(found[returning]),
        count=int(known.sum()),
        median_distance_m=float(np.median(distance[known])) if known.any() else float("nan"),
        distance_m=distance,
        right=right,
    )


def _true_positions(t_s: F64, truth: Truth) -> F64:
    """True positions (n, 2) at times (n,), NaN outside the truth's span."""
    columns = [
        np.interp(t_s, truth.t_s, truth.world_from_body[:, axis], left=np.nan, right=np.nan)
        for axis in (0, 1)
    ]
    return np.column_stack(columns)


def _returning(t_s: F64, xy_m: F64, radius_m: float, revisit_s: float) -> Bool:
    earlier = np.searchsorted(t_s, t_s - revisit_s, side="right")
    return np.array(
        [
            bool((np.linalg.norm(xy_m[:count] - here, axis=1) <= radius_m).any())
            for count, here in zip(earlier, xy_m, strict=True)
        ],
        dtype=bool,
    )


def _share(flags: Bool) -> float:
    return float(flags.mean()) if flags.size else float("nan")


RESAMPLES = 2000
CONFIDENCE = 0.95


def interval(
    values_per_walk: Sequence[F64],
    statistic: Callable[[F64], float],
    generator: np.random.Generator,
) -> tuple[float, float]:
    """95 % percentile interval of a statistic of all values, walks drawn with replacement.

    `values_per_walk` holds one array per walk or seed (Efron and Tibshirani 1993, chapter 13).
    Raises InputError where no walk has a value.
    """
    walks = [np.asarray(values, float) for values in values_per_walk if np.size(values)]
    if not walks:
        raise InputError("bootstrap: got no values, wanted at least one walk; check coverage")
    drawn = generator.integers(len(walks), size=(RESAMPLES, len(walks)))
    statistics = [statistic(np.concatenate([walks[k] for k in row])) for row in drawn]
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(statistics, [tail, 1 - tail])
    return float(low), float(high)


ScoreRow = dict[str, object]


def methods(run: Run) -> dict[str, tuple[F64, F64]]:
    """Times and poses of what a run can be judged by, by name."""
    return {
        "dead reckoning": (run.odometry.t_s, run.odometry.world_from_body),
        "SLAM": (run.trajectory.t_s, run.trajectory.world_from_body),
    }


def run_scores(run: Run, truth: Truth) -> list[ScoreRow]:
    """A row per method and alignment: the fields of `ErrorSummary`, and the end error's share.

    The share of the path (not per cent) belongs to the anchored rows; it is None in the others.
    """
    rows: list[ScoreRow] = []
    for method, (t_s, poses) in methods(run).items():
        for alignment in Alignment:
            errors = position_errors(t_s, poses, truth, alignment)
            anchored = alignment is Alignment.ANCHORED
            end = end_error_share(t_s, poses, truth) if anchored else None
            row = {"method": method, "alignment": alignment.value, **asdict(summarise(errors))}
            rows.append(_plain({**row, "end_error_share": end}))
    return rows


def closure_scores(run: Run, truth: Truth, *, radius_m: float = 1.0) -> list[ScoreRow]:
    """Precision, recall, count and median true distance of the closures, found and kept."""
    kept = run.trajectory.closure_weights > 0.5
    stages = {"found": np.ones_like(kept), "kept": kept}
    return [
        _closure_row(name, run.closures.chosen(rows), run, truth, radius_m)
        for name, rows in stages.items()
    ]


def _closure_row(
    name: str, closures: Closures, run: Run, truth: Truth, radius_m: float
) -> ScoreRow:
    score = score_closures(closures, run.trajectory.t_s, truth, radius_m=radius_m)
    return _plain(
        {
            "closures": name,
            "radius_m": radius_m,
            "precision": score.precision,
            "recall": score.recall,
            "count": score.count,
            "median_distance_m": score.median_distance_m,
        }
    )


def fix_scores(fixes: Fixes, truth: Truth, world_from_map: F64) -> list[ScoreRow]:
    """A row for the OK fixes and one for the ambiguous, each beside the counts by status."""
    summary = fix_errors(fixes, truth, world_from_map)
    shared = {"coverage": summary.coverage, "by_status": dict(summary.by_status)}
    parts = {"OK": summary.ok, "AMBIGUOUS": summary.ambiguous}
    return [_plain({"status": name, **asdict(part), **shared}) for name, part in parts.items()]


def _plain(row: ScoreRow) -> ScoreRow:
    """NaN is no JSON: what does not exist is None."""
    return {
        name: None if isinstance(value, float) and math.isnan(value) else value
        for name, value in row.items()
    }
