"""Checkpoints: places that the walker named close loops and name the map, taps lay it on a plan.

Points of interest that walks named go into the map that those walks became."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from elfslam.base.arrays import F64, I64, Bool
from elfslam.base.geometry import between, compose
from elfslam.base.parameters import parameter
from elfslam.base.values import (
    NO_CLOSURES,
    Checkpoints,
    Closures,
    Odometry,
    PointKind,
    PointOfInterest,
    Trajectory,
)

ANY_HEADING_RAD = 6.0
"""Whoever stands at a door may face anywhere."""
SURE = 1.0
"""The similarity of a place to itself."""
ANYWHERE = np.array([1e3, 1e3, np.pi])
"""Sigmas (m, m, rad) of where the plan is, seen from the first footstep: nobody knows."""
LEAST_APART_M = 2.0
"""Two taps nearer to each other say no heading."""
BEYOND_CHANCE = 0.99
MOST_PAIRED = 40
"""So many taps are tried two by two."""
CLEARLY_OFF, LEAST_OFF_M = 3.0, 1.0
"""A tap is a slip at first where it is off by so many times what taps are, and that is so much."""


@dataclass(frozen=True)
class CheckpointParameters:
    """What a tap on "I am here" says."""

    sigma_m: float = parameter(
        0.4, "m", "how far from a named place its walker stands, per axis", 0.01, 100.0
    )
    slack_s: float = parameter(
        2.0, "s", "a tap this long before or after all footsteps still counts", 0.0, 600.0
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
    return _known_places(pairs[:, 0], pairs[:, 1], np.zeros((len(pairs), 3)), parameters)


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


@dataclass(frozen=True, eq=False)
class OnPlan:
    """A walk led by one more pose, the middle of the taps, and a closure from there to each tap.

    That pose is headed as the plan is, and near: a plan's origin may lie a country away, and the
    walk would turn about it. Those `believed` (k) at first are no slips of the finger.
    """

    nodes: Odometry
    closures: Closures
    believed: Bool


def on_plan(
    checkpoints: Checkpoints | None, nodes: Odometry, parameters: CheckpointParameters
) -> OnPlan | None:
    """The walk as seen from the plan that its walker tapped on; None with fewer than two places.

    A pose graph of it has the plan's frame, and bends to what was tapped.
    """
    at, xy_m = _taps(checkpoints, nodes.t_s, parameters)
    found = _laid(nodes.world_from_body[at, :2], xy_m)
    if found is None:
        return None
    frame, off_m = found
    laid = compose(frame, nodes.world_from_body)
    middle = np.append(np.median(xy_m, axis=0), 0.0)
    led = replace(
        nodes,
        t_s=np.concatenate([[nodes.t_s[0] - 1.0], nodes.t_s]),
        world_from_body=np.vstack([middle, laid]),
        step_sigma=np.vstack([ANYWHERE, nodes.step_sigma]),
        # The plan knows how long things are.
        scale_sigma=0.0,
    )
    from_middle = np.column_stack([xy_m - middle[:2], laid[at, 2]])
    taps = _known_places(np.zeros_like(at), at + 1, from_middle, parameters)
    return OnPlan(led, taps, off_m <= CLEARLY_OFF * max(np.median(off_m), LEAST_OFF_M))


def tapped_closures(
    checkpoints: Checkpoints | None, trajectory: Trajectory, parameters: CheckpointParameters
) -> Closures:
    """Closures from a plan's origin to the taps that a map on that plan agrees with.

    None where those are at fewer than two places: the map does not lie on the plan.
    """
    at, xy_m = _taps(checkpoints, trajectory.t_s, parameters)
    off_m = np.linalg.norm(trajectory.world_from_body[at, :2] - xy_m, axis=1)
    agreeing = off_m <= parameters.sigma_m * np.sqrt(chi2.ppf(BEYOND_CHANCE, 2))
    if _width_m(xy_m[agreeing]) < LEAST_APART_M:
        return NO_CLOSURES
    at = at[agreeing]
    from_plan = np.column_stack([xy_m[agreeing], trajectory.world_from_body[at, 2]])
    return _known_places(np.zeros_like(at), at, from_plan, parameters)


def lies_on_plan(
    checkpoints: Checkpoints | None, trajectory: Trajectory, parameters: CheckpointParameters
) -> bool:
    """Whether a map has its walker where they tapped, at two places or more."""
    return len(tapped_closures(checkpoints, trajectory, parameters).i) > 0


def _known_places(i: I64, j: I64, i_from_j: F64, parameters: CheckpointParameters) -> Closures:
    """Closures made by hand: positions are known, headings are not."""
    covariance = np.diag(np.square([parameters.sigma_m, parameters.sigma_m, ANY_HEADING_RAD]))
    count = len(i)
    return Closures(i, j, np.full(count, SURE), i_from_j, np.tile(covariance, (count, 1, 1)))


def _taps(
    checkpoints: Checkpoints | None, footstep_t_s: F64, parameters: CheckpointParameters
) -> tuple[I64, F64]:
    """The footsteps (k) at which places were tapped on a plan, and where those are (k, 2)."""
    if checkpoints is None or checkpoints.xy_m is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 2))
    tapped = np.isfinite(checkpoints.xy_m[:, 0]) & _within(checkpoints, footstep_t_s, parameters)
    return _nearest(checkpoints, footstep_t_s)[tapped], checkpoints.xy_m[tapped]


def _width_m(xy_m: F64) -> float:
    """How far apart the places (k, 2) lie that are farthest apart; 0 of none."""
    return float(np.linalg.norm(xy_m[:, None] - xy_m, axis=2).max(initial=0.0))


def _laid(walked_m: F64, xy_m: F64) -> tuple[F64, F64] | None:
    """The walk's frame on the plan, and how far off each tap (k) then is; None where nobody knows.

    Of the frames that two taps give, that of the least absolute deviations: a slip of the finger
    has no say.
    """
    walked, tapped = walked_m @ [1, 1j], xy_m @ [1, 1j]
    few = np.unique(np.linspace(0, len(tapped) - 1, MOST_PAIRED).astype(int))[: len(tapped)]
    i, j = (few[side] for side in np.triu_indices(len(few), 1))
    own, other = walked[j] - walked[i], tapped[j] - tapped[i]
    apart = np.minimum(np.abs(own), np.abs(other)) >= LEAST_APART_M
    if not apart.any():
        return None
    i, j, turn = i[apart], j[apart], np.exp(1j * np.angle(other[apart] / own[apart]))
    shift = (tapped[i] + tapped[j] - turn * (walked[i] + walked[j])) / 2
    off_m = np.abs(turn[:, None] * walked + shift[:, None] - tapped)
    best = np.argmin(off_m.sum(axis=1))
    frame = np.array([shift[best].real, shift[best].imag, np.angle(turn[best])])
    return frame, off_m[best]


def _visits(
    checkpoints: Checkpoints, footstep_t_s: F64, parameters: CheckpointParameters
) -> dict[str, list[int]]:
    """The footsteps at which each place was visited, in order."""
    visits: dict[str, list[int]] = {}
    nearest = _nearest(checkpoints, footstep_t_s)
    for k in np.flatnonzero(_within(checkpoints, footstep_t_s, parameters)):
        visits.setdefault(checkpoints.names[k], []).append(int(nearest[k]))
    return visits


def _within(checkpoints: Checkpoints, footstep_t_s: F64, parameters: CheckpointParameters) -> Bool:
    """Which taps (k) were made while somebody walked."""
    early_s = footstep_t_s[0] - parameters.slack_s
    late_s = footstep_t_s[-1] + parameters.slack_s
    return np.asarray((early_s <= checkpoints.t_s) & (checkpoints.t_s <= late_s))


def _nearest(checkpoints: Checkpoints, footstep_t_s: F64) -> I64:
    """The footstep nearest in time to each tap (k)."""
    halfway_s = (footstep_t_s[:-1] + footstep_t_s[1:]) / 2
    return np.searchsorted(halfway_s, checkpoints.t_s)


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
