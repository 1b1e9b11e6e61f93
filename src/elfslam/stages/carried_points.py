"""Points of interest of walks in the frame of the map that those walks became."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.geometry import between, compose
from elfslam.base.values import PointOfInterest, Trajectory

SAME_PLACE_M = 3.0
"""Two walkers stand this far apart at most when they name one place alike."""


def carried(
    points: Sequence[PointOfInterest], before: Trajectory, after: Trajectory
) -> list[PointOfInterest]:
    """The points of a walk that was moved and bent: each stays beside its nearest footstep."""
    return [_carried(each, before.world_from_body, after.world_from_body) for each in points]


def gathered(points: Sequence[PointOfInterest]) -> list[PointOfInterest]:
    """One point for all of the same name and kind that are near each other: their middle."""
    groups: list[list[PointOfInterest]] = []
    for each in points:
        for group in groups:
            if _same(group[0], each):
                group.append(each)
                break
        else:
            groups.append([each])
    return [
        replace(
            group[0],
            x_m=float(np.mean([each.x_m for each in group])),
            y_m=float(np.mean([each.y_m for each in group])),
        )
        for group in groups
    ]


def _carried(point: PointOfInterest, before: F64, after: F64) -> PointOfInterest:
    where = np.array([point.x_m, point.y_m, 0.0])
    nearest = np.argmin(np.linalg.norm(before[:, :2] - where[:2], axis=1))
    x_m, y_m, _ = compose(after[nearest], between(before[nearest], where)).tolist()
    return replace(point, x_m=x_m, y_m=y_m)


def _same(one: PointOfInterest, other: PointOfInterest) -> bool:
    alike = one.name.casefold() == other.name.casefold() and one.kind is other.kind
    return alike and np.hypot(one.x_m - other.x_m, one.y_m - other.y_m) <= SAME_PLACE_M
