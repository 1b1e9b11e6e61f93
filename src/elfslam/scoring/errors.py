"""How far an estimate is from the truth: of walks, of fixes with what was refused, of closures.

A phone alone knows neither where north is nor where it started, and loop closures cannot see
the length of a step. So an error is stated three times, each time forgiving more: anchored,
aligned, aligned with scale.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum

import numpy as np

from elfslam.base.arrays import F64, I64, Bool, Value, array
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose, interpolate_poses, inverse, path_length_m, wrap_angle
from elfslam.base.values import Closures, Fixes, FixStatus, Run, Trajectory, Truth

STANDING_S = 2.0
"""Waypoints this long before the first or after the last node count: the walker stood there."""

ANCHOR_TRAVEL_M = 3.0
"""Where the truth has no heading, the direction of travel over so many metres stands in."""


class Alignment(StrEnum):
    """What is forgiven before the error is measured."""

    ANCHORED = "anchored"
    ALIGNED = "aligned"
    ALIGNED_WITH_SCALE = "aligned with scale"


@dataclass(frozen=True, eq=False)
class SimilarityTransform(Value):
    """Where the map lies in the world: scale first, then the pose `world_from_map` (3)."""

    world_from_map: F64 = array(3)
    scale: float = 1.0


AS_DECLARED = SimilarityTransform(np.zeros(3))
"""A map whose start was declared lies in the world already."""


@dataclass(frozen=True, eq=False)
class Matched(Value):
    """Estimate and truth at the same times."""

    t_s: F64 = array("n", increasing=True)
    estimate: F64 = array("n", 3)
    truth: F64 = array("n", 3, finite=False)


def is_sparse(truth: Truth) -> bool:
    """Whether the truth is waypoints: positions without heading, exact only where they are."""
    return bool(np.isnan(truth.world_from_body[:, 2]).any())


def match(t_s: F64, poses: F64, truth: Truth) -> Matched:
    """Estimate and truth side by side: at the estimate's times, or at the waypoints.

    Dense truth is interpolated to the estimate's times (n,) inside its span; for waypoints it
    is the estimate (n, 3) that is interpolated. Raises InputError where the two do not overlap.
    """
    if is_sparse(truth):
        inside = _inside(truth.t_s, t_s[0] - STANDING_S, t_s[-1] + STANDING_S)
        at_s, true = truth.t_s[inside], truth.world_from_body[inside]
        estimate = interpolate_poses(t_s, poses, at_s)
    else:
        inside = _inside(t_s, truth.t_s[0], truth.t_s[-1])
        at_s, estimate = t_s[inside], poses[inside]
        true = interpolate_poses(truth.t_s, truth.world_from_body, at_s)
    if at_s.size < 2:
        raise InputError(
            f"the estimate ({t_s[0]:.1f} to {t_s[-1]:.1f} s) and the truth ({truth.t_s[0]:.1f} to "
            f"{truth.t_s[-1]:.1f} s) share {at_s.size} times, wanted 2; are they one walk?"
        )
    return Matched(at_s, estimate, true)


def placement(matched: Matched, alignment: Alignment) -> SimilarityTransform:
    """Where the estimate lies in the world.

    ANCHORED puts its first pose on the true one, position and heading. ALIGNED is the rigid
    least-squares fit, ALIGNED_WITH_SCALE the similarity one (Umeyama, PAMI 1991).
    """
    if alignment is Alignment.ANCHORED:
        start = _first_pose(matched, matched.truth)
        return SimilarityTransform(compose(start, inverse(_first_pose(matched, matched.estimate))))
    return _least_squares(matched, with_scale=alignment is Alignment.ALIGNED_WITH_SCALE)


def place(poses: F64, where: SimilarityTransform) -> F64:
    """Poses (n, 3) of the map, in the world."""
    scaled = poses * np.array([where.scale, where.scale, 1.0])
    return compose(where.world_from_map, scaled)


def alignment_of(trajectory: Trajectory, truth: Truth) -> F64:
    """`world_from_map` (3): the rigid fit of the mapping walk onto its truth.

    Fixes found in that map are scored after this move (see `errors.fix_errors`).
    """
    matched = match(trajectory.t_s, trajectory.world_from_body, truth)
    return placement(matched, Alignment.ALIGNED).world_from_map


def _inside(t_s: F64, low_s: float, high_s: float) -> Bool:
    return np.asarray((t_s >= low_s) & (t_s <= high_s))


def _first_pose(matched: Matched, poses: F64) -> F64:
    """The anchor: its heading is the direction of travel where the truth knows no heading.

    The direction leads from the first waypoint to the first one ANCHOR_TRAVEL_M away (or to
    the farthest of all), and for the estimate to where it was at that same time.
    """
    if not np.isnan(matched.truth[0, 2]):
        return np.asarray(poses[0])
    away = np.linalg.norm(matched.truth[:, :2] - matched.truth[0, :2], axis=1)
    far = away >= ANCHOR_TRAVEL_M
    row = int(np.argmax(far) if far.any() else np.argmax(away))
    move = poses[row, :2] - poses[0, :2]
    return np.array([*poses[0, :2], np.arctan2(move[1], move[0])])


def _least_squares(matched: Matched, *, with_scale: bool) -> SimilarityTransform:
    """Complex numbers make the planar case a single product: angle turns, modulus scales."""
    estimate = matched.estimate[:, 0] + 1j * matched.estimate[:, 1]
    truth = matched.truth[:, 0] + 1j * matched.truth[:, 1]
    mean_normalised = estimate - estimate.mean()
    covariance = np.vdot(mean_normalised, truth - truth.mean())
    spread = np.vdot(mean_normalised, mean_normalised).real
    scale = float(abs(covariance) / spread) if with_scale and spread > 0 else 1.0
    angle = float(np.angle(covariance))
    origin = truth.mean() - scale * np.exp(1j * angle) * estimate.mean()
    return SimilarityTransform(np.array([origin.real, origin.imag, wrap_angle(angle)]), scale)


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


RADIUS_M = 1.0
"""The ends of a right closure lie this near each other."""


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
    radius_m: float = RADIUS_M,
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


def closure_scores(run: Run, truth: Truth) -> list[ScoreRow]:
    """Precision, recall, count and median true distance of the closures, found and kept."""
    kept = run.trajectory.closure_weights > 0.5
    stages = {"found": np.ones_like(kept), "kept": kept}
    scores = {
        name: score_closures(run.closures.chosen(rows), run.trajectory.t_s, truth)
        for name, rows in stages.items()
    }
    return [_closure_row(name, score) for name, score in scores.items()]


def _closure_row(name: str, score: ClosureScore) -> ScoreRow:
    return _plain(
        {
            "closures": name,
            "radius_m": RADIUS_M,
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
