"""Fixes from places that are more or less likely: softmax over scores, mean near the best."""

from typing import Protocol

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.values import FixStatus

Fix = tuple[F64, float, F64, float, int]
"""Position (2), heading, covariance (2, 2), score and status."""
NOWHERE = (np.full(2, np.nan), np.nan, np.full((2, 2), np.nan))


class FixRule(Protocol):
    """When scores give a fix; the parameters of a stage have these."""

    @property
    def unknown_below(self) -> float: ...
    @property
    def temperature(self) -> float: ...
    @property
    def near_m(self) -> float: ...
    @property
    def ambiguous_below(self) -> float: ...
    @property
    def sigma_floor_m(self) -> float: ...


def scored_fix(scores: F32, xy_m: F64, heading_rad: F64, covariances_m2: F64, rule: FixRule) -> Fix:
    """The fix among places (k) by their scores (k); UNKNOWN_PLACE where even the best is low.

    The mean near the best place, or of all where too little weight is there (AMBIGUOUS); the
    covariance is their spread, that of the best place and the floor.
    """
    best = int(np.argmax(scores))
    if scores[best] < rule.unknown_below:
        return *NOWHERE, float(scores[best]), int(FixStatus.UNKNOWN_PLACE)
    weight = np.exp((scores - scores[best]).astype(np.float64) / rule.temperature)
    near = np.linalg.norm(xy_m - xy_m[best], axis=1) <= rule.near_m
    clear = weight[near].sum() >= rule.ambiguous_below * weight.sum()
    used = near if clear else np.ones_like(near)
    share = weight[used] / weight[used].sum()
    xy, heading, spread_m2 = moments(share, xy_m[used], heading_rad[used])
    covariance = spread_m2 + covariances_m2[best] + rule.sigma_floor_m**2 * np.eye(2)
    status = FixStatus.OK if clear else FixStatus.AMBIGUOUS
    return xy, heading, covariance, float(scores[best]), int(status)


def moments(share: F64, xy_m: F64, heading_rad: F64) -> tuple[F64, float, F64]:
    """Mean position (2), mean heading and covariance (2, 2) of places by their shares (sum 1)."""
    xy = share @ xy_m
    offset = xy_m - xy
    heading = float(np.angle(share @ np.exp(1j * heading_rad)))
    return xy, heading, np.einsum("k,ki,kj->ij", share, offset, offset)
