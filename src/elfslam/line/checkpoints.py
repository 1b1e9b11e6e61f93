"""Checkpoints: places that the walker gave a name close loops by hand, and name the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.base.parameters import parameter
from elfslam.base.points_of_interest import PointKind, PointOfInterest
from elfslam.base.values import NO_CLOSURES, Checkpoints, Closures, Odometry, Trajectory

ANY_HEADING_RAD = 6.0
"""Whoever stands at a door may face anywhere."""
SURE = 1.0
"""The likeness of a place to itself."""


@dataclass(frozen=True)
class CheckpointParameters:
    """What a tap on "I am here" says."""

    sigma_m: float = parameter(
        0.4, "m", "how far from a named place its walker stands, per axis", low=0.01, high=100.0
    )
    slack_s: float = parameter(
        2.0, "s", "a tap this long before or after all footsteps still counts", low=0.0, high=600.0
    )


def closures_at(
    checkpoints: Checkpoints | None, nodes: Odometry, parameters: CheckpointParameters
) -> Closures:
    """A closure from the first visit of each named place to every later one.

    They know the position and not the heading.
    """
    if checkpoints is None:
        return NO_CLOSURES
    pairs = np.array(
        [
            (first, later)
            for first, *others in _visits(checkpoints, nodes.t_s, parameters).values()
            for later in others
            if later > first
        ],
        dtype=np.int64,
    ).reshape(-1, 2)
    covariance = np.diag(np.square([parameters.sigma_m, parameters.sigma_m, ANY_HEADING_RAD]))
    count = len(pairs)
    return Closures(
        pairs[:, 0],
        pairs[:, 1],
        np.full(count, SURE),
        np.zeros((count, 3)),
        np.tile(covariance, (count, 1, 1)),
    )


def places_visited(
    checkpoints: Checkpoints | None, trajectory: Trajectory, parameters: CheckpointParameters
) -> tuple[PointOfInterest, ...]:
    """Each named place as a point of interest: the middle of where its visits were mapped."""
    if checkpoints is None:
        return ()
    xy_m = trajectory.world_from_body[:, :2]
    return tuple(
        PointOfInterest(name, PointKind.OTHER, *xy_m[visits].mean(axis=0).tolist())
        for name, visits in _visits(checkpoints, trajectory.t_s, parameters).items()
    )


def _visits(
    checkpoints: Checkpoints, footstep_t_s: F64, parameters: CheckpointParameters
) -> dict[str, list[int]]:
    """The footsteps at which each place was visited, in order."""
    visits: dict[str, list[int]] = {}
    first_s, last_s = footstep_t_s[0] - parameters.slack_s, footstep_t_s[-1] + parameters.slack_s
    for t_s, node, name in zip(
        checkpoints.t_s, _nearest(checkpoints, footstep_t_s), checkpoints.names, strict=True
    ):
        if first_s <= t_s <= last_s:
            visits.setdefault(name, []).append(int(node))
    return visits


def _nearest(checkpoints: Checkpoints, footstep_t_s: F64) -> I64:
    """The footstep nearest in time to each tap (k)."""
    halfway_s = (footstep_t_s[:-1] + footstep_t_s[1:]) / 2
    return np.searchsorted(halfway_s, checkpoints.t_s)
