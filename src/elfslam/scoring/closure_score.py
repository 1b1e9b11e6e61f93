"""How good the closures are: precision, recall, and which of them are right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, Bool
from elfslam.base.values import Closures, Truth


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
