"""Putting an estimated walk onto the true one: anchored, aligned, aligned with scale.

A phone alone knows neither where north is nor where it started, and loop closures cannot see
the length of a step. So an error is stated three times, each time forgiving more.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from elfslam.base.arrays import F64, Bool, Value, array
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose, interpolate_poses, inverse, wrap_angle
from elfslam.base.values import Trajectory, Truth

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
